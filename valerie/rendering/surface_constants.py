"""Constants of what every engine shows on and behind surfaces: rooms behind panes, rain water, lying snow, fallen leaves.

Shaders of the raster engine get them as GLSL constants of the same names, Blender as a message. Both have the formulas.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.rain import random_of
from valerie.rendering.sky import SNOW_ALBEDO
from valerie.scene.light.weather import COVERING_M

Constant = float | tuple[float, ...]

#: Upward component of the normals from which snow does not slide.
SNOW_SLOPE: Final = (0.5, 0.85)
#: Upward component of the normals on which leaves lie.
LEAVES_LIE: Final = (0.8, 0.95)
#: Shares of the snow that traffic takes: everywhere, from tracks, from the whole surface on average.
SNOW_TAKEN: Final = (0.5, 0.94, 2.0 / 3.0)

#: Pairs are the ends of smooth steps. Lengths are metres.
CONSTANTS: Final[Mapping[str, Constant]] = {
    # Half of the part of a cell that pane and picture fill; distance of curtains behind the pane; height of the ceiling above
    # the pane; least height of the pane's upper edge above the floor; least width of a room in panes.
    "ROOM_FRONT": 0.48,
    "ROOM_HANGS": 0.08,
    "ROOM_CEILING": 0.35,
    "ROOM_STOREY": 2.3,
    "ROOM_PANES": 1.5,
    # Largest slope of a pane, which is slightly bent as a whole and in itself. Double glazing has twice the surfaces.
    "GLASS_BENT": 0.012,
    "GLAZING": 2.0,
    # Upward component of the normals that water wets, and of those on which it stands.
    "WATER_WETS": (0.7, 0.95),
    "WATER_STANDS": (0.97, 0.995),
    # Lengths of hollows along x and y, from broad to fine, their weights, and the weight of ruts with their roughness.
    "WATER_BROAD": (3.1, 3.1),
    "WATER_NARROW": (0.8, 1.1),
    "WATER_FINE": (0.06, 0.06),
    "WATER_WEIGHTS": (0.62, 0.30, 0.08, 0.10),
    "WATER_RUTS": (0.78, 0.88),
    # Level of hollows that hold water on dry sealed ground, its change on wet ground and on soil; softness of the shore.
    "WATER_LEVEL": (0.72, -0.14, 0.2),
    "WATER_SHORE": (-0.04, 0.06),
    "WATER_RIPPLES": 0.012,
    # Darkening by pores full of water, and the roughness of surfaces with pores.
    "WATER_DARKENS": 0.5,
    "WATER_PORES": (0.2, 0.6),
    # Largest roughness of a film on sealed ground, its factor on soil, roughness of standing water; reflectance over 4 %;
    # share of the relief that a film fills.
    "WATER_ROUGHNESS": (0.22, 0.75, 0.08),
    "WATER_SPECULAR": 0.55,
    "WATER_FILLS": 0.6,
    # Standard deviation of random relief.
    "RELIEF_DEVIATION": 0.21,
    # Lengths of patches and their weights.
    "SNOW_LENGTHS": (1.6, 0.4, 0.1, 0.03),
    "SNOW_WEIGHTS": (0.36, 0.27, 0.2, 0.17),
    # Change of the upward component and of the roughness by the relief, which makes borders and tracks ragged.
    "SNOW_RAGGED": (0.5, 0.04),
    # Depth that covers 76 % of the ground.
    "SNOW_SLOPE": SNOW_SLOPE,
    "SNOW_COVERING": COVERING_M,
    # Roughness of asphalt that wheels use (from, to), of their tracks and of slush (from, to); luminance of markings.
    "SNOW_DRIVEN": (0.745, 0.77),
    "SNOW_TRACK": (0.785, 0.81),
    "SNOW_SLUSHY": (0.80, 0.90),
    "SNOW_MARKING": (0.16, 0.26),
    "SNOW_TAKEN": SNOW_TAKEN,
    # Softness of borders, largest thickness and slope there; height of dunes on untouched snow and more with traffic.
    "SNOW_SOFT": 0.2,
    "SNOW_THICKNESS": 0.02,
    "SNOW_STEEPEST": 1.2,
    "SNOW_DUNES": (0.35, 0.35),
    "SNOW_ROUNDS": 0.35,
    # Dirt by traffic and in slush.
    "SNOW_DIRT": (0.12, 0.4),
    # Bare ground in tracks: depth of snow that makes it damp, what then remains of its albedo, its roughness, and its share;
    # loss of albedo at the edge of snow.
    "SNOW_DAMP": 0.02,
    "SNOW_DAMP_ALBEDO": 0.55,
    "SNOW_DAMP_ROUGHNESS": (0.4, 0.7),
    "SNOW_SHADES": 0.35,
    "SNOW_WHITE": tuple(SNOW_ALBEDO.tolist()),
    "SNOW_SLUSH": (0.36, 0.34, 0.32),
    "SNOW_ROUGHNESS": 0.8,
    "SNOW_SPECULAR": 0.5,
    "LEAVES_LIE": LEAVES_LIE,
    # Shares of the leaves that traffic takes everywhere and from tracks; roughness of tracks (from, to).
    "LEAVES_TAKEN": (0.5, 0.8),
    "LEAVES_TRACK": (0.79, 0.87),
    # Length of patches and of decay; edge of the cells of the first layer, and its growth with each layer; their turn likewise.
    "LEAVES_PATCH": 2.3,
    "LEAVES_DECAY": 0.025,
    "LEAVES_CELL": (0.12, 0.02),
    "LEAVES_TURN": (0.4, 0.7),
    "LEAVES_YELLOW": (0.42, 0.27, 0.045),
    "LEAVES_RUST": (0.26, 0.105, 0.03),
    "LEAVES_BROWN": (0.115, 0.065, 0.03),
    "LEAVES_ROUGHNESS": 0.7,
}
#: Layers of random relief (``relief.glsl``): of snow, from long to short, of water, from broad to fine, of patches of leaves and
#: of the decay in their layers.
RELIEF_LAYERS: Final = (0, 1, 2, 3, 40, 41, 42, 30, 20, 21, 22, 23)
#: Cells along each edge of `relief_corners`.
_CELLS: Final = 512


def glsl_constants() -> str:
    """Return `CONSTANTS` as GLSL."""
    lines = []
    for name, value in CONSTANTS.items():
        parts = value if isinstance(value, tuple) else (value,)
        kind = "float" if len(parts) == 1 else f"vec{len(parts)}"
        lines.append(f"const {kind} {name} = {kind}({', '.join(repr(float(part)) for part in parts)});\n")
    return "".join(lines)


def relief_corners() -> NDArray[np.uint8]:
    """Return the heights at the corners of the relief's cells, (layers, 512, 512, 4), in the order of ``relief.glsl``.

    Rows are y downwards and columns x, both −256…255. Engines that repeat them have the raster engine's relief in between:
    within 6 m of the origin for the decay of leaves, 8 m for the shortest snow, 100 m for patches, 790 m for broad puddles.
    """
    at = np.arange(-_CELLS // 2, _CELLS // 2 + 1, dtype=np.float32)
    corners = np.empty((len(RELIEF_LAYERS), _CELLS, _CELLS, 4), np.uint8)
    for image, layer in zip(corners, RELIEF_LAYERS, strict=True):
        heights = np.rint(random_of(at[None, :], at[:, None], np.float32(layer)) * 255).astype(np.uint8)
        for channel, (up, right) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
            image[..., channel] = heights[up : up + _CELLS, right : right + _CELLS][::-1]
    return corners
