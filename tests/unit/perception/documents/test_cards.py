from typing import Any

import pytest

from valerie.perception.base import FunctionCard
from valerie.perception.documents.cards import card_rows
from valerie.perception.documents.function import parse_function
from valerie.perception.shipped import function_card, function_document

PAYLOAD = {"sha256": "ab" * 32, "bytes": 16_042_000, "format": "onnx"}


def rows(**entries: Any) -> dict[str, str]:
    fields = {"name": "mine", "kind": "onnx", **entries}
    payload = {"payload": PAYLOAD} if fields["kind"] == "onnx" else {}
    document = parse_function(fields, **payload)
    return dict(card_rows(document.card(), document))


def test_the_card_of_a_shipped_function_shows_everything_that_decides_its_labels() -> None:
    lines = dict(card_rows(function_card("semantic-fpn-small"), function_document("semantic-fpn-small")))
    assert lines["classes"].startswith("19: road, sidewalk, building")
    assert lines["input size"] == "the frame's own, padded to multiples of 32"
    assert "longer than 1600 pixels" in lines["reduction"]
    assert lines["normalisation"].startswith("(x / 255 − mean) / std, mean 0.")
    assert (lines["channel order"], lines["engine"]) == ("RGB", "openvino")
    assert lines["precision"] in ("fp32", "bf16")  # bf16 where the processor multiplies it
    assert lines["digest"] == function_card("semantic-fpn-small").digest
    assert lines["licence"] == "Apache-2.0"


def test_classes_are_shown_with_the_evaluated_class_that_they_count_as() -> None:
    output = {"classes": ["background", "human", "car"], "class_map": {"human": "person"}, "target_classes": ["person"]}
    lines = rows(output=output)
    assert lines["classes"] == "3: background → void, human → person, car"
    assert lines["judged by"] == "person"
    assert (lines["answers"], lines["file"]) == ("logits", "onnx, 16,042,000 bytes")


def test_the_threshold_of_a_single_class_is_shown() -> None:
    lines = rows(output={"kind": "probabilities", "classes": ["person"], "threshold": 0.4})
    assert lines["answers"] == "probabilities; above 0.4 a pixel is of the class"


@pytest.mark.parametrize(
    ("taken", "size"),
    [
        ({}, "the frame's own"),
        ({"size": [640, 480]}, "640 × 480: smaller frames are padded"),
        ({"size": [640, 480], "mode": "resize"}, "640 × 480: frames are resized"),
        ({"size": [640, 480], "mode": "tile", "overlap": 32}, "640 × 480: tiles that share at least 32 pixels"),
    ],
)
def test_every_adaptation_is_shown(taken: dict[str, Any], size: str) -> None:
    lines = rows(input=taken)
    assert lines["input size"] == size
    assert "reduction" not in lines


@pytest.mark.parametrize(
    ("taken", "text"),
    [
        ({}, "x / 255"),
        ({"scale": 1}, "x"),
        ({"scale": 1, "mean": [104, 117, 123]}, "(x − mean) / std, mean 104, 117, 123, std 1, 1, 1"),
    ],
)
def test_normalisation_is_shown_as_a_formula(taken: dict[str, Any], text: str) -> None:
    assert rows(input=taken)["normalisation"] == text


def test_a_function_behind_http_is_shown_with_its_address() -> None:
    lines = rows(kind="http", options={"url": "http://models.example:8000/predict", "timeout_s": 5})
    assert (lines["address"], lines["time limit"]) == (
        "http://models.example:8000/predict",
        "5 s per picture",
    )
    assert not {"input size", "normalisation", "engine", "precision", "file"} & lines.keys()


def test_the_deadline_of_uploaded_predictions_is_shown() -> None:
    lines = rows(kind="predictions", options={"deadline_hours": 48})
    assert lines["deadline"] == "48 hours after the start of a run"


def test_a_class_of_an_installed_package_shows_its_card_alone() -> None:
    card = FunctionCard("dark", "d1", "threshold", "uint8", "numpy", {"licence": "MIT"})
    assert card_rows(card) == [
        ("digest", "d1"),
        ("architecture", "threshold"),
        ("engine", "numpy"),
        ("precision", "uint8"),
        ("licence", "MIT"),
    ]
