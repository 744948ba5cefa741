"""Houses with more relief than a flat front: mansard, bay windows, timber frame, flat-roofed modern block.

Each builder takes a placement and returns the house in the frame of its front (see `facade`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, boxes, fan, pose, quads, tubes
from urban_street.street.facade import Opening, Trim, build_front, moulding, railing
from urban_street.street.houses import (
    CORNICE,
    DOOR_COLORS,
    RENDER_COLORS,
    ROOF_COLORS,
    House,
    add_base,
    add_chimneys,
    add_drainpipes,
    add_eaves_roof,
    add_shop_boards,
    other_walls,
)
from urban_street.street.plan import Placement
from urban_street.street.textures.walls import BRICK_TILE, RENDER_TILE, ROOF_TILE, STONE_TILE

_BAND = ((0.0, 0.0), (0.06, 0.02), (0.10, 0.10), (0.10, 0.16), (0.0, 0.20))


def _house(
    placement: Placement, floors: int, ground: float, floor: float, trim: Trim, roof: str, pitch: float
) -> House:
    width, depth, bays, door = placement.size[:4]
    return House(width, depth, int(bays), int(door), floors, ground, floor, trim, roof, pitch)


def _trim(rng: np.random.Generator) -> Trim:
    tint = f"render-{rng.integers(RENDER_COLORS)}"
    return Trim(tint, tint, "frame-white", "stone", "stucco", f"door-{rng.integers(DOOR_COLORS)}", RENDER_TILE)


def _roof(rng: np.random.Generator) -> str:
    return f"roof-{rng.integers(ROOF_COLORS)}"


def _shifted(x: float, y: float, z: float = 0.0, heading: float = 0.0) -> Floats:
    return pose(x, y, z, heading)


def _centres(house: House) -> Floats:
    return np.asarray((np.arange(house.bays) + 0.5) * house.width / house.bays)


def build_mansard(placement: Placement) -> Bag:
    """Build a house of dressed stone: tall windows, iron guards, two running balconies, dormers in a steep zinc roof."""
    rng = np.random.default_rng(placement.seed)
    trim = replace(
        _trim(rng), wall="ashlar", reveal="ashlar", tile=STONE_TILE, surround="ashlar", surrounds="flat",
        sashes=2, transom=0.78, depth=0.26,
    )  # fmt: skip
    house = _house(placement, min(placement.variant + 1, 5), 4.2, 3.25, trim, _roof(rng), 38.0)
    bag = Bag()
    centres, width = _centres(house), house.width
    door = centres[house.door_bay]
    openings = [Opening(door - 0.75, door + 0.75, 0.16, 3.2, "door")]
    for x0, x1 in ((0.5, door - 1.2), (door + 1.2, width - 0.5)):
        if x1 - x0 > 1.2:
            openings.append(Opening(x0, x1, 0.16, 3.2, "shop"))
    half = float(np.clip(0.21 * width / house.bays, 0.5, 0.62))
    running = {1, house.floors - 1}
    for floor in range(1, house.floors):
        z = house.ground_floor + (floor - 1) * house.floor
        openings += [Opening(x - half, x + half, z + 0.1, z + 2.6, "french") for x in centres]
    build_front(bag, width, house.eaves, openings, trim, rng)
    other_walls(bag, house, gabled=True)
    add_base(bag, house, openings)
    bag.add("ashlar", moulding(width, house.eaves - 0.44, CORNICE))
    for floor in range(1, house.floors):
        z = house.ground_floor + (floor - 1) * house.floor
        if floor in running:
            _running_balcony(bag, width, z, 0.75)
        else:
            bag.add("ashlar", moulding(width, z - 0.12, _BAND))
            for x in centres:
                low, high = railing(x - half - 0.02, x + half + 0.02, -0.06, z + 0.1, 0.85, sides=False)
                bag.add("iron", boxes(low, high, skip=("-z", "+z")))
        # keystones and a moulded head over each window
        low = np.stack([centres - half - 0.22, np.full_like(centres, -0.10), np.full_like(centres, z + 2.76)], -1)
        bag.add("ashlar", boxes(low, low + np.array([2.0 * half + 0.44, 0.10, 0.10]), skip=("+y",), tile=STONE_TILE))
    add_shop_boards(bag, openings, rng)
    add_drainpipes(bag, house)
    _mansard_roof(bag, house, rng)
    add_chimneys(bag, replace(house, pitch=35.0), rng, gabled=False)
    return bag


def _running_balcony(bag: Bag, width: float, z: float, deep: float) -> None:
    """Add a stone slab on consoles along the whole front, with an iron railing."""
    bag.add("stone", boxes([[0.25, -deep, z - 0.12]], [[width - 0.25, 0.02, z + 0.06]], skip=("+y",), tile=STONE_TILE))
    x = np.linspace(0.5, width - 0.5, max(int(width / 1.3), 2))
    low = np.stack([x - 0.09, np.full_like(x, -0.8 * deep), np.full_like(x, z - 0.32)], -1)
    bag.add("stone", boxes(low, low + np.array([0.18, 0.8 * deep, 0.2]), skip=("+y", "+z"), tile=STONE_TILE))
    low_bars, high_bars = railing(0.3, width - 0.3, -deep + 0.05, z + 0.06, 0.95)
    bag.add("iron", boxes(low_bars, high_bars, skip=("-z", "+z")))


def _mansard_roof(bag: Bag, house: House, rng: np.random.Generator) -> None:
    w, d, h = house.width, house.depth, house.eaves
    rise, back = 2.7, 0.75
    ridge = h + rise + 1.3
    outline = [(0.05, h), (back, h + rise), (0.5 * d, ridge), (d - back, h + rise), (d, h)]
    material = "slate" if rng.random() < 0.5 else "zinc-roof"
    for (y0, z0), (y1, z1) in pairwise(outline):
        bag.add(material, quads([[(0, y0, z0), (w, y0, z0), (w, y1, z1), (0, y1, z1)]], tile=ROOF_TILE))
    for x, turn in ((0.0, True), (w, False)):  # fire walls rise above the roof
        side = np.array([(x, y, z + 0.25) for y, z in outline])
        wall = np.concatenate([[[x, outline[0][0], h]], side, [[x, outline[-1][0], h]]])
        bag.add("render-side", fan(wall if turn else wall[::-1], tile=RENDER_TILE))
        bag.add(
            "render-side", fan((wall if not turn else wall[::-1]) + [0.28 if turn else -0.28, 0, 0], tile=RENDER_TILE)
        )
        for a, b in pairwise(side):
            off = np.array([0.28 if turn else -0.28, 0.0, 0.0])
            strip = [a, a + off, b + off, b] if turn else [a + off, a, b, b + off]
            bag.add("zinc", quads([strip]))
    bag.add("zinc", boxes([[0.0, -0.25, h - 0.02]], [[w, 0.1, h + 0.1]], skip=("+y",)))
    for x in _centres(house):
        _roof_window(bag, house, float(x), h, rng)


def _roof_window(bag: Bag, house: House, x: float, z: float, rng: np.random.Generator) -> None:
    """Add a dormer in the steep slope, with a stuccoed front, zinc cheeks and a shallow curved lid."""
    half, tall, y = 0.62, 1.95, 0.12
    front = Bag()
    trim = replace(house.trim, wall="stucco", reveal="stucco", surrounds="none", depth=0.08, transom=0.0, tile=2.0)
    build_front(front, 2 * half, tall, [Opening(0.16, 2 * half - 0.16, 0.28, tall - 0.14, "french")], trim, rng)
    bag.merge(front, _shifted(x - half, y, z))
    back = 1.1
    x0, x1, top = x - half, x + half, z + tall
    bag.add("zinc", quads([[(x0, back, z), (x0, y, z), (x0, y, top), (x0, back, top)],
                           [(x1, y, z), (x1, back, z), (x1, back, top), (x1, y, top)]]))  # fmt: skip
    angle = np.linspace(0.0, np.pi, 7)
    arc = np.stack([x - (half + 0.1) * np.cos(angle), top + 0.28 * np.sin(angle)], -1)
    lids = [
        [(a[0], y - 0.1, a[1]), (b[0], y - 0.1, b[1]), (b[0], back + 0.2, b[1]), (a[0], back + 0.2, a[1])]
        for a, b in pairwise(arc)
    ]
    bag.add("zinc", quads(lids))
    bag.add("stucco", fan(np.stack([arc[::-1, 0], np.full(7, y - 0.02), arc[::-1, 1]], -1)))


def build_bay(placement: Placement) -> Bag:
    """Build a brick house with canted bay windows over two floors, a porch over the door and white stone dressings."""
    rng = np.random.default_rng(placement.seed)
    bricks = "brick-red" if rng.random() < 0.6 else "brick-buff"
    trim = replace(
        _trim(rng), wall=bricks, reveal=bricks, tile=BRICK_TILE, surrounds="lintel", sashes=1, transom=0.5, depth=0.13
    )
    house = _house(placement, min(placement.variant, 3), 3.5, 3.1, trim, _roof(rng), 44.0)
    out = 0.85  # the bays' fronts are on the building line
    shell = Bag()
    centres = _centres(house)
    half = 0.52
    canted = _bay_places(house, centres)
    openings: list[Opening] = []
    for floor in range(house.floors):
        z = 0.0 if floor == 0 else house.ground_floor + (floor - 1) * house.floor
        for k, x in enumerate(centres):
            if floor == 0 and k == house.door_bay:
                openings.append(Opening(x - 0.55, x + 0.55, 0.16, 2.6, "door"))
            elif floor > 1 or all(abs(x - place) > 1.75 for place in canted):
                openings.append(Opening(x - half, x + half, z + 0.95, z + 2.65, "window"))
    build_front(shell, house.width, house.eaves, openings, trim, rng)
    other_walls(shell, replace(house, depth=house.depth - out), gabled=False)
    add_base(shell, house, openings)
    shell.add("stucco", moulding(house.width, house.eaves - 0.44, CORNICE))
    shell.add("stucco", moulding(house.width, house.ground_floor - 0.1, _BAND))
    top = house.ground_floor + (house.floor if house.floors > 1 else 0.0) - 0.15
    for x in canted:
        _canted_bay(shell, float(x), out, top, house, trim, rng)
    _porch(shell, float(centres[house.door_bay]))
    add_drainpipes(shell, house)
    add_eaves_roof(shell, replace(house, depth=house.depth - out), rng, dormers=house.floors < 3)
    add_chimneys(shell, replace(house, depth=house.depth - out), rng, gabled=False)
    bag = Bag()
    bag.merge(shell, _shifted(0.0, out))
    return bag


def _bay_places(house: House, centres: Floats) -> list[float]:
    """Return the middles of the bays, on each side of the door with at least 3 m of room."""
    door = centres[house.door_bay]
    return [
        0.5 * (a + b) for a, b in ((0.25, door - 1.0), (door + 1.0, house.width - 0.25)) if b - a > 3.1
    ]  # fmt: skip


def _canted_bay(bag: Bag, x: float, out: float, top: float, house: House, trim: Trim, rng: np.random.Generator) -> None:
    """Add three faces, 1.3 m wide in front and cut back at 45°, with windows on each floor and a hipped lead roof."""
    front, slant = 1.3, out * np.sqrt(2.0)
    faces = (
        (x - 0.5 * front - out, 0.0, -0.25 * np.pi, slant, 0.40),
        (x - 0.5 * front, -out, 0.0, front, 0.55),
        (x + 0.5 * front, -out, 0.25 * np.pi, slant, 0.40),
    )
    levels = [0.75, house.ground_floor + 0.65] if top > house.ground_floor else [0.75]
    for x0, y0, turn, width, half in faces:
        face = Bag()
        openings = [Opening(0.5 * width - half, 0.5 * width + half, z, z + 2.0, "window") for z in levels]
        build_front(face, width, top, openings, replace(trim, wall="stucco", reveal="stucco", surrounds="none"), rng)
        face.add(trim.wall, boxes([[0.0, -0.02, 0.0]], [[width, 0.0, 0.62]], skip=("+y",), tile=BRICK_TILE))
        if len(levels) > 1:
            z = house.ground_floor - 0.35
            face.add(trim.wall, boxes([[0.0, -0.015, z]], [[width, 0.0, z + 0.85]], skip=("+y",), tile=BRICK_TILE))
        face.add(
            "stucco", moulding(width, top - 0.16, ((0.0, 0.0), (0.06, 0.04), (0.12, 0.12), (0.12, 0.18), (0.0, 0.2)))
        )
        bag.merge(face, _shifted(x0, y0, 0.0, turn))
    edge = 0.1
    a, b = x - 0.5 * front - out - edge, x + 0.5 * front + out + edge
    c, d, y = x - 0.5 * front - 0.5 * edge, x + 0.5 * front + 0.5 * edge, -out - edge
    peak, z = top + 0.75, top + 0.03
    bag.add(
        house.roof,
        fan([(a, 0.0, z), (c, y, z), (x - 0.3, 0.0, peak)], tile=ROOF_TILE),
        quads([[(c, y, z), (d, y, z), (x + 0.3, 0.0, peak), (x - 0.3, 0.0, peak)]], tile=ROOF_TILE),
        fan([(d, y, z), (b, 0.0, z), (x + 0.3, 0.0, peak)], tile=ROOF_TILE),
    )


def _porch(bag: Bag, x: float) -> None:
    """Add two slim columns and a small roof over the door."""
    for side in (-0.78, 0.78):
        bag.add("stucco", tubes([[[x + side, -0.62, 0.0], [x + side, -0.62, 2.75]]], np.full((1, 2), 0.08), 10))
        bag.add("stucco", boxes([[x + side - 0.12, -0.74, 0.0]], [[x + side + 0.12, -0.5, 0.22]]))
    bag.add("stucco", boxes([[x - 0.98, -0.82, 2.75]], [[x + 0.98, 0.0, 2.98]], skip=("+y",), tile=2.0))
    bag.add("zinc", quads([[(x - 1.0, -0.84, 2.98), (x + 1.0, -0.84, 2.98), (x + 1.0, 0.0, 3.2), (x - 1.0, 0.0, 3.2)]]))


def build_timber(placement: Placement) -> Bag:
    """Build a half-timbered house with jutting floors, dark posts, rails and braces, and a gable to the street."""
    rng = np.random.default_rng(placement.seed)
    base = _trim(rng)
    panel = str(rng.choice(["stucco", base.wall]))
    trim = replace(
        base, wall=panel, reveal="timber", surrounds="none", sashes=2, transom=0.0, depth=0.09, sill="timber"
    )
    house = _house(placement, min(placement.variant, 3), 3.1, 2.65, trim, _roof(rng), 54.0)
    bag = Bag()
    w, jut = house.width, 0.28
    depth = jut * (house.floors - 1)  # the gable's front is on the building line
    centres = _centres(house)
    ground = Bag()
    stone = replace(trim, wall="stone", reveal="stone", tile=STONE_TILE)
    openings = [
        Opening(x - 0.55, x + 0.55, 0.16, 2.3, "door") if k == house.door_bay
        else Opening(x - 0.6, x + 0.6, 0.95, 2.25, "window")
        for k, x in enumerate(centres)
    ]  # fmt: skip
    build_front(ground, w, house.ground_floor, openings, stone, rng)
    bag.merge(ground, _shifted(0.0, depth))
    for floor in range(1, house.floors):
        z, y = house.ground_floor + (floor - 1) * house.floor, depth - jut * floor
        storey = Bag()
        windows = [Opening(x - 0.5, x + 0.5, 0.85, 2.1, "window") for x in centres]
        build_front(storey, w, house.floor, windows, trim, rng)
        _frame(storey, w, house.floor, windows, rng)
        bag.merge(storey, _shifted(0.0, y, z))
        under = np.array([[(0, y + jut, z), (w, y + jut, z), (w, y, z), (0, y, z)]], np.float64)
        bag.add("timber", quads(under))
        x = np.arange(0.3, w, 0.62)  # ends of the joists
        low = np.stack([x - 0.08, np.full_like(x, y - 0.02), np.full_like(x, z - 0.17)], -1)
        bag.add("timber", boxes(low, low + np.array([0.16, jut + 0.02, 0.17]), skip=("+y",)))
    eaves = house.ground_floor + (house.floors - 1) * house.floor
    _timber_gable(bag, house, eaves, rng)
    d = house.depth
    walls = [
        [(0, d, 0), (0, depth, 0), (0, depth, eaves), (0, d, eaves)],
        [(w, depth, 0), (w, d, 0), (w, d, eaves), (w, depth, eaves)],
        [(0, depth, house.ground_floor), (0, 0, house.ground_floor), (0, 0, eaves), (0, depth, eaves)],
        [(w, 0, house.ground_floor), (w, depth, house.ground_floor), (w, depth, eaves), (w, 0, eaves)],
        [(w, d, 0), (0, d, 0), (0, d, eaves), (w, d, eaves)],
    ]
    bag.add("render-side", quads(np.array(walls, np.float64), tile=RENDER_TILE))
    return bag


def _beams(bag: Bag, ends: Sequence[tuple[float, float, float, float]], wide: float = 0.16) -> None:
    """Add timbers on a front between points (x0, z0, x1, z1), 3 cm proud of it."""
    a = np.array([(x0, z0) for x0, z0, _, _ in ends])
    b = np.array([(x1, z1) for _, _, x1, z1 in ends])
    along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], -1) * 0.5 * wide

    def at(points: Floats, y: float) -> Floats:
        return np.stack([points[:, 0], np.full(len(points), y), points[:, 1]], -1)

    near, far = -0.03, 0.0
    corners = (a - across, b - across, b + across, a + across)
    faces = [np.stack([at(corner, near) for corner in corners], 1)]
    for p, q in zip(corners, (*corners[1:], corners[0]), strict=True):
        faces.append(np.stack([at(q, near), at(p, near), at(p, far), at(q, far)], 1))
    bag.add("timber", quads(np.concatenate(faces)))


def _frame(bag: Bag, width: float, height: float, windows: Sequence[Opening], rng: np.random.Generator) -> None:
    """Add sills, plates, posts beside each window, a rail below it, and braces in the panels without windows."""
    low, high = windows[0].z0, windows[0].z1
    beams = [(0.0, 0.09, width, 0.09), (0.0, height - 0.09, width, height - 0.09)]
    posts = sorted({0.08, width - 0.08, *(o.x0 - 0.08 for o in windows), *(o.x1 + 0.08 for o in windows)})
    beams += [(x, 0.1, x, height - 0.1) for x in posts]
    beams += [(o.x0, z, o.x1, z) for o in windows for z in (low - 0.08, high + 0.08)]
    for left, right in pairwise(posts):
        if right - left < 0.5:
            continue
        middle = 0.5 * (left + right)
        if any(o.x0 < middle < o.x1 for o in windows):
            beams.append((left, 0.15, right, low - 0.12) if rng.random() < 0.5 else (left, low - 0.12, right, 0.15))
            continue
        beams.append((left, 0.5 * height, right, 0.5 * height))
        lean = [(left, 0.15, right, 0.5 * height), (left, 0.5 * height, right, height - 0.15)]
        beams += lean if rng.random() < 0.5 else [(a, d, c, b) for a, b, c, d in lean]
    _beams(bag, beams)


def _timber_gable(bag: Bag, house: House, z: float, rng: np.random.Generator) -> None:
    w, d = house.width, house.depth
    middle, rise = 0.5 * w, 0.5 * w * float(np.tan(np.radians(house.pitch)))
    over, out = 0.35, 0.4
    drop = over * rise / middle
    bag.add(house.trim.wall, fan([(0, 0.0, z), (w, 0.0, z), (middle, 0.0, z + rise)], tile=house.trim.tile))
    slopes = [
        [(-over, -out, z - drop), (middle, -out, z + rise), (middle, d, z + rise), (-over, d, z - drop)],
        [(middle, -out, z + rise), (w + over, -out, z - drop), (w + over, d, z - drop), (middle, d, z + rise)],
    ]
    thick = np.array([0.0, 0.0, 0.14])
    bag.add(house.roof, quads(np.array(slopes) + thick, tile=ROOF_TILE))
    bag.add("timber", quads(np.array(slopes)[:, ::-1]))
    barge = [
        [slopes[0][0], slopes[0][1], np.add(slopes[0][1], thick), np.add(slopes[0][0], thick)],
        [slopes[1][0], slopes[1][1], np.add(slopes[1][1], thick), np.add(slopes[1][0], thick)],
    ]
    bag.add("timber", quads(barge))
    bag.add(house.trim.wall, fan([(w, d, z), (0, d, z), (middle, d, z + rise)], tile=house.trim.tile))
    beams = [(0.1, z + 0.09, w - 0.1, z + 0.09)]
    for level in (0.36, 0.68):
        half = middle * (1.0 - level)
        beams.append((middle - half, z + level * rise, middle + half, z + level * rise))
    steps = np.arange(-2, 3) * w / 6.0
    for step in steps:
        top = z + rise * (1.0 - abs(step) / middle) - 0.1
        beams.append((middle + step, z + 0.1, middle + step, min(top, z + 0.68 * rise)))
    beams += [
        (middle - 2 * w / 6, z + 0.15, middle - w / 6, z + 0.36 * rise),
        (middle + 2 * w / 6, z + 0.15, middle + w / 6, z + 0.36 * rise),
    ]
    beams += [(0.06, z + 0.05, middle, z + rise - 0.05), (w - 0.06, z + 0.05, middle, z + rise - 0.05)]
    _beams(bag, beams)
    for x, level in ((middle - w / 12, 0.08), (middle + w / 12, 0.08), (middle - w / 12, 0.42)):
        attic = Bag()
        trim = replace(house.trim, wall="timber", reveal="timber", depth=0.03, tile=2.0)
        build_front(attic, 0.96, 1.2, [Opening(0.08, 0.88, 0.08, 1.12, "french")], trim, rng)
        bag.merge(attic, _shifted(x - 0.48, -0.06, z + level * rise + 0.15))


def build_modern(placement: Placement) -> Bag:
    """Build a flat-roofed block of flats: wide dark-framed windows, long balconies, a set-back top floor, and shops below."""
    rng = np.random.default_rng(placement.seed)
    base = _trim(rng)
    wall = str(rng.choice([base.wall, "stucco", "brick-buff", "concrete"]))
    trim = replace(
        base, wall=wall, reveal=wall, frame="frame-dark", sill="zinc", surrounds="none", sashes=2, transom=0.0, depth=0.2,
        tile=BRICK_TILE if wall.startswith("brick") else RENDER_TILE,
    )  # fmt: skip
    house = _house(placement, placement.variant, 3.4, 2.95, trim, "zinc", 0.0)
    w, d = house.width, house.depth
    bag = Bag()
    door = _centres(house)[house.door_bay]
    openings = [Opening(door - 0.7, door + 0.7, 0.1, 2.75, "door")]
    for x0, x1 in ((0.4, door - 1.1), (door + 1.1, w - 0.4)):
        if x1 - x0 > 1.4:
            openings.append(Opening(x0, x1, 0.1, 2.75, "shop"))
    columns = max(int(w // 3.4), 2)
    middles = (np.arange(columns) + 0.5) * w / columns
    half = 0.5 * w / columns - 0.55
    first = int(rng.integers(2))
    for floor in range(1, house.floors):
        z = house.ground_floor + (floor - 1) * house.floor
        for k, x in enumerate(middles):
            balcony = (k + first) % 2 == 0
            openings.append(Opening(x - half, x + half, z + (0.08 if balcony else 0.75), z + 2.45, "french"))
    top = house.ground_floor + (house.floors - 1) * house.floor
    build_front(bag, w, top + 0.5, openings, trim, rng)
    solid = rng.random() < 0.4
    for floor in range(1, house.floors):
        z = house.ground_floor + (floor - 1) * house.floor
        for k, x in enumerate(middles):
            if (k + first) % 2 == 0:
                _long_balcony(bag, x - half - 0.3, x + half + 0.3, z, solid=solid, rng=rng)
    walls = [
        [(0, d, 0), (0, 0, 0), (0, 0, top + 0.5), (0, d, top + 0.5)],
        [(w, 0, 0), (w, d, 0), (w, d, top + 0.5), (w, 0, top + 0.5)],
        [(w, d, 0), (0, d, 0), (0, d, top + 0.5), (w, d, top + 0.5)],
    ]
    bag.add(wall if wall.startswith("brick") else "render-side", quads(np.array(walls, np.float64), tile=trim.tile))
    bag.add("concrete", quads([[(0, 0, top + 0.1), (w, 0, top + 0.1), (w, d, top + 0.1), (0, d, top + 0.1)]], tile=2.0))
    bag.add(
        "zinc",
        boxes(
            [[-0.02, -0.06, top + 0.5], [-0.02, d - 0.2, top + 0.5]],
            [[w + 0.02, 0.24, top + 0.58], [w + 0.02, d, top + 0.58]],
        ),
    )
    bag.add("frame-dark", boxes([[0.3, -1.1, 2.95]], [[w - 0.3, 0.0, 3.12]], skip=("+y",)))
    _penthouse(bag, house, top + 0.1, rng)
    add_drainpipes(bag, house)
    return bag


def _long_balcony(bag: Bag, x0: float, x1: float, z: float, *, solid: bool, rng: np.random.Generator) -> None:
    deep, top = 1.25, z + 1.05
    bag.add("concrete", boxes([[x0, -deep, z - 0.16]], [[x1, 0.02, z + 0.05]], skip=("+y",), tile=2.0))
    if solid:
        bag.add("frame-dark", boxes([[x0, -deep - 0.03, z - 0.05], [x0, -deep, z - 0.05], [x1 - 0.03, -deep, z - 0.05]],
                                    [[x1, -deep, top], [x0 + 0.03, 0.0, top], [x1, 0.0, top]]))  # fmt: skip
    else:
        low, high = railing(x0 + 0.03, x1 - 0.03, -deep + 0.03, z + 0.05, 1.0)
        bag.add("steel", boxes(low, high, skip=("-z", "+z")))
    if rng.random() < 0.6:  # plants and a table
        left = float(rng.uniform(x0 + 0.2, x1 - 1.2))
        bag.add(
            "hedge", boxes([[left, -deep + 0.1, z + 0.35]], [[left + 0.9, -deep + 0.35, z + 0.8 + 0.3 * rng.random()]])
        )
        bag.add("planter", boxes([[left - 0.05, -deep + 0.08, z + 0.05]], [[left + 0.95, -deep + 0.38, z + 0.38]]))


def _penthouse(bag: Bag, house: House, z: float, rng: np.random.Generator) -> None:
    """Add the top floor, set back 2 m behind a terrace with a railing."""
    w, d, back = house.width, house.depth, 2.0
    top = Bag()
    inner = w - 1.6
    count = max(int(inner // 2.6), 1)
    x = (np.arange(count) + 0.5) * inner / count
    openings = [Opening(float(c) - 0.95, float(c) + 0.95, 0.1, 2.4, "french") for c in x]
    build_front(top, inner, 2.8, openings, replace(house.trim, wall="frame-dark", reveal="frame-dark"), rng)
    bag.merge(top, _shifted(0.8, back, z))
    bag.add("frame-dark", boxes([[0.8, back + 0.001, z]], [[w - 0.8, d - 0.8, z + 2.8]], skip=("-y", "-z")))
    bag.add("zinc", boxes([[0.4, back - 0.7, z + 2.8]], [[w - 0.4, d - 0.5, z + 3.0]]))
    low, high = railing(0.1, w - 0.1, 0.1, z + 0.4, 0.65, sides=False)
    bag.add("steel", boxes(low, high, skip=("-z", "+z")))
    bag.add("zinc", tubes([[[w * 0.3, d * 0.5, z + 3.0], [w * 0.3, d * 0.5, z + 4.1]]], np.full((1, 2), 0.14), 8))


#: Kind of placement to builder.
BUILDERS: dict[str, Callable[[Placement], Bag]] = {
    "mansard": build_mansard,
    "bay": build_bay,
    "timber": build_timber,
    "modern": build_modern,
}
