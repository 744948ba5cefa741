"""Carriageway, kerbs, footways, cross streets and surrounding ground, of a few textured quadrilaterals."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, Surface, boxes, quads
from urban_street.street.plan import SIDE_ROAD_HALF, Placement, StreetLines
from urban_street.street.textures.ground import PAVING_TILE, ROAD_TILE

KERB_WIDTH = 0.2
#: Width and depth of the joints between kerb stones, metres.
_JOINT = 0.008
#: Depth of the block below a surface, and height of such blocks' lower ends, just above the outskirts, metres.
_BED, _GROUND = 0.02, -0.055
_PLAIN_SURFACES = 2


def floor_quads(x0: Floats, x1: Floats, y0: Floats, y1: Floats, z: float) -> Floats:
    """Return level rectangles that face up, (N, 4, 3)."""
    height = np.full_like(x0, z)
    corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    return np.stack([np.stack([x, y, height], -1) for x, y in corners], 1)


def build_carriageway(placement: Placement, lines: StreetLines) -> Bag:
    """Build pieces of asphalt that meet edge to edge, each with its own wear. Crossings are part of their textures."""
    bag = Bag()
    rng = np.random.default_rng(placement.seed)
    length = ROAD_TILE[1]
    # Each crossing is in the middle of a piece.
    first = lines.crossings[0] - 0.5 * length
    number = range(math.floor((lines.road_start - first) / length), math.ceil((lines.road_stop - 6.0 - first) / length))
    crossings = {round((c - 0.5 * length - first) / length) for c in lines.crossings}
    for k in number:
        start, stop = max(first + k * length, lines.road_start), min(first + (k + 1) * length, lines.road_stop - 6.0)
        material = "asphalt-crossing" if k in crossings else f"asphalt-{rng.integers(_PLAIN_SURFACES)}"
        cuts = np.linspace(start, stop, 9)
        y0, y1 = cuts[:-1], cuts[1:]
        x0, x1 = np.full_like(y0, lines.left_kerb), np.full_like(y0, lines.right_kerb)
        u, v0, v1 = np.zeros_like(y0), (y0 - first) / length - k, (y1 - first) / length - k
        uvs = np.stack(
            [np.stack([u, v0], -1), np.stack([u + 1.0, v0], -1), np.stack([u + 1.0, v1], -1), np.stack([u, v1], -1)], 1
        )
        bag.add(material, quads(floor_quads(x0, x1, y0, y1, 0.0), uvs))
    bag.add("joint", _bed(lines.left_kerb, lines.right_kerb, lines.road_start, lines.road_stop - 6.0, -_BED))
    return bag


def build_footway(placement: Placement, lines: StreetLines) -> Bag:
    """Build a kerb of granite with a worn edge, and paving from there to the houses."""
    bag = Bag()
    left = placement.kind == "left"
    spans = lines.spans(lines.road_start, lines.road_stop - 6.0, SIDE_ROAD_HALF, left=left)
    for start, stop in spans:
        _footway_span(bag, lines, start, stop, left=left)
    for (_, end), (start, _) in pairwise(spans):
        _kerb_ends(bag, lines, end, start, left=left)
    return bag


def _footway_span(bag: Bag, lines: StreetLines, start: float, stop: float, *, left: bool) -> None:
    kerb, front = (lines.left_kerb, lines.left_front) if left else (lines.right_kerb, lines.right_front)
    height = lines.kerb_height
    outward = -1.0 if left else 1.0
    cuts = np.arange(start, stop + 0.5, 1.0)
    cuts[-1] = stop
    y0, y1 = cuts[:-1] + 0.5 * _JOINT, cuts[1:] - 0.5 * _JOINT
    bevel = 0.025
    # upright face, bevel, top and the part of the back that a joint shows, stone by stone
    stone = [(0.0, -0.05), (0.0, height - bevel), (bevel, height), (KERB_WIDTH - 0.004, height)]
    deep = height - 2.0 * _JOINT
    back = (KERB_WIDTH - 0.004, deep)
    bag.add("kerb", quads(_swept([*stone, back], kerb, outward, y0, y1), tile=2.0))
    core = [(2.0 * _JOINT, -0.05), (2.0 * _JOINT, deep), (bevel, deep), back]
    bag.add("kerb", quads(_stone_ends(stone, core, kerb, outward, y0, y1), tile=2.0))
    # the bed that is visible between the stones, from under the carriageway's edge to that of the paving
    top = height - _JOINT
    bed = [(-_JOINT, -0.002), (_JOINT, -0.002), (_JOINT, top), (KERB_WIDTH, top), (KERB_WIDTH, height)]
    bag.add("joint", quads(_swept(bed, kerb, outward, np.array([start]), np.array([stop]))))
    inner, outer = kerb + outward * KERB_WIDTH, front
    cuts = np.append(np.arange(start, stop, PAVING_TILE[1]), stop)
    y0, y1 = cuts[:-1], cuts[1:]
    x0, x1 = np.full_like(y0, min(inner, outer)), np.full_like(y0, max(inner, outer))
    repeats = float(max(round(abs(outer - inner) / PAVING_TILE[0]), 1))
    u_wall, u_kerb = (0.0, repeats) if left else (repeats, 0.0)
    u0, u1 = np.full_like(y0, u_wall if left else u_kerb), np.full_like(y0, u_kerb if left else u_wall)
    v0, v1 = (y0 - start) / PAVING_TILE[1], (y1 - start) / PAVING_TILE[1]
    uvs = np.stack([np.stack([u0, v0], -1), np.stack([u1, v0], -1), np.stack([u1, v1], -1), np.stack([u0, v1], -1)], 1)
    bag.add("paving", quads(floor_quads(x0, x1, y0, y1, height), uvs))
    # The paving continues behind the building line, where houses are set back.
    beyond = front + outward * (1.8 + lines.setback)
    strip = _level(front - outward * 0.1, beyond, start, stop, height - 0.004)
    bag.add("kerb", quads(strip, tile=2.0), _bed(inner, beyond, start, stop, height - _BED))


def _level(x0: float, x1: float, y0: float, y1: float, z: float) -> Floats:
    """Return a level rectangle, (1, 4, 3), between two values of x and of y, in any order."""
    (left, right), (low, high) = sorted((x0, x1)), sorted((y0, y1))
    return floor_quads(np.array([left]), np.array([right]), np.array([low]), np.array([high]), z)


def _bed(x0: float, x1: float, y0: float, y1: float, z: float) -> Surface:
    """Build a block below a surface, up to z. Rays that slip between two edges hit it instead of another class."""
    (left, right), (low, high) = sorted((x0, x1)), sorted((y0, y1))
    return boxes([[left, low, _GROUND]], [[right, high, z]], skip=("-z",), tile=2.0)


def _swept(profile: list[tuple[float, float]], kerb: float, outward: float, y0: Floats, y1: Floats) -> Floats:
    """Return strips, (N, 4, 3), between y0 and y1 with a profile of (metres from the kerb's line away from the road, z)."""
    strips = []
    for (near, z0), (far, z1) in pairwise(profile):
        places = ((near, y0, z0), (near, y1, z0), (far, y1, z1), (far, y0, z1))
        a, b, c, d = (np.stack([np.full_like(y, kerb + outward * o), y, np.full_like(y, z)], -1) for o, y, z in places)
        strips.append(np.stack([a, b, c, d] if outward < 0.0 else [b, a, d, c], 1))
    return np.concatenate(strips)


def _stone_ends(
    profile: list[tuple[float, float]],
    core: list[tuple[float, float]],
    kerb: float,
    outward: float,
    y0: Floats,
    y1: Floats,
) -> Floats:
    """Return upright strips, (N, 4, 3), between a profile and a core below it, at y0 and y1, to a joint's depth."""
    strips = []
    for outer, inner in zip(pairwise(profile), pairwise(core), strict=True):
        for y, forwards in ((y0, False), (y1, True)):
            ring = (*outer, *reversed(inner))
            corners = np.stack(
                [np.stack([np.full_like(y, kerb + outward * o), y, np.full_like(y, z)], -1) for o, z in ring], 1
            )
            strips.append(corners if forwards == (outward > 0.0) else corners[:, ::-1])
    return np.concatenate(strips)


def _kerb_ends(bag: Bag, lines: StreetLines, low: float, high: float, *, left: bool) -> None:
    """Add the pavement's upright faces at a side street, from the kerb into the side street's own pavement."""
    kerb, front = (lines.left_kerb, lines.left_front - 0.1) if left else (lines.right_kerb, lines.right_front + 0.1)
    x0, x1 = sorted((kerb, front))
    top = lines.kerb_height
    bag.add(
        "kerb",
        boxes([[x0, low - KERB_WIDTH, _GROUND], [x0, high, _GROUND]],
              [[x1, low, top + 0.001], [x1, high + KERB_WIDTH, top + 0.001]], skip=("-z",), tile=2.0),
    )  # fmt: skip


def build_cross_road(placement: Placement) -> Bag:
    """Build asphalt across the street's end."""
    bag = Bag()
    length, width = placement.size
    cuts = np.linspace(-0.5 * length, 0.5 * length, 11)
    low, high = -0.5 * width - 3.2, 0.5 * width
    if placement.y < 0.0:
        low, high = -high, -low
    n = len(cuts) - 1
    corners = floor_quads(cuts[:-1], cuts[1:], np.full(n, low), np.full(n, high), -0.004)
    v0, v1 = cuts[:-1] / ROAD_TILE[1], cuts[1:] / ROAD_TILE[1]
    u0, u1 = np.full(n, 0.33), np.full(n, 0.67)
    uvs = np.stack([np.stack([u0, v0], -1), np.stack([u0, v1], -1), np.stack([u1, v1], -1), np.stack([u1, v0], -1)], 1)
    bag.add("asphalt-0", quads(corners, uvs))
    bag.add("joint", _bed(-0.5 * length, 0.5 * length, low - 0.1, high + 0.1, -_BED))
    return bag


def build_cross_footway(placement: Placement, lines: StreetLines) -> Bag:
    """Build the far footway of a cross street."""
    bag = Bag()
    length, width = placement.size
    bag.add(
        "kerb",
        boxes(
            [[-0.5 * length, -0.5 * width, _GROUND]],
            [[0.5 * length, 0.5 * width, lines.kerb_height]],
            skip=("-z",),
            tile=2.0,
        ),
    )
    return bag


def build_side_road(placement: Placement, lines: StreetLines) -> Bag:
    """Build the carriageway of a side street along +x, level with the main one, with a zebra crossing at its mouth."""
    bag = Bag()
    length, width = placement.size
    cuts = np.linspace(0.0, length, 9)
    n = len(cuts) - 1
    corners = floor_quads(cuts[:-1], cuts[1:], np.full(n, -0.5 * width), np.full(n, 0.5 * width), 0.0)
    v0, v1 = cuts[:-1] / ROAD_TILE[1], cuts[1:] / ROAD_TILE[1]
    half = 0.5 * width / lines.width
    u0, u1 = np.full(n, max(0.5 - half, 0.08)), np.full(n, min(0.5 + half, 0.92))
    uvs = np.stack([np.stack([u0, v0], -1), np.stack([u0, v1], -1), np.stack([u1, v1], -1), np.stack([u1, v0], -1)], 1)
    bag.add("asphalt-side", quads(corners, uvs))
    bag.add("joint", _bed(0.0, length, -0.5 * width - 0.1, 0.5 * width + 0.1, -_BED))
    y = np.arange(-0.5 * width + 0.3, 0.5 * width - 0.5, 1.0)
    # thermoplastic is 4 mm above the road
    mouth = 1.3 if placement.x + 0.5 * length > 0.0 else length - 1.3 - 3.2
    for x in np.linspace(mouth, mouth + 3.2, 9)[:-1]:
        bag.add("road-paint", quads(floor_quads(np.full_like(y, x), np.full_like(y, x + 0.4), y, y + 0.5, 0.004)))
    return bag


def build_side_footway(placement: Placement) -> Bag:
    """Build a pavement of a side street along +x; its size is (length, width, height)."""
    bag = Bag()
    length, width, height = placement.size
    low, high = [0.0, -0.5 * width, _GROUND], [length, 0.5 * width, height]
    bag.add("kerb", boxes([low], [high], skip=("-z",), tile=2.0))
    return bag


def build_outskirts(lines: StreetLines) -> Bag:
    """Build ground below and around everything."""
    bag = Bag()
    cuts = np.linspace(-90.0, 90.0, 10)
    reach = np.linspace(-90.0, max(90.0, round(lines.road_stop - 22.2, 4)), 10)
    x, y = np.meshgrid(cuts[:-1], reach[:-1] + 40.0, indexing="ij")
    long = reach[1] - reach[0]
    side = cuts[1] - cuts[0]
    bag.add("turf", quads(floor_quads(x.ravel(), x.ravel() + side, y.ravel(), y.ravel() + long, -0.06), tile=2.0))
    return bag


def build_garden(placement: Placement) -> Bag:
    """Build a strip of grass in front of a house."""
    bag = Bag()
    wide, long = placement.size
    bag.add("turf", boxes([[0.0, 0.0, 0.0]], [[wide, long, 0.05]], skip=("-z",), tile=2.0))
    return bag
