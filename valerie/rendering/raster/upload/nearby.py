"""Light of the surfaces near a place, as its difference from the scene's mean, on a coarse grid. Uses no GPU.

`reflected` gives each hidden direction, and the ground, one radiance for the whole scene. That is too dark opposite a sunlit
house, and too bright between shaded ones. So each cell of a grid has the radiance of the surfaces around it as a linear function
of the direction, and that of the surfaces below it. ``skylight.frag`` adds the differences where surfaces hide the sky.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.projection import Points
from valerie.rendering.raster.upload.surroundings import Reflected, SurfaceSample

#: Size of a cell across, along and up, metres, and about the largest number of cells. Larger scenes have larger cells.
_CELL: Final = np.array([8.0, 8.0, 6.0])
_CELLS: Final = 512
#: Distance at which a surface no longer counts, metres. Others probably hide it.
_FAR: Final = 24.0
#: Weight of the scene's mean, as a form factor. It decides where few surfaces are near.
_PRIOR: Final = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class Nearby:
    """Light of near surfaces on a grid, linear RGB in the image's unit.

    Attributes:
        low, size: (3,) corner and size of the grid, metres. Beyond it, the nearest cell counts.
        table: (4, Z, Y, X, 4) float32, at the centres of the cells. For red, green and blue: the surfaces' radiance above the
            place, as a mean and its slopes along x, y and z of the direction. Then that of the surfaces below it, and 0. All are
            differences from `Reflected`.
    """

    low: Points
    size: Points
    table: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class _Surfaces:
    """Points of a sample, with their radiances and with the areas that they represent, m²."""

    points: Points
    normals: Points
    radiance: Points
    areas: Points

    def around(self, place: Points) -> _Surfaces:
        """Return those within `_FAR` of a place, (2,), seen from above."""
        near = (self.points[:, 0] - place[0]) ** 2 + (self.points[:, 1] - place[1]) ** 2 < _FAR**2
        return _Surfaces(self.points[near], self.normals[near], self.radiance[near], self.areas[near])

    def light_at(self, places: Points, above: Points, below: Points) -> tuple[Points, Points]:
        """Return the light above places, (P, 4, 3), and below them, (P, 3), from the scene's, (4, 3) and (3,).

        Surfaces count by their form factor (see `prominence`) without occlusion, and less with the distance. Above, a linear
        function of the direction is fitted to their radiances by least squares.
        """
        to = self.points.T[:, None] - places.T[:, :, None]
        squared = np.maximum(np.einsum("kpn,kpn->pn", to, to), 1e-2)
        basis = np.concatenate([np.ones((1, *squared.shape)), to / np.sqrt(squared)])
        facing = np.maximum(-np.einsum("nk,kpn->pn", self.normals, basis[1:]), 0)
        fading = np.maximum(1 - squared / _FAR**2, 0) ** 2
        factors = facing * fading * self.areas / (np.pi * squared + self.areas)
        upper = factors * (to[2] > 0)
        lower = factors - upper
        weighted = (upper * basis).transpose(1, 0, 2)
        prior = _PRIOR * np.diag([1, 1 / 3, 1 / 3, 1 / 3])
        moments = weighted @ basis.transpose(1, 2, 0) + prior
        fitted = np.linalg.solve(moments, weighted @ self.radiance + prior @ above)
        return fitted, (lower @ self.radiance + _PRIOR * below) / (lower.sum(axis=1) + _PRIOR)[:, None]


def nearby(sample: SurfaceSample, shares: Points, light: Reflected, directions: Points, box: Points) -> Nearby:
    """Return the light of the surfaces near each place of a box, as its difference from that of the scene.

    Args:
        sample: N places on surfaces.
        shares: (N,) share of each place's area that counts.
        light: what they reflect.
        directions: (K, 3) unit vectors of ``light.hidden``.
        box: (2, 3) its corners, metres.
    """
    # At least one cell high: the middle of a flat scene may lie below its ground.
    low, size = box[0], np.maximum(box[1] - box[0], _CELL)
    larger = max(float(np.prod(size / _CELL)) / _CELLS, 1.0) ** (1 / 3)
    counts = np.ceil(size / (_CELL * larger)).astype(int)
    x, y, z = (low[i] + (np.arange(counts[i]) + 0.5) * size[i] / counts[i] for i in range(3))
    counting = shares > 0
    surfaces = _Surfaces(
        sample.points[counting], sample.normals[counting], light.radiance[counting], sample.area * shares[counting]
    )
    linear = np.column_stack([np.ones(len(directions)), directions])
    of_scene: Points = np.linalg.pinv(linear) @ light.hidden
    table = np.zeros((4, *counts[::-1], 4), np.float32)
    for row, column in np.ndindex(len(y), len(x)):
        places = np.stack([np.full_like(z, x[column]), np.full_like(z, y[row]), z], axis=1)
        above, below = surfaces.around(places[0, :2]).light_at(places, of_scene, light.ground)
        above -= of_scene
        # Black is the least radiance in any direction.
        darker = np.maximum(-(linear @ above), 1e-12)
        above *= np.minimum((light.hidden / darker).min(axis=(1, 2)), 1.0)[:, None, None]
        table[:3, :, row, column] = above.transpose(2, 0, 1)
        table[3, :, row, column, :3] = below - light.ground
    return Nearby(low, size, table)
