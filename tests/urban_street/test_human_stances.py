"""Test poses, the walk cycle and carried things: bones first, then meshes."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from trimesh.ray.ray_pyembree import RayMeshIntersector

from tests.sampling import enough_to_show
from urban_street.human import data, figure, stances, surface
from urban_street.human.catalogue import LOOKS
from urban_street.human.figure import Model, StanceKey
from urban_street.human.stances import CARRIED, DEFAULT, POSES
from urban_street.human.townspeople import TOWNSPEOPLE
from valerie.errors import UnknownName
from valerie.scene.graph.model import JOINTS, Mesh, Stance

# Requirements of ours. A place of a sole touches the ground below 2 cm, the height of a heel's rounded edge. A foot on heel, ball
# or sole touches it with a fifth of its places, one that lies flat with two fifths, one that arrives or leaves with a twentieth.
TOUCHES, ON_A_PART, FLAT, ARRIVING = 0.02, 0.2, 0.4, 0.05
#: Share of rays that may meet skin under clothes, where sleeves and collars are open; with a raised arm three times as many.
SEEN_SKIN = 1e-3
#: The first instant of the walk, with both feet on the ground.
FIRST = StanceKey("walking", 0, "nothing")


@pytest.fixture(scope="module")
def model() -> Model:
    return Model("yellow-shirt", LOOKS["yellow-shirt"]())


def joint(model: Model, key: StanceKey, bone: str) -> NDArray[np.float64]:
    index = data.rig().bones.index(bone)
    matrix = model.posed(key).transforms[index]
    return matrix[:3, :3] @ model.body.heads[index] + matrix[:3, 3]


def soles(model: Model, key: StanceKey) -> dict[str, NDArray[np.float64]]:
    posed = model.posed(key)
    return {side: posed.apply(pair[1].points, pair[1].weights) for side, pair in model.pairs.items()}


def drawn(name: str, stance: Stance, part: str) -> Mesh:
    return next(m for m in figure(name).taking(stance).meshes if m.material == f"{name}/{part}")


@pytest.mark.parametrize("step", range(stances.GAIT_STEPS))
def test_at_every_instant_of_the_walk_a_foot_stands_on_the_ground(model: Model, step: int) -> None:
    feet = soles(model, StanceKey("walking", step, "nothing"))
    ground = min(points[:, 2].min() for points in feet.values())
    flattest = max(((points[:, 2] - ground) < TOUCHES).mean() for points in feet.values())
    assert flattest > ON_A_PART  # on heel, ball or the whole sole, not on an edge


@pytest.mark.parametrize("step", [2, 4, 6, 10, 12, 14])
def test_the_foot_that_swings_is_clear_of_the_ground_and_the_other_lies_flat(model: Model, step: int) -> None:
    feet = soles(model, StanceKey("walking", step, "nothing"))
    low, high = sorted(float(points[:, 2].min()) for points in feet.values())
    assert high > low + 0.01  # a clearance of a centimetre, as measured in people who walk
    assert max((points[:, 2] < low + TOUCHES).mean() for points in feet.values()) > FLAT


def test_half_a_cycle_later_the_other_foot_is_ahead(model: Model) -> None:
    for step in (0, 3):
        now, later = (soles(model, StanceKey("walking", s, "nothing")) for s in (step, step + stances.GAIT_STEPS // 2))
        ahead = [feet["l"][:, 1].mean() - feet["r"][:, 1].mean() for feet in (now, later)]
        assert ahead[0] == pytest.approx(-ahead[1], abs=0.03)


def test_who_stands_has_both_feet_flat_and_close_together(model: Model) -> None:
    feet = soles(model, StanceKey("standing", 0, "nothing"))
    heights = [float(points[:, 2].min()) for points in feet.values()]
    # Requirements of ours: level to two millimetres, and less than half a foot apart along the way.
    assert abs(heights[0] - heights[1]) < 0.002
    assert abs(feet["l"][:, 1].mean() - feet["r"][:, 1].mean()) < 0.15


def test_who_waves_has_the_right_hand_above_the_head(model: Model) -> None:
    key = StanceKey("waving", 0, "nothing")
    # Fingers above the joint between neck and head by half a face; those of the other arm at the hip, where arms that hang end.
    assert joint(model, key, "middle_01_r")[2] > joint(model, key, "head")[2] + 0.1
    assert joint(model, key, "middle_01_l")[2] < joint(model, key, "pelvis")[2] + 0.05


def test_who_reads_a_phone_looks_down_at_a_hand_before_the_chest(model: Model) -> None:
    reading, standing = StanceKey("phone", 0, "nothing"), StanceKey("standing", 0, "nothing")
    hand, chest = (joint(model, reading, bone) for bone in ("middle_01_r", "spine_03"))
    # Requirements of ours: 20 cm before the chest, and a gaze that falls by 0.3 of its way.
    assert hand[1] > chest[1] + 0.2
    assert joint(model, reading, "pelvis")[2] < hand[2] < joint(model, reading, "head")[2]
    head = data.rig().bones.index("head")
    down = [model.posed(key).transforms[head, :3, :3] @ np.array([0.0, 1.0, 0.0]) for key in (reading, standing)]
    assert down[0][2] < down[1][2] - 0.3


def test_an_umbrella_is_held_by_the_free_hand_and_lies_above_the_head() -> None:
    for pose, side in (("walking", 1.0), ("waving", -1.0)):
        stance = replace(DEFAULT, pose=pose, carries="umbrella")
        canopy, shaft = (drawn("yellow-shirt", stance, part).positions for part in ("carried-canopy", "carried-shaft"))
        head = drawn("yellow-shirt", stance, "hair-head").positions
        # Umbrellas are 0.85 to 1.2 m wide. The shaft ends in a hand beside the body.
        assert canopy[:, 2].max() > head[:, 2].max() + 0.05
        assert np.ptp(canopy[:, 0]) > 0.85
        lowest = shaft[shaft[:, 2].argmin()]
        assert lowest[0] * side > 0.05


def test_a_shopping_bag_hangs_below_the_left_hand_and_above_the_ground() -> None:
    bag = drawn("yellow-shirt", replace(DEFAULT, carries="shopping-bag"), "carried-shopping-bag").positions
    # Beside the body, off the ground, and below the hand of an arm that hangs, half of 1.9 m.
    assert bag[:, 0].mean() < -0.1
    assert 0.05 < bag[:, 2].min() < bag[:, 2].max() < 0.95


def test_a_backpack_is_behind_and_its_straps_lie_on_the_clothes() -> None:
    stance = replace(DEFAULT, carries="backpack")
    pack, shirt = (drawn("yellow-shirt", stance, part).positions for part in ("carried-backpack", "cloth-shirt"))
    # A fifth of its places, those of its back panel's far side, lies behind all cloth.
    assert np.percentile(pack[:, 1], 20) < shirt[:, 1].min()
    front = pack[pack[:, 1] > shirt[:, 1].mean()]  # only the straps lie before the chest
    assert len(front) >= enough_to_show(0.058)
    distance = trimesh.proximity.closest_point(
        trimesh.Trimesh(shirt, drawn("yellow-shirt", stance, "cloth-shirt").faces, process=False), front
    )[1]
    # A strap is 1 cm thick and bridges folds of 3 cm; a tenth of it leaves the body at the shoulder.
    assert np.percentile(distance, 90) < 0.045


def test_what_is_carried_belongs_to_the_character_and_can_be_put_down() -> None:
    own = {mesh.material for mesh in figure("grey-hoodie").meshes}
    without = {mesh.material for mesh in figure("grey-hoodie").taking(replace(DEFAULT, carries="nothing")).meshes}
    assert own - without == {"grey-hoodie/carried-backpack"}


def test_stances_that_look_alike_share_their_meshes_and_others_do_not() -> None:
    person = figure("yellow-shirt")
    first, near, other = (person.taking(replace(DEFAULT, gait_phase=phase)) for phase in (0.5, 0.51, 0.6))
    assert all(a is b for a, b in zip(first.meshes, near.meshes, strict=True))
    assert other.meshes[0] is not first.meshes[0]
    assert person.taking(replace(DEFAULT, carries="nothing")).meshes is person.meshes
    assert person.taking(replace(DEFAULT, gait_phase=1.0)).meshes is person.meshes  # a cycle later


def test_figures_that_share_their_meshes_keep_their_own_stances() -> None:
    stances = [replace(DEFAULT, gait_phase=phase) for phase in (0.5, 0.51)]
    assert [figure("yellow-shirt").taking(stance).stance for stance in stances] == stances


def test_an_unknown_pose_or_load_is_refused_with_near_matches() -> None:
    with pytest.raises(UnknownName, match="standing"):
        figure("yellow-shirt").taking(replace(DEFAULT, pose="standig"))
    with pytest.raises(UnknownName, match="backpack"):
        figure("yellow-shirt").taking(replace(DEFAULT, carries="bagpack"))


def test_renamed_figures_share_their_bodies_and_keep_their_names_in_other_stances() -> None:
    first = figure("striped-boy").renamed("a/{}".format)
    second = first.renamed("b/{}".format).taking(replace(DEFAULT, pose="standing"))
    assert {mesh.material.split("/")[0] for mesh in first.meshes} == {"a"}
    assert all(mesh.material.startswith("b/a/striped-boy/") for mesh in second.meshes)


@pytest.fixture(scope="module", params=sorted(LOOKS))
def anybody(request: pytest.FixtureRequest) -> Model:
    return Model(request.param, LOOKS[request.param]())


def test_anybodys_feet_both_touch_the_ground_at_the_first_instant_and_nothing_lies_below(anybody: Model) -> None:
    posed = anybody.posed(FIRST)
    feet = soles(anybody, FIRST)
    ground = min(float(points[:, 2].min()) for points in feet.values())
    assert max(float(points[:, 2].min()) for points in feet.values()) < ground + 0.003  # as of the finished characters
    for points in feet.values():
        assert ((points[:, 2] - ground) < TOUCHES).mean() > ARRIVING  # on heel or ball, not on a corner
    bare = np.unique(data.base_mesh().groups["body"].quads)
    assert posed.apply(anybody.body.vertices, data.rig().weights)[bare, 2].min() > ground


def test_no_covered_skin_comes_through_anybodys_clothes_at_the_first_instant(anybody: Model) -> None:
    # The rays are sparse here; the slow tests use dense rays and every stance.
    assert covered_share(anybody, FIRST, spacing=0.02, directions=6) < SEEN_SKIN


def test_the_first_twelve_bodies_have_silhouettes_of_their_own() -> None:
    """Compare bare bodies that stand alike, from the front: only the bodies differ, not clothes or step."""
    others = {"yellow-outfit", *TOWNSPEOPLE}
    silhouettes = {name: silhouette(Model(name, LOOKS[name]())) for name in LOOKS if name not in others}
    assert len(silhouettes) == 12
    for (first, a), (second, b) in combinations(silhouettes.items(), 2):
        assert (a ^ b).sum() > 0.1 * (a | b).sum(), (first, second)  # a tenth, a requirement of ours
    heights = {name: 0.01 * np.flatnonzero(shape.any(axis=1)).max() for name, shape in silhouettes.items()}
    children = {"striped-boy", "pink-girl"}
    assert all((height < 1.4) == (name in children) for name, height in heights.items())
    areas = sorted(float(shape.sum()) for name, shape in silhouettes.items() if name not in children)
    assert (
        areas[-1] > 1.4 * areas[0]
    )  # slight and stout, a requirement of ours: as much as from 50 to 80 kg at one height


def silhouette(model: Model) -> NDArray[np.bool_]:
    """Return (200, 200) hits of parallel rays along +y on the bare standing body, on a grid of 1 cm up from its lowest point."""
    points = model.posed(StanceKey("standing", 0, "nothing")).apply(model.body.vertices, data.rig().weights)
    faces = surface.triangles(data.base_mesh().groups["body"].quads)
    points = points - [0.0, 0.0, points[np.unique(faces), 2].min()]
    across, up = np.meshgrid(np.arange(-1.0, 1.0, 0.01), np.arange(0.005, 2.0, 0.01))
    origins = np.stack([across, np.full_like(across, -5.0), up], -1).reshape(-1, 3)
    hit = RayMeshIntersector(trimesh.Trimesh(points, faces, process=False)).intersects_any(
        origins, np.broadcast_to([0.0, 1.0, 0.0], origins.shape)
    )
    return np.asarray(hit.reshape(across.shape))


def covered_share(model: Model, key: StanceKey, *, spacing: float = 0.012, directions: int = 8) -> float:
    """Return the share of rays from all around, ``spacing`` metres apart, that first hit skin under clothes."""
    posed = model.posed(key)
    faces = surface.triangles(data.base_mesh().groups["body"].quads)
    pieces = [(posed.apply(model.body.vertices, data.rig().weights), faces)]
    pieces += [(cloth.points, cloth.faces) for cloth in model.dressed(posed)]
    starts = np.cumsum([0] + [len(points) for points, _ in pieces])
    mesh = trimesh.Trimesh(
        np.concatenate([points for points, _ in pieces]),
        np.concatenate([part + start for (_, part), start in zip(pieces, starts, strict=False)]),
        process=False,
    )
    rays, hits, skin = RayMeshIntersector(mesh), 0, 0
    across, up = np.meshgrid(np.arange(-0.7, 0.7, spacing), np.arange(-1.1, 1.1, spacing))
    for azimuth in np.linspace(0.0, 2.0 * np.pi, directions, endpoint=False):
        view = np.array([np.sin(azimuth), np.cos(azimuth), -0.1])
        view /= np.linalg.norm(view)
        right = surface.normalize(np.cross(view, [0.0, 0.0, 1.0]))
        origins = across[..., None] * right + up[..., None] * np.cross(right, view) - 5.0 * view
        hit = rays.intersects_first(origins.reshape(-1, 3), np.broadcast_to(view, (across.size, 3)))
        hit = hit[hit >= 0]
        hits += len(hit)
        skin += int(model.covered[faces[hit[hit < len(faces)]]].all(axis=1).sum())
    assert (
        hits * spacing**2 > 0.15 * directions
    )  # square metres that are visible from each side: a child's, 1.1 × 0.2 m, or more
    return skin / hits


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(LOOKS))
def test_no_covered_skin_comes_through_anybodys_clothes_in_any_pose(name: str) -> None:
    model = Model(name, LOOKS[name]())
    carries = model.look.carries
    for step in range(0, stances.GAIT_STEPS, 2):
        assert covered_share(model, StanceKey("walking", step, carries)) < SEEN_SKIN, step
    for pose in POSES:
        # A raised arm opens a short sleeve, and rays enter it.
        assert covered_share(model, StanceKey(pose, 0, carries)) < 3 * SEEN_SKIN, pose


@pytest.mark.slow
@pytest.mark.parametrize("carries", [c for c in CARRIED if c not in {"own", "nothing"}])
@pytest.mark.parametrize("name", sorted(LOOKS))
def test_everybody_can_carry_everything(name: str, carries: str) -> None:
    for mesh in figure(name).taking(replace(DEFAULT, carries=carries)).meshes:
        assert np.isfinite(mesh.positions).all()
        assert mesh.positions[:, 2].min() > -0.005, mesh.material  # nothing sinks in by more than a pixel shows
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-4)


def joint_places(name: str, stance: Stance) -> dict[str, NDArray[np.float64]]:
    return dict(zip(JOINTS, figure(name).taking(stance).joints, strict=True))


@pytest.mark.parametrize(
    "stance",
    [
        *(replace(DEFAULT, gait_phase=phase) for phase in (0.2, 0.5, 0.8)),
        *(replace(DEFAULT, pose=pose) for pose in POSES),
    ],
)
def test_joints_keep_the_lengths_of_the_limbs_in_every_stance(stance: Stance) -> None:
    first, here = joint_places("yellow-shirt", DEFAULT), joint_places("yellow-shirt", stance)
    for side in ("left", "right"):
        for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle")):
            ends = f"{side}_{a}", f"{side}_{b}"
            lengths = [float(np.linalg.norm(places[ends[0]] - places[ends[1]])) for places in (first, here)]
            assert lengths[1] == pytest.approx(lengths[0], abs=1e-9)
    assert here["left_hip"][0] < here["right_hip"][0]


def test_joints_lie_within_what_is_drawn() -> None:
    walker = figure("yellow-shirt")
    points = np.concatenate([mesh.positions for mesh in walker.meshes])
    joints = walker.joints
    assert (joints >= points.min(axis=0)).all()
    assert (joints <= points.max(axis=0)).all()
    places = dict(zip(JOINTS, joints, strict=True))
    # Hair is less than 10 cm high. The toes of the foot that arrives are raised by its 25° or less, on 25 cm.
    assert points[:, 2].max() - places["head_top"][2] < 0.1
    assert max(places["left_toes"][2], places["right_toes"][2]) < 0.12
