"""Test riders: they sit, hold and stand at the vehicle's places."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from urban_street.human import data
from urban_street.human.body import Body, BodyShape, shape_body
from urban_street.human.pose import pose_body
from urban_street.human.riding import ride
from urban_street.vehicles import MOUNTS, VehicleContent, build_rider
from valerie.errors import UnknownName
from valerie.scene.graph.model import JOINTS

#: Largest distances of a wrist from what its hand holds, and of the ball of a foot from its pedal, metres: requirements of ours.
PALM, SOLE = 0.13, 0.06
_BONES = ("hand_l", "hand_r", "ball_l", "ball_r", "thigh_l", "calf_l", "foot_l", "thigh_r", "calf_r", "foot_r", "head")


@pytest.fixture(scope="module", params=[0.45, 0.6, 0.75])
def body(request: pytest.FixtureRequest) -> Body:
    return shape_body(BodyShape(sex=0.5, height=request.param))


def joints(body: Body, mount: str) -> dict[str, np.ndarray]:
    """Return the heads of the bones, in the vehicle's frame."""
    rotations, origin = ride(body, MOUNTS[mount])
    transforms = pose_body(body, rotations).transforms
    places = {}
    for bone in _BONES:
        matrix = transforms[data.rig().bones.index(bone)]
        places[bone] = matrix[:3, :3] @ body.head(bone) + matrix[:3, 3] - origin
    return places


@pytest.mark.parametrize("mount", MOUNTS)
def test_hands_are_at_the_grips_and_feet_at_the_pedals(body: Body, mount: str) -> None:
    at, contact = joints(body, mount), MOUNTS[mount]
    for side, outwards, foot in (("r", 1.0, contact.foot[0]), ("l", -1.0, contact.foot[1])):
        grip = np.array(contact.grip) * [outwards, 1.0, 1.0]
        assert np.linalg.norm(at[f"hand_{side}"] - grip) < PALM
        assert np.linalg.norm(at[f"ball_{side}"] - foot) < SOLE


@pytest.mark.parametrize("mount", MOUNTS)
def test_legs_keep_their_lengths_and_knees_bend_forwards(body: Body, mount: str) -> None:
    at = joints(body, mount)
    for side in "lr":
        thigh = at[f"calf_{side}"] - at[f"thigh_{side}"]
        rest = body.head(f"calf_{side}") - body.head(f"thigh_{side}")
        assert np.linalg.norm(thigh) == pytest.approx(np.linalg.norm(rest), rel=1e-6)
        straight = at[f"foot_{side}"] - at[f"thigh_{side}"]
        bend = thigh - straight * (thigh @ straight) / (straight @ straight)
        assert bend[1] > 0.0


def test_the_head_is_above_the_saddle_and_looks_ahead(body: Body) -> None:
    rotations, _ = ride(body, MOUNTS["bicycle"])
    head = pose_body(body, rotations).transforms[data.rig().bones.index("head")][:3, :3]
    assert (head @ [0.0, 1.0, 0.0])[1] > np.cos(np.radians(18.0))  # a requirement of ours
    # By the length of a trunk that leans forwards, 0.6 m and more upright.
    assert joints(body, "bicycle")["head"][2] > MOUNTS["bicycle"].seat[2] + 0.5


@pytest.fixture(scope="module")
def riders() -> dict[str, VehicleContent]:
    return {mount: build_rider(mount, "yellow-shirt") for mount in MOUNTS}


@pytest.fixture(scope="module")
def cyclist(riders: dict[str, VehicleContent]) -> VehicleContent:
    return riders["bicycle"]


def test_a_cyclist_is_a_rider_with_clothes_of_his_own(cyclist: VehicleContent) -> None:
    assert cyclist.object_class == "rider"
    assert all(name.startswith("rider-bicycle/") for name in cyclist.materials)
    assert set(cyclist.materials) == {mesh.material for mesh in cyclist.parts[0].meshes}
    # A saddle of 0.9 to 1 m and a person of 0.7 to 0.9 m when sitting, with a helmet.
    assert 1.55 < max(mesh.positions[:, 2].max() for mesh in cyclist.parts[0].meshes) < 2.0


def test_skin_touches_the_grips_and_shoes_the_pedals(cyclist: VehicleContent) -> None:
    meshes = {mesh.material.rpartition("/")[2]: mesh.positions for mesh in cyclist.parts[0].meshes}
    contact = MOUNTS["bicycle"]
    hands = cKDTree(meshes["skin-limbs"])
    for outwards in (-1.0, 1.0):
        # Skin lies around the grip's axis: its radius, half a finger and the step between vertices.
        assert hands.query(np.array(contact.grip) * [outwards, 1.0, 1.0])[0] < 0.04
    sole = next(mesh for mesh in cyclist.parts[0].meshes if mesh.material.endswith("shoe-sole"))
    solid = trimesh.Trimesh(sole.positions, sole.faces.astype(np.int64), process=False, validate=False)
    below = np.array(contact.foot) - [0.0, 0.0, 0.3]
    hits, rays, _ = solid.ray.intersects_location(below, np.tile([0.0, 0.0, 1.0], (2, 1)), multiple_hits=False)
    assert sorted(rays) == [0, 1]
    gaps = [hit[2] - contact.foot[ray][2] for hit, ray in zip(hits, rays, strict=True)]
    assert np.abs(gaps).max() < 0.02  # half the thickness of a pedal


@pytest.mark.parametrize("mount", MOUNTS)
def test_joints_of_a_rider_lie_in_the_limbs_that_they_are_named_after(
    riders: dict[str, VehicleContent], mount: str
) -> None:
    (part,) = riders[mount].parts
    assert part.skeleton is not None
    at = dict(zip(JOINTS, part.skeleton.joints, strict=True))
    meshes = {mesh.material.rpartition("/")[2]: mesh for mesh in part.meshes}
    for side, outwards in (("left", -1.0), ("right", 1.0)):

        def own(name: str, outwards: float = outwards) -> np.ndarray:
            points = meshes[name].positions.astype(np.float64)
            return points[points[:, 0] * outwards > 0.0]

        # An eye has a radius of 12 mm.
        assert np.linalg.norm(own("skin-eyes").mean(axis=0) - at[f"{side}_eye"]) < 0.01
        assert np.linalg.norm(np.array(MOUNTS[mount].grip) * [outwards, 1.0, 1.0] - at[f"{side}_wrist"]) < PALM
        sole = own("shoe-sole")
        low, high = sole.min(axis=0), sole.max(axis=0)
        for joint in ("ankle", "toes"):
            x, y, z = at[f"{side}_{joint}"]
            assert low[0] < x < high[0]
            assert low[1] < y < high[1]
            assert 0.0 < z - low[2] < 0.2  # the height of an ankle, on a foot that is tilted
        # A shin is 0.4 m long and hangs by more than 22°.
        assert at[f"{side}_knee"][2] > at[f"{side}_ankle"][2] + 0.15
        assert at[f"{side}_hip"][2] == pytest.approx(MOUNTS[mount].seat[2], abs=0.15)


@pytest.mark.parametrize("mount", MOUNTS)
def test_joints_of_a_rider_are_surrounded_by_its_body(riders: dict[str, VehicleContent], mount: str) -> None:
    (part,) = riders[mount].parts
    assert part.skeleton is not None
    soup = np.concatenate([mesh.positions[mesh.faces] for mesh in part.meshes]).astype(np.float64).reshape(-1, 3)
    body = trimesh.Trimesh(soup, np.arange(len(soup)).reshape(-1, 3), process=False, validate=False)
    inside = [name for name in JOINTS if name != "head_top"]  # Hair or helmet covers the top of the skull.
    directions = np.concatenate([np.eye(3), -np.eye(3)])
    origins = np.repeat([part.skeleton.joints[JOINTS.index(name)] for name in inside], len(directions), axis=0)
    hits, rays, _ = body.ray.intersects_location(origins, np.tile(directions, (len(inside), 1)), multiple_hits=False)
    # Within a trunk's width, and on all sides but one, on which clothes may be open.
    near = np.linalg.norm(hits - origins[rays], axis=1) < 0.35
    met = np.bincount(rays[near] // len(directions), minlength=len(inside))
    assert {name: count for name, count in zip(inside, met.tolist(), strict=True) if count < 5} == {}


def test_what_cannot_be_ridden_is_refused() -> None:
    with pytest.raises(UnknownName, match="bicycle"):
        build_rider("bicicle")
