"""Riders: they sit, hold and stand where the vehicle says."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from valerie.errors import UnknownName
from valerie.scene.procedural.human import data
from valerie.scene.procedural.human.body import Body, BodyShape, shape_body
from valerie.scene.procedural.human.pose import pose_body
from valerie.scene.procedural.human.riding import ride
from valerie.scene.procedural.vehicles import MOUNTS, VehicleContent, build_rider

_BONES = ("hand_l", "hand_r", "ball_l", "ball_r", "thigh_l", "calf_l", "foot_l", "thigh_r", "calf_r", "foot_r", "head")


@pytest.fixture(scope="module", params=[0.45, 0.6, 0.75])
def body(request: pytest.FixtureRequest) -> Body:
    return shape_body(BodyShape(sex=0.5, height=request.param))


def joints(body: Body, mount: str) -> dict[str, np.ndarray]:
    """Where bones begin, in the vehicle's frame."""
    rotations, origin = ride(body, MOUNTS[mount])
    transforms = pose_body(body, rotations).transforms
    found = {}
    for bone in _BONES:
        matrix = transforms[data.rig().bones.index(bone)]
        found[bone] = matrix[:3, :3] @ body.head(bone) + matrix[:3, 3] - origin
    return found


@pytest.mark.parametrize("mount", MOUNTS)
def test_hands_are_at_the_grips_and_feet_at_the_pedals(body: Body, mount: str) -> None:
    at, contact = joints(body, mount), MOUNTS[mount]
    for side, outwards, foot in (("r", 1.0, contact.foot[0]), ("l", -1.0, contact.foot[1])):
        grip = np.array(contact.grip) * [outwards, 1.0, 1.0]
        assert np.linalg.norm(at[f"hand_{side}"] - grip) < 0.13
        assert np.linalg.norm(at[f"ball_{side}"] - foot) < 0.06


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
    assert (head @ [0.0, 1.0, 0.0])[1] > 0.95
    assert joints(body, "bicycle")["head"][2] > MOUNTS["bicycle"].seat[2] + 0.5


@pytest.fixture(scope="module")
def cyclist() -> VehicleContent:
    return build_rider("bicycle", "yellow-shirt")


def test_a_cyclist_is_a_rider_with_clothes_of_his_own(cyclist: VehicleContent) -> None:
    assert cyclist.object_class == "rider"
    assert all(name.startswith("rider-bicycle/") for name in cyclist.materials)
    assert set(cyclist.materials) == {mesh.material for mesh in cyclist.parts[0].meshes}
    assert 1.55 < cyclist.height_m < 2.0


def test_skin_touches_the_grips_and_shoes_the_pedals(cyclist: VehicleContent) -> None:
    meshes = {mesh.material.rpartition("/")[2]: mesh.positions for mesh in cyclist.parts[0].meshes}
    contact = MOUNTS["bicycle"]
    hands = cKDTree(meshes["skin-limbs"])
    for outwards in (-1.0, 1.0):
        assert hands.query(np.array(contact.grip) * [outwards, 1.0, 1.0])[0] < 0.04
    sole = next(mesh for mesh in cyclist.parts[0].meshes if mesh.material.endswith("shoe-sole"))
    solid = trimesh.Trimesh(sole.positions, sole.faces.astype(np.int64), process=False, validate=False)
    below = np.array(contact.foot) - [0.0, 0.0, 0.3]
    hits, rays, _ = solid.ray.intersects_location(below, np.tile([0.0, 0.0, 1.0], (2, 1)), multiple_hits=False)
    assert sorted(rays) == [0, 1]
    gaps = [hit[2] - contact.foot[ray][2] for hit, ray in zip(hits, rays, strict=True)]
    assert np.abs(gaps).max() < 0.02


def test_what_cannot_be_ridden_is_refused() -> None:
    with pytest.raises(UnknownName, match="bicycle"):
        build_rider("bicicle")
