"""Finish a settled garment: hems with a visible thickness, and collars.

Both are added to the posed garment and to its pattern, from which texture coordinates follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from urban_street.human import data, surface
from urban_street.human.body import Body
from urban_street.human.clothing import Cloth
from urban_street.human.pose import Posed
from urban_street.human.surface import Indices, Points

#: Depth to which the lining is visible from outside, metres.
_LINING: Final = 0.022


@dataclass(frozen=True, slots=True)
class Collar:
    """The profile of a collar.

    Attributes:
        rows: (metres up along the neck, metres outwards) of each ring above the neckline, from the seam on. A folded collar has
            a profile that turns down again.
        opening: drop of the front, as a share of the height.
        folded: True if the profile turns down outside, so that the inside of the cloth is visible.
    """

    rows: tuple[tuple[float, float], ...]
    opening: float = 0.0
    folded: bool = False


def add_hems(cloth: Cloth, thickness: float) -> Cloth:
    """Turn every open edge inwards, by a band as wide as the thickness, then the lining."""
    rings: list[tuple[Indices, Points, Points]] = []
    for loop in surface.boundary_loops(cloth.faces):
        posed = _lining(cloth.points, cloth.faces, loop, thickness)
        pattern = _lining(cloth.rest, cloth.faces, loop, thickness)
        rings.append((loop, posed, pattern))
    for loop, posed, pattern in rings:
        cloth = _with_rings(cloth, loop, posed, pattern, doubled=True)
    return cloth


def add_collar(cloth: Cloth, collar: Collar, body: Body, posed: Posed) -> Cloth:
    """Add a collar to the uppermost open edge, the neckline."""
    loops = surface.boundary_loops(cloth.faces)
    loop = max(loops, key=lambda ring: float(cloth.rest[ring, 2].mean()))
    axis = surface.normalize(
        0.3 * surface.normalize(body.head("head") - body.head("neck_01")) + np.array([0.0, 0.0, 1.0])
    )
    turn = posed.transforms[data.rig().bones.index("spine_03"), :3, :3]
    return _with_rings(
        cloth,
        loop,
        _collar_rings(cloth.points[loop], turn @ axis, turn @ np.array([0.0, 1.0, 0.0]), collar),
        _collar_rings(cloth.rest[loop], axis, np.array([0.0, 1.0, 0.0]), collar),
        doubled=False,
        flipped=collar.folded,
    )


def _lining(points: Points, faces: Indices, loop: Indices, thickness: float) -> Points:
    """Return two rings, (2, n, 3): the inner edge of the hem, and the end of the lining."""
    edge = points[loop]
    normals = surface.vertex_normals(points, faces)[loop]
    along = surface.normalize(np.roll(edge, -1, axis=0) - np.roll(edge, 1, axis=0))
    inwards = surface.normalize(np.cross(normals, along))  # the surface is left of its boundary
    end = edge - (thickness + 0.001) * normals + _LINING * inwards
    return np.stack([edge - thickness * normals, end])


def _collar_rings(edge: Points, up: Points, front: Points, collar: Collar) -> Points:
    centre = edge.mean(axis=0)
    radial = edge - centre
    radial = surface.normalize(radial - (radial @ up)[:, None] * up)
    share = np.clip(radial @ surface.normalize(front), 0.0, 1.0) ** 4
    height = 1.0 - collar.opening * share
    return np.stack([edge + height[:, None] * rise * up + out * radial for rise, out in collar.rows])


def _with_rings(
    cloth: Cloth, loop: Indices, posed: Points, pattern: Points, *, doubled: bool, flipped: bool = False
) -> Cloth:
    """Append rings of vertices and the strips between them; ``doubled`` leaves the first edge sharp."""
    doubled = doubled or flipped  # normals must not be averaged over opposite faces
    rows = [cloth.points, *posed]
    rest = [cloth.rest, *pattern]
    count = len(cloth.points)
    rings = [loop]
    if doubled:
        rows.insert(1, cloth.points[loop])
        rest.insert(1, cloth.rest[loop])
        rings = []
    for _ in range(len(rows) - 1):
        rings.append(np.arange(count, count + len(loop)))
        count += len(loop)
    strips = [surface.strip(a, b)[:, :: -1 if flipped else 1] for a, b in pairwise(rings)]
    copies = len(rows) - 1
    return Cloth(
        points=np.concatenate(rows),
        rest=np.concatenate(rest),
        weights=np.concatenate([cloth.weights, *[cloth.weights[loop]] * copies]),
        faces=np.concatenate([cloth.faces, *strips]),
        regions=np.concatenate([cloth.regions, *[cloth.regions[loop]] * copies]),
    )
