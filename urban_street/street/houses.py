"""Houses of five styles: brick, classic stucco, plain post-war render, narrow gables, shops with flats above."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, boxes, fan, pose, quads, tubes
from urban_street.street.facade import Opening, Trim, build_front, moulding, railing
from urban_street.street.plan import Placement
from urban_street.street.textures.walls import BRICK_TILE, RENDER_TILE, ROOF_TILE, STONE_TILE

RENDER_COLORS = 9
DOOR_COLORS = 5
ROOF_COLORS = 3


@dataclass(frozen=True, slots=True)
class House:
    """The dimensions, metres, and materials of one house."""

    width: float
    depth: float
    bays: int
    door_bay: int
    floors: int
    ground_floor: float
    floor: float
    trim: Trim
    roof: str
    pitch: float

    @property
    def eaves(self) -> float:
        return self.ground_floor + self.floor * (self.floors - 1) + 0.35


def build_house(placement: Placement) -> Bag:
    """Build one house in the frame of its front (see `facade`)."""
    rng = np.random.default_rng(placement.seed)
    house = _decide(placement, rng)
    bag = Bag()
    openings = _openings(house, placement.kind, rng)
    gabled = placement.kind == "gable"
    build_front(bag, house.width, house.eaves, openings, house.trim, rng)
    other_walls(bag, house, gabled=gabled)
    add_base(bag, house, openings)
    _ornaments(bag, house, placement.kind, openings, rng)
    if gabled:
        _gable_roof(bag, house, rng)
    else:
        add_eaves_roof(bag, house, rng, dormers=placement.kind in {"classic", "brick", "shop"})
    add_chimneys(bag, house, rng, gabled=gabled)
    if len(placement.size) > 4:
        _corner_front(bag, house, rng, first=placement.size[4] < 0.0)
    return bag


def _corner_front(bag: Bag, house: House, rng: np.random.Generator, *, first: bool) -> None:
    """Add a second front, a brick thick, on the side wall along a side street: at x = 0 (``first``) or at the other end."""
    thick, d, h = 0.2, house.depth, house.eaves - 0.05
    side = Bag()
    centres = (np.arange(4) + 0.5) * d / 4.0
    levels = [0.0, *(house.ground_floor + k * house.floor for k in range(house.floors - 1))]
    openings = [Opening(x - 0.5, x + 0.5, z + 1.0, min(z + 2.6, h - 0.45), "window") for z in levels for x in centres]
    build_front(side, d, h, openings, replace(house.trim, depth=0.12), rng)
    ends = [[(0, thick, 0), (0, 0, 0), (0, 0, h), (0, thick, h)], [(d, 0, 0), (d, thick, 0), (d, thick, h), (d, 0, h)]]
    side.add(house.trim.wall, quads(np.array(ends, np.float64), tile=house.trim.tile))
    side.add("stone", boxes([[0.0, -0.05, -0.15]], [[d, 0.0, 0.62]], skip=("+y", "-z"), tile=STONE_TILE))
    side.add("stucco", moulding(d, house.ground_floor - 0.1, _BAND), moulding(d, h - 0.44, CORNICE))
    side.add("zinc", quads([[(0, 0, h), (d, 0, h), (d, thick, h), (0, thick, h)]]))
    w = house.width
    bag.merge(side, pose(-thick, d, 0.0, -0.5 * np.pi) if first else pose(w + thick, 0.0, 0.0, 0.5 * np.pi))


def _decide(placement: Placement, rng: np.random.Generator) -> House:
    kind, floors = placement.kind, placement.variant
    width, depth = placement.size[:2]
    bays, door_bay = int(placement.size[2]), int(placement.size[3])

    def house(floors: int, ground_floor: float, floor: float, trim: Trim, pitch: float) -> House:
        return House(width, depth, bays, door_bay, floors, ground_floor, floor, trim, roof, pitch)

    tint = f"render-{rng.integers(RENDER_COLORS)}"
    door = f"door-{rng.integers(DOOR_COLORS)}"
    roof = f"roof-{rng.integers(ROOF_COLORS)}"
    bricks = "brick-red" if rng.random() < 0.62 else "brick-buff"
    plain = Trim(tint, tint, "frame-white", "stone", "stucco", door, RENDER_TILE)
    if kind == "brick":
        trim = replace(
            plain,
            wall=bricks,
            reveal=bricks,
            tile=BRICK_TILE,
            surround="stucco",
            surrounds="lintel",
            sashes=2,
            transom=0.52 if rng.random() < 0.5 else 0.7,
        )
        return house(min(floors, 4), 3.5, float(rng.uniform(2.95, 3.2)), trim, 42.0)
    if kind == "classic":
        trim = replace(plain, surrounds="pediment", sashes=2, transom=0.7, depth=0.2)
        return house(min(floors, 4), 4.1, float(rng.uniform(3.4, 3.65)), trim, 38.0)
    if kind == "plain":
        trim = replace(
            plain, sashes=2, transom=0.0, depth=0.12, frame="frame-white" if rng.random() < 0.7 else "frame-dark"
        )
        return house(floors, 3.2, 2.85, trim, 33.0)
    if kind == "gable":
        wall = bricks if rng.random() < 0.5 else tint
        trim = replace(
            plain,
            wall=wall,
            reveal=wall,
            tile=BRICK_TILE,
            surrounds="flat" if wall == tint else "lintel",
            sashes=2,
            transom=0.62,
        )
        return house(min(floors, 4), 3.4, 2.95, trim, 52.0)
    trim = replace(plain, surrounds="flat", sashes=2, transom=0.68)
    return house(floors, 4.0, float(rng.uniform(3.0, 3.3)), trim, 40.0)


def _openings(house: House, kind: str, rng: np.random.Generator) -> list[Opening]:
    bays, door_bay = house.bays, house.door_bay
    pitch = house.width / bays
    wide = float(np.clip(pitch * rng.uniform(0.40, 0.48), 0.9, 1.45))
    if kind == "plain":
        wide = float(np.clip(pitch * 0.58, 1.1, 1.8))
    openings = []
    step = 0.16
    centres = (np.arange(bays) + 0.5) * pitch
    if kind == "shop":
        door = centres[door_bay]
        openings.append(Opening(door - 0.55, door + 0.55, step, 3.0, "door"))
        for x0, x1 in ((0.45, door - 0.95), (door + 0.95, house.width - 0.45)):
            if x1 - x0 > 1.2:
                openings.append(Opening(x0, x1, step, 3.0, "shop"))
    else:
        gate = kind == "classic"
        half = 0.8 if gate else 0.55
        top = 2.95 if gate else 2.5
        for k, x in enumerate(centres):
            if k == door_bay:
                openings.append(Opening(x - half, x + half, step, top, "door"))
            else:
                openings.append(
                    Opening(x - 0.5 * wide, x + 0.5 * wide, 1.15, min(house.ground_floor - 0.55, 2.95), "window")
                )
    balcony = kind in {"plain", "classic", "shop"}
    for floor in range(1, house.floors):
        z = house.ground_floor + (floor - 1) * house.floor
        tall = house.floor - 1.28 if kind != "plain" else 1.45
        for k, x in enumerate(centres):
            french = balcony and _has_balcony(kind, k, bays, floor, house.floors)
            low, high = (z + 0.12, z + 0.9 + tall) if french else (z + 0.9, z + 0.9 + tall)
            openings.append(
                Opening(
                    x - 0.5 * wide, x + 0.5 * wide, low, min(high, house.eaves - 0.4), "french" if french else "window"
                )
            )
    return openings


def _has_balcony(kind: str, bay: int, bays: int, floor: int, floors: int) -> bool:
    if kind == "plain":
        return bay in {1, bays - 2} and floor >= 1
    if kind == "classic":
        return bay == bays // 2 and 1 <= floor <= floors - 2
    return bay == bays // 2 and floor == 1


def other_walls(bag: Bag, house: House, *, gabled: bool) -> None:
    """Add plain party walls and a back wall, which are visible above lower neighbours."""
    w, d, h = house.width, house.depth, house.eaves
    faces = np.array(
        [
            [(0, d, 0), (0, 0, 0), (0, 0, h), (0, d, h)],
            [(w, 0, 0), (w, d, 0), (w, d, h), (w, 0, h)],
            [(w, d, 0), (0, d, 0), (0, d, h), (w, d, h)],
        ]
    )
    side = house.trim.wall if house.trim.wall.startswith("brick") else "render-side"
    bag.add(side, quads(faces, tile=house.trim.tile))
    if gabled:
        return
    rise = 0.5 * d * np.tan(np.radians(house.pitch))
    bag.add(side, fan([(0, d, h), (0, 0, h), (0, 0.5 * d, h + rise)], tile=house.trim.tile),
            fan([(w, 0, h), (w, d, h), (w, 0.5 * d, h + rise)], tile=house.trim.tile))  # fmt: skip


def add_base(bag: Bag, house: House, openings: list[Opening]) -> None:
    """Add a plinth between the doors and shop fronts."""
    holes = sorted((o.x0 - 0.02, o.x1 + 0.02) for o in openings if o.z0 < 0.5)
    starts = [0.0, *(stop for _, stop in holes)]
    stops = [*(start for start, _ in holes), house.width]
    spans = np.array([(a, b) for a, b in zip(starts, stops, strict=True) if b - a > 0.05])
    if len(spans):
        flat = np.zeros(len(spans))
        low = np.stack([spans[:, 0], flat - 0.05, flat - 0.15], -1)
        bag.add("stone", boxes(low, np.stack([spans[:, 1], flat, flat + 0.62], -1), skip=("+y", "-z"), tile=STONE_TILE))


def add_floor(bag: Bag, placement: Placement) -> None:
    """Add the ground below a house, from 1 cm below its walls down to any road. It is visible behind recessed doors."""
    width, depth = placement.size[:2]
    bag.add("stone", boxes([[0.0, 0.0, -0.26]], [[width, depth, -0.01]], skip=("-z",), tile=STONE_TILE))


CORNICE = ((0.0, 0.0), (0.05, 0.0), (0.07, 0.10), (0.16, 0.14), (0.18, 0.24), (0.34, 0.30), (0.36, 0.42), (0.0, 0.44))
_BAND = ((0.0, 0.0), (0.05, 0.02), (0.09, 0.10), (0.09, 0.16), (0.0, 0.20))


def _ornaments(bag: Bag, house: House, kind: str, openings: list[Opening], rng: np.random.Generator) -> None:
    w = house.width
    if kind in {"classic", "brick", "shop"}:
        bag.add("stucco", moulding(w, house.ground_floor - 0.1, _BAND))
        bag.add("stucco", moulding(w, house.eaves - 0.44, CORNICE))
    if kind == "classic":
        # Rusticated ground floor: ashlar piers between the openings, in front of the wall.
        holes = sorted((o.x0 - 0.26, o.x1 + 0.26) for o in openings if o.z0 < 2.0)
        spans = [
            (a, b)
            for a, b in zip([0.0, *(b for _, b in holes)], [*(a for a, _ in holes), w], strict=True)
            if b - a > 0.12
        ]
        low = [(a, -0.035, 0.62) for a, _ in spans]
        bag.add(
            "ashlar", boxes(low, [(b, 0.0, house.ground_floor - 0.1) for _, b in spans], skip=("+y",), tile=STONE_TILE)
        )
        for floor in range(1, house.floors - 1):
            bag.add("stucco", moulding(w, house.ground_floor + floor * house.floor - 0.05, _BAND))
        count = max(int(w / 0.55), 2)
        x = np.linspace(0.15, w - 0.15, count)
        z = np.full(count, house.eaves - 0.30)
        low3 = np.stack([x - 0.06, np.full(count, -0.24), z], -1)
        bag.add("stucco", boxes(low3, low3 + np.array([0.12, 0.24, 0.2]), skip=("+y",)))
    for o in openings:
        if o.kind == "french":
            add_balcony(bag, o, solid=kind == "plain" and rng.random() < 0.5, deep=1.05 if kind == "plain" else 0.7)
    if kind == "shop":
        add_shop_boards(bag, openings, rng)
    add_drainpipes(bag, house)


def add_balcony(bag: Bag, o: Opening, *, solid: bool, deep: float) -> None:
    x0, x1, z = o.x0 - 0.55, o.x1 + 0.55, o.z0 - 0.02
    bag.add("stucco", boxes([[x0, -deep, z - 0.16]], [[x1, 0.02, z]], skip=("+y",), tile=2.0))
    if solid:
        low = [[x0, -deep, z], [x0, -deep, z], [x1 - 0.04, -deep, z]]
        high = [[x1, -deep + 0.04, z + 0.9], [x0 + 0.04, 0.0, z + 0.9], [x1, 0.0, z + 0.9]]
        bag.add("frame-dark", boxes(low, high))
        return
    low2, high2 = railing(x0 + 0.03, x1 - 0.03, -deep + 0.03, z, 0.95)
    bag.add("iron", boxes(low2, high2, skip=("-z", "+z")))
    bag.add("hedge", boxes([[x0 + 0.15, -deep - 0.12, z + 0.72]], [[x1 - 0.15, -deep + 0.02, z + 0.98]]))


def add_shop_boards(bag: Bag, openings: list[Opening], rng: np.random.Generator) -> None:
    """Add name boards over the shop windows, and usually an awning over the first."""
    for k, o in enumerate(o for o in openings if o.kind == "shop"):
        cell = int(rng.integers(8))
        column, row = cell % 4, cell // 4
        board = boxes([[o.x0, -0.07, 3.05]], [[o.x1, 0.0, 3.6]], skip=("-y", "+y"))
        bag.add("frame-dark", board)
        corners = [[(o.x0, -0.07, 3.05), (o.x1, -0.07, 3.05), (o.x1, -0.07, 3.6), (o.x0, -0.07, 3.6)]]
        u0, v0 = column / 4, row / 2
        bag.add("shop-board", quads(corners, [[(u0, v0 + 0.5), (u0 + 0.25, v0 + 0.5), (u0 + 0.25, v0), (u0, v0)]]))
        if k == 0 and rng.random() < 0.75:
            _awning(bag, o, f"awning-{rng.integers(3)}")


def _awning(bag: Bag, o: Opening, material: str) -> None:
    """Add an awning of striped cloth, 0.95 m deep, with a hanging edge."""
    count = max(round((o.x1 - o.x0) / 0.3), 2)
    x = np.linspace(o.x0, o.x1, count + 1)
    edges = np.array([(-0.95, 2.26), (-0.95, 2.48), (0.0, 2.98)])  # y, z: hem, front, wall
    lines = np.concatenate(
        [np.broadcast_to(x[:, None, None], (count + 1, 3, 1)), np.broadcast_to(edges, (count + 1, 3, 2))], -1
    )
    for step in (0, 1):
        cloth = np.stack([lines[:-1, step], lines[1:, step], lines[1:, step + 1], lines[:-1, step + 1]], 1)
        bag.add(material, quads(cloth[0::2]))
        bag.add("awning-white", quads(cloth[1::2]))


def add_drainpipes(bag: Bag, house: House) -> None:
    x = 0.14
    path = [[[x, -0.07, 0.1], [x, -0.07, house.eaves - 0.5], [x, -0.3, house.eaves + 0.02]]]
    bag.add("zinc", tubes(path, np.full((1, 3), 0.045), 7))


def add_eaves_roof(bag: Bag, house: House, rng: np.random.Generator, *, dormers: bool) -> None:
    w, d, h = house.width, house.depth, house.eaves
    slope = np.tan(np.radians(house.pitch))
    over = 0.42
    ridge = h + 0.5 * d * slope
    low = h - over * slope * 0.25 + 0.05
    front = [(0, -over, low), (w, -over, low), (w, 0.5 * d, ridge), (0, 0.5 * d, ridge)]
    back = [(w, d + over, low), (0, d + over, low), (0, 0.5 * d, ridge), (w, 0.5 * d, ridge)]
    bag.add(house.roof, quads([front, back], tile=ROOF_TILE))
    under = [(0, 0, low - 0.02), (w, 0, low - 0.02), (w, -over, low - 0.02), (0, -over, low - 0.02)]
    bag.add("stucco", quads([under], tile=2.0))
    bag.add("zinc", tubes([[[0.0, -over - 0.03, low + 0.0], [w, -over - 0.03, low + 0.0]]], np.full((1, 2), 0.07), 8))
    bag.add(house.roof, tubes([[[0.0, 0.5 * d, ridge], [w, 0.5 * d, ridge]]], np.full((1, 2), 0.11), 7))
    if not dormers or rng.random() < 0.25:
        return
    count = max(int(w / 3.4), 1)
    for x in (np.arange(count) + 0.5) * w / count:
        _dormer(bag, house, float(x), slope, low, over, rng)


def _dormer(bag: Bag, house: House, x: float, slope: float, low: float, over: float, rng: np.random.Generator) -> None:
    """Add a small gabled window in the roof's front slope."""
    half, tall = 0.72, 1.45
    y = 0.75
    z = low + (y + over) * (house.eaves + 0.5 * house.depth * slope - low) / (0.5 * house.depth + over)
    back = y + (tall + 0.55) / slope + 0.3
    dormer = Bag()
    opening = [Opening(0.22, 2 * half - 0.22, 0.18, tall - 0.1, "french")]
    trim = replace(house.trim, wall="stucco", reveal="stucco", surrounds="none", depth=0.06, transom=0.0, tile=2.0)
    build_front(dormer, 2 * half, tall, opening, trim, rng)
    matrix = np.eye(4)
    matrix[:3, 3] = (x - half, y, z)
    bag.merge(dormer, matrix)
    x0, x1, top = x - half, x + half, z + tall
    sides = [
        [(x0, back, z), (x0, y, z), (x0, y, top), (x0, back, top)],
        [(x1, y, z), (x1, back, z), (x1, back, top), (x1, y, top)],
    ]
    bag.add("zinc", quads(sides))
    peak = top + 0.5
    bag.add("stucco", fan([(x0, y, top), (x1, y, top), (x, y, peak)]))
    out = y - 0.15
    left = [
        (x0 - 0.15, out, top - 0.1),
        (x, out, peak + 0.02),
        (x, back + 0.5, peak + 0.02),
        (x0 - 0.15, back + 0.5, top - 0.1),
    ]
    right = [
        (x, out, peak + 0.02),
        (x1 + 0.15, out, top - 0.1),
        (x1 + 0.15, back + 0.5, top - 0.1),
        (x, back + 0.5, peak + 0.02),
    ]
    bag.add(house.roof, quads([left, right], tile=ROOF_TILE))


def _gable_roof(bag: Bag, house: House, rng: np.random.Generator) -> None:
    """Add a roof whose ridge runs back from the street, and a front that rises in steps or in a triangle with a coping."""
    w, d, h = house.width, house.depth, house.eaves
    rise = 0.5 * w * np.tan(np.radians(house.pitch))
    middle, peak = 0.5 * w, h + rise
    wall = house.trim.wall
    slopes = [
        [(0, 0.15, h), (middle, 0.15, peak), (middle, d, peak), (0, d, h)],
        [(middle, 0.15, peak), (w, 0.15, h), (w, d, h), (middle, d, peak)],
    ]
    bag.add(house.roof, quads(slopes, tile=ROOF_TILE))
    bag.add(wall, fan([(w, d, h), (0, d, h), (middle, d, peak)], tile=house.trim.tile))
    steps = 6
    stepped = rng.random() < 0.6
    size = 0.5 * w / steps
    if stepped:
        for k in range(steps):
            z0, z1 = h + rise * k / steps, h + rise * (k + 1) / steps + 0.12
            x0, x1 = k * size, w - k * size
            bag.add(wall, boxes([[x0, 0.0, z0]], [[x1, 0.3, z1]], skip=("-z",), tile=house.trim.tile))
            for a, b in ((x0 - 0.03, x0 + size + 0.03), (x1 - size - 0.03, x1 + 0.03)):
                bag.add("stucco", boxes([[a, -0.05, z1]], [[b, 0.33, z1 + 0.09]]))
    else:
        bag.add(wall, fan([(0, 0.0, h), (w, 0.0, h), (middle, 0.0, peak + 0.25)], tile=house.trim.tile))
        for start, stop in (((0.0, h), (middle, peak + 0.25)), ((middle, peak + 0.25), (w, h))):
            bag.add("stucco", quads(_coping(start, stop), tile=2.0))
    # Attic windows are on the wall's face, since the steps are solid.
    for count, level in ((2, 0.14), (1, 0.5)):
        for x in middle + (np.arange(count) - 0.5 * (count - 1)) * w * 0.26:
            attic = Bag()
            trim = replace(house.trim, wall="stucco", reveal="stucco", depth=0.03, surrounds="none", tile=2.0)
            build_front(attic, 1.16, 1.56, [Opening(0.1, 1.06, 0.1, 1.46, "french")], trim, rng)
            matrix = np.eye(4)
            matrix[:3, 3] = (x - 0.58, -0.08, h + level * rise)
            bag.merge(attic, matrix)


def _coping(start: tuple[float, float], stop: tuple[float, float]) -> Floats:
    """Return front, top and underside, (3, 4, 3), of a stone band 0.22 m high along a gable's edge between points (x, z)."""
    near, far, high = -0.08, 0.3, 0.22
    (x0, z0), (x1, z1) = start, stop
    front = [(x0, near, z0), (x1, near, z1), (x1, near, z1 + high), (x0, near, z0 + high)]
    top = [(x0, near, z0 + high), (x1, near, z1 + high), (x1, far, z1 + high), (x0, far, z0 + high)]
    under = [(x0, 0.0, z0), (x1, 0.0, z1), (x1, near, z1), (x0, near, z0)]
    return np.array([front, top, under])


def add_chimneys(bag: Bag, house: House, rng: np.random.Generator, *, gabled: bool) -> None:
    ridge = house.eaves + 0.5 * (house.width if gabled else house.depth) * np.tan(np.radians(house.pitch))
    for _ in range(int(rng.integers(1, 3))):
        x, y = (
            (rng.uniform(0.6, house.width - 1.4), 0.5 * house.depth)
            if not gabled
            else (0.5 * house.width - 0.4, rng.uniform(4.0, 8.0))
        )
        bag.add(
            "brick-red", boxes([[x, y, ridge - 1.0]], [[x + 0.8, y + 0.5, ridge + 0.95]], skip=("-z",), tile=BRICK_TILE)
        )
        bag.add("stucco", boxes([[x - 0.06, y - 0.06, ridge + 0.95]], [[x + 0.86, y + 0.56, ridge + 1.05]]))
        pots = [[[x + px, y + 0.25, ridge + 1.05], [x + px, y + 0.25, ridge + 1.4]] for px in (0.2, 0.6)]
        bag.add("roof-0", tubes(pots, np.full((2, 2), 0.1), 7))
