"""Both engines that run ONNX, with a network that needs no training: what goes in must come out."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.errors import InvalidInput, MissingDependency
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.engines.graph import whole_graph
from valerie.perception.running.opening import open_function
from valerie.perception.shipped import file_document
from valerie.testing.perception import PerceptionContract

ENGINES = pytest.mark.parametrize("engine", ["openvino", "onnxruntime"])


def blocks(height: int, width: int, *, side: int = 1, classes: int = 19) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A picture of squares and its labels; red is ten times the label, as the network of these tests reads it."""
    rows, columns = np.mgrid[0:height, 0:width]
    labels = ((rows // side * 7 + columns // side * 3) % classes).astype(np.uint8)
    return np.stack([labels * 10, np.full_like(labels, 3), 250 - labels], axis=2), labels


def predicted(
    write_onnx: Any, picture: NDArray[np.uint8], document: dict[str, Any], **network: Any
) -> NDArray[np.uint8]:
    function = open_function(*write_onnx(document, **network))
    try:
        return function.predict(picture)
    finally:
        function.close()


@pytest.fixture(scope="module")
def opened(tmp_path_factory) -> Iterator[dict[str, PerceptionFunction]]:
    path = tmp_path_factory.mktemp("payload") / "small.safetensors"
    path.write_bytes(random_function_file("semantic-fpn-small"))
    document = file_document("under-test", path)
    functions = {
        engine: open_function(document.model_copy(update={"engine": engine}), path)
        for engine in ("openvino", "onnxruntime")
    }
    yield functions
    for function in functions.values():
        function.close()


class _Contract(PerceptionContract):
    engine: str

    @pytest.fixture
    def function(self, opened: dict[str, PerceptionFunction]) -> PerceptionFunction:
        return opened[self.engine]


class TestOpenVino(_Contract):
    engine = "openvino"


class TestOnnxRuntime(_Contract):
    engine = "onnxruntime"


def random_function_file(architecture: str) -> bytes:
    import torch

    from valerie.perception.importing.function_file import function_file_bytes
    from valerie.perception.networks.architectures import build_network

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(2)
        state = build_network(architecture).state_dict()
    tensors = {name: value.numpy() for name, value in state.items() if not name.endswith("num_batches_tracked")}
    return function_file_bytes(
        tensors, architecture=architecture, mean=(0.4, 0.45, 0.5), std=(0.2, 0.25, 0.3), provenance={}
    )


@ENGINES
@pytest.mark.parametrize(
    "taken",
    [
        {},
        {"multiple_of": 32},
        {"size": [96, 64], "mode": "tile", "overlap": 10},
        {"size": [160, 96]},
    ],
)
def test_a_known_label_map_comes_back_exactly(write_onnx, engine: str, taken: dict[str, Any]) -> None:
    picture, labels = blocks(90, 150)
    classes_of_pixels = predicted(write_onnx, picture, {"engine": engine, "input": {"scale": 1, **taken}})
    np.testing.assert_array_equal(classes_of_pixels, labels)


@ENGINES
@pytest.mark.parametrize("rank", [3, 4])
def test_a_network_that_answers_labels_is_resampled_to_the_nearest(write_onnx, engine: str, rank: int) -> None:
    picture, labels = blocks(60, 90, side=3)
    document = {
        "engine": engine,
        "input": {"scale": 1, "size": [30, 20], "mode": "resize"},
        "output": {"kind": "labels"},
    }
    classes_of_pixels = predicted(write_onnx, picture, document, answer="labels", rank=rank)
    np.testing.assert_array_equal(classes_of_pixels, labels)


@ENGINES
def test_logits_of_a_coarser_grid_lie_on_the_pixels_that_caused_them(write_onnx, engine: str) -> None:
    picture, labels = blocks(64, 128, side=32, classes=2)
    classes_of_pixels = predicted(write_onnx, picture, {"engine": engine}, stride=4)
    inside = (np.arange(64) % 32 >= 2) & (np.arange(64) % 32 < 30)
    across = (np.arange(128) % 32 >= 2) & (np.arange(128) % 32 < 30)
    np.testing.assert_array_equal(classes_of_pixels[inside][:, across], labels[inside][:, across])


@ENGINES
def test_upsampling_equals_torchs(write_onnx, engine: str) -> None:
    import torch

    picture = np.random.default_rng(0).integers(0, 190, (48, 80, 3), dtype=np.uint8)
    values = torch.from_numpy(picture[..., :1].copy()).permute(2, 0, 1)[None].double()
    ids = torch.arange(19, dtype=torch.float64).view(1, 19, 1, 1)
    logits = 20 * ids * torch.nn.functional.avg_pool2d(values, 4) - 100 * ids**2
    for aligned in (False, True):
        full = torch.nn.functional.interpolate(logits, size=(48, 80), mode="bilinear", align_corners=aligned)
        expected = full.argmax(1)[0].numpy()
        labels = predicted(write_onnx, picture, {"engine": engine, "output": {"align_corners": aligned}}, stride=4)
        # Where two classes are equal but for rounding, either is right.
        top = full.topk(2, dim=1).values[0]
        clear = ((top[0] - top[1]) > 1e-2).numpy()
        np.testing.assert_array_equal(labels[clear], expected[clear])
        assert clear.mean() > 0.99  # or little would be compared


@ENGINES
def test_channels_last_input_and_output(write_onnx, engine: str) -> None:
    picture, labels = blocks(32, 48)
    document = {"engine": engine, "input": {"scale": 1, "layout": "nhwc"}}
    np.testing.assert_array_equal(predicted(write_onnx, picture, document, layout="nhwc"), labels)


@ENGINES
def test_blue_first(write_onnx, engine: str) -> None:
    picture, labels = blocks(32, 48)
    document = {"engine": engine, "input": {"scale": 1, "channel_order": "bgr"}}
    np.testing.assert_array_equal(predicted(write_onnx, picture[..., ::-1], document), labels)


@ENGINES
def test_normalisation_is_undone_by_its_inverse(write_onnx, engine: str) -> None:
    # x / 255 with mean 0.2 and std 1 / 255 is x − 51: a picture that is 51 brighter gives the labels back.
    picture, labels = blocks(32, 48)
    brighter = picture.copy()
    brighter[..., 0] += 51
    document = {"engine": engine, "input": {"mean": [0.2, 0, 0], "std": [1 / 255] * 3}}
    np.testing.assert_array_equal(predicted(write_onnx, brighter, document), labels)


@ENGINES
def test_a_network_that_takes_bytes_is_given_bytes(write_onnx, engine: str) -> None:
    picture, labels = blocks(32, 48)
    np.testing.assert_array_equal(predicted(write_onnx, picture, {"engine": engine}, kind=2), labels)


@ENGINES
def test_more_classes_than_are_upsampled_at_once(write_onnx, engine: str) -> None:
    names = [f"class {number}" for number in range(70)]
    picture = np.zeros((32, 64, 3), np.uint8)
    # Red holds up to 255, so of 70 classes the first 26 occur: each maps to person or not by its number.
    numbers = np.arange(32 * 64).reshape(32, 64) % 26
    picture[..., 0] = numbers * 10
    document = {"engine": engine, "output": {"classes": names, "class_map": {"class 25": "person", "class 3": "road"}}}
    labels = predicted(write_onnx, picture, document, classes=70)
    np.testing.assert_array_equal(labels, np.select([numbers == 25, numbers == 3], [11, 0], 255))


@ENGINES
def test_person_or_not_with_a_single_channel(write_onnx, engine: str) -> None:
    # One class: its "logit" is 0 · x − 0 = 0 everywhere, so the threshold alone decides.
    picture, _ = blocks(32, 32)
    for threshold, expected in ((-0.5, 11), (0.5, 255)):
        document = {"engine": engine, "output": {"classes": ["person"], "threshold": threshold}}
        assert (predicted(write_onnx, picture, document, classes=1) == expected).all()


@ENGINES
def test_person_or_not_with_two_channels(write_onnx, engine: str) -> None:
    picture, labels = blocks(32, 32, classes=2)
    document = {"engine": engine, "output": {"classes": ["not", "human"], "class_map": {"human": "person"}}}
    classes_of_pixels = predicted(write_onnx, picture, document, classes=2)
    np.testing.assert_array_equal(classes_of_pixels, np.where(labels == 1, 11, 255))


@ENGINES
def test_of_equal_logits_the_first_class_wins(write_onnx, engine: str) -> None:
    # 5 lies between class 0 and class 1: both logits are 0.
    picture = np.full((32, 32, 3), 5, np.uint8)
    assert (predicted(write_onnx, picture, {"engine": engine}) == 0).all()


@ENGINES
def test_labels_beyond_a_byte_are_void(write_onnx, engine: str) -> None:
    document = {"engine": engine, "input": {"scale": 1, "mean": [200, 0, 0], "std": [0.05, 1, 1]}}
    picture = np.zeros((16, 16, 3), np.uint8)
    picture[:8] = 255  # (255 − 200) / 0.05 / 10 = 110, and (0 − 200) / 0.05 / 10 = −400
    labels = predicted(write_onnx, picture, {**document, "output": {"kind": "labels"}}, answer="labels")
    assert set(labels.ravel().tolist()) == {255}


@ENGINES
def test_an_older_operator_set(write_onnx, engine: str) -> None:
    picture, labels = blocks(32, 32)
    np.testing.assert_array_equal(predicted(write_onnx, picture, {"engine": engine}, opset=11), labels)


@pytest.mark.parametrize(
    ("document", "network", "message"),
    [
        ({"output": {"classes": ["person", "road"]}}, {}, "another number of classes"),
        ({}, {"size": (64, 64)}, "takes another input.*1 × 3 × 32 × 32|takes another input"),
        ({"input": {"layout": "nhwc"}}, {}, "input.layout"),
        ({"options": {"output": "z"}}, {}, "no such output; got z; limit: y"),
        ({}, {"opset": 10}, "the operator set is too old; got 10"),
    ],
)
def test_a_disagreement_of_document_and_network_is_named(
    write_onnx, document: dict[str, Any], network: dict[str, Any], message: str
) -> None:
    if network.get("opset") == 10:
        import onnx

        model = onnx.load_from_string(write_onnx({})[1].read_bytes())
        model.opset_import[0].version = 10
        network = {"data": model.SerializeToString()}
    with pytest.raises(InvalidInput, match=message):
        predicted(write_onnx, np.zeros((32, 32, 3), np.uint8), document, **network)


def test_two_inputs_are_refused(write_onnx) -> None:
    import onnx

    document, path = write_onnx({})
    model = onnx.load(path)
    model.graph.input.append(onnx.helper.make_tensor_value_info("z", 1, [1]))
    with pytest.raises(InvalidInput, match="one input is needed; got x, z"):
        whole_graph(model, source=document.input, answer=document.output, piece=(8, 8), labels=(8, 8))


@ENGINES
def test_the_engines_give_the_labels_of_the_reference(tmp_path, engine: str) -> None:
    from valerie.perception.shipped import FUNCTIONS, function_path

    rng = np.random.default_rng(1)
    picture = np.kron(rng.integers(0, 256, (10, 15, 3), dtype=np.uint8), np.ones((16, 16, 1), np.uint8))[:150, :230]
    for name in FUNCTIONS:
        path = function_path(name)
        document = file_document(name, path)
        reference = open_function(document, path).predict(picture)
        function = open_function(document.model_copy(update={"engine": engine}), path)
        assert function.card.precision == "fp32"
        # A requirement: rounding may turn pixels on an edge between classes, few of 34,500.
        assert (function.predict(picture) == reference).mean() > 0.9995
        function.close()


def test_the_precision_is_read_back_and_another_one_refused(write_onnx) -> None:
    picture, labels = blocks(32, 32)
    for precision in ("bf16", "fp16"):
        document, path = write_onnx({"engine": "openvino", "precision": precision})
        try:
            function = open_function(document, path)
        except MissingDependency as error:
            assert precision in str(error)  # noqa: PT017  which of the two depends on the processor
            continue
        assert function.card.precision == precision
        assert f"-{precision}-" in function.numeric_class
        assert (function.predict(picture) == labels).mean() > 0.5  # 1 in 19 by chance; logits lose up to 16 of 24 bits


def test_precision_engine_and_threads_are_in_the_numeric_class(write_onnx) -> None:
    classes = []
    for engine, threads in (("openvino", 1), ("openvino", 4), ("onnxruntime", 1), ("openvino", 2)):
        document, path = write_onnx({"engine": engine})
        classes.append(open_function(document, path, threads=threads).numeric_class)
    assert len(set(classes)) == 3
    assert classes[0].startswith("openvino-")
    assert "-cpu-fp32-" in classes[0]
    assert classes[1].endswith("-t2")  # two pictures share the threads
    assert classes[3] == classes[0]


@ENGINES
def test_an_export_leaves_nothing_on_disk(tmp_path, monkeypatch, engine: str) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    path = tmp_path / "small.safetensors"
    path.write_bytes(random_function_file("semantic-fpn-small"))
    document: FunctionDocument = file_document("f", path).model_copy(update={"engine": engine})
    function = open_function(document, path)
    function.predict(np.zeros((64, 96, 3), np.uint8))
    assert list(tmp_path.iterdir()) == [path]
    function.close()
