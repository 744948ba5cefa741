import pytest

from valerie.perception.importing.checkpoints.configuration import config_values


def test_values_have_dotted_names_in_calls_and_in_braces() -> None:
    text = "a = 1\nmodel = dict(head=dict(align_corners=True, rates=(1, 6)), other={'x': {'y': [1.5]}}, f=g(h=2))"
    assert config_values({"meta.cfg": text}) == {
        "a": 1,
        "model.head.align_corners": True,
        "model.head.rates": (1, 6),
        "model.other.x.y": [1.5],
        "model.f.h": 2,
    }


@pytest.mark.parametrize(
    "text",
    ["/home/somebody/config.py\nmodel = dict(", "(" * 100_000, "a = " + "-" * 100_000 + "1", "x" * 1_000_001, 7, "\0"],
)
def test_text_that_cannot_be_parsed_gives_no_values(text: object) -> None:
    assert config_values({"meta.config": text}) == {}


def test_expressions_give_no_values() -> None:
    assert config_values({"meta.config": "a = b + 1\nc = [dict(type='x')]\nd = f'{a}'\ne, g = 1, 2"}) == {}


def test_a_file_without_settings_gives_no_values() -> None:
    assert config_values({"meta.CLASSES": ("a",)}) == {}
