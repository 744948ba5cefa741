"""House fronts: walls with real openings, and windows, doors and shop fronts in them.

Local frame: x along the front from 0 to the width, z up; the front is in the plane y = 0 and faces −y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, Surface, boxes, extrude, quads
from urban_street.street.textures.walls import ATLAS_CELLS


@dataclass(frozen=True, slots=True)
class Opening:
    """A hole in the front; metres.

    Attributes:
        x0, x1, z0, z1: the hole.
        kind: window, french (down to the floor), door, shop, gate.
    """

    x0: float
    x1: float
    z0: float
    z1: float
    kind: str = "window"


@dataclass(frozen=True, slots=True)
class Trim:
    """Materials and style of one front.

    Attributes:
        wall, reveal, frame, sill, surround, door: materials.
        tile: size of the wall's texture, metres.
        depth: depth of the reveals, metres.
        sashes: panes side by side in a window.
        transom: height of the horizontal bar as a share of the window, or 0.
        surrounds: mouldings around windows: none, flat, lintel, pediment.
    """

    wall: str
    reveal: str
    frame: str
    sill: str
    surround: str
    door: str
    tile: float
    depth: float = 0.16
    sashes: int = 2
    transom: float = 0.7
    surrounds: str = "none"


def wall_with_openings(width: float, height: float, openings: Sequence[Opening]) -> Floats:
    """Return the quadrilaterals, (N, 4, 3), of the front without the openings, on the grid of all their edges."""
    xs = np.unique([0.0, width, *(o.x0 for o in openings), *(o.x1 for o in openings)])
    zs = np.unique([0.0, height, *(o.z0 for o in openings), *(o.z1 for o in openings)])
    x, z = np.meshgrid(0.5 * (xs[:-1] + xs[1:]), 0.5 * (zs[:-1] + zs[1:]), indexing="ij")
    solid = np.ones(x.shape, bool)
    for o in openings:
        solid &= ~((x > o.x0) & (x < o.x1) & (z > o.z0) & (z < o.z1))
    i, k = np.nonzero(solid)
    return front_quads(xs[i], xs[i + 1], zs[k], zs[k + 1], np.zeros(len(i)))


def front_quads(x0: Floats, x1: Floats, z0: Floats, z1: Floats, y: Floats) -> Floats:
    """Return upright rectangles that face −y, (N, 4, 3)."""
    return np.stack(
        [np.stack([x0, y, z0], -1), np.stack([x1, y, z0], -1), np.stack([x1, y, z1], -1), np.stack([x0, y, z1], -1)], 1
    )


def build_front(
    bag: Bag, width: float, height: float, openings: Sequence[Opening], trim: Trim, rng: np.random.Generator
) -> None:
    """Add wall, reveals, and a window, door or shop front in every opening."""
    bag.add(trim.wall, quads(wall_with_openings(width, height, openings), tile=trim.tile))
    if not openings:
        return
    edges = np.array([(o.x0, o.x1, o.z0, o.z1) for o in openings])
    _reveals(bag, edges, trim)
    kinds = np.array([o.kind for o in openings])
    glazed = np.isin(kinds, ["window", "french"])
    if glazed.any():
        _windows(bag, edges[glazed], trim, rng)
    if (kinds == "window").any():
        _sills_and_surrounds(bag, edges[kinds == "window"], trim)
    for o in openings:
        if o.kind in {"door", "gate"}:
            _door(bag, o, trim, rng)
        elif o.kind == "shop":
            _shop_window(bag, o, trim, rng)


def _reveals(bag: Bag, edges: Floats, trim: Trim) -> None:
    x0, x1, z0, z1 = edges.T
    near, far = np.zeros_like(x0), np.full_like(x0, trim.depth + 0.05)

    def quad(*corners: tuple[Floats, Floats, Floats]) -> Floats:
        return np.stack([np.stack(corner, -1) for corner in corners], 1)

    left = quad((x0, near, z0), (x0, far, z0), (x0, far, z1), (x0, near, z1))
    right = quad((x1, far, z0), (x1, near, z0), (x1, near, z1), (x1, far, z1))
    top = quad((x0, far, z1), (x1, far, z1), (x1, near, z1), (x0, near, z1))
    bottom = quad((x0, near, z0), (x1, near, z0), (x1, far, z0), (x0, far, z0))
    bag.add(trim.reveal, quads(np.concatenate([left, right, top, bottom]), tile=trim.tile))


def _bars(x0: Floats, x1: Floats, z0: Floats, z1: Floats, y: float, thick: float) -> tuple[Floats, Floats]:
    """Return the corners (low, high) of boxes in the plane of a window."""
    near, far = np.full_like(x0, y), np.full_like(x0, y + thick)
    return np.stack([x0, near, z0], -1), np.stack([x1, far, z1], -1)


def _windows(bag: Bag, edges: Floats, trim: Trim, rng: np.random.Generator) -> None:
    """Add frame, sashes, transom, and glass with a room behind it."""
    x0, x1, z0, z1 = edges.T
    y, bar, wide = trim.depth, 0.045, 0.075
    middle = z0 + (z1 - z0) * (trim.transom or 1.0)
    parts = [
        _bars(x0, x1, z0, z0 + wide, y, 0.05), _bars(x0, x1, z1 - wide, z1, y, 0.05),
        _bars(x0, x0 + wide, z0 + wide, z1 - wide, y, 0.05), _bars(x1 - wide, x1, z0 + wide, z1 - wide, y, 0.05),
    ]  # fmt: skip
    for k in range(1, trim.sashes):
        x = x0 + (x1 - x0) * k / trim.sashes
        parts.append(_bars(x - 0.045, x + 0.045, z0 + wide, z1 - wide, y - 0.012, 0.062))
    if trim.transom:
        parts.append(_bars(x0 + wide, x1 - wide, middle - bar, middle + bar, y - 0.008, 0.058))
    low, high = (np.concatenate(side) for side in zip(*parts, strict=True))
    bag.add(trim.frame, boxes(low, high, skip=("+y",)))
    glass_y = np.full_like(x0, y + 0.035)
    cell = rng.integers(0, ATLAS_CELLS**2, len(x0))
    corner = np.stack([cell % ATLAS_CELLS, cell // ATLAS_CELLS], -1) / ATLAS_CELLS
    square = np.array([[0.02, 0.98], [0.98, 0.98], [0.98, 0.02], [0.02, 0.02]]) / ATLAS_CELLS
    bag.add("window-glass", quads(front_quads(x0, x1, z0, z1, glass_y), corner[:, None] + square[None]))


def _sills_and_surrounds(bag: Bag, edges: Floats, trim: Trim) -> None:
    x0, x1, z0, z1 = edges.T
    front = np.full_like(x0, -0.09)
    back = np.full_like(x0, trim.depth)
    low = np.stack([x0 - 0.06, front, z0 - 0.06], -1)
    bag.add(trim.sill, boxes(low, np.stack([x1 + 0.06, back, z0 + 0.015], -1), skip=("+y",)))
    if trim.surrounds == "none":
        return
    wide, out = 0.15, -0.045
    if trim.surrounds == "lintel":
        parts = [_bars(x0 - 0.12, x1 + 0.12, z1, z1 + 0.24, -0.02, 0.02)]
    else:
        parts = [
            _bars(x0 - wide, x0, z0, z1, out, -out), _bars(x1, x1 + wide, z0, z1, out, -out),
            _bars(x0 - wide, x1 + wide, z1, z1 + wide, out, -out),
        ]  # fmt: skip
    if trim.surrounds == "pediment":
        parts.append(_bars(x0 - 0.24, x1 + 0.24, z1 + 0.30, z1 + 0.38, -0.15, 0.15))
        parts.append(_bars(x0 - 0.16, x1 + 0.16, z1 + 0.22, z1 + 0.30, -0.08, 0.08))
    low, high = (np.concatenate(side) for side in zip(*parts, strict=True))
    bag.add(trim.surround, boxes(low, high, skip=("+y",), tile=2.0))


def _door(bag: Bag, o: Opening, trim: Trim, rng: np.random.Generator) -> None:
    """Add leaves with raised panels, a fanlight, a handle and a step."""
    y = trim.depth
    fanlight = o.z1 - (0.45 if o.z1 - o.z0 > 2.3 else 0.0)
    leaves = 2 if o.x1 - o.x0 > 1.25 else 1
    bag.add(trim.door, boxes([[o.x0, y, o.z0]], [[o.x1, y + 0.06, fanlight]], skip=("+y",)))
    width = (o.x1 - o.x0) / leaves
    low, high = [], []
    for leaf in range(leaves):
        left = o.x0 + leaf * width
        for z0, z1 in ((0.12, 0.34), (0.40, 0.62), (0.68, 0.95)):
            span = fanlight - o.z0
            low.append((left + 0.13, y - 0.022, o.z0 + z0 * span))
            high.append((left + width - 0.13, y, o.z0 + z1 * span))
        low.append((left + 0.0, y - 0.03, o.z0))
        high.append((left + 0.07, y, fanlight))
    bag.add(trim.door, boxes(low, high, skip=("+y",)))
    handle = o.x0 + (width if leaves > 1 else 0.9 * width)
    bag.add("metal", boxes([[handle - 0.09, y - 0.08, o.z0 + 1.0]], [[handle - 0.05, y, o.z0 + 1.16]]))
    if fanlight < o.z1:
        edge = np.array([[o.x0, o.x1, fanlight, o.z1]])
        _windows(bag, edge, trim, rng)
    if trim.surrounds in {"flat", "pediment"}:
        bag.add(
            trim.surround,
            boxes([[o.x0 - 0.2, -0.06, o.z0], [o.x1, -0.06, o.z0], [o.x0 - 0.28, -0.13, o.z1]],
                  [[o.x0, 0.0, o.z1], [o.x1 + 0.2, 0.0, o.z1], [o.x1 + 0.28, 0.0, o.z1 + 0.2]], skip=("+y",), tile=2.0),
        )  # fmt: skip
    bag.add("stone", boxes([[o.x0 - 0.1, -0.14, 0.0]], [[o.x1 + 0.1, y + 0.05, o.z0]], tile=2.0))


def _shop_window(bag: Bag, o: Opening, trim: Trim, rng: np.random.Generator) -> None:
    """Add large panes in a dark frame on a low stall riser."""
    y, riser = trim.depth, 0.45
    bag.add(trim.door, boxes([[o.x0, y - 0.05, o.z0]], [[o.x1, y + 0.05, o.z0 + riser]], skip=("+y",)))
    count = max(round((o.x1 - o.x0) / 1.3), 1)
    x = np.linspace(o.x0, o.x1, count + 1)
    z0, z1 = o.z0 + riser, o.z1
    transom = np.array([z0 + 0.76 * (z1 - z0)])
    bars = [
        _bars(x - 0.04, x + 0.04, np.full_like(x, z0), np.full_like(x, z1), y - 0.04, 0.08),
        _bars(x[:1], x[-1:], transom, transom + 0.06, y - 0.03, 0.07),
    ]
    low, high = (np.concatenate(side) for side in zip(*bars, strict=True))
    bag.add(trim.door, boxes(low, high, skip=("+y",)))
    cell = rng.integers(0, ATLAS_CELLS**2, count)
    corner = np.stack([cell % ATLAS_CELLS, cell // ATLAS_CELLS], -1) / ATLAS_CELLS
    square = np.array([[0.02, 0.98], [0.98, 0.98], [0.98, 0.02], [0.02, 0.02]]) / ATLAS_CELLS
    panes = front_quads(x[:-1], x[1:], np.full(count, z0), np.full(count, z1), np.full(count, y + 0.02))
    bag.add("shop-glass", quads(panes, corner[:, None] + square[None]))


def moulding(width: float, z: float, profile: Sequence[tuple[float, float]], *, tile: float = 2.0) -> Surface:
    """Build a cornice along the whole front. ``profile`` has points (out, up) from the wall's face."""
    line = [(-out, z + up) for out, up in profile]
    return extrude(line, 0.0, width, tile=tile)


def railing(x0: float, x1: float, y0: float, z0: float, height: float, sides: bool = True) -> tuple[Floats, Floats]:
    """Return boxes (low, high) of a balcony's railing along front and sides: bars every 11 cm, and a hand rail."""
    xs = np.arange(x0, x1 + 1e-6, 0.11)
    bar = 0.009
    low = [np.stack([xs - bar, np.full_like(xs, y0 - bar), np.full_like(xs, z0)], -1)]
    high = [np.stack([xs + bar, np.full_like(xs, y0 + bar), np.full_like(xs, z0 + height)], -1)]
    if sides:
        ys = np.arange(y0 + 0.11, -0.02, 0.11)
        for x in (x0, x1):
            low.append(np.stack([np.full_like(ys, x - bar), ys - bar, np.full_like(ys, z0)], -1))
            high.append(np.stack([np.full_like(ys, x + bar), ys + bar, np.full_like(ys, z0 + height)], -1))
            low.append(np.array([[x - 0.025, y0, z0 + height]]))
            high.append(np.array([[x + 0.025, 0.0, z0 + height + 0.04]]))
    low.append(np.array([[x0 - 0.025, y0 - 0.025, z0 + height]]))
    high.append(np.array([[x1 + 0.025, y0 + 0.025, z0 + height + 0.04]]))
    return np.concatenate(low), np.concatenate(high)
