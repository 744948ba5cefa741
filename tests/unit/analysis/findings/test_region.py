import numpy as np
import pytest

from valerie.analysis.findings.region import Arc, Choices, Range, Region, region_of
from valerie.errors import InvalidInput
from valerie.parameters.definitions import ParameterType

FLOAT, ANGLE, NAME = ParameterType.FLOAT, ParameterType.ANGLE, ParameterType.CATEGORICAL


def bound(some: list[object], every: list[object], kind: ParameterType) -> object:
    rows = [[{"q": value} for value in values] for values in (some, every)]
    return region_of(rows[0], rows[1], {"q": kind}).bounds.get("q")


def test_a_range_holds_the_middle_of_the_selected_rows() -> None:
    every = np.linspace(10, 50, 401).tolist()
    limits = bound([*np.linspace(30, 50, 200), 11.0], every, FLOAT)
    assert isinstance(limits, Range)
    assert limits.low == pytest.approx(30.9, abs=0.4)
    assert limits.high == pytest.approx(49.0, abs=0.4)


def test_one_step_of_a_grid_reaches_half_way_to_its_neighbours() -> None:
    assert bound([20.0, 20.0], [10.0, 20.0, 40.0], FLOAT) == Range(low=15.0, high=30.0)
    assert bound([40.0], [10.0, 20.0, 40.0], FLOAT) == Range(low=30.0, high=50.0)


def test_a_quantity_that_the_selection_does_not_narrow_is_free() -> None:
    every = np.linspace(0, 1, 50).tolist()
    assert bound(every, every, FLOAT) is None
    assert bound([5.0], [5.0, 5.0], FLOAT) is None  # constant in the run
    assert bound(["a", "b"], ["a", "b", "a"], NAME) is None
    assert bound([0.0, 90.0, 180.0, 270.0], [0.0, 90.0, 180.0, 270.0], ANGLE) is None


def test_an_arc_may_contain_north() -> None:
    arc = bound([315.0, 0.0, 45.0], [float(a) for a in range(0, 360, 45)], ANGLE)
    assert arc == Arc(start=292.5, width=135.0)
    assert isinstance(arc, Arc)
    assert arc.holds(359)
    assert arc.holds(0)
    assert not arc.holds(90)
    assert not arc.holds(270)


def test_choices_are_the_names_that_cover_the_selection() -> None:
    assert bound(["black"] * 30 + ["yellow"], ["black", "yellow"], NAME) == Choices(names=("black",))


def test_a_missing_quantity_is_outside_but_may_not_be_measured_yet() -> None:
    region = Region(bounds={"distance_m": Range(low=1, high=2), "occlusion_rate": Range(low=0, high=0.5)})
    assert region.holds({"distance_m": 1.5, "occlusion_rate": 0.1})
    assert not region.holds({"distance_m": 1.5, "occlusion_rate": None})
    assert not region.holds({"distance_m": 1.5})
    assert region.allows({"distance_m": 1.5})
    assert not region.allows({"distance_m": 2.5})


def test_a_region_survives_json() -> None:
    region = Region(
        bounds={"a": Range(low=0, high=1), "b": Arc(start=10, width=20), "c": Choices(names=("x",))}, rows=3
    )
    assert Region.model_validate_json(region.model_dump_json()) == region
    assert str(region) == "a 0 … 1; b 10° … 30°; c x"


def test_an_empty_selection_is_refused() -> None:
    with pytest.raises(InvalidInput, match="no row"):
        region_of([], [{"q": 1.0}], {"q": FLOAT})
