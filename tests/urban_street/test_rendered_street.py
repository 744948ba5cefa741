"""The generated street in small images: labels by node names against rays, layers against frames rendered from scratch."""

from dataclasses import replace

import numpy as np
import pytest

from tests.sampling import enough_to_show
from tests.unit.rendering.scene_rays import assert_agrees, triangles_of
from valerie.parameters.definitions import Value
from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.graph.model import Camera, Scene
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.variation.variant import apply
from valerie.testing.rendering import assert_same

pytestmark = pytest.mark.gl

#: Label ids of Cityscapes (cityscapesScripts, labels.py) by the first part of a node's name.
IDS = {
    "static": 4, "dynamic": 5, "ground": 6, "road": 7, "sidewalk": 8, "parking": 9, "building": 11, "wall": 12, "fence": 13,
    "guard-rail": 14, "pole": 17, "traffic-light": 19, "traffic-sign": 20, "vegetation": 21, "terrain": 22, "sky": 23,
    "person": 24, "rider": 25, "car": 26, "truck": 27, "bus": 28, "motorcycle": 32, "bicycle": 33,
}  # fmt: skip
#: Label ids with instances.
COUNTED = range(24, 34)
#: Label ids that evaluations use, except the train (31).
EVALUATED = {7, 8, 11, 12, 13, 17, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 32, 33}

#: Places with a good view of each class: a driver's, and four farther along the street.
CAMERAS = {
    "as a driver": ((2.5, -12.0, 1.4), 0.0, 50.0),
    "walls and heavy vehicles": ((2.5, 80.0, 2.0), 0.0, 40.0),
    "the cyclist who waits": ((2.5, 70.0, 2.5), 180.0, 35.0),
    "a traffic light": ((2.5, 30.0, 2.0), 330.0, 35.0),
    "a motorcycle": ((2.5, 100.0, 2.0), 180.0, 35.0),
}
SIZE = 240, 135
#: Share of pixels at gaps between parts of the street, or at what is thinner than an edge may move, such as distant panes and
#: bodywork: a two-hundredth, a requirement of ours.
GAPS = 0.005

#: Two persons, one with an umbrella, a car and a cyclist, overlapping in the image.
CROWDED: dict[str, Value] = {
    "scene.person-1.pos.x": 1.2,
    "scene.person-1.pos.y": 8.0,
    "scene.person-2.character": "red-coat",
    "scene.person-2.carries": "umbrella",
    "scene.person-2.pos.x": 2.4,
    "scene.person-2.pos.y": 5.0,
    "scene.car-101.kind": "suv",
    "scene.car-101.pos.x": 3.0,
    "scene.car-101.pos.y": 18.0,
    "scene.bicycle-101.visible": True,
    "scene.bicycle-101.pos.x": 1.0,
    "scene.bicycle-101.pos.y": 12.0,
}
NIGHT: dict[str, Value] = {"scene.sun-1.elevation": -10.0}
#: A low sun and all lamps: shadows of both kinds.
EVENING: dict[str, Value] = {
    "scene.sun-1.elevation": 20.0,
    "scene.environment-1.street_lamps": "on",
    "scene.environment-1.car_lamps": "on",
}


def named(scene: Scene) -> Scene:
    """Return the scene with labels by names: by the last part of a path that begins with a class."""
    nodes = {}
    for path, node in scene.nodes.items():
        label = instance = 0
        for part in path.split("."):
            kind, _, number = part.rpartition("-")
            if kind in IDS and number.isdigit():
                label = IDS[kind]
                instance = 1000 * label + int(number) if label in COUNTED else 0
        nodes[path] = replace(node, label_id=label, instance_id=instance)
    return replace(scene, nodes=nodes)


def test_every_class_except_the_train_is_visible_with_the_label_and_number_of_its_name(
    asset: SceneAsset, truth_pass: TruthPass
) -> None:
    scene = apply({}, asset)
    triangles = triangles_of(named(scene))
    largest: dict[int, int] = {}
    for position, yaw, focal_length in CAMERAS.values():
        camera = Camera("scene.camera-1", camera_transform(position, yaw, 0.0, 0.0), focal_length)
        view = View("camera-1", *SIZE)
        truth = truth_pass.truth(replace(scene, cameras={"camera-1": camera}), view)
        classes, instances, _ = assert_agrees(truth, triangles, camera, view, gaps=GAPS)
        sure = (truth.class_map == classes) & (truth.instance_map == instances)
        for label, count in zip(*np.unique(truth.class_map[sure], return_counts=True), strict=True):
            largest[int(label)] = max(largest.get(int(label), 0), int(count))
    assert largest.keys() >= EVALUATED
    assert all(largest[label] >= enough_to_show(0.14) for label in EVALUATED), largest


@pytest.mark.parametrize(
    "light",
    [EVENING, pytest.param({}, marks=pytest.mark.slow), pytest.param(NIGHT, marks=pytest.mark.slow)],
    ids=["evening", "day", "night"],
)
def test_the_layer_over_the_background_is_the_frame_of_the_street_bit_for_bit(
    asset: SceneAsset, raster: RasterRenderer, light: dict[str, Value]
) -> None:
    # A frame rendered from scratch uses no rectangles: everything is drawn and lit.
    scene, view = apply(CROWDED | light, asset), View("camera-1", 160, 90)
    layer = raster.layer(scene, view)
    area = layer.rectangle.width * layer.rectangle.height
    assert area > 0
    assert area < 160 * 90 or light is NIGHT  # at night, the head lamps of movables reach the whole image
    assert_same(layer.over(raster.background(scene, view)), raster.full(scene, view))


def one_piece(scene: Scene) -> Scene:
    """Return the scene without movables: the engine draws everything in one piece and uses no rectangles."""
    return replace(scene, nodes={path: replace(node, movable=False) for path, node in scene.nodes.items()})


def test_truth_of_the_street_in_layers_is_that_of_one_piece(asset: SceneAsset, truth_pass: TruthPass) -> None:
    scene, view = apply(CROWDED, asset), View("camera-1", 160, 90)
    layered, whole = truth_pass.truth(scene, view), truth_pass.truth(one_piece(scene), view)
    np.testing.assert_array_equal(layered.class_map, whole.class_map)
    np.testing.assert_array_equal(layered.instance_map, whole.instance_map)
    assert [person.instance_id for person in layered.persons] == [24001, 24002]
    for person, other in zip(layered.persons, whole.persons, strict=True):
        np.testing.assert_array_equal(person.amodal, other.amodal)
        assert person.padded_pixels == other.padded_pixels
    hit = np.isfinite(whole.depth)
    np.testing.assert_array_equal(np.isfinite(layered.depth), hit)
    # Statics are uploaded in world coordinates, movables with a matrix. Their vertices are rounded differently in the last places
    # of float32: two of the vertex and two of the interpolation between vertices.
    difference = np.abs(layered.depth[hit].astype(np.float64) - whole.depth[hit])
    assert (difference <= 4 * np.spacing(whole.depth[hit])).all()
    moves = np.isin(whole.instance_map, [24001, 24002, 26101, 33101, 25101])
    assert not difference[~moves[hit]].any()
