"""What large panes mirror, against rays that are mirrored and traced."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from tests.sampling import enough_to_show
from tests.unit.rendering.scene_rays import pixel_rays, triangles_of
from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.raster.upload.context import GraphicsContext
from valerie.scene.graph.model import Camera, Environment, Material, Node, Scene, Sun
from valerie.scene.graph.transforms import Pose, camera_transform
from valerie.testing.assets import box_mesh
from valerie.testing.rendering import assert_same

pytestmark = pytest.mark.gl

VIEW = View("camera-1", 320, 180)
#: Class ids of what the pane mirrors. Each has a colour of its own.
RED, BLUE = 12, 15
MATERIALS = {
    "glass": Material("glass", (1.0, 1.0, 1.0), roughness=0.04, metallic=1.0),
    "red": Material("red", (0.6, 0.02, 0.02), roughness=1.0, specular=0.0),
    "blue": Material("blue", (0.02, 0.02, 0.6), roughness=1.0, specular=0.0),
}


def box(path: str, low: tuple[float, ...], high: tuple[float, ...], material: str, label: int) -> Node:
    return Node(f"scene.{path}", np.eye(4), (box_mesh(low, high, material),), label_id=label)  # type: ignore[arg-type]


def before_a_pane(turn: float, *, person: bool = False) -> Scene:
    """Return a pane 6 m ahead that is turned, in a red house, and blue blocks before a red wall 5 m behind the camera.

    The blocks stand 0.8 to 1.5 m before the wall, so a picture from another place than the camera's mirror image, or one that
    the house hides, shows them elsewhere.
    """
    pose = Pose((0.0, 6.0, 3.0), (0, 0, turn)).matrix()
    nodes = [
        Node("scene.pane-1", pose, (box_mesh((-2, 0, -1), (2, 0.01, 1), "glass"),), label_id=11),
        Node("scene.house-1", pose, (box_mesh((-6, 0.02, -3), (6, 5, 6), "red"),), label_id=11),
        box("wall-1", (-40, -6, 0), (40, -5, 30), "red", RED),
        *(
            box(f"block-{i}", (x, -4.5 + 0.35 * (i % 3), z), (x + 0.8, -3.5, z + 0.9), "blue", BLUE)
            for i, (x, z) in enumerate((x, z) for x in (-6.0, -4.2, -2.4, -0.6, 1.2, 3.0, 4.8) for z in (0.6, 2.3, 4.0, 5.7))
        ),
    ]  # fmt: skip
    if person:
        nodes.append(replace(box("person-1", (-0.4, 3.5, 2.0), (0.1, 3.9, 3.2), "blue", 24), movable=True))
    camera = Camera("scene.camera-1", camera_transform((0.3, -1.0, 3.2), 0, 0, 0), focal_length_mm=50.0)
    return Scene(
        {node.path: node for node in nodes}, MATERIALS, {}, {"camera-1": camera}, Sun(0.0, math.radians(50)),
        environment=Environment(cloud_cover=1.0),
    )  # fmt: skip


@pytest.mark.parametrize("turn", [0.0, 9.0, -14.0])
def test_a_pane_mirrors_things_where_mirrored_rays_meet_them(raster: RasterRenderer, turn: float) -> None:
    scene = before_a_pane(turn)
    camera, pose = scene.cameras["camera-1"], scene.nodes["scene.pane-1"].transform
    rays, across = pixel_rays(camera, VIEW), pose[:3, 1]
    met = camera.position + rays * ((pose[:3, 3] - camera.position) @ across / (rays @ across))[..., None]
    onward = rays - 2 * (rays @ across)[..., None] * across
    triangles = triangles_of(scene)
    # The origins lie before the pane, so that the rays do not meet it again.
    hit = triangles.intersector.intersects_first((met - 1e-3 * across).reshape(-1, 3), onward.reshape(-1, 3))
    seen = np.where(hit < 0, 0, triangles.labels[hit]).reshape(VIEW.height, VIEW.width)
    within = (np.abs((met - pose[:3, 3]) @ pose[:3, :3])[..., [0, 2]] < (1.9, 0.9)).all(axis=2)
    # A texel of the picture covers 2.5 pixels, and its filter reaches one texel to each side, as does the image's own.
    reach = 2 * 4 + 1
    sure = within & (maximum_filter(seen, reach) == minimum_filter(seen, reach)) & np.isin(seen, (RED, BLUE))
    assert min((sure & (seen == label)).sum() for label in (RED, BLUE)) >= enough_to_show(0.03)
    pixels = raster.full(scene, VIEW).pixels.astype(np.float64)
    np.testing.assert_array_equal((pixels[..., 2] > pixels[..., 0])[sure], (seen == BLUE)[sure])


def test_a_pane_of_one_scene_leaves_no_trace_in_image_and_truth_of_another(
    raster: RasterRenderer, truth_pass: TruthPass
) -> None:
    # The pane's plane cuts through the second scene: a plane that stayed would take a part of it away.
    first, second = before_a_pane(9.0), before_a_pane(-14.0, person=True)
    truth = truth_pass.truth(second, VIEW)
    raster.background(first, VIEW)
    background, layer, frame = raster.background(second, VIEW), raster.layer(second, VIEW), raster.full(second, VIEW)
    again = truth_pass.truth(second, VIEW)
    context = GraphicsContext()
    alone = RasterRenderer(context)
    try:
        assert_same(frame, alone.full(second, VIEW))
    finally:
        alone.close()
        context.close()
    assert_same(layer.over(background), frame)
    for part in ("class_map", "instance_map", "depth"):
        np.testing.assert_array_equal(getattr(again, part), getattr(truth, part))
