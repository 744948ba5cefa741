"""The next spec from a run."""

from __future__ import annotations

from typing import Any

import pytest

from valerie.analysis.findings.refining import halved_spec
from valerie.analysis.findings.region import Choices, Range, Region
from valerie.errors import InvalidInput, UnknownName
from valerie.runs.document.run_spec import RunSpec
from valerie.runs.resolving.spec import parse, resolve
from valerie.testing.assets import simple_manifest

X, Y, COAT = "scene.person-1.pos.x", "scene.person-1.pos.y", "scene.person-1.character"


def refine(document: dict[str, Any], region: dict[str, Any] | None = None, **more: Any) -> RunSpec:
    manifest = simple_manifest()
    resolved = resolve(parse({"name": "a", "asset": "simple", **document}), manifest)
    spec = halved_spec(
        resolved.spec,
        resolved.space.blocks,
        resolved.space.definitions,
        Region(bounds=region or {}),
        run_id="r1",
        middle={X: 1.0, Y: 4.0},
        **more,
    )
    # What is written is a spec that resolves, and half as coarse.
    resolve(parse(spec.to_yaml()), manifest)
    return spec


GRID: dict[str, Any] = {
    "vary": [["person-1.pos.x", "HOMOGENEOUS", -2, 2, 1], ["person-1.pos.y", "HOMOGENEOUS", 3, 9, 2]]
}


def vary(spec: RunSpec) -> list[dict[str, Any]]:
    return [varied.model_dump(exclude_none=True) for varied in spec.blocks[0].vary]


def test_steps_are_halved_inside_the_region_and_old_steps_stay_on_the_grid() -> None:
    spec = refine(GRID, {X: Range(low=-0.5, high=1.5)})
    first, second = vary(spec)
    assert (first["minimum"], first["maximum"], first["step"]) == ("-0.5 m", "1.5 m", "0.5 m")
    assert (second["minimum"], second["maximum"], second["step"]) == ("3 m", "9 m", "1 m")
    assert (spec.parent_run, spec.iteration) == ("r1", 1)


def test_refining_twice_quarters_the_steps() -> None:
    once = refine(GRID)
    twice = refine(once.model_dump(mode="json", exclude_defaults=True) | {"name": once.name})
    assert (once.name, twice.name) == ("a refined", "a refined 2")
    assert vary(twice)[0]["step"] == "0.25 m"
    assert twice.iteration == 2


def test_a_parameter_is_dropped_to_its_middle_and_another_added_over_its_range() -> None:
    spec = refine(GRID, drop=[Y], add=["scene.sun-1.azimuth"])
    assert [varied["parameter"] for varied in vary(spec)] == ["person-1.pos.x", "sun-1.azimuth"]
    assert spec.blocks[0].constants == {Y: "4 m"}
    assert vary(spec)[1]["count"] == 3


def test_points_become_a_sampling_design_over_the_region() -> None:
    points = [{"person-1.pos.x": x, "person-1.pos.y": 5.0} for x in (-1.0, 0.0, 2.0)]
    spec = refine({"design": "points", "points": points}, {X: Range(low=-0.5, high=2.0)})
    assert (spec.blocks[0].design, spec.blocks[0].count) == ("sobol", 3)
    first, second = vary(spec)
    assert (first["distribution"], first["minimum"], first["maximum"]) == ("UNIFORM", "-0.5 m", "2 m")
    assert (second["distribution"], second["values"]) == ("CHOICE", ("5 m",))


def test_choices_keep_those_of_the_region() -> None:
    names = ["red-coat", "blue-coat"]
    spec = refine({"vary": [["person-1.character", "CHOICE", *names]]}, {COAT: Choices(names=("red-coat",))})
    assert vary(spec)[0]["values"] == ("red-coat",)


def test_wrong_names_and_an_empty_rest_are_refused() -> None:
    with pytest.raises(UnknownName, match="--drop"):
        refine(GRID, drop=["scene.sun-1.azimuth"])
    with pytest.raises(InvalidInput, match="nothing is left"):
        refine(GRID, drop=[X, Y])
