from functools import cache
from importlib.resources import files
from pathlib import Path

import pytest

from tests.shipped import EXAMPLES, SPECS, STUDIES
from valerie.runs.forecasting.forecast import plan
from valerie.runs.forecasting.plan import Plan
from valerie.runs.products.inputs import ProductInputs
from valerie.runs.products.pins import Pins
from valerie.runs.resolving.spec import parse, resolve
from valerie.runs.study.study_document import parse_study
from valerie.scene.assets.asset import asset_manifest
from valerie.scene.legality.ground import ground_height

FUNCTIONS = ("deeplabv3plus-small", "semantic-fpn-small")


@cache
def planned(text: str) -> Plan:
    spec = parse(text)
    manifest, digest = asset_manifest(spec.asset)
    run = resolve(spec, manifest, asset_digest=digest, engines=("raster", "pyrender", "cycles"), functions=FUNCTIONS)
    assert run.warnings == ()
    return plan(run)


def test_the_first_run_is_large_enough_to_show_something() -> None:
    forecast = planned((EXAMPLES / "first-run.yaml").read_text("utf-8"))
    assert forecast.frames >= 120
    assert forecast.evaluations == 2 * forecast.frames
    assert len(forecast.cameras) == 3
    spec = parse((EXAMPLES / "first-run.yaml").read_text("utf-8"))
    assert spec.resolution.width >= 960
    assert spec.resolution.height >= 540
    suns = {one.values["sun-1.azimuth"] for one in (*forecast.first, *forecast.last)}
    assert len(suns) == 2


def test_the_papers_lists_give_its_ten_variants() -> None:
    forecast = planned((EXAMPLES / "paper-lists.yaml").read_text("utf-8"))
    assert forecast.variants == forecast.accepted == 10
    assert forecast.first[0].values == {"p1": 1.5, "p2": 4.0}
    assert forecast.last[-1].values == {"p1": 5.5, "p2": 5.0}


def test_the_papers_pattern_has_its_size() -> None:
    forecast = planned((EXAMPLES / "paper-pattern.yaml").read_text("utf-8"))
    assert forecast.variants == 10 * 16 * 8 * 4 * 2
    assert forecast.accepted > forecast.variants / 2
    assert all(reason.startswith("person-1 ") for reason in forecast.rejected)


def test_the_sensor_example_renders_nothing_after_the_first_run(pins: Pins) -> None:
    def rendered(name: str) -> set[str]:
        spec = parse((EXAMPLES / name).read_text("utf-8"))
        manifest, digest = asset_manifest(spec.asset)
        run = resolve(spec, manifest, asset_digest=digest)
        inputs = ProductInputs(run, asset_digest=digest, pins=pins)
        names: set[str] = set()
        for _, values in run.space.values(0, run.space.size):
            for camera in range(len(run.cameras)):
                names.update(inputs.frame(values, camera).products.required)
        return names

    assert rendered("sensor.yaml") < rendered("first-run.yaml")


@pytest.mark.parametrize("file", SPECS, ids=lambda file: file.name)
def test_every_example_can_be_planned(file: Path) -> None:
    assert planned(file.read_text("utf-8")).accepted > 0


@pytest.mark.parametrize("file", STUDIES, ids=lambda file: file.name)
def test_every_example_of_a_study_varies_parameters_of_its_asset(file: Path) -> None:
    spec = parse_study(file.read_text("utf-8")).spec
    manifest, _ = asset_manifest(spec.asset)
    varied = {varied.parameter for block in spec.blocks for varied in block.vary}
    names = {name for parameter in manifest.parameters for name in (parameter.name, parameter.path)}
    assert varied
    assert varied <= names


def test_the_template_of_a_new_spec_can_be_planned_as_it_is() -> None:
    text = files("valerie.runs").joinpath("template.yaml").read_text("utf-8")
    assert planned(text).frames > 0


def test_the_crossing_is_one_movement_in_twelve_timings_over_the_whole_street() -> None:
    text = (EXAMPLES / "crossing.yaml").read_text("utf-8")
    forecast = planned(text)
    assert (forecast.variants, forecast.accepted, forecast.moments, forecast.frames) == (12, 12, 8, 96)
    backgrounds = next(product for product in forecast.products if product.kind == "background")
    assert backgrounds.needed == 1
    spec = parse(text)
    manifest, _ = asset_manifest(spec.asset)
    run = resolve(spec, manifest)
    heights = {path: ground_height(manifest, x, 7.5) for path, x in (("left", -1.4), ("middle", 2.5), ("right", 6.4))}
    assert heights == {"left": 0.12, "middle": 0.0, "right": 0.12}
    for variant in run.space:
        ways = [[run.at(variant.values, i)[f"scene.person-{n}.pos.x"] for i in range(8)] for n in (1, 2)]
        assert all(min(way) < -0.8 for way in ways)
        assert all(max(way) > 5.8 for way in ways)


def test_a_bus_stands_between_the_camera_and_a_child_in_the_open() -> None:
    forecast = planned((EXAMPLES / "behind-the-bus.yaml").read_text("utf-8"))
    assert (forecast.variants, forecast.accepted, forecast.frames) == (14, 14, 28)
