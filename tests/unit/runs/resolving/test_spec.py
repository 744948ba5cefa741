from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from valerie.errors import InvalidInput, InvalidInputs
from valerie.runs.resolving.spec import RunSpec, parse
from valerie.sensing.settings import METERING, SensorSetting

LISTS = """
name: one
asset: urban-street
parameters:
  - [p1, scene.person-1.pos.x, FLOAT, 0.0, 20.0]
  - [c, scene.person-1.character, CATEGORICAL, [black-outfit, yellow-shirt]]
vary:
  - [p1, HOMOGENEOUS, 1.5, 5.5, 1.0]
  - [person-1.pos.y, GAUSSIAN, 4.0, 1.0]
  - [person-2.pos.x, UNIFORM, 1, 2]
  - [c, CHOICE, black-outfit, yellow-shirt]
  - [person-1.heading, CONSTANT, 90]
design: sobol
count: 8
"""
MAPPINGS = """
name: one
asset: {name: urban-street}
parameters:
  p1: {scene_graph_ref: scene.person-1.pos.x, type: FLOAT, from: 0.0, to: 20.0}
  c: {path: scene.person-1.character, type: CATEGORICAL, choices: [black-outfit, yellow-shirt]}
blocks:
  - design: sobol
    count: 8
    vary:
      p1: {homogeneous: {from: 1.5, to: 5.5, step: 1.0}}
      person-1.pos.y: {gaussian: {mean: 4.0, sigma: 1.0}}
      person-2.pos.x: {uniform: {from: 1, to: 2}}
      c: {choice: [black-outfit, yellow-shirt]}
      person-1.heading: {constant: 90}
"""
OBJECTS = {
    "name": "one",
    "asset": "urban-street",
    "parameters": [
        {"name": "p1", "path": "scene.person-1.pos.x", "type": "FLOAT", "minimum": 0.0, "maximum": 20.0},
        {"name": "c", "path": "scene.person-1.character", "type": "CATEGORICAL",
         "choices": ["black-outfit", "yellow-shirt"]},
    ],
    "blocks": [
        {
            "design": "sobol",
            "count": 8,
            "vary": [
                {"parameter": "p1", "distribution": "HOMOGENEOUS", "minimum": 1.5, "maximum": 5.5, "step": 1.0},
                {"person-1.pos.y": {"gaussian": {"mean": 4.0, "standard_deviation": 1.0}}},
                {"parameter": "person-2.pos.x", "distribution": "uniform", "from": 1, "to": 2},
                ["c", "CHOICE", ["black-outfit", "yellow-shirt"]],
                {"parameter": "person-1.heading", "distribution": "CONSTANT", "value": 90},
            ],
        }
    ],
}  # fmt: skip


def spec(**given: Any) -> dict[str, Any]:
    return {"name": "one", "asset": "urban-street", **given}


def problems(document: dict[str, Any] | str) -> dict[str, str]:
    with pytest.raises(InvalidInput) as caught:
        parse(document)
    error = caught.value
    problems_listed = error.problems if isinstance(error, InvalidInputs) else (error,)
    return {problem.field: str(problem) for problem in problems_listed}


def test_all_notations_say_the_same() -> None:
    lists, mappings, objects = parse(LISTS), parse(MAPPINGS), parse(OBJECTS)
    assert lists == mappings == objects
    assert lists.digest == mappings.digest == objects.digest


@pytest.mark.parametrize("source", [LISTS, MAPPINGS, OBJECTS])
def test_a_spec_survives_its_file_its_column_and_its_body(source: Any) -> None:
    document = parse(source)
    assert parse(document.to_yaml()) == document
    assert parse(document.model_dump(mode="json")) == document
    assert RunSpec.model_validate_json(document.model_dump_json()) == document
    assert parse(document.to_yaml()).digest == document.digest


def required(statistic: str = "mean(pacc) >= 0.8", **values: Any) -> dict[str, Any]:
    return {"id": "R", "statistic": statistic, **values}


def test_a_spec_needs_a_name_and_an_asset_alone() -> None:
    least = parse({"name": "one", "asset": "urban-street"})
    assert least.resolution.model_dump() == {"width": 960, "height": 540}
    assert [block.design for block in least.blocks] == ["grid"]
    assert least.seed == 0
    assert least.renderer == "raster"
    assert least.detection_threshold == 0.5
    assert least.sensors == (METERING,)
    assert (METERING.name, METERING.auto_exposure, METERING.noise.shot) == ("default", True, True)
    fixed = parse({"name": "one", "asset": "urban-street", "sensors": [{"auto_exposure": False}]})
    assert fixed.sensors == (SensorSetting(),)
    assert yaml.safe_load(fixed.to_yaml())["sensors"] == [{"auto_exposure": False}]
    assert "sensors" not in yaml.safe_load(least.to_yaml())
    assert problems({}) == {"name": "name: this field is missing", "asset": "asset: this field is missing"}


def test_a_generators_arguments_stay_with_the_asset() -> None:
    assert parse(spec(asset={"name": "urban-street", "seed": 7})).asset == {"name": "urban-street", "seed": 7}


def test_another_digest_follows_from_any_change() -> None:
    base = parse(spec()).digest
    changes: list[dict[str, Any]] = [
        {"name": "two"}, {"seed": 1}, {"functions": ["f"]}, {"sensors": [{"exposure_ev": 1}]},
        {"requirements": [required()]}, {"parent_run": "r1", "iteration": 1}, {"constraints": ["p1 < 1"]},
        {"resolution": {"width": 961, "height": 540}}, {"blocks": [{}, {}]},
    ]  # fmt: skip
    assert len({base, *(parse(spec(**change)).digest for change in changes)}) == len(changes) + 1


def test_a_spec_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        parse(spec()).name = "two"  # type: ignore[misc]


def test_three_numbers_of_a_gaussian_are_refused_with_the_right_form() -> None:
    refusals = problems(spec(vary=[["p1", "GAUSSIAN", 0, 10, 1]]))
    assert "limit: [p1, GAUSSIAN, mean, standard_deviation]" in refusals["vary.0"]


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        (["p1", "HOMOGENEOUS", 1, 2], "[p1, HOMOGENEOUS, minimum, maximum, step]"),
        (["p1", "HOMOGENOUS", 1, 2, 1], "did you mean HOMOGENEOUS"),
        (["p1"], "a list has a parameter"),
        ([1, 2, 3], "a list has a parameter"),
        (3, "not an entry of vary"),
        ({"p1": None, "HOMOGENEOUS": None, "1.5": None}, "write the paper's list in square brackets"),
        ({"p1": {"homogeneous": 3}}, "takes a mapping"),
        ({"p1": {"homogeneous": {}, "uniform": {}}}, "has one distribution"),
        ({"p1": {"homogenous": {}}}, "did you mean homogeneous"),
        ({"p1": {"uniform": {"from": 1, "minimum": 2}}}, "given twice"),
    ],
)
def test_an_entry_in_neither_notation_is_refused_with_the_right_form(entry: Any, expected: str) -> None:
    refusals = problems(spec(vary=[["p0", "CONSTANT", 1], entry]))
    assert all(field.startswith("vary.1") for field in refusals)
    assert expected in "".join(refusals.values())


def test_every_problem_is_listed_at_the_place_where_it_was_written() -> None:
    refusals = problems(
        spec(
            blocks=[{"vary": [["p1", "HOMO", 1], {"p2": {"homogeneous": {"from": 0, "too": 3, "step": True}}}]}],
            seed=1.5, functions="f", sed=3, resolution={"width": 8, "hight": 100}, cameras=[],
            sensors=[{"name": "a", "exposure": 1}], detection_threshold=0, iteration=-1, constraints=[3],
        )
    )  # fmt: skip
    assert set(refusals) == {
        "blocks.0.vary.0", "blocks.0.vary.1.maximum", "blocks.0.vary.1.too", "blocks.0.vary.1.step", "seed", "functions",
        "sed", "resolution.width", "resolution.hight", "cameras", "sensors.0.exposure", "detection_threshold",
        "iteration", "constraints.0",
    }  # fmt: skip
    assert "did you mean seed" in refusals["sed"]
    assert "did you mean height" in refusals["resolution.hight"]
    assert "did you mean exposure_ev" in refusals["sensors.0.exposure"]
    assert "got 8; limit: >= 16" in refusals["resolution.width"]


def test_a_mapping_names_its_entries_in_errors() -> None:
    refusals = problems(spec(vary={"p1": {"homogeneous": {"from": 0, "to": 1}}}))
    assert refusals == {"vary.p1.step": "vary.p1.step: this field is missing"}


def test_one_block_stands_at_the_top_or_below_blocks_and_not_both() -> None:
    assert list(problems(spec(vary=[], blocks=[{}]))) == ["vary"]


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"parameters": [["p1", "scene.a.x", "FLOAT", 0, 1], ["p1", "scene.a.y", "FLOAT", 0, 1]]}, "parameters.1"),
        ({"parameters": [["p1", "scene.a.x"]]}, "parameters.0"),
        ({"parameters": [["p1", "scene.a.x", "FLOAT", 0]]}, "parameters.0"),
        ({"parameters": [["p1", "scene.a.x", "DOUBLE", 0, 1]]}, "parameters.0.type"),
        ({"parameters": {"p1": 3}}, "parameters.p1"),
        ({"cameras": ["camera-1", "camera-1"]}, "cameras.1"),
        ({"functions": ["f", "g", "f"]}, "functions.2"),
        ({"sensors": [{"name": "a"}, {"name": "a", "gamma": 2}]}, "sensors.1"),
        ({"sensors": []}, "sensors"),
        ({"blocks": []}, "blocks"),
        ({"name": ""}, "name"),
        ({"name": 3}, "name"),
        ({"name": "x" * 201}, "name"),
        ({"asset": {"seed": 7}}, "asset"),
        ({"seed": -1}, "seed"),
        ({"seed": 2**63}, "seed"),
        ({"seed": True}, "seed"),
        ({"resolution": {"width": 8193, "height": 540}}, "resolution.width"),
        ({"resolution": {"width": 960.5, "height": 540}}, "resolution.width"),
        ({"schema_version": 2}, "schema_version"),
        ({"count": 0, "design": "sobol"}, "count"),
        ({"count": 1.5, "design": "sobol"}, "count"),
        ({"points": [{"p1": [1]}], "design": "points"}, "points.0.p1"),
        ({"constants": {"p1": None}}, "constants.p1"),
        ({"requirements": [{"statistic": "mean(pacc) >= 0.8"}]}, "requirements.0.id"),
        ({"requirements": [{"id": "R"}]}, "requirements.0.statistic"),
        ({"requirements": [required(), required()]}, "requirements.1"),
        ({"requirements": [required(confidence=1.0)]}, "requirements.0.confidence"),
        ({"requirements": [required(min_units=0)]}, "requirements.0.min_units"),
        ({"requirements": [required(min_visible_pixels=-1)]}, "requirements.0.min_visible_pixels"),
        ({"requirements": [required("mean(iou) >= 0.5", min_visible_pixels=9)]}, "requirements.0.min_visible_pixels"),
        ({"requirements": [required(functions=["f"])]}, "requirements.0.functions.0"),
        ({"requirements": [required("mean(pac) >= 0.5")]}, "requirements.0.statistic"),
        ({"requirements": [required("mean(pacc) >= 0")]}, "requirements.0.statistic"),
        (
            {"requirements": [required("share(pacc >= 0.5) >= 1")], "design": "random", "count": 9},
            "requirements.0.statistic",
        ),
    ],
)
def test_bad_input_is_named_by_its_field(given: dict[str, Any], field: str) -> None:
    assert field in problems(spec(**given))


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"functions": "f"}, "functions: a list is needed here; got f; limit: [f]"),
        ({"sensors": {"name": "a", "gamma": 2}}, "sensors: a list is needed here; limit: [{name: …}]"),
        ({"vary": None}, "vary: entries are needed here, indented; limit: p1: {homogeneous: {from: …, to: …, step: …}}"),
        ({"vary": ["p1", "CONSTANT", 1]}, "vary: brackets around each entry are missing; got ['p1', 'CONSTANT', 1]; limit: [["),
        ({"vary": {"p1": [1, 2]}}, "limit: p1: {choice: [1, 2]}"),
        ({"vary": {"p1": "3 m"}}, "limit: p1: {constant: 3 m}"),
        ({"vary": {"p1": {"choice": 3}}}, "vary.p1.choice: a list is needed here; got 3; limit: [3]"),
        ({"vary": {"p1": {"choice": []}}}, "vary.p1.choice: out of bounds; got []; limit: at least 1 entry"),
        ({"vary": {"p1": {"normal": {"mean": 1, "sigma": 2}}}}, "unknown distribution 'normal'; did you mean gaussian?"),
        ({"vary": {"p1": {"uniform": {"from": [1], "to": 2}}}}, "vary.p1.from: a number is needed here; got [1]"),
        ({"constants": {"p1": [1]}}, "constants.p1: a single value is needed here; got [1]"),
        ({"p1.pos.x": {"constant": 1}}, "p1.pos.x: unknown field 'p1.pos.x'; limit: a parameter stands below vary"),
        ({"name": 12}, "name: text is needed here; got 12; limit: '12' in quotes"),
        ({"name": True}, "name: text is needed here; got True; limit: 'true' in quotes"),
        ({"name": ""}, "limit: at least 1 character"),
        ({"cameras": []}, "limit: at least 1 entry"),
        ({"schema_version": 2}, "schema_version: not an accepted value; got 2; limit: 1"),
    ],
)  # fmt: skip
def test_an_error_says_what_is_right(given: dict[str, Any], expected: str) -> None:
    assert expected in "\n".join(problems(spec(**given)).values())


def test_a_study_is_told_from_a_run() -> None:
    study = spec(goal="estimate", measure="min(pacc) >= 0.5", budget={"variants": 64})
    (said,) = problems(study).values()
    assert said == (
        "goal: a run has no goal, a study has; got estimate; "
        "limit: `valerie study plan` and `valerie study run`, or leave goal out"
    )


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(
                st.sampled_from(["vary", "blocks", "parameters", "points", "p1", "homogeneous", "from", "name", "asset"]),
                inner, max_size=4,
            )
        ),
        max_leaves=10,
    )
)  # fmt: skip
def test_any_document_is_a_spec_or_refused(given: Any) -> None:
    for document in (given, {"name": "a", "asset": "b", "vary": given}, {"name": "a", "asset": "b", "blocks": [given]}):
        try:
            parse(document)
        except InvalidInput:
            continue


def test_a_renderer_is_a_name_or_a_mapping_with_settings() -> None:
    def given(renderer: object) -> RunSpec:
        return parse({"name": "one", "asset": "urban-street", "renderer": renderer})

    assert given({"name": "cycles"}) == given("cycles")
    assert given({"name": "cycles"}).digest == given("cycles").digest
    assert given("cycles").engine_settings == {}
    assert given({"name": "cycles", "samples": 16}).engine == "cycles"
    assert given({"name": "cycles", "samples": 16}).engine_settings == {"samples": 16}
    with pytest.raises(InvalidInputs, match="a renderer mapping needs a name"):
        given({"samples": 16})
