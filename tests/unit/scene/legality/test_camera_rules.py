"""Cameras inside movers, against outlines that shapely moves."""

import numpy as np
import pytest
import shapely
from shapely import affinity

from valerie.parameters.definitions import Value
from valerie.scene.assets.manifest import Footprint, Manifest
from valerie.scene.legality.rejection import rejection_reason
from valerie.testing.assets import simple_manifest

PLACE = (2.0, 8.0)
#: Its outline on that place; 1.5 m high.
CAR = shapely.box(1.1, 5.9, 2.9, 10.1)
CAMERA = (0.0, -4.0, 1.4)


def street(camera: tuple[float, float, float] = CAMERA, *, axes: str = "xyz", visible: bool = True) -> Manifest:
    """The boxes, free of people, with a camera that has a place and a car that moves."""
    document = simple_manifest().model_dump(mode="json")
    car = Footprint(path="scene.car-1", polygon=tuple(CAR.exterior.coords)[:-1], height_m=1.5)
    others = [obstacle for obstacle in document["obstacles"] if obstacle["path"] != "scene.car-1"]
    free = [parameter for parameter in document["parameters"] if not parameter["path"].startswith("scene.camera-1.pos")]
    place = [
        {"path": f"scene.camera-1.pos.{axis}", "minimum": -40, "maximum": 80, "default": value}
        for axis, value in zip("xyz", camera, strict=True)
        if axis in axes
    ]
    pose = [
        *({"path": f"scene.car-1.pos.{axis}", "minimum": -40, "maximum": 80, "default": value}
          for axis, value in zip("xy", PLACE, strict=True)),
        {"path": "scene.car-1.heading", "default": 0},
        {"path": "scene.car-1.visible", "default": visible},
    ]  # fmt: skip
    parameters = [*free, *place, *pose]
    return Manifest.model_validate(
        {**document, "obstacles": [*others, car.model_dump()], "parameters": parameters, "extent": (-40, -40, 40, 80)}
    )


def camera(x: float, y: float, z: float) -> dict[str, Value]:
    return {f"scene.camera-1.pos.{axis}": value for axis, value in zip("xyz", (x, y, z), strict=True)}


def car(x: float, y: float, heading: float = 0.0, *, visible: bool = True) -> dict[str, Value]:
    pose: dict[str, Value] = {"scene.car-1.pos.x": x, "scene.car-1.pos.y": y, "scene.car-1.heading": heading}
    return {**pose, "scene.car-1.visible": visible}


INSIDE = "camera-1 is inside car-1"


@pytest.mark.parametrize(
    ("assignment", "reason"),
    [
        (car(0.5, -4.0), INSIDE),  # the camera is where it always is
        (car(0.5, -4.0, visible=False), None),
        (car(0.0, -10.0), None),
        (camera(2.0, 8.0, 1.0), INSIDE),  # the car is where it always is
        (camera(2.0, 8.0, 1.6), None),  # above its roof
        (camera(2.0, 20.0, 1.0), None),
        (camera(0.5, 30.0, 1.0) | car(0.0, 30.0), INSIDE),
        (camera(1.4, 30.0, 1.0) | car(0.0, 30.0), None),
        (camera(1.4, 30.0, 1.0) | car(0.0, 30.0, 90.0), INSIDE),  # it stands across
        ({"scene.camera-1.pos.y": 8.0, "scene.camera-1.pos.x": 2.0}, INSIDE),  # its height is the asset's
        ({}, None),
    ],
)
def test_a_camera_inside_a_mover_is_rejected(assignment: dict[str, Value], reason: str | None) -> None:
    assert rejection_reason(assignment, street()) == reason


def test_every_camera_is_judged_like_an_outline_that_shapely_moves() -> None:
    manifest, judged = street(), []
    for x, y, heading in np.random.default_rng(6).uniform((-3, -8, 0), (3, 0, 360), (800, 3)).tolist():
        turned = affinity.rotate(CAR, heading, origin=PLACE)
        distance = affinity.translate(turned, x - PLACE[0], y - PLACE[1]).distance(shapely.Point(CAMERA[:2]))
        # Round corners have 64 sides, which pass up to r (1 − cos π/64) = 6e-5 m inside the circle.
        if abs(distance - 0.05) > 1e-4:
            judged.append(rejection_reason(car(x, y, heading), manifest) is None)
            assert judged[-1] == (distance > 0.05), (x, y, heading)
    # A car's outline with a rim of 5 cm lies wholly within the 6 × 8 m: five standard deviations of the share that it covers.
    share = CAR.buffer(0.05).area / 48.0
    expected = pytest.approx(share, abs=5 * (share * (1 - share) / len(judged)) ** 0.5)
    assert 1 - sum(judged) / len(judged) == expected


def test_a_thing_without_values_in_the_variant_is_not_judged() -> None:
    manifest = street((2.0, 8.0, 1.0), visible=False)
    shown = {"scene.car-1.visible": True}
    assert rejection_reason({"scene.person-1.pos.x": 0.0}, manifest) is None
    assert rejection_reason(shown, manifest) == INSIDE


def test_a_camera_that_its_author_put_into_a_vehicle_is_the_vehicles() -> None:
    manifest = street((2.0, 8.0, 1.0))
    assert rejection_reason(camera(2.0, 9.0, 1.0), manifest) is None
    assert rejection_reason(camera(2.0, 30.0, 1.0) | car(2.0, 30.0), manifest) is None
    assert rejection_reason(camera(-6.0, 15.0, 1.0), manifest) == "camera-1 is inside building-1"


def test_a_camera_whose_place_is_not_known_is_not_judged() -> None:
    assert rejection_reason(car(0.0, -4.0), street(axes="xy")) is None
