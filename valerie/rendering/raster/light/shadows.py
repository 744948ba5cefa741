"""Shadow maps: of the statics that a camera sees, of the movables, and of the statics from directions all over the sky."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Final

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import View
from valerie.rendering.projection import (
    LightView,
    Points,
    box_corners,
    fit_light_view,
    light_axes,
    seen_points,
    turned_to_fit,
)
from valerie.rendering.raster.gl.targets import RenderTarget
from valerie.rendering.raster.gl.tiles import Mask
from valerie.rendering.raster.gl.uniforms import Uniforms
from valerie.rendering.raster.upload.drawing import SurfaceDrawer
from valerie.rendering.raster.upload.surroundings import SurfaceSample, prominence
from valerie.scene.graph.model import Camera, Matrix

if TYPE_CHECKING:
    from valerie.rendering.raster.upload.context import GraphicsContext
    from valerie.rendering.raster.upload.scenes import Prepared, Statics
    from valerie.rendering.raster.upload.static_geometry import StaticGeometry

#: Texels per side of the statics' map, of the map of movables that are far apart, and of movables close together.
STATIC_MAP: Final = 4096
MOVABLE_MAP: Final = 1024
CLOSE_MAP: Final = 512
#: Largest extent of movables close together, across the light, metres. Texels are then at most 8 mm wide.
_CLOSE: Final = 4.0
#: Largest ratio of the shared map's width to that of a camera's own map at which the camera uses the shared map.
_SHARED: Final = 1.5
#: Texels per side of the blocks of the statics' map that the survey of depths uses.
_BLOCK: Final = 8
#: Rows of texels that one read covers.
_BAND: Final = 512
#: Largest depth along the optical axis with shadows, metres.
SHADOW_DISTANCE: Final = 160.0
#: Widest blur of a shadow's edge to each side, metres.
LARGEST_PENUMBRA: Final = 0.25
#: The lowest height of a place without movables, metres; the highest is its negative.
NO_COLUMN: Final = 1_000_000
#: Texels per side of the map of `nearest_directions`.
_AROUND: Final = 128
#: As STEEPEST in ``openness.frag``.
_STEEPEST: Final = 30.0
#: Columns and rows of the sky atlas: one tile per direction.
SKY_TILES: Final = (8, 4)
#: Texels per side of a tile.
SKY_MAP: Final = 512


class ShadowMap:
    """A depth map and the box that it covers.

    Attributes:
        casters: the least and the largest depth around each block of texels, after `survey`.
    """

    def __init__(self, gl: moderngl.Context, light: LightView, resolution: int) -> None:
        self._gl = gl
        self.light = light
        self.casters: moderngl.Texture | None = None
        self.target = RenderTarget(gl, (resolution, resolution), (), depth=True)

    @property
    def texture(self) -> moderngl.Texture:
        assert self.target.depth is not None
        return self.target.depth

    def survey(self) -> None:
        """Compute the depth range of casters around each block. With it, most places need no blocker search."""
        side = self.target.size[0]
        across, up = np.ceil((LARGEST_PENUMBRA * side / self.light.extent[:2] + 1) / _BLOCK).astype(int)
        around = np.ones((2 * up + 1, 2 * across + 1), np.uint8)
        # Band by band: the system would allocate a buffer for the whole map anew each time.
        bands = [self._blocks(first, min(_BAND, side - first)) for first in range(0, side, _BAND)]
        least, largest = (np.concatenate(parts) for parts in zip(*bands, strict=True))
        ranges = [cv2.erode(least, around), cv2.dilate(largest, around)]
        size = (side // _BLOCK, side // _BLOCK)
        self.casters = self._gl.texture(size, 2, np.stack(ranges, axis=2).tobytes(), dtype="f4")
        self.casters.filter = (moderngl.NEAREST, moderngl.NEAREST)

    def _blocks(self, first: int, count: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the least and the largest depth in each block of ``count`` rows of texels from row ``first`` on."""
        side, part = self.target.size[0], (0, first, self.target.size[0], count)
        data = self.target.framebuffer.read(viewport=part, components=1, attachment=-1, dtype="f4", alignment=1)
        rows = np.frombuffer(data, np.float32).reshape(count // _BLOCK, _BLOCK, side)
        least, largest = rows.min(axis=1), rows.max(axis=1)
        return (
            np.minimum.reduce([least[:, i::_BLOCK] for i in range(_BLOCK)]),
            np.maximum.reduce([largest[:, i::_BLOCK] for i in range(_BLOCK)]),
        )

    def holds(self, low: Points, high: Points) -> Mask:
        """Return (N,) bool, True if a caster lies in the rectangle ``low`` … ``high``, (N, 2) metres in the light's axes."""
        side = self.target.size[0]
        data = self.target.framebuffer.read(components=1, attachment=-1, dtype="f4", alignment=1)
        casters = (np.frombuffer(data, np.float32) < 1).reshape(side, side)
        # A summed-area table counts the drawn texels of a rectangle.
        sums = cv2.integral(casters.view(np.uint8), sdepth=cv2.CV_32S)
        texel = self.light.extent[:2] / side
        first = np.clip(np.floor((low - self.light.origin[:2]) / texel), 0, side).astype(np.int64)
        last = np.clip(np.ceil((high - self.light.origin[:2]) / texel), 0, side).astype(np.int64)
        (x0, y0), (x1, y1) = first.T, last.T
        occupied: Mask = sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0] > 0
        return occupied

    def release(self) -> None:
        """Free the map."""
        if self.casters is not None:
            self.casters.release()
        self.target.release()


class ColumnMap:
    """The lowest and the highest surface of the movables over each place of the ground (``columns.glsl``).

    Attributes:
        light: the box that the map covers, seen from below: its axes are those of the world.
    """

    def __init__(self, gl: moderngl.Context, light: LightView, resolution: int) -> None:
        self.light = light
        self.target = RenderTarget(gl, (resolution, resolution), ((2, "f4"),), depth=False)

    @property
    def texture(self) -> moderngl.Texture:
        return self.target.colors[0]

    @property
    def values(self) -> Uniforms:
        """The uniforms that place it."""
        origin, extent = self.light.origin, self.light.extent
        return {"columns_origin": (origin[0], origin[1]), "columns_extent": (extent[0], extent[1])}

    def clear(self) -> None:
        """Remove all columns."""
        self.target.framebuffer.clear(-NO_COLUMN, -NO_COLUMN)

    def release(self) -> None:
        """Free the map."""
        self.target.release()


class SkyMaps:
    """Depth maps of the statics from directions spread evenly over the sky, in one atlas.

    Attributes:
        directions: (K, 3) unit vectors towards the sky.
        rows: (3·K, 4) float32; rows 3k … 3k+2 map a world point to [0, 1]³ of tile k.
        extents: (K, 3) float32, size of the box that a tile covers, metres.
        openness: (N, K) bool, True if nothing hides the sky from a place of the statics' `SurfaceSample`.
        prominence: (N,) weights of these places.
        nearest, shares: textures of `nearest_directions`.
    """

    def __init__(self, gl: moderngl.Context, drawer: SurfaceDrawer, statics: Statics, table: moderngl.Texture) -> None:
        across, down = SKY_TILES
        self.directions = even_directions(across * down)
        self.target = RenderTarget(gl, (across * SKY_MAP, down * SKY_MAP), (), depth=True)
        self.target.use()
        self.target.clear()
        geometry = statics.geometry
        core = box_corners(geometry.core_low - 1, geometry.core_high + 1)
        casters = box_corners(geometry.low, geometry.high)
        rows: list[NDArray[np.float64]] = []
        extents: list[NDArray[np.float64]] = []
        framebuffer = self.target.framebuffer
        for k, direction in enumerate(self.directions):
            light = fit_light_view(turned_to_fit(light_axes(direction), core), core, casters, SKY_MAP, 0.5)
            framebuffer.viewport = (k % across * SKY_MAP, k // across * SKY_MAP, SKY_MAP, SKY_MAP)
            framebuffer.use()
            drawer.statics(statics, table, {"clip_from_world": light.clip_from_world})
            rows.append(np.hstack([light.rows, -light.origin[:, None]]) / light.extent[:, None])
            extents.append(light.extent)
        self.rows = np.concatenate(rows).astype(np.float32)
        self.extents = np.array(extents, np.float32)
        self.openness = self._open_to(geometry.sample)
        self.prominence = prominence(geometry.sample, self.openness)
        nearest, shares = nearest_directions(across * down)
        size = nearest.shape[1::-1]
        self.nearest = gl.texture(size, 4, nearest.tobytes(), dtype="u1")
        self.shares = gl.texture(size, 4, shares.tobytes(), dtype="f1")
        self.nearest.filter = self.shares.filter = (moderngl.NEAREST, moderngl.NEAREST)

    def _open_to(self, sample: SurfaceSample) -> NDArray[np.bool_]:
        across, down = SKY_TILES
        # As in ``openness.frag``.
        places = np.column_stack([sample.points + 0.12 * sample.normals, np.ones(len(sample.points))])
        openness = np.ones((len(places), across * down), np.bool_)
        for row in range(down):
            part = (0, row * SKY_MAP, across * SKY_MAP, SKY_MAP)
            data = self.target.framebuffer.read(viewport=part, components=1, attachment=-1, dtype="f4", alignment=1)
            depth = np.frombuffer(data, np.float32).reshape(SKY_MAP, across, SKY_MAP)
            for column in range(across):
                k = row * across + column
                rows, extent = self.rows[3 * k : 3 * k + 3].astype(np.float64), self.extents[k].astype(np.float64)
                at = places @ rows.T
                inside = ((at > 0) & (at < 1)).all(axis=1)
                texel = np.clip((at[:, :2] * SKY_MAP).astype(int), 0, SKY_MAP - 1)
                normal = sample.normals @ rows[:, :3].T * extent
                along = np.where(np.abs(normal[:, 2]) < 1e-3, 1e-3, normal[:, 2])
                slope = np.clip(-normal[:, :2] / along[:, None], -_STEEPEST, _STEEPEST) * extent[:2] / extent[2]
                plane = at[:, 2] + (((texel + 0.5) / SKY_MAP - at[:, :2]) * slope).sum(axis=1)
                openness[inside, k] = (depth[texel[:, 1], column, texel[:, 0]] >= plane)[inside]
        return openness

    @property
    def texture(self) -> moderngl.Texture:
        assert self.target.depth is not None
        return self.target.depth

    def release(self) -> None:
        """Free the textures."""
        for texture in (self.target, self.nearest, self.shares):
            texture.release()


@dataclass(frozen=True, slots=True, eq=False)
class MovableShadows:
    """The movables of a frame as the sun sees them, None if it does not shine, and their columns."""

    sun: ShadowMap | None
    columns: ColumnMap


class Shadows:
    """Draws shadow maps."""

    def __init__(self, context: GraphicsContext) -> None:
        self._context = context
        self._drawer = SurfaceDrawer(context, "shape.frag", all_faces=True, panes="not")
        self._column_drawer = SurfaceDrawer(context, "columns.frag", all_faces=True, panes="not", keeps="largest")
        self._movable: dict[int, ShadowMap] = {}
        self._columns: dict[int, ColumnMap] = {}

    def static(self, statics: Statics, light: LightView, table: moderngl.Texture) -> ShadowMap:
        """Draw the statics' shadow map for a view of `static_view`."""
        shadow = ShadowMap(self._context.gl, light, STATIC_MAP)
        shadow.target.use()
        shadow.target.clear()
        self._drawer.statics(statics, table, {"clip_from_world": light.clip_from_world})
        shadow.survey()
        return shadow

    def movable(self, prepared: Prepared, static: LightView | None, table: moderngl.Texture) -> MovableShadows:
        """Draw the movables' columns and, in the axes of the statics' map, as the sun sees them. Valid until the next call."""
        geometry = prepared.statics.geometry
        sun = None
        if static is not None:
            view, side = _around(prepared, static.rows, box_corners(geometry.low, geometry.high))
            if side not in self._movable:
                self._movable[side] = ShadowMap(self._context.gl, view, side)
            sun = self._movable[side]
            sun.light = view
            sun.target.use()
            sun.target.clear()
            self._draw(self._drawer, prepared, view, table)
        view, side = _around(prepared, light_axes(np.array([0.0, 0.0, -1.0])), np.empty((0, 3)))
        if side not in self._columns:
            self._columns[side] = ColumnMap(self._context.gl, view, side)
        columns = self._columns[side]
        columns.light = view
        columns.target.use()
        columns.clear()
        self._draw(self._column_drawer, prepared, view, table)
        return MovableShadows(sun, columns)

    def _draw(self, drawer: SurfaceDrawer, prepared: Prepared, view: LightView, table: moderngl.Texture) -> None:
        drawer.movables(prepared.placed, prepared.statics.textures, table, {"clip_from_world": view.clip_from_world})

    def sky(self, statics: Statics, table: moderngl.Texture) -> SkyMaps:
        """Draw the statics' depth maps from directions all over the sky."""
        return SkyMaps(self._context.gl, self._drawer, statics, table)

    def release(self) -> None:
        """Free the movables' maps."""
        for maps in (self._movable, self._columns):
            for drawn in maps.values():
                drawn.release()
            maps.clear()


def _around(prepared: Prepared, rows: Matrix, receivers: Points) -> tuple[LightView, int]:
    """Return a map's view of the movables, along which it covers the receivers, too, and its texels per side."""
    bodies = np.concatenate([mesh.corners for mesh in prepared.placed])
    side = CLOSE_MAP if float(np.ptp(bodies @ rows[:2].T, axis=0).max()) <= _CLOSE else MOVABLE_MAP
    return fit_light_view(rows, bodies, np.concatenate([bodies, receivers]), side, LARGEST_PENUMBRA + 0.1), side


def static_view(geometry: StaticGeometry, camera: Camera, view: View, toward_sun: Points) -> LightView:
    """Return the view of the statics' shadow map.

    It bounds all statics, so that cameras share it, unless a map of the part that this camera sees is much finer.
    """
    low, high = geometry.core_low - 2, geometry.core_high + 2
    casters, axes = box_corners(geometry.low, geometry.high), light_axes(toward_sun)

    def around(receivers: Points) -> LightView:
        return fit_light_view(turned_to_fit(axes, receivers), receivers, casters, STATIC_MAP, 1.0)

    shared, visible = around(box_corners(low, high)), seen_points(camera, view, low, high, SHADOW_DISTANCE)
    if not len(visible):
        return shared
    own = around(visible)
    return shared if shared.extent[:2].max() <= _SHARED * own.extent[:2].max() else own


def even_directions(count: int) -> Points:
    """Return (count, 3) unit vectors spread evenly over the upper half of the sphere (a Fibonacci spiral)."""
    k = np.arange(count)
    z = 1 - (k + 0.5) / count
    angle = k * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


@cache
def nearest_directions(count: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return for each direction of the upper hemisphere the nearest four of `even_directions` and their weights.

    Rows and columns are those of an octahedron's upper half, turned by 45°, as in ``lighting.frag``: column (p.x + p.y + 1) / 2
    and row (p.x − p.y + 1) / 2 of the width, where p is the direction's x and y over the sum of its absolute coordinates.

    Returns:
        Indices of directions, (S, S, 4), and their weights in 1/255, (S, S, 4). Weights change continuously: a direction has
        weight 0 where it becomes the fifth.
    """
    middle = (np.arange(_AROUND) + 0.5) / _AROUND * 2 - 1
    along, across = np.meshgrid(middle, middle)
    x, y = (along + across) / 2, (along - across) / 2
    rays = np.stack([x, y, 1 - np.abs(x) - np.abs(y)], axis=2)
    near = rays / np.linalg.norm(rays, axis=2, keepdims=True) @ even_directions(count).T
    order = np.argsort(-near, axis=2)[..., :5]
    cosines = np.take_along_axis(near, order, axis=2)
    shares = (cosines[..., :4] - cosines[..., 4:]) ** 2
    shares = shares / np.maximum(shares.sum(axis=2, keepdims=True), 1e-12)
    return order[..., :4].astype(np.uint8), np.round(shares * 255).astype(np.uint8)
