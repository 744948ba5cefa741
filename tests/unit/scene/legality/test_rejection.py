"""Legality against distances measured with shapely."""

import numpy as np
import pytest
import shapely

from valerie.errors import InvalidInput
from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType, Value
from valerie.scene.assets.manifest import Footprint, Manifest
from valerie.scene.legality.rejection import rejection_reason, rejection_reasons
from valerie.testing.assets import simple_manifest

MANIFEST = simple_manifest()


def at(x: float, y: float, person: str = "person-1") -> dict[str, Value]:
    return {f"scene.{person}.pos.x": x, f"scene.{person}.pos.y": y}


def with_camera_position(manifest: Manifest) -> Manifest:
    position = [
        ParameterDefinition(
            path=f"scene.camera-1.pos.{axis}", type=ParameterType.FLOAT, minimum=-10, maximum=10, unit="m",
            default=value, affects=Affects.GEOMETRY,
        )
        for axis, value in (("y", -2.0), ("z", 1.5))
    ]  # fmt: skip
    return manifest.model_copy(update={"parameters": (*manifest.parameters, *position)})


def test_a_place_on_the_free_ground_is_legal() -> None:
    assert rejection_reason(at(0, 20), MANIFEST) is None
    assert rejection_reason({}, MANIFEST) is None


@pytest.mark.parametrize(
    ("x", "y", "reason"),
    [
        (-6, 15, "person-1 stands inside building-1"),
        (2, 8, "person-1 stands inside car-1"),
        (2.9 + 0.29, 8, "person-1 stands inside car-1"),
    ],
)
def test_the_reason_names_person_and_obstacle(x: float, y: float, reason: str) -> None:
    assert rejection_reason(at(x, y), MANIFEST) == reason


def test_beside_an_obstacle_there_is_room_from_the_radius_on() -> None:
    assert rejection_reason(at(2.9 + 0.31, 8), MANIFEST) is None


def test_outside_the_extent_is_outside_the_asset() -> None:
    narrow = MANIFEST.model_copy(update={"extent": (-1.0, 0.0, 1.0, 50.0)})
    assert rejection_reason(at(1.5, 10), narrow) == "person-1 is outside the asset"


def test_an_absent_person_may_be_anywhere() -> None:
    assert rejection_reason({**at(-6, 15), "scene.person-1.character": "absent"}, MANIFEST) is None


def test_two_persons_in_one_place_overlap_unless_one_is_absent() -> None:
    both = {**at(0, 20), **at(0.5, 20, "person-2"), "scene.person-2.character": "blue-coat"}
    assert rejection_reason(both, MANIFEST) == "person-1 and person-2 overlap"
    assert rejection_reason({**both, "scene.person-2.character": "absent"}, MANIFEST) is None
    assert rejection_reason({**both, "scene.person-2.pos.x": 0.61}, MANIFEST) is None


def test_every_place_is_judged_by_its_distance_to_the_obstacles() -> None:
    polygons = [shapely.Polygon(obstacle.polygon) for obstacle in MANIFEST.obstacles]
    places = np.random.default_rng(3).uniform((-10, 0), (5, 22), (2000, 2))
    reasons = rejection_reasons([at(*place) for place in places.tolist()], MANIFEST)
    for (x, y), reason in zip(places, reasons, strict=True):
        distance = min(polygon.distance(shapely.Point(x, y)) for polygon in polygons)
        # Round corners have 64 sides, which pass up to r (1 − cos π/64) = 0.0012 r inside the circle.
        if abs(distance - MANIFEST.person_radius_m) > 0.0013 * MANIFEST.person_radius_m:
            assert (reason is None) == (distance > MANIFEST.person_radius_m), (x, y)


def test_a_camera_inside_a_building_is_rejected_but_not_one_above_a_low_obstacle() -> None:
    manifest = MANIFEST.model_copy(
        update={
            "obstacles": (
                Footprint(path="scene.building-1", polygon=((-4, -3), (-1, -3), (-1, 0), (-4, 0))),
                Footprint(path="scene.car-1", polygon=((1, -3), (4, -3), (4, 0), (1, 0)), height_m=1.4),
            )
        }
    )
    manifest = with_camera_position(manifest)
    assert rejection_reason({"scene.camera-1.pos.x": -2.0}, manifest) == "camera-1 is inside building-1"
    assert rejection_reason({"scene.camera-1.pos.x": 2.0}, manifest) is None
    assert rejection_reason({"scene.camera-1.pos.x": 2.0, "scene.camera-1.pos.z": 1.0}, manifest) is not None


def with_moving_car() -> Manifest:
    pose = [
        {"path": "scene.car-1.pos.x", "minimum": -10, "maximum": 10, "default": 2},
        {"path": "scene.car-1.pos.y", "minimum": 0, "maximum": 50, "default": 8},
        {"path": "scene.car-1.heading", "default": 0},
        {"path": "scene.car-1.visible", "default": True},
    ]
    document = MANIFEST.model_dump()
    return Manifest.model_validate({**document, "parameters": [*document["parameters"], *pose]})


@pytest.mark.parametrize(
    ("car", "place", "free"),
    [
        ({}, (2, 8), False),
        ({"pos.x": -3, "pos.y": 30}, (2, 8), True),
        ({"pos.x": -3, "pos.y": 30}, (-3, 32), False),
        ({"pos.x": -3, "pos.y": 30, "heading": 90}, (-3, 32), True),
        ({"pos.x": -3, "pos.y": 30, "heading": 90}, (-1, 30), False),
        ({"pos.x": -3, "pos.y": 30, "heading": 45}, (-3 - 1.3, 30 + 1.3), False),
        ({"pos.x": -3, "pos.y": 30, "heading": 45}, (-3 + 1.3, 30 + 1.3), True),
        ({"visible": False}, (2, 8), True),
    ],
)
def test_an_obstacle_that_moves_blocks_where_it_is(
    car: dict[str, Value], place: tuple[float, float], free: bool
) -> None:
    assignment = {**at(*place), **{f"scene.car-1.{name}": value for name, value in car.items()}}
    assert (rejection_reason(assignment, with_moving_car()) is None) == free


def test_an_obstacle_that_turns_without_a_position_is_refused() -> None:
    document = MANIFEST.model_dump()
    turning = {"path": "scene.car-1.heading", "default": 0}
    with pytest.raises(InvalidInput, match="turns or scales needs"):
        Manifest.model_validate({**document, "parameters": [*document["parameters"], turning]})
