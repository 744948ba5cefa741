"""Details on a car's skin: mirrors, handles, plates, wipers, arch liners, exhaust, aerial, rails."""

from __future__ import annotations

import numpy as np

from urban_street.solids.rounded import pillow, rod, turned
from urban_street.solids.surfaces import Bag, Floats, Surface, boxes, fan, merge, quads, sheet, unit
from urban_street.vehicles.panels import Half
from urban_street.vehicles.shell import HOUSE, Shell, roof_place
from urban_street.vehicles.windows import BODY, FRONT_DOOR, REAR_DOOR

PLATES = 8


def add_side_details(half: Half, shell: Shell) -> None:
    """Add mirror and handles of the right side, and arch liners."""
    d = shell.design
    _mirror(half.parts[FRONT_DOOR], shell)
    handles = ((FRONT_DOOR, d.doors[1] + 0.16), (REAR_DOOR, d.doors[2] + 0.10))
    for part, y in handles[:1] if d.two_doors else handles:
        _handle(half.parts[part], shell, y)
    for axle in (d.front_axle,) if d.back == "box" else (d.rear_axle, d.front_axle):
        _liner(half.parts[BODY], shell, axle)
    _seam(half.parts[BODY], shell)
    if d.roof_rails:
        q = shell.house_place(
            np.linspace(float(shell.house_side(d.rear_base + 0.25)), float(shell.house_side(d.pillar_base - 0.75)), 10)
        )
        line = shell.roof_edge(q) + np.array([-0.035, 0.0, 0.045])
        line[[0, -1], 2] -= 0.045
        line[[1, -2], 2] -= 0.008
        half.parts[BODY].add("vehicle-satin", rod(line, 0.014, 8))


def _mirror(bag: Bag, shell: Shell) -> None:
    d = shell.design
    y = d.pillar_base - 0.20
    a = shell.house_side(y)
    foot = shell.house.points(np.array([[float(a), 0.10 * HOUSE]]))[0]
    centre = foot + np.array([0.145, -0.02, 0.060])
    shape = pillow((0.105, 0.062, 0.070), squareness=0.55, sides=16, levels=7)
    # wider outside, with the back (towards the driver) cut flat
    points = shape.positions * (1.0 + 0.12 * shape.positions[:, :1] / 0.105)
    points[:, 1] = np.maximum(points[:, 1], -0.034)
    case = Surface(points, shape.normals, shape.uvs, shape.faces).moved(turned(2, 8.0, centre))
    lower = case.positions[case.faces].mean(axis=1)[:, 2] < centre[2] - 0.032
    bag.add("paint", case.selected(~lower))
    bag.add("vehicle-plastic", case.selected(lower))
    size = (0.088, 0.004, 0.054)
    glass = pillow(size, squareness=0.4, sides=12, levels=3) if d.early else convex_mirror(size)
    bag.add("vehicle-mirror", glass.moved(turned(2, 8.0, centre + [0.005, -0.036, 0.0])))
    arm = pillow((0.07, 0.03, 0.022), squareness=0.6, sides=12, levels=5).moved(
        turned(1, -22.0, foot + np.array([0.05, 0.0, 0.012]))
    )
    bag.add("vehicle-plastic", arm)
    blinker = pillow((0.05, 0.010, 0.008), sides=10, levels=3).moved(turned(2, -12.0, centre + [0.035, 0.050, 0.0]))
    bag.add("vehicle-amber", blinker)


def convex_mirror(half: tuple[float, float, float]) -> Surface:
    """Build the glass of an outside mirror around the origin, facing −y; it is bent as UN Regulation 46 demands (1.2 m)."""
    glass = pillow(half, squareness=0.4, sides=16, levels=5)
    across, _, up = glass.positions.T / 1.2
    bent = unit(np.column_stack([across, np.full(len(up), -1.0), up]))
    face = glass.normals[:, 1] < -0.3
    return Surface(glass.positions, np.where(face[:, None], bent, glass.normals), glass.uvs, glass.faces)


def _handle(bag: Bag, shell: Shell, y: float) -> None:
    ring = shell.ring
    z = float(np.interp(y, *np.array(shell.design.belt).T)) - 0.115
    place = shell.side([(y, z), (y + 0.001, z)])[:1]
    at, normal = ring.points(place)[0], ring.normals(place)[0]
    grip = pillow((0.016, 0.105, 0.016), squareness=0.55, sides=10, levels=5)
    bow = grip.positions.copy()
    bow[:, 0] += 0.016 * np.cos(np.pi * bow[:, 1] / 0.24)
    lean = turned(1, -float(np.degrees(np.arcsin(np.clip(normal[2], -1.0, 1.0)))), at + normal * 0.006)
    bag.add("paint", Surface(bow, grip.normals, grip.uvs, grip.faces).moved(lean))
    if not shell.fine:
        return
    cup = pillow((0.004, 0.075, 0.030), squareness=0.8, sides=12, levels=3).moved(lean)
    bag.add("vehicle-gap", cup)


def _liner(bag: Bag, shell: Shell, axle: float) -> None:
    """Add the inside of a wheel arch: a half barrel open to the outside, and a wall behind the wheel."""
    d = shell.design
    inner = 0.5 * d.width - 0.34
    line = shell.arch(axle)
    keep = line[:, 1] > np.interp(line[:, 0], *np.array(d.sill).T) + 0.004
    line = line[keep][::2]
    t = shell.outline.at_y(line[:, 0])
    rim = shell.ring.points(np.column_stack([t, shell.rail_at(t, line[:, 1])]))
    deep = rim.copy()
    deep[:, 0] = inner
    lip = rim - np.array([0.022, 0.0, 0.0])
    bag.add("vehicle-plastic", sheet(np.stack([rim, lip], 1)))
    bag.add("vehicle-gap", sheet(np.stack([lip, deep], 1)))
    foot = np.array([[inner, line[-1, 0], line[-1, 1] - 0.03], [inner, line[0, 0], line[0, 1] - 0.03]])
    wall = np.concatenate([deep, foot])
    bag.add("vehicle-gap", fan(wall))


def _seam(bag: Bag, shell: Shell) -> None:
    """Add a dark strip between windows and doors."""
    d = shell.design
    a0, a1 = shell.house_side([d.posts[0][0] if d.panel_van else d.rear_base + 0.10, d.pillar_base - 0.02])
    a = np.linspace(float(a0), float(a1), 14)
    foot = shell.house.points(np.column_stack([a, np.full_like(a, 0.035 * HOUSE)]))
    bag.add("vehicle-black-gloss", rod(foot + np.array([0.004, 0.0, 0.0]), 0.011, 5))


def add_details(bag: Bag, shell: Shell) -> None:
    """Add the details that a car has only once."""
    d = shell.design
    for front in (True, False) if d.back != "box" else (True,):
        _plate(bag, shell, front=front)
    _underbody(bag, shell)
    if not shell.fine:
        return
    _wipers(bag, shell)
    if d.bars[0]:
        _exhaust(bag, shell)
    if d.fin:
        _shark_fin(bag, shell)
    # badges
    for front, rail in ((True, 6.35), (False, 6.6 if d.hatch else 6.2))[: 1 if d.back == "box" else 2]:
        t = shell.outline.length if front else 0.0
        place = np.array([[t, float(shell.height_of(rail))]])
        at, normal = shell.ring.points(place)[0], shell.ring.normals(place)[0]
        tilt = float(np.degrees(np.arcsin(np.clip(normal[2], -1.0, 1.0)))) * (1.0 if front else -1.0)
        bag.add(
            "vehicle-chrome",
            pillow((0.045, 0.006, 0.045), squareness=1.0, sides=18, levels=5).moved(
                turned(0, tilt, at + normal * 0.002)
            ),
        )


def _exhaust(bag: Bag, shell: Shell) -> None:
    """Add a pipe on the left, seen from behind."""
    sill = float(shell.ring.points(np.array([[0.0, 0.0]]))[0, 2])
    y = -0.5 * shell.design.length
    pipe = rod([(-0.48, y + 0.30, sill + 0.02), (-0.48, y + 0.055, sill + 0.02)], 0.032, 12)
    bag.add("vehicle-chrome", pipe)
    bag.add("vehicle-gap", rod([(-0.48, y + 0.058, sill + 0.02), (-0.48, y + 0.056, sill + 0.02)], [0.028, 0.0001], 12))


def _shark_fin(bag: Bag, shell: Shell) -> None:
    d = shell.design
    fin = pillow((0.018, 0.07, 0.045), squareness=0.9, sides=12, levels=7)
    shape = fin.positions.copy()
    shape[:, 1] -= 0.8 * np.maximum(shape[:, 2], 0.0)
    place = np.array([0.0, d.roof_rear + 0.30, d.height - 0.028])
    if not d.early:
        place = roof_place(shell, 0.0, float(place[1])) - [0.0, 0.0, 0.014]
    bag.add("paint", Surface(shape, fin.normals, fin.uvs, fin.faces).moved(turned(0, 0.0, place)))


def _plate(bag: Bag, shell: Shell, *, front: bool) -> None:
    t = shell.outline.length if front else 0.0
    rail = shell.design.plate[0 if front else 1]
    place = np.array([[t, float(shell.height_of(rail))]])
    at, normal = shell.ring.points(place)[0], shell.ring.normals(place)[0]
    bag.merge(number_plate(), facing(at + normal * 0.012, front=front))


def facing(at: Floats, *, front: bool) -> Floats:
    """Return the (4, 4) transform of an object that faces −y to a place, where it faces backwards, or forwards (``front``)."""
    return turned(2, 180.0 if front else 0.0, at)


def number_plate() -> Bag:
    """Build a plate of 52 × 11 cm around the origin, facing −y, with the first of the `PLATES` numbers."""
    bag = Bag()
    v0, v1 = 0.0, 1.0 / PLATES
    # In front of its holder by more than a step of distant depths, which are of 24 bits.
    y = -0.012
    corners = [[(-0.26, y, -0.055), (0.26, y, -0.055), (0.26, y, 0.055), (-0.26, y, 0.055)]]
    bag.add("vehicle-plate", quads(corners, [[(0.0, v1), (1.0, v1), (1.0, v0), (0.0, v0)]]))
    bag.add("vehicle-plastic", boxes([[-0.267, -0.005, -0.062]], [[0.267, 0.02, 0.062]], skip=("+y",)))
    return bag


def _wipers(bag: Bag, shell: Shell) -> None:
    """Add two wipers at rest along the windscreen's lower edge."""
    house = shell.house
    length = shell.house_length

    def on_glass(x: float, h: float) -> Floats:
        """Return a point near the glass at distance ``x`` from the middle and height ``h``."""
        a = length - abs(x)
        point = house.points(np.array([[a, h * HOUSE]]))[0] + house.normals(np.array([[a, h * HOUSE]]))[0] * 0.018
        return np.asarray(point * [np.sign(x) if x else 1.0, 1.0, 1.0])

    for pivot, tip in ((0.10, -0.50), (-0.52 + 1.12, 0.02)):
        places = np.linspace(pivot, tip, 9)
        blade = np.array([on_glass(float(x), 0.07 + 0.05 * k / 8) for k, x in enumerate(places)])
        bag.add("vehicle-plastic", rod(blade, 0.009, 5))
        foot = on_glass(pivot, -0.02)
        bag.add("vehicle-plastic", rod([foot, blade[2] + [0.0, 0.0, 0.012], blade[4]], 0.008, 5))


def _underbody(bag: Bag, shell: Shell) -> None:
    """Add a dark floor slightly above the sill."""
    start = float(shell.outline.at_y(shell.design.box[1])) if shell.design.back == "box" else 0.0
    t = np.linspace(start, shell.outline.length, 40)
    right = shell.ring.points(np.column_stack([t, np.zeros_like(t)]))
    inner = 0.5 * shell.design.width - 0.36
    for axle in (shell.design.rear_axle, shell.design.front_axle):
        near = np.abs(right[:, 1] - axle) < shell.design.arch + 0.03
        right[near, 0] = np.minimum(right[near, 0], inner)
    right[:, 2] += 0.015
    strip = np.stack([right, right * [-1.0, 1.0, 1.0]], 1)
    down = sheet(strip)
    flipped = Surface(down.positions, -down.normals, down.uvs, down.faces[:, ::-1])
    bag.add("vehicle-gap", down, flipped)
    # Engine, tank and axles close the view from side to side.
    d, low = shell.design, float(right[:, 2].min())
    end = 0.5 * d.length - 0.30
    core = [
        boxes([[-inner, max(axle - 0.4, -end), low]], [[inner, min(axle + 0.4, end), d.tyre + d.arch - 0.02]])
        for axle in ((d.front_axle,) if d.back == "box" else (d.rear_axle, d.front_axle))
    ]
    bag.add("vehicle-gap", merge(core))
