from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from tests.shipped import SPECS
from valerie.runs.document.schema import run_spec_schema, schema_text
from valerie.runs.resolving.spec import parse

ROOT = Path(__file__).parents[4]
FILES = [*SPECS, ROOT / "valerie" / "runs" / "template.yaml"]


@pytest.fixture(scope="module")
def validator() -> Any:
    schema = run_spec_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_the_committed_schema_is_current() -> None:
    committed = (ROOT / "docs" / "run-spec.schema.json").read_text("utf-8")
    assert committed == schema_text(), "run: python -m valerie.runs.document.schema > docs/run-spec.schema.json"


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_shipped_specs_and_their_stored_form_follow_the_schema(validator: Any, file: Path) -> None:
    text = file.read_text("utf-8")
    validator.validate(yaml.safe_load(text))
    validator.validate(parse(text).model_dump(mode="json"))


@pytest.mark.parametrize(
    "change",
    [
        {"sed": 1}, {"vary": {"p1": {"homogenous": {}}}}, {"vary": {"p1": {"homogeneous": {"from": 0, "to": 1}}}},
        {"vary": [["p1", "GAUSSIAN", 1, 2, 3]]}, {"vary": [["p1", "HOMOGENEOUS", 1, 2]]}, {"vary": [], "blocks": [{}]},
        {"resolution": {"width": 8}}, {"seed": 1.5}, {"parameters": [["p1", "scene.x.y", "DOUBLE"]]},
        {"sensors": [{"curve": "film"}]}, {"name": None},
        {"renderer": {"name": "cycles", "sample": 4}}, {"renderer": {"name": "cycles", "samples": 0}}, {"renderer": {}},
        {"renderer": {"name": "raster", "samples": 4}},
        {"sequence": [1]}, {"sequence": {"frames": 3}}, {"trajectories": {"person-1": [[0, 1]]}},
        {"trajectories": {"person-1": {"keyframes": [{"pos.x": 1}]}}},
    ],
)  # fmt: skip
def test_an_editor_marks_what_the_product_refuses(validator: Any, change: dict[str, Any]) -> None:
    with pytest.raises(jsonschema.ValidationError):
        validator.validate({"name": "a", "asset": "b", **change})


def test_fields_are_described(validator: Any) -> None:
    properties = validator.schema["properties"]
    undescribed = [name for name, field in properties.items() if not field.get("description")]
    assert undescribed == []
