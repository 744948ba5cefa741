import json
from typing import Any

import pytest

from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.parameters.assignment import digest
from valerie.perception.documents.function import FunctionDocument, parse_function

PAYLOAD = {"sha256": "0" * 64, "bytes": 10, "format": "onnx"}
SIDECAR = """
name: my-net
kind: onnx
input: {size: [1024, 512], mode: resize, mean: [0.485, 0.456, 0.406], std: [0.229, 0.224, 0.225], channel_order: bgr}
output:
  kind: logits
  classes: [background, human]
  class_map: {human: person}
"""


def document(**changes: Any) -> FunctionDocument:
    values = {"name": "f", "kind": "onnx", "payload": PAYLOAD, **changes}
    return parse_function(values)


def test_a_sidecar_is_read_with_the_payload_that_lies_beside_it() -> None:
    read = parse_function(SIDECAR, payload=PAYLOAD)
    assert read.input.size == (1024, 512)
    assert read.input.channel_order == "bgr"
    assert (read.engine, read.precision) == ("openvino", "fp32")
    assert read.output.reached == ("person",)
    assert read.output.unmapped == ("background",)


def test_a_document_survives_its_own_json() -> None:
    read = parse_function(SIDECAR, payload=PAYLOAD)
    again = parse_function(json.loads(read.model_dump_json()))
    assert again == read
    assert again.digest == read.digest


def test_the_name_is_no_part_of_the_digest() -> None:
    assert document(name="a").digest == document(name="b").digest


@pytest.mark.parametrize(
    "change",
    [
        {"payload": {**PAYLOAD, "sha256": "1" * 64}},
        {"input": {"multiple_of": 32}},
        {"input": {"mean": [0.5, 0, 0]}},
        {"input": {"channel_order": "bgr"}},
        {"output": {"kind": "labels"}},
        {"output": {"class_map": {"rider": "person"}}},
        {"precision": "bf16"},
        {"engine": "onnxruntime"},
        {"provenance": {"licence": "MIT"}},
    ],
)
def test_every_other_entry_is_part_of_the_digest(change: dict[str, Any]) -> None:
    assert document(**change).digest != document().digest


def test_defaults_that_are_written_out_change_no_digest() -> None:
    text = document(engine="openvino", precision="fp32", input={"scale": 1 / 255}, output={"classes": "cityscapes"})
    assert text.digest == document().digest


def test_the_digest_covers_what_a_document_says_and_no_default() -> None:
    # Runs are pinned to it: an entry that a later version adds leaves the digests of older documents as they are.
    assert document().digest == digest("function", 1, {"kind": "onnx", "payload": PAYLOAD, "engine": "openvino"})


@pytest.mark.parametrize(("given", "read"), [(1, "1"), (1.0, "1"), ("1/255", "1/255"), (0.00392157, "1/255")])
def test_the_scale_may_be_a_number(given: object, read: str) -> None:
    assert document(input={"scale": given}).input.scale == read


@pytest.mark.parametrize(
    ("change", "field", "message"),
    [
        ({"name": "My Net"}, "name", "not of the required form"),
        ({"kind": "torchscript"}, "kind", "onnx"),
        ({"engine": "torch"}, "", "engine torch cannot run kind onnx"),
        ({"engine": "onnxruntime", "precision": "bf16"}, "", "onnxruntime has no bf16"),
        ({"payload": None}, "", "takes a file of onnx, not none"),
        ({"payload": {**PAYLOAD, "format": "safetensors"}}, "", "takes a file of onnx, not safetensors"),
        ({"kind": "http", "options": {"url": "http://a/"}}, "", "takes no file"),
        ({"kind": "http", "payload": None, "options": {}}, "options.url", "missing"),
        ({"options": {"outptu": "y"}}, "options.outptu", "did you mean output"),
        ({"kind": "network", "payload": {**PAYLOAD, "format": "safetensors"}}, "", "needs an architecture"),
        ({"payload": {**PAYLOAD, "sha256": "../etc"}}, "payload.sha256", "not of the required form"),
        ({"input": {"mode": "tile"}}, "input", "mode tile needs a size"),
        ({"input": {"size": [64, 0], "mode": "tile"}}, "input.size.1", "limit: >= 1"),
        ({"input": {"size": [64, 64], "overlap": 8}}, "input", "overlap belongs to mode tile"),
        ({"input": {"size": [64, 64], "mode": "tile", "overlap": 64}}, "input", "must be below"),
        ({"input": {"size": [64, 64], "multiple_of": 32}}, "input", "without a size"),
        ({"input": {"std": [1, 0, 1]}}, "input.std.1", "limit: > 0"),
        ({"input": {"mean": [float("inf"), 0, 0]}}, "", "not finite"),
        ({"input": {"scale": 2}}, "input.scale", "1/255"),
        ({"output": {"classes": []}}, "output.classes", "at least 1"),
        ({"output": {"classes": ["person", "road"], "threshold": 0.5}}, "output", "single class"),
    ],
)
def test_a_contradiction_is_named_with_its_field(change: dict[str, Any], field: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=message) as caught:
        document(**change)
    if field:
        assert isinstance(caught.value, InvalidInputs)
        assert caught.value.problems[0].field == field


@pytest.mark.parametrize(
    ("change", "near"),
    [
        ({"inputs": {}}, "input"),
        ({"input": {"means": [0, 0, 0]}}, "mean"),
        ({"payload": {**PAYLOAD, "sha": 1}}, "sha256"),
        ({"output": {"class_map": {"person": "peson"}}}, "person"),
        ({"output": {"target_classes": ["persons"]}}, "person"),
        ({"output": {"classes": "cityscape"}}, "cityscapes"),
    ],
)
def test_unknown_names_come_with_near_matches(change: dict[str, Any], near: str) -> None:
    with pytest.raises(InvalidInput, match=f"did you mean.*{near}"):
        document(**change)


def test_a_target_class_must_be_one_that_the_function_can_predict() -> None:
    with pytest.raises(UnknownName, match="target class"):
        document(output={"classes": ["person"], "target_classes": ["road"]})


def test_a_missing_field_is_named() -> None:
    with pytest.raises(InvalidInput, match="kind: this field is missing"):
        parse_function({"name": "f"})


def test_a_wrong_kind_is_one_problem_and_a_wrong_name_shows_its_form() -> None:
    with pytest.raises(InvalidInputs) as caught:
        parse_function({"name": "A B", "kind": "onix", "input": {"size": "512x256"}})
    assert [str(problem) for problem in caught.value.problems] == [
        "name: not of the required form; got A B; limit: ^[a-z0-9][a-z0-9_.-]*$",
        "kind: unknown value 'onix'; did you mean onnx?",
        "input.size: a list is needed here; got 512x256; limit: [512, 256]",
    ]


def test_a_document_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        document().name = "other"


def test_the_card_shows_the_real_precision() -> None:
    card = document(precision="bf16").card(precision="fp32")
    assert (card.name, card.engine, card.precision, card.architecture) == ("f", "openvino", "fp32", "onnx")
    assert card.digest == document(precision="bf16").digest


def test_the_card_shows_the_classes_that_judge_the_function() -> None:
    person_or_not = {"classes": ["not", "human"], "class_map": {"human": "person"}}
    several = {"classes": ["car", "road", "person"]}
    assert document(output=person_or_not).card().judged_by == ("person",)
    assert document(output=several).card().judged_by == ("road", "person", "car")
    assert document(output={**several, "target_classes": ["person"]}).card().judged_by == ("person",)
    assert document(output={"target_classes": ["car", "road"]}).card().judged_by == ("road", "car")
    assert document().card().judged_by == ()


def test_options_that_are_written_out_and_left_out_are_one_function() -> None:
    text = document(options={"output": ""})
    assert text == document()
    assert text.digest == document().digest
    assert text.digest != document(options={"output": "logits"}).digest


def test_options_survive_a_trip_through_json() -> None:
    document = parse_function(
        {"name": "a", "kind": "http", "options": {"url": "http://models.example/", "timeout_s": 5}}
    )
    assert FunctionDocument.model_validate_json(document.model_dump_json()) == document
