"""Light and weather of a variant in numbers, and equal inputs of both notations of a sun."""

import json
from functools import partial

import pytest

from valerie.errors import InvalidInput
from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType
from valerie.scene.assets.manifest import Manifest
from valerie.scene.light.solar import AZIMUTH, CLOCK, CLOCK_PATHS, ELEVATION
from valerie.scene.variation.conditions import conditions, sun_by_time, with_sun_angles
from valerie.scene.variation.variant import complete, split
from valerie.testing.assets import simple_manifest

TIME, DAY = CLOCK_PATHS[:2]


@pytest.fixture(scope="module")
def street() -> Manifest:
    """The boxes, with a sun that both notations set, and rain."""
    declare = partial(ParameterDefinition, type=ParameterType.FLOAT, affects=Affects.LIGHT)
    boxes = simple_manifest()
    sun = (
        declare(path=AZIMUTH, type=ParameterType.ANGLE, minimum=0.0, maximum=360.0, default=180.0, unit="deg"),
        declare(path=ELEVATION, minimum=-20.0, maximum=75.0, default=40.0, unit="deg"),
        *(clock.definition() for clock in CLOCK),
        declare(path="scene.environment-1.rain", minimum=0.0, maximum=50.0, default=0.0, unit="mm/h"),
    )
    others = tuple(d for d in boxes.parameters if d.path not in (AZIMUTH, ELEVATION))
    return boxes.model_copy(update={"parameters": (*others, *sun)})


def test_the_defaults_are_the_declared_angles_and_a_dry_road(street: Manifest) -> None:
    measures = conditions({}, street)
    assert (measures.sun_azimuth_deg, measures.sun_elevation_deg, measures.road_friction) == (180.0, 40.0, 0.85)


def test_time_and_place_come_to_angles(street: Manifest) -> None:
    measures = conditions({TIME: 8.0, DAY: 172, "scene.environment-1.rain": 5.0}, street)
    # At 10° east 8:00 is 7:38 by the sun: 65.4° before noon, with a declination of 23.44° at 50° north.
    # `valerie.scene.light.solar` is accurate to 0.5°.
    assert measures.sun_azimuth_deg == pytest.approx(92.5, abs=0.5)
    assert measures.sun_elevation_deg == pytest.approx(33.4, abs=0.5)
    # In rain of 5 mm/h, a share exp(−5 / 0.8) = 0.002 of the road is still dry.
    assert measures.road_friction == pytest.approx(0.65, abs=5e-4)


def test_conditions_are_unknown_where_the_asset_declares_no_parameter_for_them() -> None:
    measures = conditions({}, simple_manifest())
    assert measures.sun_elevation_deg == 45.0
    assert measures.road_friction is None


def test_a_sun_gives_the_same_inputs_in_both_notations(street: Manifest) -> None:
    by_time = {TIME: 15.0, DAY: 250}
    angles = {path: complete(by_time, street)[path] for path in (AZIMUTH, ELEVATION)}
    assert split(by_time, street, "camera-1") == split(angles, street, "camera-1")


def test_time_and_place_are_inputs_of_nothing_where_the_angles_are_given(street: Manifest) -> None:
    assert not set(CLOCK_PATHS) & complete({}, street).keys()
    assert not set(CLOCK_PATHS) & complete({TIME: 9.0}, street).keys()


def test_the_sun_changes_the_light_and_never_the_truth(street: Manifest) -> None:
    noon, morning = split({TIME: 12.0}, street, "camera-1"), split({TIME: 9.0}, street, "camera-1")
    assert noon.geometry == morning.geometry
    assert noon.sensor == morning.sensor
    first, second = (json.loads(inputs.layer) for inputs in (noon, morning))
    changed = {path for path, value in first.items() if second[path] != value}
    assert changed == {AZIMUTH, ELEVATION}


def test_a_variant_with_both_notations_is_refused(street: Manifest) -> None:
    with pytest.raises(InvalidInput, match="given twice"):
        complete({TIME: 9.0, ELEVATION: 30.0}, street)


def test_tables_have_the_angles_of_a_sun_that_is_given_by_time(street: Manifest) -> None:
    spoken = with_sun_angles({TIME: 9.0, "scene.person-1.pos.x": 2.0}, street)
    assert (spoken[AZIMUTH], spoken[ELEVATION]) == sun_by_time({TIME: 9.0}, street)
    assert spoken[TIME] == 9.0
    assert with_sun_angles({ELEVATION: 20.0}, street) == {ELEVATION: 20.0}


def test_a_manifest_with_time_but_without_angles_is_refused() -> None:
    manifest = simple_manifest().model_dump()
    clock = {"path": TIME, "type": "FLOAT", "unit": "h", "minimum": 0, "maximum": 24, "default": 12, "affects": "light"}
    without = [p for p in manifest["parameters"] if p["path"] != AZIMUTH]
    with pytest.raises(InvalidInput, match="needs its two angles too"):
        Manifest.model_validate(manifest | {"parameters": [*without, clock]})
