"""Hats: a beanie, a peaked cap, a hat with a brim, each built over the skull like hair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from urban_street.human import hair, surface, textures
from urban_street.human.body import Body
from urban_street.human.surface import Points


@dataclass(frozen=True, slots=True, eq=False)
class Hat:
    """A hat.

    Attributes:
        kind: ``beanie``, ``cap`` (peaked in front) or ``brimmed``.
        texture: paints it; u runs around, v from the crown to the edge.
    """

    kind: Literal["beanie", "cap", "brimmed"]
    texture: Callable[[], textures.TextureCanvas]


_EDGES = {
    "beanie": {0.0: 27.0, 60.0: 12.0, 90.0: 1.0, 180.0: -14.0},
    "cap": {0.0: 25.0, 60.0: 22.0, 90.0: 18.0, 180.0: 6.0},
    "brimmed": {0.0: 25.0, 90.0: 19.0, 180.0: 6.0},
}


def build_hat(hat: Hat, body: Body) -> hair.Hair:
    """Build the hat on a body's head in the rest pose, in the head bone's frame."""
    slack = {"beanie": 0.026, "cap": 0.024, "brimmed": 0.045}[hat.kind]
    cut = hair.HairCut(hairline=_EDGES[hat.kind], thickness=slack, edge=0.017, strand=0.04, ragged=0.0)
    crown = hair.build_hair(cut, body, seed=0)
    if hat.kind == "beanie":
        return crown
    edge = crown.points[(hair.ROWS - 1) * hair.COLUMNS : hair.ROWS * hair.COLUMNS]
    return hair.together(crown, _brim(edge, peaked=hat.kind == "cap"))


def _brim(edge: Points, *, peaked: bool) -> hair.Hair:
    """Return a two-sided sheet that extends from the hat's edge: all around, or as a peak in front."""
    azimuth = np.arange(hair.COLUMNS) / hair.COLUMNS * 2.0 * np.pi - np.pi
    out = np.stack([np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=1)
    peak = 0.07 * np.clip(np.cos(azimuth * 1.12), 0.0, 1.0) ** 0.6 * (np.abs(azimuth) < 1.3)
    reach = peak if peaked else np.full(len(out), 0.052)
    drop = 0.35 if peaked else 0.18
    shares = np.array([0.0, 0.5, 1.0])
    top = [edge + (s * reach)[:, None] * out - [0.0, 0.0, 1.0] * (drop * s**1.5 * reach)[:, None] for s in shares]
    bottom = [ring - np.array([0.0, 0.0, 0.003]) for ring in top[::-1]]
    grid = np.stack([*top, *bottom])
    columns = grid.shape[1]
    ids = np.arange(grid.shape[0] * columns).reshape(-1, columns)
    faces = np.concatenate([surface.strip(ids[k], ids[k + 1])[:, ::-1] for k in range(len(ids) - 1)])
    wide = np.concatenate([np.minimum(reach, np.roll(reach, -1))] * 2 * (len(ids) - 1)) > 1e-4
    around = np.tile(np.arange(columns) / columns, len(ids))
    down = np.repeat(np.linspace(0.8, 1.0, len(ids)), columns)
    return hair.Hair(grid.reshape(-1, 3), faces[wide], np.stack([around, down], axis=1))
