"""Hats: a beanie, a peaked cap, a hat with a brim, a turban, a headscarf, a hood, each built over the skull like hair."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from urban_street.human import data, hair, surface, textures
from urban_street.human.body import Body
from urban_street.human.surface import Points


@dataclass(frozen=True, slots=True, eq=False)
class Hat:
    """A hat.

    Attributes:
        kind: one of `SHAPES`.
        texture: paints it; u runs around, v from the crown to the edge.
    """

    kind: Literal["beanie", "cap", "brimmed", "turban", "headscarf", "hood"]
    texture: Callable[[], textures.TextureCanvas]


class Shape(NamedTuple):
    """The shape of a kind of hat, in degrees and metres as in `hair.HairCut`.

    Attributes:
        edge_line: elevation of its edge by azimuth.
        slack, edge: distance from the skull at the crown and at the edge.
        folds: depth of its folds, as a share of the distance.
        fall: length below the centre of the head, by azimuth.
        brim: ``peak`` in front, ``all`` around, or none.
        wrap: distance from neck and shoulders of the cloth around them; 0 for none.
    """

    edge_line: Mapping[float, float]
    slack: float
    edge: float = 0.017
    folds: float = 0.04
    fall: Mapping[float, float] | None = None
    brim: Literal["", "peak", "all"] = ""
    wrap: float = 0.0


#: The kinds of hats.
SHAPES: Final[Mapping[str, Shape]] = {
    "beanie": Shape({0.0: 27.0, 60.0: 12.0, 90.0: 1.0, 180.0: -14.0}, 0.026),
    "cap": Shape({0.0: 25.0, 60.0: 22.0, 90.0: 18.0, 180.0: 6.0}, 0.024, brim="peak"),
    "brimmed": Shape({0.0: 25.0, 90.0: 19.0, 180.0: 6.0}, 0.045, brim="all"),
    "turban": Shape({0.0: 36.0, 30.0: 26.0, 60.0: 14.0, 90.0: 4.0, 180.0: -12.0}, 0.058, 0.034, 0.10),
    "headscarf": Shape(
        {0.0: 38.0, 20.0: 37.0, 38.0: 30.0, 50.0: 12.0, 58.0: 0.0, 180.0: 0.0},
        0.016, 0.010, 0.10, {0.0: 0.0, 50.0: 0.0, 56.0: 0.10, 70.0: 0.14, 110.0: 0.16, 180.0: 0.15}, wrap=0.026,
    ),
    "hood": Shape(
        {0.0: 34.0, 20.0: 33.0, 38.0: 26.0, 50.0: 8.0, 56.0: 0.0, 180.0: 0.0},
        0.046, 0.034, 0.10, {0.0: 0.0, 48.0: 0.0, 54.0: 0.10, 70.0: 0.15, 110.0: 0.17, 180.0: 0.16}, wrap=0.034,
    ),
}  # fmt: skip
#: Height of the upper and of the lower edge of the cloth around the neck, from the head's centre, by azimuth; metres.
_WRAP_TOP: Final = {0.0: -0.148, 45.0: -0.128, 90.0: -0.075, 180.0: -0.05}
_WRAP_END: Final = {0.0: -0.265, 60.0: -0.245, 100.0: -0.225, 180.0: -0.235}


def build_hat(hat: Hat, body: Body) -> hair.Hair:
    """Build the hat on a body's head in the rest pose, in the head bone's frame."""
    shape = SHAPES[hat.kind]
    cut = hair.HairCut(
        hairline=shape.edge_line,
        thickness=shape.slack,
        edge=shape.edge,
        fall=shape.fall,
        strand=shape.folds,
        ragged=0.0,
    )
    crown = hair.build_hair(cut, body, seed=0)
    if shape.wrap:
        return hair.together(crown, _neck_wrap(body, shape.wrap))
    if not shape.brim:
        return crown
    edge = crown.points[(hair.ROWS - 1) * hair.COLUMNS : hair.ROWS * hair.COLUMNS]
    return hair.together(crown, _brim(edge, peaked=shape.brim == "peak"))


def _neck_wrap(body: Body, slack: float) -> hair.Hair:
    """Return cloth around neck and shoulders, from under the chin down to the collarbones."""
    rows = np.unique(data.base_mesh().groups["body"].quads)
    rig = data.rig()
    names = ("neck_01", "spine_03", "clavicle_l", "clavicle_r", "head")
    trunk = rig.weights[rows][:, [rig.bones.index(name) for name in names]].sum(axis=1) > 0.5
    centre = hair.head_centre(body)
    size = float(centre[2] - body.head("head")[2]) / 0.075
    middle = centre - np.array([0.0, 0.03 * size, 0.0])
    near = body.vertices[rows[trunk]] - middle
    azimuth = np.arange(hair.COLUMNS) / hair.COLUMNS * 2.0 * np.pi - np.pi
    from_front = np.degrees(np.abs(azimuth))
    top, end = (size * np.interp(from_front, list(t), list(t.values())) for t in (_WRAP_TOP, _WRAP_END))
    along = np.linspace(0.0, 1.0, 12)[:, None]
    height = top + along * (end - top)
    reach = np.hypot(near[:, 0], near[:, 1])
    angle = np.arctan2(near[:, 0], near[:, 1])
    low = near[:, 2] < np.interp(np.degrees(np.abs(angle)), [0.0, 45.0, 80.0], [-0.125 * size, -0.10 * size, 0.0])
    around = np.concatenate([angle[low] + turn for turn in (-2.0 * np.pi, 0.0, 2.0 * np.pi)])
    tree = cKDTree(np.stack([0.09 * size * around, np.tile(near[low, 2], 3)], axis=1))
    places = np.stack(np.broadcast_arrays(0.09 * size * azimuth, height), axis=-1)
    radius = np.tile(reach[low], 3)[np.asarray(tree.query(places, k=5)[1])].max(axis=-1)
    radius = ndimage.gaussian_filter(radius, (1.0, 1.5), mode=("nearest", "wrap"))
    folds = 1.0 + 0.35 * np.sin(2.0 * np.pi * (2.6 * along + 0.12 * np.cos(azimuth - 0.6)))
    radius = radius + slack * folds * np.clip(0.35 + 2.0 * along, 0.0, 1.0)
    outer = np.stack(np.broadcast_arrays(radius * np.sin(azimuth), radius * np.cos(azimuth), height), axis=2)
    hem = outer[-1] * [0.97, 0.97, 1.0] + [0.0, 0.0, 0.004]
    grid = middle + np.concatenate([outer, hem[None]])
    ids = np.arange(len(grid) * hair.COLUMNS).reshape(len(grid), -1)
    faces = np.concatenate([surface.strip(ids[k], ids[k + 1])[:, ::-1] for k in range(len(ids) - 1)])
    uvs = np.stack(
        [
            np.tile(np.arange(hair.COLUMNS) / hair.COLUMNS, len(grid)),
            np.repeat(np.linspace(0.5, 1.0, len(grid)), hair.COLUMNS),
        ],
        axis=1,
    )
    down = np.clip(np.append(along, 1.0), 0.0, 1.0) ** 0.7
    return hair.Hair(grid.reshape(-1, 3), faces, uvs, np.repeat(down, hair.COLUMNS))


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
