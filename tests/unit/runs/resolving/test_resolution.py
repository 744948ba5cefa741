import math
from typing import Any

import pytest

from valerie.errors import InvalidInputs
from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType
from valerie.runs.forecasting.forecast import plan
from valerie.runs.resolving.spec import ResolvedRun, parse, resolve
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.model import POSITIONS
from valerie.scene.light.solar import CLOCK

X, Y, HEADING = "scene.person-1.pos.x", "scene.person-1.pos.y", "scene.person-1.heading"


def resolved(street: Manifest, **given: Any) -> ResolvedRun:
    return resolve(
        parse({"name": "one", "asset": "urban-street", "functions": ["deeplabv3plus-small"], **given}),
        street,
        engines=("raster", "pyrender", "cycles"),
        functions=("deeplabv3plus-small", "semantic-fpn-small"),
    )


def problems(street: Manifest, **given: Any) -> dict[str, str]:
    with pytest.raises(InvalidInputs) as caught:
        resolved(street, **given)
    return {problem.field: str(problem) for problem in caught.value.problems}


@pytest.mark.parametrize(
    "given",
    [
        {"constants": {"environment-1.rain": 4.0}},
        {"vary": [["environment-1.cloud_cover", "HOMOGENEOUS", 0.0, 1.0, 0.5]]},
    ],
)
def test_an_engine_without_weather_is_refused_where_a_spec_names_it(street: Manifest, given: dict[str, Any]) -> None:
    weather = [
        ParameterDefinition(
            path=f"scene.environment-1.{name}",
            type=ParameterType.FLOAT,
            minimum=0,
            maximum=10,
            default=0.0,
            affects=Affects.LIGHT,
        )
        for name in ("rain", "cloud_cover")
    ]
    street = street.model_copy(update={"parameters": (*street.parameters, *weather)})
    (found,) = problems(street, renderer="pyrender", **given).values()
    assert "pyrender" in found
    assert "raster" in found
    resolved(street, renderer="raster", **given)


def test_an_engine_without_lamps_is_refused_where_a_spec_switches_them(street: Manifest) -> None:
    switch = ParameterDefinition(
        path="scene.environment-1.street_lamps",
        type=ParameterType.CATEGORICAL,
        choices=POSITIONS,
        default="auto",
        affects=Affects.LIGHT,
    )
    street = street.model_copy(update={"parameters": (*street.parameters, switch)})
    constants = {"environment-1.street_lamps": "on"}
    (found,) = problems(street, renderer="pyrender", constants=constants).values()
    assert "pyrender" in found
    resolved(street, renderer="raster", constants=constants)
    resolved(street, renderer="cycles", constants=constants)


def test_an_engine_for_the_day_takes_no_sun_below_the_horizon(street: Manifest) -> None:
    elevation = street.by_path["scene.sun-1.elevation"].model_copy(update={"minimum": -20.0})
    others = (p for p in street.parameters if p.path != elevation.path)
    street = street.model_copy(update={"parameters": (*others, elevation)})
    vary = [["sun-1.elevation", "HOMOGENEOUS", -10.0, 10.0, 5.0]]
    (found,) = problems(street, renderer="pyrender", vary=vary).values()
    assert "0…75 deg" in found
    assert resolved(street, renderer="raster", vary=vary).space.size == 5


def with_a_clock(street: Manifest) -> Manifest:
    return street.model_copy(update={"parameters": (*street.parameters, *(row.definition() for row in CLOCK))})


@pytest.mark.parametrize(
    "given",
    [
        {"constants": {"sun-1.elevation": 30.0}},
        {"constraints": ["sun-1.azimuth > 90"]},
        {"blocks": [{"vary": [["sun-1.azimuth", "CHOICE", 90, 180]]}]},
    ],
)
def test_a_sun_that_is_given_by_time_and_by_angles_is_refused(street: Manifest, given: dict[str, Any]) -> None:
    by_time = {"blocks": [{"vary": [["sun-1.time_of_day", "HOMOGENEOUS", "8 h", "16 h", "60 min"]]}]}
    both = by_time | given
    if "blocks" in given:
        both["blocks"] = by_time["blocks"] + given["blocks"]
    (found,) = problems(with_a_clock(street), **both).values()
    assert "given twice" in found
    assert "sun-1.time_of_day" in found


def test_a_day_from_morning_to_evening_is_a_plan_whose_variants_say_where_the_sun_stands(street: Manifest) -> None:
    run = resolved(
        with_a_clock(street),
        vary=[["sun-1.time_of_day", "HOMOGENEOUS", "8 h", "16 h", "60 min"]],
        constants={"sun-1.day_of_year": 172, "sun-1.latitude": "48.8 deg"},
    )
    assert run.space.size == 9
    forecast = plan(run)
    first, last = forecast.first[0].sun, forecast.last[-1].sun
    assert first is not None
    assert last is not None
    assert first[0] < 120
    assert last[0] > 240
    assert plan(resolved(street)).first[0].sun is None


def test_the_papers_two_lists_give_ten_variants(street: Manifest) -> None:
    run = resolved(
        street,
        parameters=[["p1", X, "FLOAT", 0.0, 20.0], ["p2", Y, "FLOAT", 0.0, 10.0]],
        vary=[["p1", "HOMOGENEOUS", 1.5, 5.5, 1.0], ["p2", "HOMOGENEOUS", 4.0, 5.0, 1.0]],
    )
    assert len(run.space) == 10
    assert run.space[9].values == {X: 5.5, Y: 5.0}
    assert run.warnings == ()
    assert run.notes == ("p1: numbers without unit are in m", "p2: numbers without unit are in m")


def test_units_are_converted_to_the_declarations(street: Manifest) -> None:
    run = resolved(
        street,
        vary={
            "person-1.pos.x": {"homogeneous": {"from": "0 m", "to": "1.2 m", "step": "30 cm"}},
            "person-1.heading": {"homogeneous": {"from": 0, "to": f"{2 * math.pi!r} rad", "step": "45 deg"}},
            "person-1.cloth.metallic": {"choice": ["30 %", 0.5]},
        },
        constants={"sensor.exposure_ev": "-1 EV", "camera-1.focal_length_mm": "5 cm"},
    )
    assert len(run.space) == 5 * 8 * 2
    assert run.space[79].values == {
        "sensor.exposure_ev": -1.0, "scene.camera-1.focal_length_mm": 50.0, X: 1.2, HEADING: 315.0,
        "scene.person-1.cloth.metallic": 0.5,
    }  # fmt: skip
    assert run.notes == ("person-1.heading: numbers without unit are in deg",)


def test_a_full_turn_in_steps_of_45_degrees_is_eight_headings(street: Manifest) -> None:
    assert len(resolved(street, vary=[["person-1.heading", "HOMOGENEOUS", 0, 360, 45]]).space) == 8


def test_a_parameter_may_be_called_by_name_by_path_or_by_the_specs_own_name(street: Manifest) -> None:
    run = resolved(
        street,
        parameters=[["p1", X, "FLOAT", 0, 10]],
        blocks=[{"vary": [[name, "HOMOGENEOUS", 1, 2, 1]]} for name in ("p1", "person-1.pos.x", X)],
        constraints=["p1 < 2 and person-1.pos.x < 2 and scene.person-1.pos.x < 2"],
    )
    assert [a.values[X] for a in run.space] == [1.0, 2.0] * 3
    assert [run.space.violated(a.values) is None for a in run.space] == [True, False] * 3


def test_a_spec_narrows_the_declared_range(street: Manifest) -> None:
    run = resolved(
        street, parameters=[["p1", X, "FLOAT", 2, 4]], design="random", count=50, vary={"p1": {"uniform": {}}}
    )
    assert all(2 <= float(a.values[X]) <= 4 for a in run.space)
    refusals = problems(street, parameters=[["p1", X, "FLOAT", 2, 4]], vary=[["p1", "HOMOGENEOUS", 1, 4, 1]])
    assert list(refusals) == ["vary.0.minimum"]


def test_a_spec_may_choose_among_the_assets_choices(street: Manifest) -> None:
    declared = [["c", "scene.person-1.character", "CATEGORICAL", ["yellow-shirt"]]]
    assert list(problems(street, parameters=declared, vary=[["c", "CHOICE", "black-outfit"]])) == ["vary.0.values.0"]


def test_a_gaussian_is_truncated_to_the_range_in_force(street: Manifest) -> None:
    run = resolved(
        street, parameters=[["p1", X, "FLOAT", 2, 4]], design="sobol", count=64, vary=[["p1", "GAUSSIAN", 3, 10]]
    )
    values = [float(a.values[X]) for a in run.space]
    assert 2 <= min(values) < 2.1
    assert 3.9 < max(values) <= 4


def test_a_maximum_that_is_not_reached_is_warned_of(street: Manifest) -> None:
    run = resolved(street, vary={"person-1.pos.x": {"homogeneous": {"from": "0 m", "to": "10 m", "step": "3 m"}}})
    (warning,) = run.warnings
    assert warning == (
        "vary.person-1.pos.x: 0…10 step 3 gives 0, 3, 6, 9; the maximum 10 is not reached"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"design": "sobol", "count": 100, "vary": [["person-1.pos.x", "UNIFORM", 0, 1]]}, "nearest are 64 and 128"),
        ({"design": "halton", "count": 19, "vary": [["person-1.pos.x", "UNIFORM", 0, 1]]}, "drawn independently"),
        (
            {
                "design": "random",
                "count": 50,
                "vary": [["person-1.pos.x", "UNIFORM", 0, 1]],
                "requirements": [{"id": "R", "statistic": "share(pacc >= 0.5) >= 0.95"}],
            },
            "R: 50 variants will hardly decide it; if share(pacc >= 0.5) is 97.5 %, about",
        ),
        ({"vary": [["person-1.pos.x", "CHOICE", 1, 2]], "constants": {X: "3 m"}}, "is varied and constant"),
        ({"parameters": [["p1", X, "FLOAT", 0, 1]]}, "p1 is declared and not varied; it stays at 3 m"),
        ({"functions": []}, "no function under test"),
    ],
)
def test_what_is_probably_not_meant_is_warned_of(street: Manifest, given: dict[str, Any], words: str) -> None:
    assert words in "\n".join(resolved(street, **given).warnings)


@pytest.mark.parametrize(("engine", "warned"), [("pyrender", True), ("raster", False)])
def test_solid_shadows_of_cut_outs_are_warned_of(street: Manifest, engine: str, warned: bool) -> None:
    from_files = street.model_copy(update={"files": ("street.glb",)})
    assert any("cut-out" in text for text in resolved(from_files, renderer=engine).warnings) is warned
    assert not any("cut-out" in text for text in resolved(street, renderer=engine).warnings)


def test_all_cameras_are_taken_unless_some_are_named(street: Manifest) -> None:
    assert resolved(street).cameras == ("camera-1", "camera-2", "camera-3")
    assert resolved(street, cameras=["camera-3", "camera-1"]).cameras == ("camera-3", "camera-1")


def test_a_stored_run_outlives_what_was_installed(street: Manifest) -> None:
    document = parse({"name": "one", "asset": "urban-street", "renderer": "gone", "functions": ["gone"]})
    assert resolve(document, street).space.size == 1


@pytest.mark.parametrize(
    ("given", "field", "words"),
    [
        ({"renderer": "rastr"}, "renderer", "did you mean raster"),
        ({"renderer": {"name": "rastr", "samples": 4}}, "renderer", "did you mean raster"),
        ({"renderer": {"name": "cycles", "sample": 4}}, "renderer.sample", "did you mean samples"),
        ({"renderer": {"name": "cycles", "samples": -1}}, "renderer.samples", "limit: >= 1"),
        ({"functions": ["deeplab-small"]}, "functions.0", "did you mean deeplabv3plus-small"),
        ({"cameras": ["camera-4"]}, "cameras.0", "did you mean camera-"),
        ({"design": "sobel", "count": 2}, "design", "did you mean sobol"),
        ({"vary": [["person-1.pos.z", "CHOICE", 1]]}, "vary.0", "did you mean person-1.pos."),
        ({"vary": [["person-1.pos.x", "HOMOGENEOUS", 5, 1, 1]]}, "vary.0.minimum", "above the maximum"),
        ({"vary": [["person-1.pos.x", "HOMOGENEOUS", 1, 5, 0]]}, "vary.0.step", "limit: > 0"),
        ({"vary": [["person-1.pos.x", "HOMOGENEOUS", 1, 5, -1]]}, "vary.0.step", "got -1"),
        ({"vary": [["person-1.pos.x", "HOMOGENEOUS", 1, 25, 1]]}, "vary.0.maximum", "limit: -10…20 m"),
        ({"vary": [["person-1.pos.x", "HOMOGENEOUS", 1, "5 deg", 1]]}, "vary.0.maximum", "does not fit"),
        ({"vary": [["person-1.pos.x", "HOMOGENEOUS", 1, "5 mm", 1]]}, "vary.0.minimum", "above the maximum"),
        ({"vary": [["person-1.pos.x", "HOMOGENEOUS", 1, "5 miles", 1]]}, "vary.0.maximum", "unknown unit 'miles'"),
        ({"vary": [["person-1.pos.x", "HOMOGENEOUS", 1, "five", 1]]}, "vary.0.maximum", "a number in m"),
        ({"vary": [["person-1.pos.x", "CHOICE", "yellow-shirt"]]}, "vary.0.values.0", "takes a number"),
        ({"vary": [["person-1.character", "HOMOGENEOUS", 0, 1, 1]]}, "vary.0.distribution", "is CATEGORICAL"),
        ({"vary": [["person-1.character", "CHOICE", "yellow"]]}, "vary.0.values.0", "did you mean yellow-shirt"),
        ({"vary": [["person-1.character", "CHOICE", 3]]}, "vary.0.values.0", "got 3"),
        ({"vary": [["person-1.pos.x", "GAUSSIAN", 1, 0]]}, "vary.0.standard_deviation", "above 0"),
        ({"vary": [["person-1.pos.x", "GAUSSIAN", 1, 1]]}, "vary.0.count", "limit: count: N"),
        ({"vary": [["person-1.pos.x", "CHOICE", 1], [X, "CHOICE", 2]]}, "vary.1", "varied twice"),
        ({"vary": [["person-1.heading", "CHOICE", 0, 360]]}, "vary.0.values.1", "listed twice"),
        ({"constants": {"sun-1.elevation": 90}}, "constants.sun-1.elevation", "limit: 3…75 deg"),
        ({"constants": {"sun-1.elevatio": 40}}, "constants.sun-1.elevatio", "did you mean sun-1.elevation"),
        ({"constants": {"person-1.pos.x": 1, X: 2}}, f"constants.{X}", "two values"),
        ({"design": "points", "points": [{"person-1.pos.x": 1}, {"person-1.pos.x": 99}]}, "points.1.person-1.pos.x",
         "outside"),
        ({"constraints": ["person-1.pos.x <"]}, "constraints.0", "ends too early"),
        ({"parameters": [["p1", "scene.person-1.pos.q", "FLOAT", 0, 1]]}, "parameters.0.path", "did you mean"),
        ({"parameters": [["p1", X, "INT", 0, 1]]}, "parameters.0.type", "limit: FLOAT"),
        ({"parameters": [["p1", X, "FLOAT", -20, 1]]}, "parameters.0.minimum", "never widen"),
        ({"parameters": [["p1", X, "FLOAT", 0, 21]]}, "parameters.0.maximum", "never widen"),
        ({"parameters": [["p1", X, "FLOAT", 2, 1]]}, "parameters.0.minimum", "above the maximum"),
        ({"parameters": [["p1", X, "FLOAT", 0, 1], ["p2", X, "FLOAT", 0, 1]]}, "parameters.1.path", "parameters.0"),
        ({"parameters": [["person-1.pos.y", X, "FLOAT", 0, 1]]}, "parameters.0.name", "another parameter"),
    ],
)  # fmt: skip
def test_bad_input_is_named_by_its_field(street: Manifest, given: dict[str, Any], field: str, words: str) -> None:
    refusals = problems(street, **given)
    assert list(refusals) == [field]
    assert words in refusals[field]


def test_every_problem_is_listed(street: Manifest) -> None:
    refusals = problems(
        street,
        renderer="gl", cameras=["camera-9"], constants={"a": 1}, constraints=["b < 1"],
        vary=[["c", "CHOICE", 1], ["person-1.pos.x", "HOMOGENEOUS", 1, 2, 0]],
    )  # fmt: skip
    assert set(refusals) == {"renderer", "cameras.0", "constants.a", "constraints.0", "vary.0", "vary.1.step"}


def test_too_many_variants_are_refused_by_arithmetic(street: Manifest) -> None:
    tiny = problems(street, vary=[["person-1.pos.x", "HOMOGENEOUS", 0, 20, 1e-12]])
    assert tiny == {
        "vary.0.step": "vary.0.step: 20,000,000,000,001 variants are too many; got 1e-12; limit: 1,000,000 variants"
    }
    tiniest = problems(street, vary=[["person-1.pos.x", "HOMOGENEOUS", 0, 20, 1e-300]])["vary.0.step"]
    assert tiniest.startswith("vary.0.step: about 2e+301 variants are too many"), "not three hundred digits"
    product = problems(
        street, vary=[["person-1.pos.x", "HOMOGENEOUS", 0, 20, 0.01], ["person-1.pos.y", "HOMOGENEOUS", 0, 50, 0.01]]
    )
    assert product == {"blocks": "blocks: 10,007,001 variants are too many; limit: 1,000,000 variants"}
    drawn = problems(street, design="random", count=10**9, vary=[["person-1.pos.x", "UNIFORM", 0, 20]])
    assert list(drawn) == ["count"]


def test_a_billion_variants_resolve_where_they_are_allowed(street: Manifest) -> None:
    document = parse(
        {
            "name": "one",
            "asset": "urban-street",
            "vary": [
                ["person-1.pos.x", "HOMOGENEOUS", 0, 9.999, 0.001],
                ["person-1.pos.y", "HOMOGENEOUS", 0, 99.999, 0.001],
            ],
        }
    )
    run = resolve(document, street, max_variants=None)
    assert run.space.size == 10**9
    assert run.space[123_456_789].values == {X: 1.234, Y: 56.789}


def test_a_step_of_a_billionth_metre_in_a_sampled_design_is_too_fine_as_well(street: Manifest) -> None:
    refusals = problems(street, design="sobol", count=4, vary=[["person-1.pos.x", "HOMOGENEOUS", 0, 20, 1e-9]])
    assert list(refusals) == ["vary.0.step"]


def test_a_spec_may_say_what_a_parameter_stands_for_and_where_its_range_comes_from(street: Manifest) -> None:
    declared = {"path": Y, "type": "FLOAT", "from": "5 m", "to": "35 m"}
    plain, told = (
        resolved(street, parameters={"y": one})
        for one in (declared, declared | {"odd": "special structures", "source": "section 6.1"})
    )
    of_asset, of_spec = (
        next(definition for definition in run.definitions if definition.path == Y) for run in (plain, told)
    )
    assert (of_asset.odd, of_asset.source) == (street.by_path[Y].odd, street.by_path[Y].source)
    assert (of_spec.odd, of_spec.source, of_spec.maximum) == ("special structures", "section 6.1", 35.0)
    assert plain.spec.digest != told.spec.digest


def test_fields_at_their_defaults_do_not_change_the_digest(street: Manifest) -> None:
    declared = {"path": Y, "type": "FLOAT"}
    plain = resolved(street, parameters={"y": declared})
    assert plain.spec.digest == resolved(street, parameters={"y": declared | {"odd": None, "source": ""}}).spec.digest
