from typing import Any

import pytest

from valerie.errors import InvalidInputs
from valerie.runs.products.inputs import ProductInputs
from valerie.runs.products.pins import Pins
from valerie.runs.resolving.sensors import focal_length_mm
from valerie.runs.resolving.spec import ResolvedRun, parse, resolve
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.sensor_parameters import SENSOR_PARAMETERS
from valerie.testing.assets import simple_manifest


@pytest.fixture(scope="module")
def street(street: Manifest) -> Manifest:
    """The street of these tests, also by night, with every parameter of the sensor."""
    others = (
        d.model_copy(update={"minimum": -20.0}) if d.path == "scene.sun-1.elevation" else d
        for d in street.parameters
        if not d.path.startswith("sensor.")
    )
    sensor = (row.definition() for row in SENSOR_PARAMETERS.values())
    return street.model_copy(update={"parameters": (*others, *sensor)})


def resolved(manifest: Manifest, **entries: Any) -> ResolvedRun:
    return resolve(parse({"name": "one", "asset": manifest.name, "functions": ["f"], **entries}), manifest)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("sensor.noise.read_electrons", "4 electrons"),
        ("sensor.lens.focus_distance_m", "150 cm"),
        ("sensor.noise.shot", True),
        ("sensor.curve", "blender-filmic"),
        ("sensor.jpeg_quality", 40),
        ("sensor.pixels.hot_rate", "0.1 %"),
        ("sensor.specimen", 3),
    ],
)
def test_every_kind_of_parameter_can_be_set_in_a_spec(street: Manifest, name: str, value: Any) -> None:
    space = resolved(street, constants={name: value}).space
    assert name in space[0].values


def test_focal_length_is_the_variants_or_the_assets(street: Manifest) -> None:
    path = "scene.camera-1.focal_length_mm"
    assert focal_length_mm(street, "camera-1", {}) == street.by_path[path].default
    assert focal_length_mm(street, "camera-1", {path: 24.0}) == 24.0


@pytest.mark.parametrize(
    "entries",
    [
        {"sensors": [{"distortion": {"k1": 0.1}}]},
        {"sensors": [{"lens": {"vignetting": 1}}]},
        {"sensors": [{"lens": {"f_number": 2}}]},
    ],
)
def test_an_effect_that_needs_an_undeclared_focal_length_is_refused(entries: dict[str, Any]) -> None:
    manifest = simple_manifest()  # only its second camera declares one
    with pytest.raises(InvalidInputs, match=r"scene\.camera-1\.focal_length_mm"):
        resolved(manifest, **entries)
    resolved(manifest, **entries, cameras=["camera-2"])


def test_a_plan_says_that_defocus_waits_for_the_truth(street: Manifest) -> None:
    (warning,) = resolved(street, sensors=[{"name": "fast", "lens": {"f_number": 2}}]).warnings
    assert "fast" in warning
    assert "depth" in warning
    varied = resolved(street, vary={"sensor.lens.f_number": {"choice": [1.4, 2.8]}}).warnings
    assert any("depth" in text for text in varied)


def test_a_plan_warns_of_pictures_that_will_be_black(street: Manifest) -> None:
    night = {"constants": {"scene.sun-1.elevation": "-12 deg"}}
    (warning,) = resolved(
        street, **night, sensors=[{"name": "day"}, {"name": "metered", "auto_exposure": True}]
    ).warnings
    assert "sensor day: with the sun 12° below the horizon" in warning
    assert "auto_exposure: true" in warning
    assert resolved(street, **night, sensors=[{"name": "long", "exposure_ev": 10}]).warnings == ()
    assert resolved(street, constants={"scene.sun-1.elevation": "-2 deg"}, sensors=[{"name": "day"}]).warnings == ()
    assert resolved(street, **night).warnings == ()  # without sensors, the camera meters


def test_a_plan_warns_of_pictures_that_will_be_white(street: Manifest) -> None:
    day = {"constants": {"scene.sun-1.elevation": "30 deg"}}
    (warning,) = resolved(street, **day, sensors=[{"name": "night", "exposure_ev": 8}, {"name": "day"}]).warnings
    assert "sensor night: with the sun 30° above the horizon" in warning
    assert "gives white pictures" in warning


@pytest.mark.parametrize(
    ("vary", "reason"),
    [
        ({"sensor.lens.focus_distance_m": {"choice": [2, 5]}}, "lens.f_number"),
        ({"sensor.noise.full_well_electrons": {"choice": [2000, 5000]}}, "noise.shot"),
        ({"sensor.specimen": {"choice": [1, 2]}}, "soiling.dirt"),
    ],
)
def test_a_plan_warns_of_values_that_change_nothing(street: Manifest, vary: dict[str, Any], reason: str) -> None:
    (warning,) = resolved(street, vary=vary, sensors=[{"name": "neutral"}]).warnings
    assert "changes nothing" in warning
    assert reason in warning


@pytest.mark.parametrize(
    ("sensor", "seeded", "with_truth"),
    [
        ({}, False, False),
        ({"lens": {"vignetting": 1}}, False, False),
        ({"noise": {"shot": True}}, True, False),
        ({"soiling": {"drops": 0.1}}, True, False),
        ({"lens": {"f_number": 2}}, False, True),
    ],
)
def test_a_prediction_depends_on_seed_and_truth_only_where_its_sensor_does(
    street: Manifest, pins: Pins, sensor: dict[str, Any], *, seeded: bool, with_truth: bool
) -> None:
    pins = pins.model_copy(update={"functions": {"f": next(iter(pins.functions.values()))}})

    def prediction(seed: int = 0, revision: int = 1) -> str:
        run = resolved(street, sensors=[sensor], seed=seed)
        own = pins.model_copy(update={"truth": pins.truth.model_copy(update={"revision": revision})})
        return ProductInputs(run, asset_digest="a", pins=own).frame({}, 0).evaluations[0].prediction

    assert (prediction(seed=1) != prediction()) is seeded
    assert (prediction(revision=9) != prediction()) is with_truth
