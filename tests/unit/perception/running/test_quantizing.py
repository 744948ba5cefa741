"""Quantisation: a network in 8 bits whose ranges are those of given pictures."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.perception.documents.function import FunctionDocument, parse_function
from valerie.perception.running.opening import open_engine, open_function
from valerie.perception.running.quantizing import quantize
from valerie.perception.running.small_network import small_onnx
from valerie.perception.shipped import file_document, function_path

ENGINES = pytest.mark.parametrize("engine", ["openvino", "onnxruntime"])


def greys(*levels: int) -> NDArray[np.uint8]:
    """A picture with a column of 8 pixels for each grey level."""
    return np.broadcast_to(np.repeat(np.array(levels, np.uint8), 8)[None, :, None], (16, 8 * len(levels), 3)).copy()


def quantized(
    document: FunctionDocument, path: Path, *pictures: NDArray[np.uint8], engine: str = "openvino"
) -> tuple[FunctionDocument, Path]:
    """Quantise a function on pictures; return document and file."""
    made, data = quantize(document, path, pictures)
    file = path.with_name("quantized.onnx")
    file.write_bytes(data)
    return made.model_copy(update={"engine": engine}), file


def logits(document: FunctionDocument, path: Path, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return (C, h, w) logits."""
    engine = open_engine(document, path)
    try:
        answer: NDArray[np.float32] = engine.answer(picture)
        return answer
    finally:
        engine.close()


def largest_error(values: float, answers: float) -> float:
    """The error of three channels of weight 1, each rounded to its nearest of 255 steps, and of the step of their sum.

    Args:
        values, answers: ranges of the channels and of the sum, including 0.
    """
    return (3 * 0.5 * values + answers) / 255


def span(values: NDArray[np.floating]) -> float:
    """The range of values, including 0."""
    return float(max(values.max(), 0.0) - min(values.min(), 0.0))


@ENGINES
def test_the_logits_are_those_of_the_network_to_the_step_of_8_bits(tmp_path: Path, engine: str) -> None:
    function = small_onnx(tmp_path, engine="onnxruntime")
    picture = greys(*range(0, 256, 15))
    answer = logits(*quantized(*function, picture, engine=engine), picture)
    assert np.abs(answer - logits(*function, picture)).max() <= largest_error(1.0, 3.0)


@ENGINES
def test_values_beyond_those_of_the_pictures_count_as_the_largest_of_them(tmp_path: Path, engine: str) -> None:
    function = small_onnx(tmp_path, engine="onnxruntime")
    document, path = quantized(*function, greys(0, 102), engine=engine)
    answer = logits(document, path, greys(0, 102, 255))
    middle, bright = answer[0, 8, 12], answer[0, 8, 20]
    tolerance = largest_error(102 / 255, 3 * 102 / 255)
    assert bright == pytest.approx(middle, abs=tolerance)
    assert middle == pytest.approx(3 * 102 / 255, abs=tolerance)


@pytest.mark.parametrize("given", [{"channel_order": "bgr"}, {"mean": [0.2, 0.4, 0.6], "std": [0.1, 0.2, 0.3]}])
def test_ranges_are_of_the_pictures_as_the_network_sees_them(tmp_path: Path, given: dict[str, object]) -> None:
    document, path = small_onnx(tmp_path, engine="onnxruntime", input=given)
    picture = np.stack([greys(0, 100)[..., 0], greys(50, 10)[..., 0], greys(200, 255)[..., 0]], axis=2)
    expected = logits(document, path, picture)
    answer = logits(*quantized(document, path, picture), picture)
    values = (picture / 255 - document.input.mean) / document.input.std
    assert np.abs(answer - expected).max() <= largest_error(span(values), span(expected))


@ENGINES
def test_int8_is_read_back_and_in_the_numeric_class(tmp_path: Path, engine: str) -> None:
    document, path = quantized(*small_onnx(tmp_path), greys(0, 255), engine=engine)
    function = open_function(document, path)
    assert function.card.precision == "int8"
    assert "-cpu-int8-" in function.numeric_class
    function.close()


def test_a_shipped_network_keeps_nearly_all_labels(tmp_path: Path) -> None:
    shipped = function_path("semantic-fpn-small")
    path = tmp_path / "network.safetensors"
    path.write_bytes(shipped.read_bytes())
    random = np.random.default_rng(3)
    picture = np.kron(random.integers(0, 256, (4, 6, 3), np.uint8), np.ones((32, 32, 1), np.uint8))
    document = file_document("f", path)
    before = open_function(document, path)
    after = open_function(*quantized(document, path, picture))
    # A requirement. Random blocks have more pixels between classes than a street.
    assert (after.predict(picture) == before.predict(picture)).mean() > 0.95
    assert after.card.judged_by == before.card.judged_by


@pytest.mark.parametrize("precision", ["fp32", "int8"])
def test_a_document_states_whether_its_network_is_quantised(tmp_path: Path, precision: str) -> None:
    other = "int8" if precision == "fp32" else "fp32"
    document, path = small_onnx(tmp_path, engine="onnxruntime", precision=other)
    with pytest.raises(InvalidInput, match=f"precision: .*quantised.*got {precision}"):
        open_function(document.model_copy(update={"precision": precision}), path)


def test_a_quantised_function_is_not_quantised_again(tmp_path: Path) -> None:
    document, path = small_onnx(tmp_path, precision="int8")
    with pytest.raises(InvalidInput, match="precision: the function is quantised already"):
        quantize(document, path, [greys(0)])


def test_a_function_elsewhere_is_not_quantised(tmp_path: Path) -> None:
    document = parse_function({"name": "far", "kind": "http", "options": {"url": "http://127.0.0.1:9/p"}})
    with pytest.raises(InvalidInput, match="kind: functions of this kind cannot be quantised; got http"):
        quantize(document, tmp_path, [greys(0)])


def test_a_network_of_a_fixed_size_is_not_quantised_by_pictures_of_another(write_onnx) -> None:
    document, path = write_onnx({"engine": "onnxruntime"}, size=(32, 32))
    with pytest.raises(InvalidInput, match="payload: the network cannot be quantised"):
        quantize(document, path, [greys(0)])
