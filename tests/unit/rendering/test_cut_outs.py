"""Cut-outs in truth and pictures against rays that read the alpha of the texture at full detail."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from tests.sampling import enough_to_show
from tests.unit.rendering.scene_rays import SNAP, blended, pixel_rays
from valerie.rendering.base import Renderer, View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.pyrender.renderer import PyrenderRenderer
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.scene.graph.model import Camera, Environment, Material, Mesh, Node, Scene, Sun, Texture
from valerie.scene.graph.transforms import camera_transform

pytestmark = pytest.mark.gl

FENCE, SKY = 13, 23
CAMERA = Camera("scene.camera-1", camera_transform((0.0, 0.0, 1.2), 0.0, 0.0, 0.0), 50.0)
#: Metres of a square of texture, of which bars take up a sixth.
TILE, SIDE = 0.5, 256
VIEW = View("camera-1", 200, 112)
#: Metres to the middle of the fence, and degrees by which it is turned.
PLACES = ((2.0, 0.0), (6.0, 35.0), (25.0, 0.0), (25.0, 60.0), (60.0, 20.0))


def alpha_of_bars() -> NDArray[np.uint8]:
    """Upright bars and a ring between them: edges that lie along no row and no column."""
    y, x = np.mgrid[0:SIDE, 0:SIDE] / SIDE
    bars = np.abs((4.0 * x) % 1.0 - 0.5) < 1.0 / 12.0
    ring = np.abs(np.hypot(x - 0.5, y - 0.5) - 0.3) < 0.03
    return np.where(bars | ring, 255, 0).astype(np.uint8)


def fence(distance: float, turned_deg: float) -> Scene:
    """White and shadeless before a black ground and sky; as wide and high as the view or more."""
    half, angle = 2.0 * distance, np.radians(turned_deg)
    along = np.array([np.cos(angle), np.sin(angle), 0.0]) * half
    middle, up = np.array([0.0, distance, 1.2]), np.array([0.0, 0.0, 0.3 * half])
    corners = [middle - along - up, middle + along - up, middle + along + up, middle - along + up]
    wide, high = 2.0 * half / TILE, 0.6 * half / TILE
    image = np.zeros((SIDE, SIDE, 4), np.uint8)
    image[..., 3] = alpha_of_bars()
    mesh = Mesh(
        positions=np.float32(corners),
        normals=np.float32([[0.0, -1.0, 0.0]] * 4),
        uvs=np.float32([[0.0, high], [wide, high], [wide, 0.0], [0.0, 0.0]]),
        faces=np.uint32([[0, 1, 2], [0, 2, 3]]),
        material="bars",
    )
    node = Node("scene.fence-1", np.eye(4), (mesh,), label_id=FENCE)
    material = Material("bars", specular=0.0, base_color_texture="bars", alpha_cutoff=0.5, emissive=(3.0, 3.0, 3.0))
    return Scene(
        {node.path: node}, {"bars": material}, {"bars": Texture("bars", image)}, {"camera-1": CAMERA},
        Sun(0.0, 0.6, irradiance=0.01), Environment(),
    )  # fmt: skip


def solid(scene: Scene, view: View, *, right: float = 0.0, down: float = 0.0) -> NDArray[np.bool_]:
    """Return the pixels whose rays meet a bar, (H, W), without the engine's code; rays as in `pixel_rays`."""
    (mesh,) = scene.nodes["scene.fence-1"].meshes
    alpha = scene.textures["bars"].image[..., 3] / 255.0
    corners = mesh.positions.astype(np.float64)
    across, up = corners[1] - corners[0], corners[3] - corners[0]
    rays = pixel_rays(CAMERA, view, right=right, down=down)
    normal = np.cross(across, up)
    with np.errstate(divide="ignore"):
        way = ((corners[0] - CAMERA.position) @ normal) / (rays @ normal)
    offset = CAMERA.position + rays * way[..., None] - corners[0]
    s, t = offset @ across / (across @ across), offset @ up / (up @ up)
    inside = (way > 0) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    hit = np.zeros(inside.shape, np.bool_)
    hit[inside] = blended(alpha, np.stack([s * mesh.uvs[1, 0], (1.0 - t) * mesh.uvs[0, 1]], axis=-1)[inside]) >= 0.5
    return hit


def solid_share(scene: Scene, view: View, samples: int) -> NDArray[np.float64]:
    """Return the share of each pixel's ``samples`` × ``samples`` rays that meet a bar, (H, W)."""
    fine = solid(scene, View(view.camera, view.width * samples, view.height * samples))
    share: NDArray[np.float64] = fine.reshape(view.height, samples, view.width, samples).mean(axis=(1, 3))
    return share


@pytest.mark.parametrize("movable", [False, True], ids=["static", "movable"])
@pytest.mark.parametrize(("distance", "turned"), PLACES)
def test_truth_of_a_cut_out_is_that_of_rays_near_and_far(
    truth_pass: TruthPass, distance: float, turned: float, movable: bool
) -> None:
    scene = fence(distance, turned)
    if movable:
        node = replace(scene.nodes["scene.fence-1"], movable=True)
        scene = replace(scene, nodes={node.path: node})
    drawn = truth_pass.truth(scene, VIEW).class_map == FENCE
    traced = solid(scene, VIEW)
    assert min(traced.sum(), (~traced).sum()) >= enough_to_show(0.001)
    around = [solid(scene, VIEW, right=right, down=down) for right, down in product((-SNAP, SNAP), repeat=2)]
    sure = np.logical_and.reduce(around) | ~np.logical_or.reduce(around)
    np.testing.assert_array_equal(drawn[sure], traced[sure])


@pytest.fixture(scope="module", params=["raster", "pyrender"])
def engine(request: pytest.FixtureRequest) -> Renderer:
    if request.param == "raster":
        raster: RasterRenderer = request.getfixturevalue("raster")
        return raster
    return PyrenderRenderer()


@pytest.mark.parametrize(("distance", "turned"), PLACES)
def test_pictures_show_a_cut_out_where_truth_has_it(
    engine: Renderer, truth_pass: TruthPass, distance: float, turned: float
) -> None:
    scene = fence(distance, turned)
    # Near bars fill whole pixels.
    near, light = (engine.full(shown, VIEW).pixels[..., 1].astype(np.float64) for shown in (fence(2.0, 0.0), scene))
    shown = np.clip(light / near.max(), 0.0, 1.0)
    drawn = truth_pass.truth(scene, VIEW).class_map == FENCE
    exact = solid_share(scene, VIEW, 8)
    # As much of it as rays find, wherever it is and however fine.
    assert shown.mean() == pytest.approx(exact.mean(), abs=0.03)
    assert drawn.mean() == pytest.approx(exact.mean(), abs=0.03)
    # An edge is at most half a pixel away where bars are wider than pixels.
    surely = minimum_filter(exact, 3) == 1.0, maximum_filter(exact, 3) == 0.0
    assert (shown[surely[0]] > 0.5).all()
    assert (shown[surely[1]] < 0.5).all()
