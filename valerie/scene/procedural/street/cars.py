"""Parked cars: a lofted body with wheel arches, a glass house with pillars, wheels, lamps, plates, mirrors.

A car faces +y with its origin on the ground in the middle. The lower body is a ring around the car (plan outline: a
superellipse) swept from the sill to the belt line; bonnet and boot lie on its upper edge; the glass house is a second
ring from the belt to the roof, whose grid lines are the pillars.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from valerie.scene.procedural.street.car_shapes import CarShape
from valerie.scene.procedural.street.geometry import (
    Bag,
    Floats,
    Ints,
    Surface,
    boxes,
    ellipsoids,
    lathe,
    merge,
    quads,
    repeat,
    sheet,
)
from valerie.scene.procedural.street.noise import smoothstep

#: Heights between sill (0) and belt (1), and how wide and how far forward and back the body is there.
_LEVELS = np.array([0.0, 0.06, 0.16, 0.30, 0.45, 0.60, 0.72, 0.82, 0.90, 0.955, 0.985, 1.0])
_WIDTH = np.array([0.935, 0.965, 0.985, 0.996, 1.0, 0.998, 0.993, 0.986, 0.978, 0.962, 0.942, 0.915])
_FRONT = np.array([-0.10, -0.03, 0.0, 0.0, -0.01, -0.025, -0.05, -0.08, -0.12, -0.165, -0.205, -0.25])
_REAR = np.array([0.10, 0.04, 0.0, 0.0, 0.0, 0.01, 0.015, 0.02, 0.025, 0.035, 0.05, 0.075])
#: The plan outline (|x|/w)^q + (|y|/l)^p = 1.
_P, _Q = 7.0, 2.4
#: Where nose and tail are sampled, as fractions of the half width.
_FRACTIONS = np.array([0.0, 0.2, 0.4, 0.55, 0.7, 0.8, 0.88, 0.94, 0.975])


@dataclass(frozen=True, slots=True)
class CarPaint:
    """Materials of one car: everything else is common to all."""

    body: str
    plate: int
    wheel: int


def build_car(shape: CarShape, paint: CarPaint) -> Bag:
    """One car, about 4,000 triangles."""
    bag = Bag()
    _lower_body(bag, shape, paint.body)
    _glass_house(bag, shape, paint.body)
    _front_and_rear(bag, shape, paint)
    _wheels(bag, shape, paint)
    _small_parts(bag, shape, paint.body)
    return bag


def _paint_uvs(shape: CarShape, points: Floats) -> Floats:
    """Flank projection: u along the car, v down."""
    return np.stack([points[..., 1] / shape.texture_length + 0.5, 1.0 - points[..., 2] / shape.texture_height], -1)


def _stations(shape: CarShape) -> Floats:
    """(N,) positions along the car from rear to front in [−1, 1] of half its length: dense at ends and arches."""
    ends = (1.0 - _FRACTIONS**_Q) ** (1.0 / _P)
    half = 0.5 * shape.length
    arch = shape.arch
    steps = np.concatenate([[-1.001], -np.cos(np.linspace(0.0, np.pi, 10)), [1.001]]) * arch
    places = [shape.rear_axle + steps, shape.front_axle + steps]
    middle = np.linspace(shape.rear_axle + 1.15 * arch, shape.front_axle - 1.15 * arch, 6)
    rear_gap = np.linspace(-half * ends[-1], shape.rear_axle - 1.1 * arch, 3)[1:]
    front_gap = np.linspace(shape.front_axle + 1.1 * arch, half * ends[-1], 4)[:-1]
    inner = np.concatenate([*places, middle, rear_gap, front_gap]) / half
    inner = inner[np.abs(inner) < ends[-1]]
    return np.unique(np.concatenate([inner, ends, -ends]))


def _outline(shape: CarShape, station: Floats) -> Floats:
    """Half width in metres at the stations."""
    return np.asarray(0.5 * shape.width * (1.0 - np.minimum(np.abs(station), 1.0) ** _P) ** (1.0 / _Q))


def _point(shape: CarShape, station: Floats, half_width: Floats, level: Floats) -> Floats:
    """(…, 3) points of the lower body's right side; ``level`` in [0, 1] from sill to belt."""
    half = 0.5 * shape.length
    y = station * half
    bottom = shape.sill + 0.05 * smoothstep(0.86, 1.0, np.abs(station))
    for axle in (shape.rear_axle, shape.front_axle):
        inside = np.maximum(shape.arch**2 - (y - axle) ** 2, 0.0)
        bottom = np.where(inside > 0.0, np.maximum(bottom, shape.wheel + np.sqrt(inside)), bottom)
    top = shape.belt(y)
    z = bottom + (top - bottom) * level
    # Width and bulge follow the height itself, so that the arches do not bend the flanks.
    relative = np.clip((z - shape.sill) / (top - shape.sill), 0.0, 1.0)
    x = half_width * np.interp(relative, _LEVELS, _WIDTH)
    front, rear = smoothstep(0.55, 1.0, station), smoothstep(0.55, 1.0, -station)
    y = y + front * np.interp(relative, _LEVELS, _FRONT) * shape.nose + rear * np.interp(relative, _LEVELS, _REAR)
    return np.stack(np.broadcast_arrays(x, y, z), -1)


def _lower_body(bag: Bag, shape: CarShape, body: str) -> None:
    station = _stations(shape)
    outline = _outline(shape, station)
    right = _point(shape, station[:, None], outline[:, None], _LEVELS[None])
    left = right[::-1].copy()
    left[..., 0] *= -1.0
    ring = np.concatenate([right, left[1:-1]])
    uvs = _paint_uvs(shape, np.concatenate([ring, ring[:1]]))
    bag.add(body, sheet(ring, uvs, closed=True))
    # Bonnet, boot lid and what the glass house stands on: across between the two upper edges.
    edge = right[:, -1]
    across = np.array([-1.0, -0.93, -0.75, -0.4, 0.0, 0.4, 0.75, 0.93, 1.0])
    crown = shape.crown * (1.0 - across**2) * smoothstep(1.0, 0.8, np.abs(station))[:, None]
    deck = np.stack(
        np.broadcast_arrays(edge[:, None, 0] * across, edge[:, None, 1] + 0.0 * across, edge[:, None, 2] + crown), -1
    )
    bag.add(body, sheet(deck, _paint_uvs(shape, deck), flip=True))
    _inside_of_arches(bag, shape)


def _inside_of_arches(bag: Bag, shape: CarShape) -> None:
    """Dark floor, and liners that keep one from looking through the wheel arches."""
    half, width = 0.5 * shape.length, 0.5 * shape.width
    floor = boxes([[-width * 0.86, -half * 0.86, shape.sill + 0.01]], [[width * 0.86, half * 0.86, shape.sill + 0.04]])
    core = boxes([[-width + 0.3, -half * 0.9, shape.sill]], [[width - 0.3, half * 0.88, 0.72]])
    gap = [shape.rear_axle - shape.arch - 0.02, shape.rear_axle + shape.arch + 0.02,
           shape.front_axle - shape.arch - 0.02, shape.front_axle + shape.arch + 0.02]  # fmt: skip
    low, high = [], []
    for y in (gap[0], gap[1] - 0.03, gap[2], gap[3] - 0.03):
        reach = 0.93 * float(_outline(shape, np.array([y / half]))[0])
        low += [[-reach, y, shape.sill + 0.03], [width - 0.34, y, shape.sill + 0.03]]
        high += [[-width + 0.34, y + 0.03, 0.66], [reach, y + 0.03, 0.66]]
    roof = [[side, y, 0.66] for side in (-width + 0.06, width - 0.31) for y in (gap[0], gap[2])]
    roof_high = [[x + 0.25, y + 2.0 * shape.arch + 0.04, 0.69] for x, y, _ in roof]
    bag.add("car-underside", floor, core, boxes(low, high), boxes(roof, roof_high))


def _glass_house(bag: Bag, shape: CarShape, body: str) -> None:
    half_belt, half_roof = 0.5 * shape.width * shape.belt_width, 0.5 * shape.width * shape.roof_width
    fraction = np.array([0.0, 0.4, 0.75, 0.915])
    bow_base, bow_roof = 0.20, 0.08
    front = [
        (f * half_belt, shape.cowl - bow_base * f**2, f * half_roof, shape.roof_front - bow_roof * f**2)
        for f in fraction
    ]
    side_front, side_rear = (
        (shape.cowl - bow_base, shape.roof_front - bow_roof),
        (shape.tail + 0.07, shape.roof_rear + 0.05),
    )
    keys = [(half_belt, base, half_roof, top) for base, top in shape.side_keys(side_front, side_rear)]
    rear = [
        (f * half_belt, shape.tail + 0.07 * f**2, f * half_roof, shape.roof_rear + 0.05 * f**2) for f in fraction[::-1]
    ]
    half_ring = np.array([*front, *keys, *rear])
    heights = np.array([0.0, 0.075, 0.3, 0.55, 0.78, 0.925, 1.0])
    h = heights[None, :]
    # The body narrows towards its ends, and the glass house with it.
    narrowed = _outline(shape, half_ring[:, 1] / (0.5 * shape.length)) / (0.5 * shape.width)
    half_ring[:, 0] *= narrowed
    half_ring[:, 2] *= 0.5 + 0.5 * narrowed
    # It stands on the deck: the same crown, a little sunk in.
    fade = smoothstep(1.0, 0.8, np.abs(half_ring[:, 1]) / (0.5 * shape.length))
    crown = shape.crown * fade * np.maximum(1.0 - (half_ring[:, 0] / half_belt / narrowed) ** 2, 0.0)
    base_z = shape.belt(half_ring[:, 1]) + crown
    x = half_ring[:, :1] * (1 - h) + half_ring[:, 2:3] * h + 0.035 * np.sin(np.pi * h) * (half_ring[:, :1] / half_belt)
    y = half_ring[:, 1:2] * (1 - h) + half_ring[:, 3:4] * h
    top = shape.height - 0.075
    z = (base_z[:, None] - 0.03) * (1 - h) + top * h
    right = np.stack([x, y, z], -1)
    left = right[::-1].copy()
    left[..., 0] *= -1.0
    ring = np.concatenate([right, left[1:-1]])
    # Rows run from the front centre by the right side to the rear: clockwise from above, hence flipped.
    skin = sheet(ring, _paint_uvs(shape, np.concatenate([ring, ring[:1]])), closed=True, flip=True)
    names = ["front"] * 3 + ["pillar"] + [*shape.side_panes] + ["pillar"] + ["rear"] * 3
    segments = np.array(names + names[::-1])
    panes = np.array(["pillar", "pane", "pane", "pane", "pane", "pillar"])
    grid = _sheet_cells(ring, skin)
    see_through = np.isin(segments, shape.glazed)[grid[:, 0]] & (panes == "pane")[grid[:, 1]]
    trim = (segments == "trim")[grid[:, 0]] & (panes == "pane")[grid[:, 1]]
    bag.add("car-glass", skin.selected(see_through))
    bag.add("car-trim", skin.selected(trim))
    bag.add(body, skin.selected(~see_through & ~trim))
    _roof(bag, shape, right[:, -1], body)


def _sheet_cells(ring: Floats, surface: Surface) -> Ints:
    """(F, 2) row and column of the grid cell that each face of a closed sheet over ``ring`` belongs to."""
    columns = ring.shape[1]
    corner = surface.faces.min(axis=1)
    return np.stack([corner // columns, corner % columns], -1)


def _roof(bag: Bag, shape: CarShape, edge: Floats, body: str) -> None:
    """From the upper ring inwards, crowned."""
    across = np.array([-1.0, -0.97, -0.88, -0.6, 0.0, 0.6, 0.88, 0.97, 1.0])
    along = np.clip((edge[:, 1] - edge[-1, 1]) / (edge[0, 1] - edge[-1, 1]), 0.0, 1.0)
    rise = 0.075 * (4.0 * along * (1.0 - along)) ** 0.45
    z = edge[:, None, 2] + rise[:, None] * (1.0 - np.abs(across) ** 3.0)
    top = np.stack(np.broadcast_arrays(edge[:, None, 0] * across, edge[:, None, 1] + 0.0 * across, z), -1)
    bag.add(body, sheet(top, _paint_uvs(shape, top)))


def _patch(
    shape: CarShape, across: Sequence[float], levels: Sequence[float], *, front: bool, lift: float = 0.006,
    slant: float = 0.0, uv: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0),
) -> Surface:  # fmt: skip
    """A piece that lies on the nose or the tail.

    Args:
        shape: the car.
        across: from where to where sideways, as fractions of the half width (positive: the car's right).
        levels: from where to where between sill (0) and belt (1).
        front: nose or tail.
        lift: metres off the body.
        slant: how much the outer end is raised, in levels.
        uv: the texture's part (u0, v0, u1, v1), upright as seen from outside.
    """
    # The body's own grid lines, so that the patch is parallel to it.
    lines = np.concatenate([-_FRACTIONS, _FRACTIONS])
    f = np.array([across[0], *np.unique(lines[(lines > across[0]) & (lines < across[1])]), across[1]])[:, None]
    inner = _LEVELS[(levels[0] < _LEVELS) & (levels[1] > _LEVELS)]
    t = np.array([levels[0], *inner, levels[1]])[None]
    rise = (t - levels[0]) / (levels[1] - levels[0])
    share = (f - across[0]) / (across[1] - across[0])
    t = np.clip(t + slant * np.abs(f), 0.0, 1.0)
    station = (1.0 - np.minimum(np.abs(f), 0.999) ** _Q) ** (1.0 / _P) * (1.0 if front else -1.0)
    points = _point(shape, station, 0.5 * shape.width * np.abs(f), t)
    points[..., 0] *= np.sign(f + 1e-12)
    points[..., 1] += lift if front else -lift
    points[..., 0] += np.sign(f) * lift * np.abs(f) ** 3
    u = uv[0] + (uv[2] - uv[0]) * ((1.0 - share) if front else share)
    v = uv[3] + (uv[1] - uv[3]) * rise
    return sheet(points, np.stack(np.broadcast_arrays(u, v), -1), flip=front)


def _front_and_rear(bag: Bag, shape: CarShape, paint: CarPaint) -> None:
    wide = 0.26 / (0.5 * shape.width)
    plate = (0.0, 0.25 * paint.plate, 1.0, 0.25 * paint.plate + 0.25)
    look = shape.face
    bag.add("car-grille", _patch(shape, (-look.grille[0], look.grille[0]), look.grille[1:], front=True))
    bag.add("car-grille", _patch(shape, (-0.62, 0.62), (0.08, 0.25), front=True))
    bag.add("car-trim", _patch(shape, (-0.8, 0.8), (0.03, 0.17), front=False))
    bag.add("car-plate", _patch(shape, (-wide, wide), (0.27, 0.43), front=True, lift=0.014, uv=plate))
    low, high = look.rear_plate
    bag.add("car-plate", _patch(shape, (-wide, wide), (low, high), front=False, lift=0.014, uv=plate))
    # Shut lines: bumper and tailgate, bonnet.
    split = look.tail[2] - 0.10
    bag.add("car-trim", _patch(shape, (-0.93, 0.93), (split, split + 0.012), front=False, lift=0.004))
    bag.add(
        "car-trim", _patch(shape, (-0.88, 0.88), (look.lamp[2] - 0.05, look.lamp[2] - 0.038), front=True, lift=0.004)
    )
    bag.add("car-trim", _patch(shape, (-0.93, 0.93), (0.0, 0.13), front=True, lift=0.004))
    for side in (-1.0, 1.0):
        bag.add(
            "car-lamp",
            _patch(
                shape,
                _on_side(side, look.lamp[0], look.lamp[1]),
                look.lamp[2:4],
                front=True,
                slant=look.lamp[4],
                lift=0.008,
            ),
        )
        bag.add(
            "car-tail-lamp",
            _patch(
                shape,
                _on_side(side, look.tail[0], look.tail[1]),
                look.tail[2:4],
                front=False,
                slant=look.tail[4],
                lift=0.008,
            ),
        )
        _lamp_details(bag, shape, side)
        bag.add("car-reflector", _patch(shape, _on_side(side, 0.6, 0.8), (0.22, 0.26), front=False, lift=0.010))


def _on_side(side: float, inner: float, outer: float) -> tuple[float, float]:
    """From left to right: a stretch between two distances from the middle, on the side of the given sign."""
    return (inner, outer) if side > 0.0 else (-outer, -inner)


def _lamp_details(bag: Bag, shape: CarShape, side: float) -> None:
    """Clear stripe and dark bezel of a tail lamp; the dark housing and the reflector of a head lamp."""
    look = shape.face

    def between(start: float, stop: float, share: tuple[float, float]) -> tuple[float, float]:
        return _on_side(side, start + share[0] * (stop - start), start + share[1] * (stop - start))

    inner, outer, low, high, slant = look.tail
    third = (high - low) / 3.0
    stripe = between(inner, outer, (0.08, 0.62))
    bag.add(
        "car-lens",
        _patch(shape, stripe, (low + 1.15 * third, low + 1.75 * third), front=False, slant=slant, lift=0.011),
    )
    bag.add(
        "car-trim",
        _patch(shape, between(inner, outer, (-0.04, 1.0)), (low - 0.02, low), front=False, slant=slant, lift=0.010),
    )
    inner, outer, low, high, slant = look.lamp
    housing = between(inner, outer, (0.10, 0.82))
    middle = 0.5 * (low + high)
    bag.add("car-trim", _patch(shape, housing, (middle - 0.055, middle + 0.055), front=True, slant=slant, lift=0.011))
    bag.add(
        "car-lens",
        _patch(
            shape,
            between(inner, outer, (0.30, 0.58)),
            (middle - 0.04, middle + 0.04),
            front=True,
            slant=slant,
            lift=0.014,
        ),
    )


def _wheels(bag: Bag, shape: CarShape, paint: CarPaint) -> None:
    radius, wide = shape.wheel, 0.2
    rim = 0.66 * radius
    tyre = lathe(
        [(rim, 0.02), (radius - 0.03, 0.0), (radius, 0.04), (radius - 0.01, wide - 0.02), (rim, wide)], 18
    )  # fmt: skip
    angle = np.linspace(0.0, 2.0 * np.pi, 19)[:-1]
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], -1)
    cell = np.array([paint.wheel % 2, paint.wheel // 2]) * 0.5
    disc_uv = cell + 0.25 + 0.25 * np.stack([np.cos(angle), np.sin(angle)], -1)
    centre = np.concatenate([circle[:, :2] * rim, np.full((18, 1), 0.03)], -1)
    points = np.stack([centre, np.broadcast_to([0.0, 0.0, 0.035], centre.shape)], 1)
    uvs = np.stack([disc_uv, np.broadcast_to(cell + 0.25, disc_uv.shape)], 1)
    face = sheet(points, np.concatenate([uvs, uvs[:1]]), closed=True, flip=True)
    turn = {1.0: np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]]), -1.0: np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])}
    for side in (1.0, -1.0):
        matrix = np.eye(4)
        matrix[:3, :3] = turn[side]
        spots = [(side * (0.5 * shape.width - 0.015), y, radius) for y in (shape.rear_axle, shape.front_axle)]
        bag.add("car-tyre", repeat(tyre.moved(matrix), spots))
        bag.add("car-rim", repeat(face.moved(matrix), spots))


def _small_parts(bag: Bag, shape: CarShape, body: str) -> None:
    width = 0.5 * shape.width
    mirror_y = shape.cowl - 0.42
    mirror_z = float(shape.belt(np.array([mirror_y]))[0]) + 0.11
    spots = [(side * (width + 0.06), mirror_y, mirror_z) for side in (-1.0, 1.0)]
    bag.add(body, _plain(ellipsoids(spots, (0.11, 0.06, 0.075), 10)))
    stalks = np.array(
        [[-width - 0.05, mirror_y - 0.02, mirror_z - 0.07], [width - 0.09, mirror_y - 0.02, mirror_z - 0.07]]
    )
    bag.add("car-trim", boxes(stalks, stalks + np.array([0.14, 0.05, 0.03])))
    handles = [
        (side * (width - 0.012), y, float(shape.belt(np.array([y]))[0]) - 0.13)
        for side in (-1.0, 1.0)
        for y in shape.handles
    ]
    half = np.array([0.022, 0.09, 0.013])
    bag.add(body, _plain(boxes(np.array(handles) - half, np.array(handles) + half)))
    # Rubbing strips and window sills in black.
    y0, y1 = shape.tail + 0.35, shape.cowl - 0.3
    stations = np.linspace(y0, y1, 12)
    belt = shape.belt(stations)
    strips = []
    for side in (-1.0, 1.0):
        x = np.full_like(stations, side * width * (shape.belt_width + 0.012))
        lower, upper = np.stack([x + side * 0.016, stations, belt], -1), np.stack([x, stations, belt + 0.035], -1)
        pieces = np.stack([lower[:-1], lower[1:], upper[1:], upper[:-1]], 1)
        strips.append(quads(pieces if side > 0 else pieces[:, [1, 0, 3, 2]]))
    bag.add("car-trim", merge(strips))


def _plain(surface: Surface) -> Surface:
    """Textured from a spot of the flank without gaps or dirt."""
    return surface.textured(np.broadcast_to(np.array([0.5, 0.04]), surface.uvs.shape).copy())
