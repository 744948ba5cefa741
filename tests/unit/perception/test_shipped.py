import subprocess
import sys
from pathlib import Path

import pytest

from valerie.errors import InvalidInput, NotFound, UnknownName
from valerie.perception import shipped
from valerie.perception.networks.architectures import ARCHITECTURES
from valerie.perception.running import choice
from valerie.perception.running.engines import processor


def test_the_card_is_read_from_the_header(write_function) -> None:
    path = write_function("semantic-fpn-small")
    card = shipped.function_card("semantic-fpn-small", folder=path.parent)
    assert card.architecture == "semantic-fpn-small"
    assert card.provenance["licence"] == "Apache-2.0"


def test_the_card_is_that_of_the_loaded_function(write_function) -> None:
    path = write_function("deeplabv3plus-small")
    loaded = shipped.load_function("deeplabv3plus-small", folder=path.parent)
    assert shipped.function_card("deeplabv3plus-small", folder=path.parent) == loaded.card


def test_a_replaced_file_has_a_new_card(write_function) -> None:
    cards = []
    for seed in (1, 2):
        path = write_function("semantic-fpn-small", seed=seed)
        cards.append(shipped.function_card("semantic-fpn-small", folder=path.parent))
    assert cards[0].digest != cards[1].digest


def test_an_unknown_function_names_its_neighbours() -> None:
    with pytest.raises(UnknownName, match="deeplabv3plus-small"):
        shipped.function_card("deeplab-small")


def test_a_missing_file_is_reported_with_its_name(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match=r"semantic-fpn-small\.safetensors"):
        shipped.load_function("semantic-fpn-small", folder=tmp_path)


def test_a_damaged_file_is_reported_with_its_name(tmp_path: Path) -> None:
    (tmp_path / "semantic-fpn-small.safetensors").write_bytes(b"nothing")
    with pytest.raises(InvalidInput, match=r"semantic-fpn-small\.safetensors"):
        shipped.function_card("semantic-fpn-small", folder=tmp_path)


def test_every_shipped_function_is_an_architecture() -> None:
    assert set(shipped.FUNCTIONS) <= set(ARCHITECTURES)


def test_cards_need_no_torch(write_function) -> None:
    path = write_function("semantic-fpn-small")
    program = (
        "import sys; from pathlib import Path; from valerie.perception.shipped import function_card;"
        f"print(function_card('semantic-fpn-small', folder=Path({str(path.parent)!r})).engine);"
        "print('torch' in sys.modules, 'cv2' in sys.modules, 'openvino' in sys.modules)"
    )
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert shown.stdout.split() == ["openvino", "False", "False", "False"]


def test_the_engine_is_the_fastest_that_the_machine_has(write_function, monkeypatch) -> None:
    path = write_function("semantic-fpn-small")

    def chosen(precision: str = "auto", device: str = "cpu") -> tuple[str, str]:
        document = shipped.local_document("f", path, device=device, precision=precision)
        assert document.engine in document.provenance["engine chosen"]
        return document.engine, document.precision

    for listed, expected in (({"amx_bf16"}, "bf16"), ({"avx512_bf16"}, "bf16"), ({"avx512f", "avx2"}, "fp32")):
        monkeypatch.setattr(processor, "flags", lambda listed=listed: frozenset(listed))
        assert chosen() == ("openvino", expected)
        assert chosen("fp32") == ("openvino", "fp32")
    assert chosen(device="cuda") == ("torch", "fp32")
    monkeypatch.setattr(choice, "find_spec", lambda name: None)
    assert chosen() == ("torch", "fp32")
    reason = shipped.local_document("f", path, device="cpu").provenance["engine chosen"]
    assert reason == "torch, since openvino is not installed"


@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_the_precision_is_that_of_the_numeric_class_and_the_card(write_function, precision: str) -> None:
    if precision == "bf16" and not processor.multiplies_bf16():
        precision = "fp32"  # the only one that this processor has
    path = write_function("semantic-fpn-small")
    function = shipped.load_function("semantic-fpn-small", folder=path.parent, device="cpu", precision=precision)
    assert (function.card.engine, function.card.precision) == ("openvino", precision)
    assert f"-cpu-{precision}-" in function.numeric_class
    function.close()
