"""Hair: a cap on the scalp, combed from the crown to a hairline, optionally falling below the ears."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from urban_street.human import data, surface
from urban_street.human.body import Body
from urban_street.human.surface import Indices, Points

COLUMNS: Final = 72
ROWS: Final = 18


@dataclass(frozen=True, slots=True)
class HairCut:
    """A hairdo; angles in degrees, lengths in metres.

    Attributes:
        hairline: elevation of its edge seen from the head's centre, by azimuth from the front (0) to the back (180).
        thickness: thickness at the crown.
        edge: thickness at the hairline.
        fall: length below the centre of the head by azimuth, if the hairline is below the centre.
        strand: depth of the grooves between strands, as a share of the thickness.
        parting: azimuth of the parting, or None.
        tied: ``bun``, ``ponytail`` or none.
        ragged: unevenness of the hairline; 0 for a clean edge.
    """

    hairline: Mapping[float, float]
    thickness: float
    edge: float
    fall: Mapping[float, float] | None = None
    strand: float = 0.25
    parting: float | None = None
    tied: Literal["", "bun", "ponytail"] = ""
    ragged: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Hair:
    """(V, 3) rest positions on the head bone, (F, 3) faces, (V, 2) texture coordinates: u around, v from crown to tip.

    ``chest`` is the share, (V,), by which the vertices follow the chest instead of the head; None for none.
    """

    points: Points
    faces: Indices
    uvs: Points
    chest: Points | None = None


def head_centre(body: Body) -> Points:
    """Return the point, (3,), inside the skull at the height of the brows, half-way between forehead and back of the head."""
    points = _head_points(body)
    eyes = body.vertices[np.unique(data.base_mesh().groups["joint-l-eye"].quads)].mean(axis=0)
    level = points[np.abs(points[:, 2] - eyes[2] - 0.03) < 0.015]
    return np.array([0.0, 0.5 * (level[:, 1].min() + level[:, 1].max()), eyes[2] + 0.025])


def build_hair(cut: HairCut, body: Body, seed: int) -> Hair:
    """Build the hair of ``cut`` on a body's head in the rest pose. ``seed`` determines the strands."""
    random = np.random.default_rng(seed)
    centre = head_centre(body)
    azimuth = np.arange(COLUMNS) / COLUMNS * 2.0 * np.pi - np.pi  # −π and π are the back
    from_front = np.degrees(np.abs(azimuth))
    ragged = cut.ragged * ndimage.gaussian_filter1d(random.normal(size=COLUMNS), 0.8, mode="wrap")
    line = np.radians(_smooth(cut.hairline, from_front) + 3.0 * ragged)
    falls = _smooth(cut.fall, from_front) * (1.0 + 0.05 * ragged) if cut.fall else np.zeros(COLUMNS)
    clumps = _clumps(random)
    along = np.linspace(0.0, 1.0, ROWS)[:, None]
    # over the skull from the crown to the hairline (or to the level of the centre), then straight down
    level = np.where(falls > 0.0, np.maximum(line, 0.0), line)
    arc = (0.5 * np.pi - level) * 0.095
    over = np.clip(along * (arc + falls) / arc, 0.0, 1.0)
    below = np.clip(along * (arc + falls) - arc, 0.0, None)
    elevation = 0.5 * np.pi - over * (0.5 * np.pi - level)
    level_part = np.cos(elevation)
    directions = np.stack([level_part * np.sin(azimuth), level_part * np.cos(azimuth), np.sin(elevation)], axis=2)
    radius = _skull_radius(body, directions)
    rise = np.clip((1.0 - along) / 0.55, 0.0, 1.0)
    lift = cut.edge + (cut.thickness - cut.edge) * rise * (2.0 - rise)
    lift = lift * (1.0 + cut.strand * clumps)
    if cut.parting is not None:
        away = np.degrees(np.abs(np.angle(np.exp(1j * (azimuth - np.radians(cut.parting))))))
        lift = lift * (1.0 - 0.55 * np.exp(-((away / 7.0) ** 2)) * np.clip(1.2 - along, 0.0, 1.0))
    reach = radius + lift
    curl = 1.0 - 0.10 * np.clip(below / 0.2, 0.0, 1.0) ** 2
    flat = reach * level_part * curl
    outer = np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), reach * np.sin(elevation) - below], axis=2)
    ring = outer[-1]
    tuck = 1.0 - 0.9 * np.minimum(lift[-1] + 0.004, 0.02) / np.maximum(np.linalg.norm(ring, axis=1), 1e-6)
    inner = np.stack([ring * tuck[:, None], ring * (tuck - 0.03)[:, None] + [0.0, 0.0, 0.012]])
    grid = centre + np.concatenate([outer, inner])
    cap = _grid_surface(grid)
    if not cut.tied:
        return cap
    back = centre + np.array([0.0, -float(radius[:, COLUMNS // 2 - 1 : COLUMNS // 2 + 1].max()) - cut.thickness, 0.0])
    return together(cap, _bun(back, random) if cut.tied == "bun" else _ponytail(back, random))


def _bun(back: Points, random: np.random.Generator) -> Hair:
    """Return a knot of hair at the back of the head."""
    polar = np.linspace(0.03, np.pi - 0.03, 11)[:, None]
    around = np.arange(20) / 20 * 2.0 * np.pi
    wave = 1.0 + 0.05 * np.sin(3.0 * around + 4.0 * polar) + 0.03 * random.normal(size=(11, 20))
    radius = 0.038 * wave
    points = np.stack(
        [
            radius * np.sin(polar) * np.sin(around),
            0.8 * radius * np.cos(polar) * np.ones(20),
            radius * np.sin(polar) * np.cos(around),
        ],
        axis=2,
    )
    return _tube_surface(back + np.array([0.0, 0.0, 0.035]) + points)


def _ponytail(back: Points, random: np.random.Generator) -> Hair:
    """Return a tail that leaves the back of the head and hangs down to between the shoulder blades."""
    along = np.linspace(0.0, 1.0, 14)[:, None]
    around = np.arange(16) / 16 * 2.0 * np.pi
    radius = np.interp(along, [0.0, 0.1, 0.35, 0.8, 1.0], [0.016, 0.019, 0.032, 0.024, 0.003])
    radius = radius * (1.0 + 0.08 * random.normal(size=16))
    axis_back = np.interp(along, [0.0, 0.15, 0.4, 1.0], [0.022, -0.028, -0.045, -0.03])
    axis_down = np.interp(along, [0.0, 0.15, 0.4, 1.0], [0.045, 0.04, -0.03, -0.25])
    points = np.stack(
        [
            radius * np.sin(around),
            axis_back + 0.75 * radius * np.cos(around),
            axis_down + 0.2 * radius * np.cos(around),
        ],
        axis=2,
    )
    return _tube_surface(back + points)


def _tube_surface(grid: Points) -> Hair:
    """Return a grid of rings, turned so that its faces look outwards."""
    rows, columns = grid.shape[:2]
    ids = np.arange(rows * columns).reshape(rows, columns)
    faces = np.concatenate([surface.strip(ids[k], ids[k + 1]) for k in range(rows - 1)])
    points = grid.reshape(-1, 3)
    corners = points[faces] - points.mean(axis=0)
    if np.einsum("ij,ij->i", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]).sum() < 0.0:
        faces = faces[:, ::-1]
    around, down = np.tile(np.arange(columns) / columns, rows), np.repeat(np.arange(rows) / (rows - 1), columns)
    return Hair(points, faces, np.stack([around, down], axis=1))


def together(first: Hair, second: Hair) -> Hair:
    """Return two surfaces as one."""
    chests = [np.zeros(len(piece.points)) if piece.chest is None else piece.chest for piece in (first, second)]
    return Hair(
        np.concatenate([first.points, second.points]),
        np.concatenate([first.faces, second.faces + len(first.points)]),
        np.concatenate([first.uvs, second.uvs]),
        None if first.chest is None and second.chest is None else np.concatenate(chests),
    )


def _grid_surface(grid: Points) -> Hair:
    rows = len(grid)
    ids = np.arange(rows * COLUMNS).reshape(rows, COLUMNS)
    faces = np.concatenate([surface.strip(ids[k], ids[k + 1])[:, ::-1] for k in range(rows - 1)])
    faces = faces[COLUMNS:]  # the first ring is one point, the crown, so half of its strip has no area
    around = np.tile(np.arange(COLUMNS) / COLUMNS, rows)
    down = np.repeat(np.arange(rows) / (rows - 1), COLUMNS)
    return Hair(grid.reshape(-1, 3), faces, np.stack([around, down], axis=1))


def _head_points(body: Body) -> Points:
    """Return the vertices of the head's outside."""
    mesh, rig = data.base_mesh(), data.rig()
    rows = np.unique(mesh.groups["body"].quads)
    of_head = rig.weights[rows, rig.bones.index("head")] > 0.5
    points: Points = body.vertices[rows[of_head]]
    return points


def _skull_radius(body: Body, directions: Points) -> Points:
    """Return the distance from the head's centre to the skin, without ears, along unit ``directions`` (..., 3), metres."""
    mesh, rig = data.base_mesh(), data.rig()
    rows = np.unique(mesh.groups["body"].quads)
    weights = rig.weights[rows][:, [rig.bones.index(n) for n in ("head", "neck_01")]].sum(axis=1)
    near = body.vertices[rows] - head_centre(body)
    radius = np.linalg.norm(near, axis=1)
    azimuth = np.degrees(np.abs(np.arctan2(near[:, 0], near[:, 1])))
    elevation = np.degrees(np.arcsin(np.clip(near[:, 2] / radius, -1.0, 1.0)))
    ear = (np.abs(azimuth - 97.0) < 22.0) & (elevation < 8.0)
    keep = (weights > 0.5) & ~ear & (elevation > -60.0) & (radius > 0.07)
    distance, index = cKDTree(near[keep] / radius[keep, None]).query(directions, k=6)
    share: Points = 1.0 / (np.asarray(distance) + 1e-3) ** 2
    mean: Points = (share * radius[keep][index]).sum(axis=-1) / share.sum(axis=-1)
    return mean


def _clumps(random: np.random.Generator) -> Points:
    """Return noise in about −1…1, (ROWS, COLUMNS): strands run down the columns and wander slightly."""
    noise = random.normal(size=(ROWS, COLUMNS))
    smooth = ndimage.gaussian_filter(noise, (5.0, 0.7), mode=("nearest", "wrap"))
    smooth /= np.abs(smooth).max()
    fade = np.clip(np.linspace(0.0, 3.0, ROWS), 0.0, 1.0)[:, None]  # all strands meet at the crown
    return smooth * fade


def _smooth(table: Mapping[float, float], at: Points) -> Points:
    return np.interp(at, list(table), list(table.values()))
