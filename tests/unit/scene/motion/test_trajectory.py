"""Trajectories on the asset of boxes, against paths whose direction and length are known."""

import math
from typing import Any

import numpy as np
import pytest

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.assets.manifest import Manifest, parse_manifest
from valerie.scene.graph.transforms import Pose
from valerie.scene.motion.trajectory import TIME_PATH, Motion, Trajectory
from valerie.scene.variation.traverse import traverse
from valerie.scene.variation.variant import apply
from valerie.testing.assets import simple_asset, simple_manifest

MANIFEST = simple_manifest()
PERSON = "scene.person-1"


def walk(*keys: tuple[float, float, float], path: str = PERSON, **more: Any) -> Trajectory:
    keyframes = tuple({"time": t, "pos.x": x, "pos.y": y} for t, x, y in keys)
    return Trajectory(path=path, keyframes=keyframes, **more)


def moment(trajectory: Trajectory, time: float, manifest: Manifest = MANIFEST, **given: Any) -> dict[str, Any]:
    motion = Motion([trajectory], manifest.by_path)
    assignment = {f"{trajectory.path}.{name.replace('__', '.')}": value for name, value in given.items()}
    return {path.removeprefix(f"{trajectory.path}."): v for path, v in motion.at(assignment, time).items()}


def circle(count: int = 25, radius: float = 5.0, seconds: float = 10.0) -> Trajectory:
    """Counter-clockwise about (0, 20), beginning at its right-most point."""
    turns = np.linspace(0.0, 2.0 * np.pi, count)
    keys = [(seconds * a / (2 * np.pi), radius * math.cos(a), 20.0 + radius * math.sin(a)) for a in turns.tolist()]
    return walk(*keys)


@pytest.mark.parametrize(
    ("x", "y", "heading"), [(0, 12, 0), (-3, 15, 45), (-2, 10, 90), (0, 8, 180), (2, 10, 270), (1, 9, 225)]
)
def test_a_walking_person_faces_its_way(x: float, y: float, heading: float) -> None:
    trajectory = walk((0, 0, 10), (2, x, y))
    state = moment(trajectory, 1.0)
    assert (state["pos.x"], state["pos.y"]) == pytest.approx((x / 2, 5 + y / 2))
    if (x, y) == (-3, 15):
        heading = math.degrees(math.atan2(3, 5))
    assert state["heading"] == pytest.approx(heading, abs=1e-6)
    # The heading of the scene is the one that the geometry turns by: a nose ahead of the body.
    scene = apply(Motion([trajectory], MANIFEST.by_path).at({}, 1.0), simple_asset())
    nose = scene.world_transform(PERSON)[:3, :3] @ [0.0, 1.0, 0.0]
    assert nose[:2] == pytest.approx(np.array([x, y - 10]) / math.hypot(x, y - 10), abs=1e-6)


def test_on_a_circle_position_and_heading_follow_it() -> None:
    # With keyframes h = 2π/24 apart, the first and last tangents are off by R h²/3, and positions by up to 4/27 h of that:
    # 4.4 mm.
    for time in np.linspace(0.05, 9.95, 34).tolist():
        angle = 2 * math.pi * time / 10
        state = moment(circle(), time)
        assert (state["pos.x"], state["pos.y"]) == pytest.approx(
            (5 * math.cos(angle), 20 + 5 * math.sin(angle)), abs=5e-3
        )
        turned = (state["heading"] - math.degrees(angle) + 180) % 360 - 180  # along the tangent, it faces +y at angle 0
        assert abs(turned) < 1.0


def test_a_standing_person_faces_its_last_movement_and_before_the_first_one_the_next() -> None:
    trajectory = walk((0, 0, 10), (1, 0, 10), (2, 2, 10), (3, 2, 10), (4, 2, 14), (5, 2, 14))
    headings = [moment(trajectory, t)["heading"] for t in (-1.0, 0.5, 1.5, 2.0, 2.5, 3.5, 4.5, 9.0)]
    assert headings == pytest.approx([270, 270, 270, 270, 270, 0, 0, 0], abs=1e-6)


def test_keyframes_that_give_the_heading_decide_it_and_it_turns_the_shortest_way() -> None:
    keys = (
        {"time": 0.0, "pos.x": 0.0, "pos.y": 10.0, "heading": 350.0},
        {"time": 2.0, "pos.x": 2.0, "pos.y": 10.0, "heading": 30.0},
    )
    state = moment(Trajectory(path=PERSON, keyframes=keys), 1.0)
    assert state["heading"] == pytest.approx(10.0)
    kept = moment(walk((0, 0, 10), (2, 2, 10), facing="kept"), 1.0)
    assert "heading" not in kept


def test_values_of_a_variant_replace_those_of_keyframes_and_start() -> None:
    trajectory = walk((0, 0, 10), (2, 4, 10))
    assert moment(trajectory, 1.0, **{"trajectory__key-2__pos__x": 8.0})["pos.x"] == pytest.approx(4.0)
    assert moment(trajectory, 1.0, **{"trajectory__key-2__time": 4.0})["pos.x"] == pytest.approx(1.0)
    assert moment(trajectory, 1.0, trajectory__start=0.5)["pos.x"] == pytest.approx(1.0)
    motion = Motion([trajectory], MANIFEST.by_path, start=0.25)
    assert motion.at({}, 0.25)["scene.person-1.pos.x"] == pytest.approx(1.0)
    assert motion.at({TIME_PATH: 1.0}, 0.25)["scene.person-1.pos.x"] == pytest.approx(2.5)
    assert motion.seconds({TIME_PATH: 1.0}, 0.25) == 1.25
    assert set(motion.at({TIME_PATH: 1.0}, 0.0)) <= set(MANIFEST.by_path)


def test_a_camera_moves_and_keeps_its_direction() -> None:
    keys = ({"time": 0.0, "pos.x": -2.0}, {"time": 1.0, "pos.x": 2.0})
    motion = Motion([Trajectory(path="scene.camera-1", keyframes=keys)], MANIFEST.by_path)
    before, after = (apply(motion.at({}, t), simple_asset()).cameras["camera-1"] for t in (0.25, 0.75))
    assert after.position - before.position == pytest.approx([2.0, 0.0, 0.0])
    assert np.array_equal(after.transform[:3, :3], before.transform[:3, :3])


def walking_manifest() -> Manifest:
    gait = ParameterDefinition(
        path=f"{PERSON}.cloth.metallic",
        type=ParameterType.FLOAT,
        minimum=0,
        maximum=1,
        default=0.25,
        affects=Affects.MATERIAL,
    )
    # The boxes have no gait: a declared number of that name stands for it, which is all that a trajectory asks for.
    renamed = gait.model_copy(update={"path": f"{PERSON}.gait_phase", "name": "person-1.gait_phase"})
    return MANIFEST.model_copy(update={"parameters": (*MANIFEST.parameters, renamed)})


def test_the_gait_follows_the_distance_walked() -> None:
    manifest = walking_manifest()
    straight = walk((0, 0, 10), (2, 0, 14), (4, 0, 14), (5, 3, 14), stride_m=1.5, interpolation="linear")
    phases = [moment(straight, t, manifest)["gait_phase"] for t in (0.0, 0.3, 2.0, 3.0, 5.0, 7.0)]
    distances = np.array([0.0, 0.6, 4.0, 4.0, 7.0, 7.0])
    assert phases == pytest.approx((0.25 + distances / 1.5) % 1.0, abs=1e-6)
    assert moment(straight, 0.3, manifest, gait_phase=0.5)["gait_phase"] == pytest.approx(0.9)
    # Once round a circle of radius 5 m.
    around = circle().model_copy(update={"stride_m": 100.0})
    assert moment(around, 10.0, manifest)["gait_phase"] == pytest.approx(0.25 + 2 * math.pi * 5 / 100, abs=1e-4)


def test_a_variant_whose_movement_cannot_be_is_rejected_with_the_moment() -> None:
    trajectory = walk((0, 0, 10), (2, 14, 10))
    motion = Motion([trajectory], MANIFEST.by_path)
    assert motion.rejection({}, (0.0, 1.0, 2.0)) is None
    far = {f"{PERSON}.trajectory.start": -1.0, f"{PERSON}.trajectory.key-1.pos.x": -15.0}
    assert motion.rejection(far, (0.0, 1.0)) is None
    overshooting = walk((0, 0, 10), (1, 15, 10), (1.5, 14, 10))
    reason = Motion([overshooting], MANIFEST.by_path).rejection({}, (0.0, 1.1))
    assert reason == "person-1.pos.x leaves its range -15…15 m at 1.1 s"
    swapped = {f"{PERSON}.trajectory.key-1.time": 3.0}
    assert motion.rejection(swapped, (0.0,)) == "the keyframes of person-1 are not in the order of time"


def test_parameters_of_keyframes_have_type_unit_and_range_of_the_moved_parameter() -> None:
    motion = Motion([walk((0, 0, 10), (2, 4, 10))], MANIFEST.by_path, start=0.5)
    definitions = {definition.name: definition for definition in motion.parameters}
    assert definitions["time"].default == 0.5
    key = definitions["person-1.trajectory.key-2.pos.x"]
    assert (key.unit, key.minimum, key.maximum, key.default) == ("m", -15, 15, 4)
    assert definitions["person-1.trajectory.key-2.time"].unit == "s"
    assert set(motion.moved) == {f"{PERSON}.pos.x", f"{PERSON}.pos.y", f"{PERSON}.heading"}


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"path": "scene.building-1"}, UnknownName, "node or camera that can move"),
        ({"path": "scene.person-9"}, UnknownName, "person-1"),
        ({"keyframes": [{"time": 0, "pos.w": 1}]}, UnknownName, "pos.w"),
        ({"keyframes": [{"time": 0, "character": 1}]}, UnknownName, "character"),
        ({"keyframes": [{"pos.x": 1}]}, InvalidInput, "a keyframe needs a time"),
        ({"keyframes": [{"time": 0}]}, InvalidInput, "give only times"),
        ({"keyframes": [{"time": 0, "pos.x": 99}]}, InvalidInput, "outside the declared range"),
        ({"keyframes": [{"time": 1, "pos.x": 1}, {"time": 1, "pos.x": 2}]}, InvalidInput, "must be in order of time"),
        ({"keyframes": [{"time": 1, "pos.x": 1}, {"time": 2, "pos.y": 2}]}, InvalidInput, "the same parameters"),
        ({"keyframes": [{"time": 1, "pos.x": 1}, {"time": 2, "pos.x": 2}], "facing": "path"}, InvalidInput, "facing the path"),
    ],
)  # fmt: skip
def test_a_trajectory_that_the_asset_has_no_room_for_is_refused(
    change: dict[str, Any], error: type[Exception], text: str
) -> None:
    document = {"path": PERSON, "keyframes": [{"time": 0, "pos.x": 1}], **change}
    with pytest.raises(error, match=text):
        MANIFEST.require_trajectory(Trajectory.model_validate(document), field="trajectories.0")


def test_the_manifest_s_own_trajectories_are_checked_and_listed() -> None:
    document = MANIFEST.model_dump(mode="json", exclude={"trajectories"})
    document["trajectories"] = [walk((0, 0, 10), (2, 4, 10)).model_dump(exclude_none=True)]
    manifest = parse_manifest(document)
    asset = simple_asset()
    moving = SceneAsset(manifest, asset.digest, asset.base)
    listed = {entry.path: entry for entry in traverse(moving)}
    assert listed[f"{PERSON}.trajectory.key-2.pos.x"].value == 4
    assert listed[TIME_PATH].unit == "s"
    assert TIME_PATH not in {entry.path for entry in traverse(asset)}
    document["trajectories"].append(document["trajectories"][0])
    with pytest.raises(InvalidInput, match="named twice"):
        parse_manifest(document)


def test_equal_moments_are_equal_assignments_whatever_the_path_to_them() -> None:
    there = Motion([walk((0, -2, 10), (4, 2, 10))], MANIFEST.by_path).at({}, 1.0)
    back = Motion([walk((0, -4, 10), (2, 2, 10))], MANIFEST.by_path).at({}, 1.0)
    assert there == back
    assert Pose.of(apply(there, simple_asset()).nodes[PERSON].transform).position == (-1.0, 10.0, 0.0)


def test_moments_that_no_frame_is_taken_at_are_held_within_the_declared_range() -> None:
    motion = Motion([walk((0, 0, 10), (1, 15, 10), (1.5, 14, 10))], MANIFEST.by_path)
    assert motion.at({}, 1.1)["scene.person-1.pos.x"] > 15
    held = motion.at({}, 1.1, within=True)
    assert held["scene.person-1.pos.x"] == 15
    assert held["scene.person-1.pos.y"] == motion.at({}, 1.1)["scene.person-1.pos.y"]
    apply(held, simple_asset())
