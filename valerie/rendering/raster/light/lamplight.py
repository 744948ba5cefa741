"""Light of lamps in the raster engine: a table of all lamps for the shader, and shadow maps of some.

Every lamp lights the surfaces within its cone and its reach. The `LAMP_TILES` nearest static lamps and the `MOVING_TILES`
strongest lamps on movables cast shadows of statics and of movables; the others cast none. The shadow maps of the statics are
cached: for static lamps over all frames of a camera, and for lamps on movables while these do not move.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.lamps import Lamp
from valerie.rendering.projection import Points
from valerie.rendering.raster.gl.targets import RenderTarget
from valerie.rendering.raster.light.lamp_reach import (
    LAMP_MAP,
    LAMP_TILES,
    MOVING_TILES,
    FrameLamps,
    LampView,
    within_reach,
)
from valerie.rendering.raster.upload.drawing import SurfaceDrawer
from valerie.rendering.sky import SNOW_ALBEDO
from valerie.scene.light.weather import snow_cover

if TYPE_CHECKING:
    from valerie.rendering.raster.upload.context import GraphicsContext
    from valerie.rendering.raster.upload.scenes import Prepared, Statics

#: Tiles per row of an atlas.
LAMP_ACROSS: Final = 4
#: Rows of tiles of static lamps, and of lamps on movables.
_STILL_ROWS: Final = LAMP_TILES // LAMP_ACROSS
_MOVING_ROWS: Final = MOVING_TILES // LAMP_ACROSS
#: Share of the lamps' light that the ground reflects.
_GROUND_ALBEDO: Final = 0.1
#: RGBA texels per lamp.
_TEXELS: Final = 5


class LampMaps:
    """Depth maps of lamps, one tile of an atlas each."""

    def __init__(self, gl: moderngl.Context, rows: int) -> None:
        self.target = RenderTarget(gl, (LAMP_ACROSS * LAMP_MAP, rows * LAMP_MAP), (), depth=True)

    @property
    def texture(self) -> moderngl.Texture:
        assert self.target.depth is not None
        return self.target.depth

    def begin(self) -> None:
        """Clear the atlas."""
        framebuffer = self.target.framebuffer
        framebuffer.viewport = (0, 0, *self.target.size)
        self.target.use()
        self.target.clear()

    def tile(self, index: int) -> None:
        """Direct the next drawing into one tile."""
        framebuffer = self.target.framebuffer
        framebuffer.viewport = (index % LAMP_ACROSS * LAMP_MAP, index // LAMP_ACROSS * LAMP_MAP, LAMP_MAP, LAMP_MAP)
        framebuffer.use()

    def release(self) -> None:
        """Free the atlas."""
        self.target.release()


class LampShadows:
    """Draws the lamps' shadow maps."""

    def __init__(self, context: GraphicsContext) -> None:
        self._context = context
        self._drawer = SurfaceDrawer(context, "shape.frag", all_faces=True, panes="not")
        self._movable: LampMaps | None = None

    def static(self, statics: Statics, views: Sequence[LampView], table: moderngl.Texture) -> LampMaps:
        """Return the statics' maps, in as many rows of tiles as they need."""
        maps = LampMaps(self._context.gl, max(-(-len(views) // LAMP_ACROSS), 1))
        maps.begin()
        for index, view in enumerate(views):
            maps.tile(index)
            self._drawer.statics(statics, table, {"clip_from_world": view.clip_from_world})
        return maps

    def movable(self, prepared: Prepared, lamps: FrameLamps, table: moderngl.Texture) -> LampMaps:
        """Return the movables' maps, those of static lamps first. They are valid until the next call."""
        if self._movable is None:
            self._movable = LampMaps(self._context.gl, _STILL_ROWS + _MOVING_ROWS)
        self._movable.begin()
        for index, view in tiles_of(lamps, movable=True).items():
            if any(within_reach(mesh.corners, view.lamp) for mesh in prepared.placed):
                self._movable.tile(index)
                values = {"clip_from_world": view.clip_from_world}
                self._drawer.movables(prepared.placed, prepared.statics.textures, table, values)
        return self._movable

    def release(self) -> None:
        """Free the movables' maps."""
        if self._movable is not None:
            self._movable.release()
            self._movable = None


@dataclass(frozen=True, slots=True, eq=False)
class LampLight:
    """The lamps' data for the shader.

    Attributes:
        lamps: the lamps that are on.
        tiles: the views of the lamps with maps, by tile.
        static: the statics' maps seen from static lamps.
        moving: the statics' maps seen from lamps on movables; None if none of these has a map.
        movable: the movables' maps seen from both; None without movables.
        falling: (3,) mean light of static lamps on the ground, as the radiance of white ground.
        bounce: (3,) radiance of the ground by this light.
    """

    lamps: tuple[Lamp, ...]
    tiles: Mapping[int, LampView]
    static: LampMaps
    moving: LampMaps | None
    movable: LampMaps | None
    falling: Points
    bounce: Points

    @property
    def dipped(self) -> bool:
        """True if a lamp has a dipped beam."""
        return any(lamp.dipped for lamp in self.lamps)

    def table(self) -> NDArray[np.float32]:
        """Return the lamp table, (N, 5, 4) float32: five RGBA texels per lamp.

        0: position, 1 / reach² · 1: axis, cosine of the outer angle · 2: strength, 1 / (difference of the cosines) ·
        3: tile (−1: none), texel size at one metre, 0, 0 · 4: up, 1 for a dipped beam.
        """
        maps = {view.lamp: (tile, view.texel) for tile, view in self.tiles.items()}
        rows = np.zeros((len(self.lamps), _TEXELS, 4), np.float32)
        for row, lamp in zip(rows, self.lamps, strict=True):
            outer, inner = math.cos(lamp.outer), math.cos(lamp.inner)
            everywhere = lamp.outer >= math.pi
            row[0] = (*lamp.position, 1.0 / lamp.reach**2)
            row[1] = (*lamp.direction, -2.0 if everywhere else outer)
            row[2] = (*lamp.strength, 1e3 if everywhere else 1.0 / max(inner - outer, 1e-3))
            row[3, :2] = maps.get(lamp, (-1.0, 0.0))
            row[4] = (*lamp.up, float(lamp.dipped))
        return rows

    def matrices(self) -> NDArray[np.float32]:
        """Return the matrices from world to clip space, (LAMP_TILES + MOVING_TILES, 4, 4) float32, column-major."""
        matrices = np.zeros((LAMP_TILES + MOVING_TILES, 4, 4), np.float32)
        for tile, view in self.tiles.items():
            matrices[tile] = view.clip_from_world.T
        return matrices


def tiles_of(lamps: FrameLamps, *, movable: bool) -> dict[int, LampView]:
    """Return the views of lamps with maps, by tile; with the lamps on movables if ``movable`` is True."""
    moving = lamps.moving_shadowed if movable else ()
    return dict(enumerate(lamps.shadowed)) | dict(enumerate(moving, start=LAMP_TILES))


def falling_light(lamps: Sequence[Lamp], low: Points, high: Points) -> Points:
    """Return the radiance by lamps of white ground, (3,), as if their light fell evenly on it.

    Args:
        lamps: the static lamps.
        low, high: (3,) corners of the scene, metres.
    """
    area = max(float(np.prod((high - low)[:2])), 1.0)
    flux = np.zeros(3)
    for lamp in lamps:
        flux += np.array(lamp.flux)
    return flux / area


def bounced(falling: Points, snow_depth: float) -> Points:
    """Return the radiance of the ground, (3,), bare or under snow: an estimate of the light on walls."""
    bounce: Points = falling * (_GROUND_ALBEDO + snow_cover(snow_depth) * (SNOW_ALBEDO - _GROUND_ALBEDO))
    return bounce
