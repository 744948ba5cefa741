"""A rolling shutter against rays cast line by line: those of a line see the scene and the camera at the line's own moment."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.sampling import enough_to_show
from tests.unit.rendering.scene_rays import SNAP, near_edges, pixel_rays, trace, triangles_of
from valerie.labels import PERSON, label_of_node_class
from valerie.rendering.annotations.scan import Scan
from valerie.rendering.base import LinearImage, Rectangle, View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.scanning import Readout, scan, sliced
from valerie.scene.graph.model import Node, Scene
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.variation.variant import apply
from valerie.testing.assets import box_mesh, simple_asset

pytestmark = pytest.mark.gl

VIEW = View("camera-1", 320, 90)
LINES = (np.arange(VIEW.height, dtype=np.float64) - 0.5 * (VIEW.height - 1))[:, None]
CAR, POLE = label_of_node_class("car").id, label_of_node_class("pole").id


def street(seconds: float, *, drives: float = 0.0, turns: float = 0.0) -> Scene:
    """Return a street with a crossing person, a car that drives off and three poles, seen by a camera that moves.

    Args:
        seconds: the moment.
        drives: speed of the camera along the street, m/s.
        turns: degrees per second to the left.
    """
    scene = apply({"scene.person-1.pos.x": -1.0 + 1.5 * seconds, "scene.person-1.pos.y": 7.0}, simple_asset())
    nodes: dict[str, Node] = {}
    for path, node in scene.nodes.items():
        nodes[path] = replace(node, movable=True) if path.startswith("scene.car-1") else node
    car = nodes["scene.car-1"].transform.copy()
    car[:2, 3] = 2.5 - 1.0 * seconds, 11.0 + 4.0 * seconds
    nodes["scene.car-1"] = replace(nodes["scene.car-1"], transform=car)
    for number, (x, y) in enumerate(((-2.5, 6.0), (1.2, 9.0), (4.0, 14.0)), start=1):
        place = np.eye(4)
        place[:2, 3] = x, y
        pole = (box_mesh((-0.1, -0.1, 0), (0.1, 0.1, 5), "plaster"),)
        nodes[f"scene.pole-{number}"] = Node(f"scene.pole-{number}", place, pole, label_id=POLE)
    camera = replace(
        scene.cameras["camera-1"], transform=camera_transform((0, -2 + drives * seconds, 1.5), turns * seconds, 0, 0)
    )
    return replace(scene, nodes=nodes, cameras={"camera-1": camera})


class Dark:
    """An engine for tests of labels: its parts are black."""

    def __getattr__(self, name: str) -> Callable[..., NDArray[np.float16]]:
        return lambda _scene, _view, window=None: (
            np.zeros((window.height, window.width, 3), np.float16) if window else None
        )


def scanned(
    truth_pass: TruthPass, engine: Any, moments: Callable[[float], Scene], line_time_s: float, image: LinearImage
) -> Scan:
    frame = image, truth_pass.truth(moments(0.0), VIEW)
    return scan(engine, truth_pass, moments, VIEW, frame, Readout(LINES, line_time_s))


class Lines(NamedTuple):
    """Class map and instance map, each line of which is traced at its own moment, and the pixels around which both are even."""

    classes: NDArray[np.uint8]
    instances: NDArray[np.uint16]
    sure: NDArray[np.bool_]


#: Pixels by which labels may be off: a slice ends before anything moves by a quarter, and the rasterizer rounds.
OFF = 0.25 + SNAP


def cast(moments: Callable[[float], Scene], line_time_s: float) -> Lines:
    shape = (VIEW.height, VIEW.width)
    lines = Lines(np.zeros(shape, np.uint8), np.zeros(shape, np.uint16), np.ones(shape, np.bool_))
    for row, line in enumerate(LINES[:, 0].tolist()):
        scene = moments(line * line_time_s)
        triangles, camera = triangles_of(scene), scene.cameras[VIEW.camera]
        classes, instances, _ = trace(triangles, camera, VIEW, row)
        lines.classes[row], lines.instances[row] = classes[0], instances[0]
        for right, down in product((-OFF, OFF), repeat=2):
            around = trace(triangles, camera, VIEW, row, right=right, down=down)
            lines.sure[row] &= (around[0] == classes)[0] & (around[1] == instances)[0]
    return lines


@pytest.mark.parametrize(
    ("drives", "turns", "line_time_s"),
    [(0.0, 0.0, 1e-3), (8.0, 0.0, 1e-3), (0.0, 30.0, 1e-3), (8.0, 20.0, 1.5e-4), (8.0, -30.0, 1e-3)],
    ids=["stands", "drives", "turns", "drives and turns, fast", "drives and turns, slow"],
)
def test_labels_are_those_of_rays_cast_line_by_line(
    truth_pass: TruthPass, drives: float, turns: float, line_time_s: float
) -> None:
    def moments(seconds: float) -> Scene:
        return street(seconds, drives=drives, turns=turns)

    lines = cast(moments, line_time_s)
    black = LinearImage(np.zeros((VIEW.height, VIEW.width, 3), np.float16))
    result = scanned(truth_pass, Dark(), moments, line_time_s, black)
    truth = result.truth(truth_pass.truth(moments(0.0), VIEW))
    assert result.consistent()
    for label in (PERSON.id, CAR, POLE):
        assert (lines.classes[lines.sure] == label).sum() >= enough_to_show(0.03)
    np.testing.assert_array_equal(truth.class_map[lines.sure], lines.classes[lines.sure])
    np.testing.assert_array_equal(truth.instance_map[lines.sure], lines.instances[lines.sure])
    for label in (PERSON.id, CAR, POLE):
        scanned_pixels, cast_pixels = truth.class_map == label, lines.classes == label
        # A requirement: 98 % over all pixels, those beside edges too.
        assert (scanned_pixels & cast_pixels).sum() >= 0.98 * (scanned_pixels | cast_pixels).sum()
    (person,) = truth.persons
    assert not (person.amodal < (truth.instance_map == person.instance_id)).any()


def test_the_image_shows_each_line_at_its_own_moment(truth_pass: TruthPass, raster: RasterRenderer) -> None:
    def moments(seconds: float) -> Scene:
        return street(seconds, turns=20.0)

    frame = LinearImage(raster.full(moments(0.0), VIEW).pixels)
    image = scanned(truth_pass, raster, moments, 2e-4, frame).image(frame).pixels.astype(np.float32)
    assert (image != frame.pixels).any()
    for row in (5, 80):
        line = raster.full(moments(float(LINES[row, 0]) * 2e-4), VIEW).pixels[row].astype(np.float32)
        # A slice ends before anything moves by half a pixel, so its middle is at most a quarter away. The camera turns by more
        # than three quarters of a pixel until these lines are read: the frame's own moment is at least three times as far.
        error, unread = (float(np.abs(other[row] - line).sum()) for other in (image, frame.pixels.astype(np.float32)))
        assert error < unread / 3


def test_nothing_changes_where_nothing_moves(truth_pass: TruthPass, raster: RasterRenderer) -> None:
    now = street(0.0)
    frame = raster.layer(now, VIEW).over(raster.background(now, VIEW)), truth_pass.truth(now, VIEW)
    still = scan(raster, truth_pass, lambda _: now, VIEW, frame, Readout(LINES, 1e-3))
    assert Rectangle(*still.rectangle.tolist()).empty
    assert still.image(frame[0]).pixels is frame[0].pixels
    assert still.truth(frame[1]).persons[0].padded_pixels == frame[1].persons[0].padded_pixels


def test_a_part_of_truth_and_image_is_that_of_the_whole(truth_pass: TruthPass, raster: RasterRenderer) -> None:
    # Parts first, while nothing of these views is in the caches.
    for number, window in enumerate((Rectangle(0, 40, 320, 3), Rectangle(100, 0, 90, 90))):
        scene = street(0.1 + 0.01 * number, drives=8.0)
        part, pixels = truth_pass.part(scene, VIEW, window), raster.part(scene, VIEW, window)
        whole, image = truth_pass.truth(scene, VIEW), raster.full(scene, VIEW).pixels
        inside = window.slices
        np.testing.assert_array_equal(pixels.view(np.uint16), image[inside].view(np.uint16))
        np.testing.assert_array_equal(part.class_map, whole.class_map[inside])
        np.testing.assert_array_equal(part.instance_map, whole.instance_map[inside])
        np.testing.assert_array_equal(part.depth, whole.depth[inside])
        differs = part.persons[0].amodal[inside] != whole.persons[0].amodal[inside]
        assert not (differs & ~near_edges(whole.class_map)[inside]).any()


def test_slices_bound_the_motion_and_cover_every_line() -> None:
    moves = np.array([0.0, 0.0, 0.1, 0.1, 0.1, 3.0, 3.0, 0.0, 0.0])
    assert list(sliced(moves, 0.25)) == [(0, 2), (2, 4), (4, 5), (5, 6), (6, 7), (7, 9)]
    assert list(sliced(np.zeros(5), 0.25)) == [(0, 5)]


def test_rays_of_one_line_are_those_of_the_image() -> None:
    camera = street(0.0).cameras["camera-1"]
    np.testing.assert_array_equal(pixel_rays(camera, VIEW, 17), pixel_rays(camera, VIEW)[17:18])
