import subprocess
import sys
from pathlib import Path

import pytest

from valerie.errors import InvalidInput, NotFound, UnknownName
from valerie.perception import shipped
from valerie.perception.networks.architectures import ARCHITECTURES


def test_the_card_is_read_from_the_header(write_function) -> None:
    path = write_function("semantic-fpn-small")
    card = shipped.function_card("semantic-fpn-small", folder=path.parent)
    assert card.architecture == "semantic-fpn-small"
    assert card.provenance == {"licence": "Apache-2.0"}


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
        "print('torch' in sys.modules, 'cv2' in sys.modules)"
    )
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert shown.stdout.split() == ["torch", "False", "False"]
