"""Takes the panorama that smooth surfaces mirror: a small picture of the statics and the sky all around the camera.

The engine photographs it itself: five small square images, level and straight up, from the middle of the cubic metre that the
camera is in, so that a moving camera seldom needs a new one. Downwards, the ground is level and of one colour. The images are
resampled to an octahedral map with the inverse distance of each texel, in which ``captured.glsl`` follows reflected rays.
Movables are not mirrored, so they never change a pixel this way.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Final, NamedTuple

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import View
from valerie.rendering.projection import Points, drawing_matrices
from valerie.rendering.raster.canvas import Canvas
from valerie.rendering.raster.gl.tiles import Area
from valerie.rendering.raster.light.lighting import LitFrame, Viewpoint
from valerie.rendering.raster.light.panorama import SIDE, SKY_DISTANCE, Panorama
from valerie.rendering.raster.upload.drawing import SurfaceDrawer
from valerie.rendering.raster.upload.scenes import Statics
from valerie.scene.graph.model import Camera

#: Pixels per side of the five images, which have a field of view of 90°.
_VIEW: Final = View("panorama", 64, 64)
#: Least size of a mesh in it, as a share of its distance: 1.3 pixels of an image. At 0.08, distant trees are missing.
_LEAST: Final = 0.04
#: Brightest value: the sun's own mirror image is a highlight (``lighting.frag``).
_BRIGHTEST: Final = 6.0
#: Least height of a spot above the ground, metres.
_LEAST_HEIGHT: Final = 0.5
_AHEAD: Final = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))


class Spot:
    """The statics seen from one place in five directions.

    Args:
        gl: the current context.
        drawer: draws the G-buffer of surfaces.
        statics: the statics.
        table: their material table.
        place: (3,) of `spot_of`.
    """

    def __init__(
        self, gl: moderngl.Context, drawer: SurfaceDrawer, statics: Statics, table: moderngl.Texture, place: Points
    ) -> None:
        self._gl = gl
        self.place = place
        self._height = max(float(place[2]) - statics.geometry.sample.lowest, _LEAST_HEIGHT)
        self._faces = [(_camera(place, ahead), Canvas(gl, _VIEW)) for ahead in map(np.array, _AHEAD)]
        for camera, canvas in self._faces:
            target = canvas.targets.surfaces
            target.use()
            target.clear()
            drawer.statics(statics, table, drawing_matrices(camera, _VIEW), least=_LEAST)

    def photograph(self, panorama: Panorama, bind: Callable[[Canvas, Viewpoint], LitFrame], ground: Points) -> None:
        """Light the statics and fill a panorama.

        Args:
            bind: returns the lighting passes of a canvas.
            ground: (3,) radiance of the ground below.
        """
        rays, everything = _rays(), Area(0, 0, _VIEW.width, _VIEW.height)
        seen = np.empty((len(self._faces), _VIEW.height, _VIEW.width, 4), np.float32)
        for face, (camera, canvas) in zip(seen, self._faces, strict=True):
            canvas.skylit, canvas.shaded = canvas.grid.none(), canvas.grid.none()
            frame = bind(canvas, Viewpoint(camera, _VIEW))
            canvas.light(frame, ~canvas.grid.none())
            frame.release()
            face[..., :3] = canvas.read_pixels(everything)
            face[..., 3] = 1 / (canvas.read_depth(camera.near, camera.far) * rays.lengths)
        np.minimum(seen[..., :3], _BRIGHTEST, out=seen[..., :3])
        sharp = np.empty((*rays.face.shape, 4), np.float32)
        for k, face in enumerate(seen):
            here = rays.face == k
            sharp[here] = cv2.remap(face, *rays.at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[here]
        below = rays.face < 0
        sharp[below, :3] = ground
        sharp[below, 3] = -rays.directions[below, 2] / self._height
        panorama.fill(sharp)

    def release(self) -> None:
        """Free the targets."""
        for _, canvas in self._faces:
            canvas.release()


def spot_of(eye: Points) -> Points:
    """Return the middle of the cubic metre that a camera at ``eye`` is in, (3,) metres."""
    return np.floor(eye) + 0.5


def _camera(place: Points, ahead: Points) -> Camera:
    up = np.array([0.0, 0.0, 1.0]) if ahead[2] == 0 else np.array([0.0, 1.0, 0.0])
    transform = np.eye(4)
    transform[:3, :3] = np.stack([np.cross(ahead, up), up, -ahead], axis=1)
    transform[:3, 3] = place
    return Camera("panorama", transform, focal_length_mm=18.0, sensor_width_mm=36.0, far=float(SKY_DISTANCE))


class _Rays(NamedTuple):
    """Where each texel of the map lies in the five images.

    Attributes:
        directions: (side, side, 3) unit vectors.
        face: (side, side) index of the image; −1 below all of them.
        at: column and row in the image, each (side, side).
        lengths: (height, width) distance of a pixel of an image over its depth.
    """

    directions: NDArray[np.float32]
    face: NDArray[np.int64]
    at: tuple[NDArray[np.float32], NDArray[np.float32]]
    lengths: NDArray[np.float32]


@cache
def _rays() -> _Rays:
    # As in ``octahedron.glsl``. Beyond an edge, the map continues turned by half a turn about the edge's middle.
    along = (np.arange(-1, SIDE + 1) + 0.5) / SIDE
    x, y = np.meshgrid(along, along)
    for a, b in ((x, y), (y, x)):
        out = (a < 0) | (a > 1)
        a[out], b[out] = np.where(a[out] < 0, -a[out], 2 - a[out]), 1 - b[out]
    x, y = 2 * x - 1, 2 * y - 1
    z = 1 - np.abs(x) - np.abs(y)
    lower = z < 0
    x, y = (
        np.where(lower, (1 - np.abs(y)) * np.where(x >= 0, 1, -1), x),
        np.where(lower, (1 - np.abs(x)) * np.where(y >= 0, 1, -1), y),
    )
    directions = np.stack([x, y, z], axis=2)
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    local = np.stack([directions @ _camera(np.zeros(3), np.array(ahead)).transform[:3, :3] for ahead in _AHEAD])
    depth = -local[..., 2]
    face = depth.argmax(axis=0)
    row, column = np.indices(face.shape)
    right, up, ahead = (part[face, row, column] for part in (local[..., 0], local[..., 1], depth))
    face = np.where(up < -ahead, -1, face)
    at = [((part / np.maximum(ahead, 1e-6) + 1) / 2 * _VIEW.width - 0.5).astype(np.float32) for part in (right, up)]
    pixels = (np.arange(_VIEW.width) + 0.5) / _VIEW.width * 2 - 1
    lengths = np.sqrt(1 + pixels**2 + pixels[:, None] ** 2).astype(np.float32)
    return _Rays(directions.astype(np.float32), face, (at[0], at[1]), lengths)
