"""A pane with a room behind it, and what any engine must show of it: rays end at the walls of a box."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from tests.unit.rendering.scene_rays import pixel_rays
from valerie.rendering.base import View
from valerie.rendering.sky import LUX
from valerie.scene.graph.model import ROOM_CELLS, Camera, Environment, Material, Mesh, Node, Rooms, Scene, Sun, Texture
from valerie.scene.graph.transforms import camera_transform

ROOMS = Rooms("rooms", width=3.0, depth=4.0, luminance=10.0)
#: Column and row of the cell of the pane; its width, metres; the heights of its edges.
CELL, WIDE, LOW, HIGH = (2, 1), 1.2, 1.0, 2.6
#: Linear colours of the walls at the left and right, of floor, ceiling and the back.
WALLS = np.array([(0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.5), (0.5, 0.5, 0.0), (0.5, 0.0, 0.5)])
GREY, CLOTH, SIDE = 0.5, 0.25, 1024
VIEW = View("camera-1", 96, 54)
CAMERAS = {
    "in front": camera_transform((0.0, 1.0, 1.7), 0, 0, 0),
    "from the left, below": camera_transform((-2.5, 3.0, 0.6), 310, 18, 0),
    "from the left, above": camera_transform((-0.9, 3.8, 3.0), 345, -40, 0),
    "from the right, above": camera_transform((2.2, 2.6, 3.2), 42, -25, 0),
}


def srgb(linear: float) -> int:
    return round(255 * (1.055 * float(linear ** (1 / 2.4)) - 0.055))


def texture(*, lit: bool = True, hung: float = 0.0) -> Texture:
    """Return the pictures of one room with coloured walls by day and grey ones by lamps. A cloth covers a part of the pane."""
    image, cell = np.zeros((SIDE, SIDE, 4), np.uint8), SIDE // 2 // ROOM_CELLS
    along = (np.arange(cell) + 0.5) / cell
    x, y = np.meshgrid((along - 0.5) / 0.48, (along - 0.5) / 0.48)
    # Seen from one depth in front, the back fills half of the front in each direction.
    wall = np.select([np.maximum(abs(x), abs(y)) < 0.5, x < -abs(y), x > abs(y), y > abs(x)], [4, 0, 1, 2], 3)
    left, top = CELL[0] * cell, CELL[1] * cell
    encoded = np.where(WALLS > 0, srgb(0.5), 0)[wall]
    half = SIDE // 2
    image[top : top + cell, left : left + cell] = np.dstack([encoded, np.full_like(wall, 255)])
    image[top : top + cell, half + left : half + left + cell] = (*[srgb(GREY)] * 3, 255 * lit)
    cover = np.where((along - 0.5) / 0.96 + 0.5 < hung, 255, 0)
    for right in (0, half):
        image[half + top : half + top + cell, right + left : right + left + cell, :3] = srgb(CLOTH)
        image[half + top : half + top + cell, right + left : right + left + cell, 3] = cover
    return Texture("rooms", image)


def pane(pictures: Texture, camera: str, elevation: float = 40.0, **environment: str) -> Scene:
    corners = [(-WIDE / 2, 5, LOW), (WIDE / 2, 5, LOW), (WIDE / 2, 5, HIGH), (-WIDE / 2, 5, HIGH)]
    uvs = (np.array([(0.02, 0.98), (0.98, 0.98), (0.98, 0.02), (0.02, 0.02)]) + CELL) / ROOM_CELLS
    mesh = Mesh(
        np.array(corners, np.float32), np.tile(np.array([0, -1, 0], np.float32), (4, 1)), uvs.astype(np.float32),
        np.array([(0, 1, 2), (0, 2, 3)], np.uint32), "glass",
    )  # fmt: skip
    node = Node("scene.building-1", np.eye(4), (mesh,), label_id=11)
    glass = Material("glass", (1.0, 1.0, 1.0), roughness=0.06, specular=0.0, rooms=ROOMS)
    return Scene(
        {node.path: node}, {"glass": glass}, {"rooms": pictures},
        {"camera-1": Camera("scene.camera-1", CAMERAS[camera], focal_length_mm=24.0)}, Sun(0.0, math.radians(elevation)),
        environment=Environment(cloud_cover=1.0, **environment),  # type: ignore[arg-type]
    )  # fmt: skip


def walls_met(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return the wall that the ray of each pixel meets, −1 beside the pane, and True if it is sure: away from all edges."""
    rays, eye = pixel_rays(camera, VIEW), camera.position
    at = eye + rays * ((5.0 - eye[1]) / rays[..., 1])[..., None]
    through = (np.abs(at[..., 0]) < WIDE / 2 - 0.15) & (at[..., 2] > LOW + 0.15) & (at[..., 2] < HIGH - 0.15)
    planes = [(0, -1.5), (0, 1.5), (2, HIGH - 2.3), (2, HIGH + 0.35), (1, 9.0)]
    with np.errstate(divide="ignore"):
        reach = np.stack([(place - at[..., axis]) / rays[..., axis] for axis, place in planes])
    ordered = np.sort(np.where(reach > 0, reach, np.inf), axis=0)
    # Metres along the ray between the two nearest walls: some texels of the back, 5 cm each.
    sure = through & ((ordered[1] - ordered[0]) * np.linalg.norm(rays, axis=-1) > 0.25)
    return np.where(through, np.where(reach > 0, reach, np.inf).argmin(0), -1), sure


def check_walls(render: Callable[[Scene], np.ndarray]) -> None:
    """Check that each pixel of the pane shows the wall that its ray meets. ``render`` returns linear pixels of `VIEW`."""
    met: set[int] = set()
    for camera in CAMERAS:
        scene = pane(texture(), camera)
        wall, sure = walls_met(scene.cameras["camera-1"])
        pixels = render(scene).astype(np.float64)
        assert sure.sum() > 100
        assert ((pixels > 0.4 * pixels.max(-1, keepdims=True)) == (WALLS[wall] > 0))[sure].all(), camera
        met |= set(wall[sure].tolist())
    assert met == {0, 1, 2, 3, 4}


def check_lamps(render: Callable[[Scene], np.ndarray]) -> None:
    """Check that lamps light the rooms that have some while the street lamps are on."""

    def middle(scene: Scene) -> float:
        return float(render(scene)[24:30, 45:51].astype(np.float64).mean())

    night = {"elevation": -18.0}
    # 10 cd/m² is the luminance of a white surface in 31.4 lx. Eight bits of a colour and of its root: 1 %.
    expected = GREY * math.pi * ROOMS.luminance * LUX
    assert middle(pane(texture(), "in front", **night)) == pytest.approx(expected, rel=0.01)  # type: ignore[arg-type]
    for scene in (
        pane(texture(), "in front", **night, street_lamps="off"),  # type: ignore[arg-type]
        pane(texture(lit=False), "in front", **night),  # type: ignore[arg-type]
    ):
        assert middle(scene) < expected / 50
