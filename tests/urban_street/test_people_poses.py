"""Test the poses and aids of people from outside: meshes, joints, labels and the ground that they need."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from urban_street.human import CHARACTERS, Figure, figure
from urban_street.human.catalogue import LOOKS
from urban_street.human.stances import CARRIED, DEFAULT, GAITS, POSES
from urban_street.human.townspeople import TOWNSPEOPLE
from urban_street.pedestrians import PLACES, Aid, Crowd, aid_classes
from urban_street.site import numbered
from urban_street.vehicles.bicycle import BICYCLE
from valerie.errors import UnknownName
from valerie.labels import BY_NAME
from valerie.pipeline.retraining.crowds import crowd_asset
from valerie.scene.assets.asset import asset_manifest, load_asset
from valerie.scene.assets.objects import classified
from valerie.scene.graph.model import JOINTS, Mesh, Stance
from valerie.scene.legality.rejection import rejection_reason
from valerie.scene.variation.variant import apply

#: Bodies that differ most: a tall and a stout one, a child, a small old one, a toddler; the slow tests take all.
SAMPLE = ("yellow-shirt", "denim-jacket", "striped-boy", "plum-cardigan", "yellow-toddler")
NEW = tuple(pose for pose in POSES if pose not in {"walking", "standing", "phone", "waving"})
#: Poses with something on the ground, by the class of its node.
WITH_AID = {
    "stroller": "dynamic", "wheelchair": "dynamic", "walking-frame": "dynamic", "dog": "dynamic", "bicycle": "bicycle",
}  # fmt: skip
#: Largest distance of feet and things from the ground, metres: a requirement of ours.
ON_GROUND = 0.01

EVERYBODY = [n if n in SAMPLE else pytest.param(n, marks=pytest.mark.slow) for n in CHARACTERS]


def posed(name: str, pose: str, **more: object) -> Figure:
    return figure(name).taking(replace(DEFAULT, pose=pose, **more))  # type: ignore[arg-type]


def points(meshes: tuple[Mesh, ...], *beginnings: str) -> NDArray[np.float32]:
    return np.concatenate([m.positions for m in meshes if m.material.rpartition("/")[2].startswith(beginnings)])


def aid_of(pose: str, phase: float = 0.0) -> tuple[Mesh, ...]:
    kind = WITH_AID[pose]
    return Aid(kind, DEFAULT, str).taking(Stance(pose, phase, "own")).meshes


def solid(meshes: tuple[Mesh, ...]) -> trimesh.Trimesh:
    return trimesh.util.concatenate([trimesh.Trimesh(m.positions, m.faces, process=False) for m in meshes])


def joints(person: Figure) -> dict[str, NDArray[np.float64]]:
    return dict(zip(JOINTS, person.joints, strict=True))


def hand(person: Figure, side: str) -> NDArray[np.float32]:
    """Return the skin of a hand: what lies within 22 cm of the wrist, the length of a large hand."""
    skin = points(person.meshes, "skin-limbs")
    return skin[np.linalg.norm(skin - joints(person)[f"{side}_wrist"], axis=1) < 0.22]


def distance(meshes: tuple[Mesh, ...], places: NDArray[np.float32]) -> float:
    """Return the least distance of places from a surface, metres."""
    return float(trimesh.proximity.closest_point(solid(meshes), places)[1].min())


@pytest.mark.parametrize("pose", NEW)
@pytest.mark.parametrize("name", EVERYBODY)
def test_anybody_takes_any_pose_on_the_ground(name: str, pose: str) -> None:
    person = posed(name, pose)
    for mesh in person.meshes:
        assert np.isfinite(mesh.positions).all(), mesh.material
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-4)
        assert mesh.faces.max() < len(mesh.positions)
    lowest = float(points(person.meshes, "").min(axis=0)[2])
    if pose == "wheelchair":
        assert lowest > 0.05  # on the footrest, or hanging above it
    else:
        assert abs(lowest) < (2.5 * ON_GROUND if pose in {"sitting", "kneeling", "crouching"} else ON_GROUND)


@pytest.mark.parametrize("pose", NEW)
@pytest.mark.parametrize("name", EVERYBODY)
def test_hands_end_arms_and_feet_end_legs(name: str, pose: str) -> None:
    person = posed(name, pose)
    place, soles = joints(person), points(person.meshes, "shoe-sole")
    for side in ("left", "right"):
        assert len(hand(person, side)) > 100
        # A sole's nearest place is below the ankle by less than the height of a foot with its shoe.
        assert np.linalg.norm(soles - place[f"{side}_ankle"], axis=1).min() < 0.15


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("pose", ["stroller", "bicycle", "walking-frame"])
@pytest.mark.parametrize("name", ["yellow-shirt", "denim-jacket", "striped-boy", "plum-cardigan"])
def test_hands_hold_what_they_push(name: str, pose: str, side: str) -> None:
    # A closed hand touches its handle; skin and tube may keep a finger's breadth. A pupil's arm ends just before a man's bicycle.
    short = pose == "bicycle" and name == "striped-boy"
    assert distance(aid_of(pose), hand(posed(name, pose), side)) < (0.08 if short else 0.02)


@pytest.mark.parametrize("phase", [0.25, 0.5])
def test_hands_stay_on_the_bar_at_every_step(phase: float) -> None:
    assert (
        distance(aid_of("stroller", phase), hand(posed("yellow-shirt", "stroller", gait_phase=phase), "right")) < 0.02
    )


@pytest.mark.parametrize(
    ("pose", "part", "sides"),
    [
        ("cane", "cane", ("right",)),
        ("crutches", "crutches", ("left", "right")),
        ("box", "box", ("left", "right")),
        ("dog", "leash", ("right",)),
    ],
)
@pytest.mark.parametrize("name", SAMPLE)
def test_hands_hold_what_is_carried(name: str, pose: str, part: str, sides: tuple[str, ...]) -> None:
    person = posed(name, pose)
    carried = tuple(mesh for mesh in person.meshes if mesh.material.endswith(f"carried-{part}"))
    for side in sides:
        assert distance(carried, hand(person, side)) < 0.02
    if pose in {"cane", "crutches"}:
        assert abs(float(points(carried, "").min(axis=0)[2])) < ON_GROUND


def test_a_box_hides_a_part_of_the_chest() -> None:
    box = points(posed("yellow-shirt", "box").meshes, "carried-box")
    shirt = points(posed("yellow-shirt", "box").meshes, "cloth-shirt")
    trunk = shirt[np.abs(shirt[:, 0]) < 0.15]
    assert box[:, 1].min() > np.percentile(trunk[:, 1], 90)
    assert np.ptp(box[:, 0]) > 0.4
    assert box[:, 2].max() > 0.7 * shirt[:, 2].max()


def test_the_leash_ends_at_the_dogs_collar() -> None:
    leash = points(posed("yellow-shirt", "dog").meshes, "carried-leash")
    collar = points(aid_of("dog"), "aid-collar")
    assert np.linalg.norm(leash[:, None] - collar[None], axis=2).min() < 0.05


@pytest.mark.parametrize("pose", sorted(WITH_AID))
def test_aids_stand_on_the_ground_and_keep_clear_of_the_persons_trunk(pose: str) -> None:
    meshes = aid_of(pose)
    assert abs(float(points(meshes, "").min(axis=0)[2])) < ON_GROUND
    for mesh in meshes:
        assert np.isfinite(mesh.positions).all()
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-4)
        a, b, c = (mesh.positions[mesh.faces[:, k]].astype(np.float64) for k in range(3))
        agree = np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.normals[mesh.faces].mean(axis=1)) > 0.0
        assert agree.mean() > 0.97, mesh.material


def test_a_dog_sets_one_paw_after_the_other() -> None:
    shapes = {aid_of("dog", step / 16)[0].positions.tobytes() for step in range(16)}
    assert len(shapes) == 16
    assert aid_of("dog", 0.5) is not aid_of("stroller", 0.5)


def test_a_wheelchair_carries_its_user() -> None:
    place = joints(posed("yellow-shirt", "wheelchair"))
    seat = points(aid_of("wheelchair"), "aid-padding")
    # Seats of wheelchairs are 45 to 55 cm high, hip joints lie 6 to 14 cm above what one sits on.
    cushion = seat[(np.abs(seat[:, 0]) < 0.1) & (np.abs(seat[:, 1]) < 0.1)][:, 2].max()
    assert 0.45 < cushion < 0.55
    assert 0.06 < place["left_hip"][2] - cushion < 0.14
    assert place["left_knee"][1] > place["left_hip"][1] + 0.3
    assert abs(place["left_knee"][2] - place["left_hip"][2]) < 0.15


def test_who_kneels_has_one_knee_on_the_ground_and_who_sits_their_hips_near_it() -> None:
    kneeling, sitting, crouching = (joints(posed("yellow-shirt", p)) for p in ("kneeling", "sitting", "crouching"))
    assert kneeling["right_knee"][2] < 0.12
    assert kneeling["left_knee"][2] > 0.3
    assert sitting["left_hip"][2] < 0.16
    assert sitting["left_knee"][2] > sitting["left_hip"][2] + 0.15
    assert crouching["left_hip"][2] < 0.5
    assert crouching["left_knee"][2] > 0.3


def test_who_runs_bends_elbows_and_knees_further_than_who_walks() -> None:
    def angle(person: Figure, a: str, b: str, c: str) -> float:
        place = joints(person)
        first, second = place[a] - place[b], place[c] - place[b]
        return float(np.degrees(np.arccos(first @ second / np.linalg.norm(first) / np.linalg.norm(second))))

    for first, middle, last in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")):
        walk, run = (
            min(
                angle(posed("coral-runner", pose), *(f"{side}_{j}" for j in (first, middle, last)))
                for side in ("left", "right")
            )
            for pose in ("walking", "running")
        )
        assert run < walk - 25.0


def test_poses_that_walk_follow_the_gait_phase_and_others_do_not() -> None:
    person = figure("yellow-shirt")
    for pose in POSES:
        first, later = (person.taking(Stance(pose, phase, "own")) for phase in (0.0, 0.5))
        assert (first.meshes is not later.meshes) == (pose in GAITS), pose


@pytest.mark.parametrize("pose", ["stroller", "wheelchair", "box", "crutches"])
def test_who_has_no_hand_free_puts_the_umbrella_down(pose: str) -> None:
    for carries in CARRIED:
        names = {mesh.material for mesh in posed("yellow-shirt", pose, carries=carries).meshes}
        assert not any("canopy" in name or "shopping" in name for name in names)
    assert any("canopy" in mesh.material for mesh in posed("yellow-shirt", "dog", carries="umbrella").meshes)


def test_only_what_is_carried_has_the_persons_label() -> None:
    crowd = Crowd()
    people = numbered(PLACES[:2])
    nodes = [node for name, person in people.items() for node in crowd.nodes(name, person)]
    labelled = classified(nodes, aid_classes(people), [f"scene.{name}" for name in people])
    person, dynamic, bicycle = (BY_NAME[name].id for name in ("person", "dynamic", "bicycle"))
    labels = {
        path.rpartition(".")[2]: (node.label_id, node.instance_id)
        for path, node in labelled.items()
        if ".person-2" in path
    }
    assert labels["red-coat"] == (person, 1000 * person + 2)
    assert labels["dynamic-1"] == (dynamic, 0)  # of Cityscapes: buggies, wheelchairs, animals
    assert labels["bicycle-202"] == (bicycle, 1000 * bicycle + 202)
    assert all(node.movable for node in labelled.values())
    # A bag, a box, a cane and crutches are meshes of the person's own node.
    assert any("carried-box" in mesh.material for mesh in posed("red-coat", "box").meshes)


def test_the_bicycle_is_pushed_by_its_left_grip_and_saddle() -> None:
    left, right = (hand(posed("grey-suit", "bicycle"), side).mean(axis=0) for side in ("left", "right"))
    # From the saddle to the left grip, as the bicycle's own table of contacts has them.
    way = np.array(BICYCLE.grip) * [-1.0, 1.0, 1.0] - np.array(BICYCLE.seat)
    assert np.linalg.norm((left - right) - way) < 0.15


def test_an_aid_comes_and_goes_with_the_pose_and_the_person() -> None:
    asset = load_asset("urban-street")
    person = "scene.person-1"

    def shown(**values: object) -> set[str]:
        scene = apply({f"{person}.{name}": value for name, value in values.items()}, asset)  # type: ignore[misc]
        return {node.name for node in scene.nodes.values() if node.parent == person and node.visible and node.meshes}

    assert shown() == {"yellow-shirt"}
    assert shown(pose="stroller") == {"yellow-shirt", "dynamic-1"}
    assert shown(pose="bicycle", character="grey-suit") == {"grey-suit", "bicycle-201"}
    assert shown(pose="dog", character="absent") == set()


def test_a_stroller_must_not_stand_in_a_house() -> None:
    manifest, _ = asset_manifest("urban-street")
    house = next(
        f for f in manifest.obstacles if f.path.startswith("scene.building") and min(x for x, _ in f.polygon) > 0.0
    )
    wall, y = min(x for x, _ in house.polygon), float(np.mean([y for _, y in house.polygon]))
    before = {"scene.person-1.pos.x": wall - 0.8, "scene.person-1.pos.y": y}
    for heading, reason in ((90.0, None), (270.0, "reaches inside building")):  # away from the wall, and towards it
        assignment = before | {"scene.person-1.heading": heading, "scene.person-1.pose": "stroller"}
        found = rejection_reason(assignment, manifest)
        assert found is None if reason is None else found is not None and reason in found
        assert rejection_reason(assignment | {"scene.person-1.pose": "walking"}, manifest) is None


def test_a_manifest_names_only_poses_that_exist() -> None:
    manifest, _ = asset_manifest("urban-street")
    fields = {name: getattr(manifest, name) for name in type(manifest).model_fields}
    with pytest.raises(UnknownName, match="strolling"):
        type(manifest).model_validate({**fields, "reaches": {"strolling": ((0.0, 1.0),)}})


def test_training_scenes_draw_the_people_they_always_drew() -> None:
    crowd = crowd_asset(load_asset("urban-street"))
    for person in crowd.manifest.persons:
        assert crowd.manifest.definition(f"{person}.character").choices == (
            "black-outfit", "yellow-shirt", "red-coat", "grey-hoodie", "blue-dress", "white-tee", "striped-boy", "pink-girl",
            "brown-hat", "green-parka", "navy-coat", "orange-workwear", "absent",
        )  # fmt: skip
        assert crowd.manifest.definition(f"{person}.carries").choices == (
            "own", "nothing", "shoulder-bag", "backpack", "shopping-bag", "umbrella",
        )  # fmt: skip
    assert crowd.manifest.training.poses == {"walking": 0.6, "standing": 0.2, "phone": 0.12, "waving": 0.08}


@pytest.mark.parametrize("name", sorted(TOWNSPEOPLE))
def test_townspeople_are_as_tall_as_their_age_has_it(name: str) -> None:
    # From the ground to the top of the head. Requirements of ours: the 3rd to 97th percentiles of growth tables, roughly.
    age = LOOKS[name]().shape.age
    low, high = next(
        span for oldest, span in ((0.12, (0.85, 1.1)), (0.36, (1.45, 1.80)), (1.0, (1.42, 2.0))) if age <= oldest
    )
    place = joints(posed(name, "standing"))
    assert low < place["head_top"][2] < high


def test_there_are_people_of_every_age_and_both_sexes() -> None:
    shapes = [look().shape for look in LOOKS.values()]
    assert len(shapes) >= 24
    assert len(POSES) >= 12
    for low, high in ((0.0, 0.12), (0.12, 0.25), (0.25, 0.4), (0.4, 0.8), (0.8, 1.0)):  # toddlers … the old
        assert any(low < shape.age <= high for shape in shapes)
    assert sum(shape.sex > 0.5 for shape in shapes) >= 8
    assert sum(shape.sex < 0.5 for shape in shapes) >= 8
    assert max(shape.weight for shape in shapes) - min(shape.weight for shape in shapes) > 0.5
