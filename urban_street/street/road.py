"""Carriageway, kerbs, footways, cross streets and the ground around: flat, textured, in a few quadrilaterals."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, boxes, quads
from urban_street.street.plan import SIDE_ROAD_HALF, Lines, Placement
from urban_street.street.textures.ground import PAVING_TILE, ROAD_TILE

KERB_WIDTH = 0.2
_PLAIN_SURFACES = 2


def floor_quads(x0: Floats, x1: Floats, y0: Floats, y1: Floats, z: float) -> Floats:
    """Return (N, 4, 3) level rectangles facing up."""
    height = np.full_like(x0, z)
    corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    return np.stack([np.stack([x, y, height], -1) for x, y in corners], 1)


def build_carriageway(placement: Placement, lines: Lines) -> Bag:
    """Build pieces of asphalt, each with its own history, meeting edge to edge; the crossings are painted into theirs."""
    bag = Bag()
    rng = np.random.default_rng(placement.seed)
    length = ROAD_TILE[1]
    # Pieces are laid so that each crossing lies in the middle of one.
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
    return bag


def build_footway(placement: Placement, lines: Lines) -> Bag:
    """Build a kerb of granite with a worn edge, and paving from there to the houses."""
    bag = Bag()
    left = placement.kind == "left"
    spans = lines.spans(lines.road_start, lines.road_stop - 6.0, SIDE_ROAD_HALF, left=left)
    for start, stop in spans:
        _footway_span(bag, lines, start, stop, left=left)
    for (_, end), (start, _) in pairwise(spans):
        _kerb_ends(bag, lines, end, start, left=left)
    return bag


def _footway_span(bag: Bag, lines: Lines, start: float, stop: float, *, left: bool) -> None:
    kerb, front = (lines.left_kerb, lines.left_front) if left else (lines.right_kerb, lines.right_front)
    height = lines.kerb_height
    outward = -1.0 if left else 1.0
    cuts = np.arange(start, stop + 0.5, 1.0)
    cuts[-1] = stop
    y0, y1 = cuts[:-1] + 0.004, cuts[1:] - 0.004
    flat = np.full_like(y0, kerb)
    top = np.full_like(y0, height)
    bevel = 0.025
    # Upright face, bevel, top: stone by stone, with open joints.
    profile = [(0.0, -0.05), (0.0, height - bevel), (bevel, height), (KERB_WIDTH - 0.004, height)]
    pieces = []
    for (o0, z0), (o1, z1) in pairwise(profile):
        a = np.stack([flat + outward * o0, y0, 0 * top + z0], -1)
        b = np.stack([flat + outward * o0, y1, 0 * top + z0], -1)
        c = np.stack([flat + outward * o1, y1, 0 * top + z1], -1)
        d = np.stack([flat + outward * o1, y0, 0 * top + z1], -1)
        pieces.append(np.stack([a, b, c, d] if left else [b, a, d, c], 1))
    bag.add("kerb", quads(np.concatenate(pieces), tile=2.0))
    bag.add("joint", quads([_joint(kerb, outward, start, stop, height)]))
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
    # Behind the building line, where houses stand back.
    beyond = front + outward * (1.8 + lines.setback)
    strip = floor_quads(
        np.array([min(front, beyond)]),
        np.array([max(front, beyond)]),
        np.array([start]),
        np.array([stop]),
        height - 0.004,
    )
    bag.add("kerb", quads(strip, tile=2.0))


def _kerb_ends(bag: Bag, lines: Lines, low: float, high: float, *, left: bool) -> None:
    """Add upright faces of the pavement where a side street cuts it, from the kerb to the plots."""
    kerb, front = (lines.left_kerb, lines.left_front) if left else (lines.right_kerb, lines.right_front)
    x0, x1 = sorted((kerb, front))
    top = lines.kerb_height
    bag.add(
        "kerb",
        boxes([[x0, low - KERB_WIDTH, 0.0], [x0, high, 0.0]], [[x1, low, top + 0.001], [x1, high + KERB_WIDTH, top + 0.001]],
              skip=("-z",), tile=2.0),
    )  # fmt: skip


def _joint(kerb: float, outward: float, start: float, stop: float, height: float) -> list[tuple[float, float, float]]:
    """Return the dark bed that shows between kerb stones."""
    x0, x1 = sorted((kerb + outward * 0.008, kerb + outward * KERB_WIDTH))
    z = height - 0.008
    return [(x0, start, z), (x1, start, z), (x1, stop, z), (x0, stop, z)]


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
    return bag


def build_cross_footway(placement: Placement, lines: Lines) -> Bag:
    """Build the far footway of a cross street."""
    bag = Bag()
    length, width = placement.size
    bag.add(
        "kerb",
        boxes(
            [[-0.5 * length, -0.5 * width, 0.0]],
            [[0.5 * length, 0.5 * width, lines.kerb_height]],
            skip=("-z",),
            tile=2.0,
        ),
    )
    return bag


def build_side_road(placement: Placement, lines: Lines) -> Bag:
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
    y = np.arange(-0.5 * width + 0.3, 0.5 * width - 0.5, 1.0)
    # Thermoplastic lies 4 mm proud of the road.
    mouth = 1.3 if placement.x + 0.5 * length > 0.0 else length - 1.3 - 3.2
    for x in np.linspace(mouth, mouth + 3.2, 9)[:-1]:
        bag.add("road-paint", quads(floor_quads(np.full_like(y, x), np.full_like(y, x + 0.4), y, y + 0.5, 0.004)))
    return bag


def build_side_footway(placement: Placement) -> Bag:
    """Build a pavement of a side street along +x: size is (length, width, height)."""
    bag = Bag()
    length, width, height = placement.size
    low, high = [0.0, -0.5 * width, 0.0], [length, 0.5 * width, height]
    bag.add("kerb", boxes([low], [high], skip=("-z",), tile=2.0))
    return bag


def build_outskirts(lines: Lines) -> Bag:
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
