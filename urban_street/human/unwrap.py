"""Texture coordinates of garments from their patterns in the rest pose (the layout that `textures` paints)."""

from __future__ import annotations

import numpy as np

from urban_street.human import surface
from urban_street.human.body import Body
from urban_street.human.clothing import LEFT, TRUNK, Cloth, Cut, limb_place
from urban_street.human.surface import Indices, Points
from urban_street.human.textures import SLEEVE_START, TRUNK_SHARE


def unwrap(cut: Cut, body: Body, cloth: Cloth) -> tuple[Indices, Points, Indices]:
    """Unwrap a garment.

    Returns:
        The result of `surface.unweld`: old vertex of each new vertex, texture coordinates (v down), new faces.
    """
    votes = np.stack([(cloth.regions[cloth.faces] == region).sum(axis=1) for region in range(3)], axis=1)
    region = votes.argmax(axis=1)
    corners = np.zeros((*cloth.faces.shape, 2))
    for which in range(3):
        own = region == which
        if own.any():
            uvs = _trunk(cut, body, cloth) if which == TRUNK else _limb(cut, body, cloth, "l" if which == LEFT else "r")
            corners[own] = uvs[cloth.faces[own]]
    return surface.unweld(cloth.faces, corners)


def _trunk(cut: Cut, body: Body, cloth: Cloth) -> Points:
    """Return texture coordinates.

    u: 0.5 in front, increasing to the character's right, seam at the back. v: down to the hem at `TRUNK_SHARE`, 1 for a skirt.
    """
    centre = body.head("spine_02")
    offset = cloth.rest - centre
    around = 0.5 + np.arctan2(offset[:, 0], offset[:, 1]) / (2.0 * np.pi)
    trunk = cloth.rest[cloth.regions == TRUNK, 2]
    top, bottom = trunk.max(), trunk.min()
    share = 1.0 if cut.kind == "skirt" else TRUNK_SHARE
    return np.stack([around, share * (top - cloth.rest[:, 2]) / (top - bottom)], axis=1)


def _limb(cut: Cut, body: Body, cloth: Cloth, side: str) -> Points:
    """Return texture coordinates; u: 0 inside, 0.25 behind, 0.5 outside, 0.75 in front, alike for both sides; v: root to hem."""
    limb = "arm" if cut.kind == "top" else "leg"
    along, axis = limb_place(body, "arm" if limb == "arm" else "leg", side, cloth.rest)
    outwards = np.array([-1.0 if side == "l" else 1.0, 0.0, 0.8 if limb == "arm" else 0.0])
    outwards /= np.linalg.norm(outwards)
    offset = cloth.rest - axis
    around = 0.5 + np.arctan2(offset[:, 1], offset @ outwards) / (2.0 * np.pi)
    start, end = (0.0, cut.sleeve) if limb == "arm" else (-0.45, 1.93)
    share = np.clip((along - start) / (end - start), 0.0, 1.0)
    if limb == "arm":
        share = SLEEVE_START + (1.0 - SLEEVE_START) * share
    return np.stack([around, share], axis=1)
