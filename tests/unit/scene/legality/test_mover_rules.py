"""Legality of movers, against outlines that shapely moves."""

import numpy as np
import pytest
import shapely
from shapely import affinity

from tests.sampling import enough_to_show
from tests.world.boxes import CAR_PLACE, pose, traffic
from valerie.errors import InvalidInput
from valerie.parameters.definitions import Value
from valerie.scene.assets.manifest import Footprint, GroundRegion, Manifest
from valerie.scene.legality.rejection import rejection_reason

#: Outline of the car at its default place.
CAR = shapely.box(1.1, 5.9, 2.9, 10.1)
MANIFEST = traffic()


def car(x: float, y: float, heading: float = 0.0) -> dict[str, Value]:
    return {"scene.car-1.pos.x": x, "scene.car-1.pos.y": y, "scene.car-1.heading": heading}


def bicycle(x: float, y: float) -> dict[str, Value]:
    return {"scene.bicycle-1.visible": True, "scene.bicycle-1.pos.x": x, "scene.bicycle-1.pos.y": y}


@pytest.mark.parametrize(
    ("assignment", "reason"),
    [
        (car(-2.0, 30.0), None),
        (car(-4.0, 14.0), "car-1 stands inside building-1"),
        (car(0.0, 9.0), "person-1 stands inside car-1"),
        (car(4.6, 30.0), "car-1 leaves its level ground"),  # the pavement begins at x = 5 and is 0.25 m high
        (car(4.2, 30.0), None),  # a few centimetres of bumper hang over it
        (car(0.0, 60.0), "car-1 is outside the asset"),
        (car(0.0, 32.0) | bicycle(0.0, 30.0), "car-1 and bicycle-1 overlap"),
        (car(0.0, 32.0) | bicycle(2.0, 30.0), None),
        (car(0.0, 32.0), None),  # the bicycle is hidden
        (bicycle(2.0, 9.0), "car-1 and bicycle-1 overlap"),  # the car is where it always is
        (bicycle(0.0, 9.5), "person-1 stands inside bicycle-1"),
    ],
)
def test_a_mover_has_room_or_the_reason_is_given(assignment: dict[str, Value], reason: str | None) -> None:
    assert rejection_reason(assignment, MANIFEST) == reason


def test_a_persons_fault_is_named_before_a_vehicles() -> None:
    assignment = {**car(-4.0, 14.0), "scene.person-1.pos.x": -6.0, "scene.person-1.pos.y": 15.0}
    assert rejection_reason(assignment, MANIFEST) == "person-1 stands inside building-1"


def test_every_pose_is_judged_like_an_outline_that_shapely_moves() -> None:
    building = shapely.box(-8, 12, -4, 18)
    judged = []
    for x, y, heading in np.random.default_rng(4).uniform((-12, 3, 0), (-1, 27, 360), (1500, 3)).tolist():
        turned = affinity.rotate(CAR, heading, origin=CAR_PLACE)
        moved = affinity.translate(turned, x - CAR_PLACE[0], y - CAR_PLACE[1])
        near_person = moved.distance(shapely.Point(0, 10)) < 0.4
        # A rim of 1 cm of both outlines may overlap, along at most 6 m: 0.12 m².
        if near_person or 0.0 < moved.intersection(building).area < 0.2:
            continue
        free = rejection_reason(car(x, y, heading), MANIFEST) is None
        assert free == (not moved.intersects(building)), (x, y, heading)
        judged.append(free)
    assert min(sum(judged), len(judged) - sum(judged)) >= enough_to_show(0.01)


def test_the_default_place_is_legal_whatever_its_outline_overlaps() -> None:
    carport = Footprint(path="scene.building-2", polygon=((0.5, 4), (4, 4), (4, 12), (0.5, 12)))
    kerb = GroundRegion(polygon=((2, -5), (20, -5), (20, 55), (2, 55)), height=0.25)
    manifest = traffic(carport, ground=[kerb.model_dump()], extent=(-20, 9, 20, 55))
    assert rejection_reason(car(*CAR_PLACE), manifest) is None
    assert rejection_reason(car(2.0, 9.0), manifest) is None
    assert rejection_reason(car(-4.0, 14.0), manifest) == "car-1 stands inside building-1"


def test_a_mover_that_is_hidden_by_default_is_judged_at_its_default_place_too() -> None:
    wall = Footprint(path="scene.wall-1", polygon=((-1, 28), (1, 28), (1, 32), (-1, 32)))
    assert rejection_reason({"scene.bicycle-1.visible": True}, traffic(wall)) == "bicycle-1 stands inside wall-1"
    assert rejection_reason({"scene.bicycle-1.pos.x": 0.2}, traffic(wall)) is None


def with_house(**more: object) -> Manifest:
    """A house, 6 m wide and 4 m deep, whose front ends at (-5, 36), beside a way; another stands two metres farther along."""
    document = traffic().model_dump(mode="json")
    document["obstacles"] += [
        {"path": "scene.building-8", "polygon": [(-9, 36), (-5, 36), (-5, 42), (-9, 42)], "height_m": 8.0},
        {"path": "scene.building-9", "polygon": [(-9, 44), (-5, 44), (-5, 54), (-9, 54)]},
    ]
    way = [(-5, 0), (-3, 0), (-3, 50), (-5, 50)]
    document["ways"] = [{"path": "scene.sidewalk-9", "polygon": way, "reason": "on sidewalk-9"}]
    document["parameters"] += [
        {"path": "scene.building-8.pos.x", "minimum": -9, "maximum": 0, "default": -5},
        {"path": "scene.building-8.pos.y", "minimum": 30, "maximum": 40, "default": 36},
        {"path": "scene.building-8.rot.z", "minimum": 60, "maximum": 120, "default": 90},
        {"path": "scene.building-8.scale", "minimum": 0.5, "maximum": 2, "default": 1},
    ]
    return Manifest.model_validate({**document, **more})


def house(**values: float) -> dict[str, Value]:
    return {f"scene.building-8.{name.replace('_', '.')}": value for name, value in values.items()}


def test_a_house_keeps_off_ways_and_neighbours() -> None:
    manifest = with_house()
    assert rejection_reason(house(pos_x=-6.0), manifest) is None
    assert rejection_reason(house(pos_x=-4.9), manifest) == "building-8 stands on sidewalk-9"
    assert rejection_reason(house(pos_y=37.9), manifest) is None
    assert rejection_reason(house(pos_y=38.1), manifest) == "building-8 stands inside building-9"
    assert rejection_reason(house(rot_z=70.0), manifest) == "building-8 stands on sidewalk-9"


def test_an_outline_grows_and_shrinks_about_its_place() -> None:
    manifest = with_house()
    assert rejection_reason(house(scale=1.3), manifest) is None
    assert rejection_reason(house(scale=1.35), manifest) == "building-8 stands inside building-9"
    beside: dict[str, Value] = {"scene.person-1.pos.x": -7.0, "scene.person-1.pos.y": 42.5}
    assert rejection_reason(beside, manifest) is None
    assert rejection_reason({**beside, **house(scale=1.1)}, manifest) == "person-1 stands inside building-8"
    within: dict[str, Value] = {"scene.person-1.pos.x": -7.0, "scene.person-1.pos.y": 41.5}
    assert rejection_reason(within, manifest) == "person-1 stands inside building-8"
    assert rejection_reason({**within, **house(scale=0.88)}, manifest) == "person-1 stands inside building-8"
    # 36 + 0.86 · 6 = 41.16 m, and 0.3 m of room.
    assert rejection_reason({**within, **house(scale=0.86)}, manifest) is None


def test_a_vehicle_is_not_kept_off_the_ways() -> None:
    way = {"path": "scene.road-9", "polygon": [(-2, 0), (4, 0), (4, 60), (-2, 60)], "reason": "on road-9"}
    assert rejection_reason(car(2.0, 9.0), with_house(ways=[way])) is None


def test_an_obstacle_that_changes_its_size_without_a_position_is_refused() -> None:
    document = traffic().model_dump(mode="json")
    scaled = {"path": "scene.building-1.scale", "minimum": 0.5, "maximum": 2, "default": 1}
    with pytest.raises(InvalidInput, match="turns or scales"):
        Manifest.model_validate({**document, "parameters": [*document["parameters"], scaled]})


def test_a_thing_without_values_in_the_variant_is_not_judged() -> None:
    manifest = traffic(Footprint(path="scene.wall-1", polygon=((-1, 28), (1, 28), (1, 32), (-1, 32))))
    assert rejection_reason({"scene.person-1.pos.x": -1.0}, manifest) is None


def test_touching_is_not_overlapping() -> None:
    manifest = traffic(Footprint(path="scene.wall-1", polygon=((-4, 20), (-3, 20), (-3, 40), (-4, 40))))
    assert rejection_reason(car(-2.1, 30.0), manifest) is None
    assert rejection_reason(car(-2.15, 30.0), manifest) == "car-1 stands inside wall-1"


def test_a_grounded_mover_may_stand_on_every_level_but_on_no_step() -> None:
    manifest = traffic(grounded=["scene.person-1", "scene.person-2", "scene.car-1"])
    assert rejection_reason(car(10.0, 30.0), manifest) is None
    assert rejection_reason(car(5.0, 30.0), manifest) == "car-1 leaves its level ground"


def test_a_mover_that_a_parameter_lifts_need_not_stand_on_the_ground() -> None:
    document = traffic().model_dump(mode="json")
    lifted = {"path": "scene.car-1.pos.z", "minimum": 0, "maximum": 5, "default": 0}
    manifest = Manifest.model_validate({**document, "parameters": [*document["parameters"], lifted]})
    assert rejection_reason(car(10.0, 30.0), manifest) is None


def test_the_kind_that_is_shown_decides_how_much_ground_is_taken() -> None:
    document = traffic().model_dump(mode="json")
    document["obstacles"] += [
        Footprint(path=f"scene.truck-1.{kind}", polygon=((-w, 40), (w, 40), (w, 44), (-w, 44))).model_dump()
        for kind, w in (("small", 0.5), ("wide", 2.0))
    ]
    document["parameters"] += [
        *pose("scene.truck-1", 0, 42),
        {"path": "scene.truck-1.kind", "choices": ["small", "wide", "absent"], "default": "absent"},
    ]
    manifest = Manifest.model_validate(document)
    beside = {"scene.truck-1.pos.x": -2.8, "scene.truck-1.pos.y": 15.0}
    assert rejection_reason(beside, manifest) is None
    assert rejection_reason({**beside, "scene.truck-1.kind": "small"}, manifest) is None
    assert rejection_reason({**beside, "scene.truck-1.kind": "wide"}, manifest) == "truck-1 stands inside building-1"


def test_an_outline_that_crosses_itself_is_judged_without_a_stack_trace() -> None:
    crossed = Footprint(path="scene.wall-1", polygon=((-4, 20), (-2, 24), (-2, 20), (-4, 24)))
    region = GroundRegion(polygon=((-9, 40), (-7, 44), (-7, 40), (-9, 44)), height=0.25)
    manifest = traffic(crossed, ground=[region.model_dump()])
    assert rejection_reason(car(-3.0, 23.0), manifest) == "car-1 stands inside wall-1"
    assert rejection_reason(car(-8.0, 43.0), manifest) == "car-1 leaves its level ground"
