"""The places beside the street: the contract of all packs, closed ground, legality, signals, persons in their pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely

from tests.urban_street.ground_rays import Street, assert_closed
from urban_street.street.build import build_street
from urban_street.street.shapes import PHASES
from valerie.parameters.odd import OddAttribute
from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.scene.assets.asset import asset_manifest, asset_names, default_pack, load_asset, load_pack
from valerie.scene.assets.attributes import ABSENT
from valerie.scene.legality.rejection import rejection_reason
from valerie.scene.variation.variant import apply
from valerie.testing.asset_packs import AssetContract

PLACES = ("street-crossing", "rural-road", "car-park", "bus-stop", "motorway-exit")


class PlaceContract(AssetContract):
    arguments = {"persons": 1}  # noqa: RUF012
    other = {"seed": 7}  # noqa: RUF012


class TestCrossing(PlaceContract):
    name = "street-crossing"


class TestRuralRoad(PlaceContract):
    name = "rural-road"


class TestCarPark(PlaceContract):
    name = "car-park"


class TestBusStop(PlaceContract):
    name = "bus-stop"


class TestMotorwayExit(PlaceContract):
    name = "motorway-exit"


def test_the_street_applies_where_no_asset_is_named() -> None:
    assert default_pack() == "urban-street" == asset_names()[0]
    assert set(PLACES) < set(asset_names())


def layout_of(name: str, seed: int) -> Any:
    pack: Any = load_pack(name)
    return pack.site(pack.Settings(seed=seed)).layout


@pytest.mark.parametrize("name", PLACES)
def test_no_ray_finds_an_underside_of_the_ground_or_a_gap(name: str) -> None:
    layout = layout_of(name, 3)
    x0, y0, x1, y1 = layout.extent
    assert_closed(Street.of(layout, build_street(layout), ((x0, y0, 0.25), (x1, y1, 3.0))), 60_000, seed=7, reach=35.0)


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("seed", [0, 1, 2, 3, 17])
def test_everything_stands_legally_by_default_with_everybody_there(name: str, seed: int) -> None:
    pack: Any = load_pack(name)
    most = next(bound.le for bound in pack.Settings.model_fields["persons"].metadata if hasattr(bound, "le"))
    manifest, _ = asset_manifest({"name": name, "seed": seed, "persons": most})
    everything = {d.path: d.check(d.default) for d in manifest.parameters if not d.path.startswith("scene.sun-1.")}
    everything |= {path: True for path in everything if path.endswith(".visible")}
    everything |= {path: manifest.by_path[path].choices[0] for path, value in everything.items() if value == ABSENT}
    assert rejection_reason(everything, manifest) is None
    outlines = [shapely.Polygon(o.polygon) for o in manifest.obstacles]
    people = [
        (manifest.by_path[f"{p}.pos.x"].default, manifest.by_path[f"{p}.pos.y"].default) for p in manifest.persons
    ]
    for place in people:
        assert min(shapely.distance(shapely.Point(place), outlines)) >= manifest.person_radius_m


@pytest.mark.parametrize(
    ("name", "x", "y", "reason"),
    [
        ("street-crossing", 14.0, 40.0, "building-"), ("street-crossing", 20.6, 21.9, "car-"),
        ("street-crossing", 8.1, 5.9, "pole-"),
        ("rural-road", -6.5, 20.0, "in the ditch"), ("rural-road", 4.5, 20.0, "guard-rail-"),
        ("car-park", 5.6, 24.7, "static-"), ("car-park", -9.2, 18.0, "pole-"),
        ("bus-stop", 9.6, 19.0, "static-"), ("bus-stop", 5.0, 30.0, "bus-101"), ("motorway-exit", 8.6, 18.0, "car-1"),
        ("motorway-exit", 10.35, 0.0, "guard-rail-"), ("motorway-exit", 1.9, 58.0, "truck-101"),
    ],
)  # fmt: skip
def test_nobody_stands_in_a_thing_or_a_ditch(name: str, x: float, y: float, reason: str) -> None:
    manifest, _ = asset_manifest(name)
    given = rejection_reason({"scene.person-1.pos.x": x, "scene.person-1.pos.y": y}, manifest)
    assert given is not None
    assert reason in given


@pytest.mark.parametrize("name", PLACES)
def test_positions_and_light_of_a_place_have_their_attribute_of_the_domain(name: str) -> None:
    manifest, _ = asset_manifest(name)
    for path in manifest.persons:
        assert manifest.by_path[f"{path}.pos.x"].odd is OddAttribute.VULNERABLE_ROAD_USERS
        assert manifest.by_path[f"{path}.pos.x"].source == "the generated place"
    assert manifest.by_path["scene.environment-1.rain"].odd is OddAttribute.RAINFALL


def test_no_phase_of_the_signals_lets_two_conflicting_groups_go() -> None:
    conflicts = (("along", "across"), ("along", "over-along"), ("across", "over-across"))
    for phase, lit in PHASES.items():
        for first, second in conflicts:
            assert not ("green" in lit.get(first, ()) and "green" in lit.get(second, ())), (phase, first, second)
            assert not ("amber" in lit.get(first, ()) and "green" in lit.get(second, ())), (phase, first, second)


def test_one_parameter_sets_all_signals_of_a_crossing() -> None:
    asset = load_asset({"name": "street-crossing", "persons": 1})
    path = "scene.traffic-light-1.kind"
    assert asset.manifest.by_path[path].choices == tuple(PHASES)
    for phase in PHASES:
        scene = apply({path: phase}, asset)
        shown = [n for n in scene.nodes.values() if n.parent == "scene.traffic-light-1" and n.visible]
        assert [node.name for node in shown] == [phase]
        lit = {mesh.material for node in shown for mesh in node.meshes}
        expected = {f"signal-{aspect}" for aspects in PHASES[phase].values() for aspect in aspects}
        assert lit - {"signal-off"} == expected
        assert {node.label_id for node in shown} == {19}


@pytest.mark.gl
@pytest.mark.parametrize(
    ("name", "classes"),
    [
        ("street-crossing", {7, 8, 11, 17, 19, 20, 21, 23, 24, 26}), ("rural-road", {7, 14, 17, 20, 21, 22, 23, 24, 25, 26, 33}),
        ("car-park", {4, 7, 8, 11, 17, 21, 22, 24, 26}), ("bus-stop", {4, 7, 8, 11, 20, 24, 26, 28}),
        ("motorway-exit", {7, 14, 17, 20, 21, 22, 23, 24, 26, 27}),
    ],
)  # fmt: skip
def test_every_camera_sees_persons_in_a_place_of_its_classes(
    name: str, classes: set[int], truth_pass: TruthPass
) -> None:
    asset = load_asset(name)
    scene = apply({}, asset)
    seen: set[int] = set()
    for camera in asset.manifest.cameras:
        truth = truth_pass.truth(scene, View(camera, 480, 270))
        seen |= set(np.unique(truth.class_map).tolist())
        areas = [np.count_nonzero(truth.instance_map == person.instance_id) for person in truth.persons]
        assert sum(area >= 60 for area in areas) >= 2, camera
        assert set(np.unique(truth.class_map).tolist()) <= {*range(34)} - {0}
    assert classes <= seen
