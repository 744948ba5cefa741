"""Street furniture: shelter, benches, bins, bicycle stands, advertising, railings, tree pits.

Each builder places its object at the origin. Fronts face −y, and long things run along x.
"""

from __future__ import annotations

import numpy as np

from urban_street.solids.surfaces import Bag, boxes, fan, lathe, quads, repeat, tubes
from urban_street.street.plan import Placement


def bench() -> Bag:
    """Build a bench of 1.8 m with wooden slats on two cast frames, its back to +y."""
    bag = Bag()
    x0, x1 = -0.9, 0.9
    seat = np.array([(-0.20 + 0.11 * k, 0.44 + 0.008 * k) for k in range(4)])
    low = np.stack([np.full(4, x0), seat[:, 0], seat[:, 1]], -1)
    bag.add("slats", boxes(low, low + np.array([x1 - x0, 0.09, 0.035])))
    back = np.array([(0.25 + 0.05 * k, 0.56 + 0.13 * k) for k in range(3)])
    low = np.stack([np.full(3, x0), back[:, 0], back[:, 1]], -1)
    bag.add("slats", boxes(low, low + np.array([x1 - x0, 0.035, 0.10])))
    for x in (-0.68, 0.68):
        frame = [
            [[x, -0.2, 0.0], [x, -0.18, 0.43], [x, 0.22, 0.45]],
            [[x, 0.34, 0.0], [x, 0.24, 0.45], [x, 0.38, 0.92]],
            [[x, -0.18, 0.43], [x, -0.16, 0.64], [x, 0.26, 0.66]],
        ]
        bag.add("iron", tubes(frame, np.full((3, 3), 0.024), 7))
    return bag


def litter_bin() -> Bag:
    """Build a litter bin: a steel drum on a post, with a dark slot and a lid."""
    bag = Bag()
    bag.add("iron", lathe([(0.03, 0.0), (0.03, 0.42)], 8))
    bag.add("cabinet", lathe([(0.0, 0.40), (0.19, 0.40), (0.22, 0.46), (0.22, 0.86)], 18))
    bag.add("iron", lathe([(0.205, 0.86), (0.205, 0.98)], 18))
    bag.add("cabinet", lathe([(0.23, 0.98), (0.235, 1.02), (0.16, 1.07), (0.0, 1.09)], 18))
    posts = boxes([[-0.02, -0.225, 0.86]], [[0.02, -0.2, 0.98]])
    bag.add(
        "cabinet", posts, boxes([[0.2, -0.02, 0.86], [-0.225, -0.02, 0.86]], [[0.225, 0.02, 0.98], [-0.2, 0.02, 0.98]])
    )
    return bag


def bicycle_stand() -> Bag:
    """Build three hoops, 0.9 m apart along x."""
    bag = Bag()
    angle = np.linspace(np.pi, 0.0, 9)
    arc = np.stack([0 * angle, 0.35 * np.cos(angle), 0.55 + 0.25 * np.sin(angle)], -1)
    hoop = np.concatenate([[[0.0, -0.35, 0.0]], arc, [[0.0, 0.35, 0.0]]])
    hoops = np.stack([hoop + np.array([x, 0.0, 0.0]) for x in (-0.9, 0.0, 0.9)])
    bag.add("steel", tubes(hoops, np.full(hoops.shape[:2], 0.024), 9))
    return bag


def cabinet(placement: Placement) -> Bag:
    """Build a telephone or electricity cabinet, with doors, vents and a sticker."""
    rng = np.random.default_rng(placement.seed)
    bag = Bag()
    half, deep, high = float(rng.choice([0.38, 0.6])), 0.16, float(rng.uniform(1.0, 1.3))
    bag.add("concrete", boxes([[-half - 0.03, -deep - 0.02, 0.0]], [[half + 0.03, deep + 0.02, 0.1]], skip=("-z",)))
    bag.add("cabinet", boxes([[-half, -deep, 0.1]], [[half, deep, high]], skip=("-z", "+z")))
    bag.add("cabinet", boxes([[-half - 0.03, -deep - 0.04, high]], [[half + 0.03, deep + 0.03, high + 0.05]]))
    seams = np.linspace(-half, half, 3 if half > 0.5 else 2)[1:-1]
    joints = [[x - 0.004, -deep - 0.002, 0.14] for x in (*seams, -half + 0.03, half - 0.03)]
    bag.add("iron", boxes(joints, np.array(joints) + np.array([0.008, 0.002, high - 0.2])))
    vents = np.array([(-half + 0.1, -deep - 0.004, high - 0.12 - 0.035 * k) for k in range(4)])
    bag.add("iron", boxes(vents, vents + np.array([2.0 * half - 0.2, 0.004, 0.012])))
    return bag


def shelter() -> Bag:
    """Build a bus shelter of 4 m: steel frame, glass at the back and one side, a bench, a lit poster and a flat roof."""
    bag = Bag()
    half, deep, high = 2.0, 1.3, 2.45
    posts = np.array(
        [(x, y, 0.0) for x in (-half, -0.66, 0.66, half) for y in (deep - 0.08,)]
        + [(-half, 0.1, 0.0), (half, 0.1, 0.0)]
    )
    bag.add("frame-dark", boxes(posts - np.array([0.035, 0.035, 0.0]), posts + np.array([0.035, 0.035, high])))
    bag.add("frame-dark", boxes([[-half - 0.15, -0.15, high]], [[half + 0.15, deep + 0.1, high + 0.09]]))
    bag.add(
        "lens",
        quads(
            [
                [
                    (-half, 0.9, high - 0.002),
                    (half, 0.9, high - 0.002),
                    (half, 0.6, high - 0.002),
                    (-half, 0.6, high - 0.002),
                ]
            ]
        ),
    )
    # Panes are open frames with a dotted band, since labelled glass would be opaque.
    for z in (0.12, 1.0, high - 0.12):
        bag.add("frame-dark", boxes([[-half, deep - 0.10, z]], [[half, deep - 0.06, z + 0.05]]))
        bag.add("frame-dark", boxes([[-half - 0.02, 0.1, z]], [[-half + 0.02, deep - 0.08, z + 0.05]]))
    bag.add("poster", boxes([[half - 0.06, 0.14, 0.45]], [[half + 0.06, deep - 0.12, 2.2]]))
    bag.add(
        "frame-dark",
        boxes(
            [[half - 0.07, 0.1, 0.35], [half - 0.07, 0.1, 2.2]],
            [[half + 0.07, deep - 0.08, 0.45], [half + 0.07, deep - 0.08, 2.3]],
        ),
    )
    bag.add(
        "poster",
        quads(
            [
                [
                    (-0.6, deep - 0.115, 1.08),
                    (0.6, deep - 0.115, 1.08),
                    (0.6, deep - 0.115, 1.95),
                    (-0.6, deep - 0.115, 1.95),
                ]
            ]
        ),
    )
    bag.add(
        "steel",
        quads([[(0.6, deep - 0.1, 1.08), (-0.6, deep - 0.1, 1.08), (-0.6, deep - 0.1, 1.95), (0.6, deep - 0.1, 1.95)]]),
    )
    seat = np.array([(-1.6, deep - 0.55 + 0.12 * k, 0.46) for k in range(3)])
    bag.add("slats", boxes(seat, seat + np.array([2.9, 0.1, 0.035])))
    bag.add(
        "frame-dark",
        boxes(
            [[-1.5, deep - 0.5, 0.0], [1.1, deep - 0.5, 0.0]], [[-1.42, deep - 0.25, 0.46], [1.18, deep - 0.25, 0.46]]
        ),
    )
    return bag


def stop_flag() -> Bag:
    """Build the plate of a bus stop on its post: green H in a yellow disc, timetable below."""
    bag = Bag()
    angle = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
    disc = np.stack([0.24 * np.cos(angle), np.full(24, -0.045), 2.6 + 0.24 * np.sin(angle)], -1)
    bag.add("stop-green", fan(disc))
    inner = np.stack([0.20 * np.cos(angle), np.full(24, -0.047), 2.6 + 0.20 * np.sin(angle)], -1)
    bag.add("stop-yellow", fan(inner))
    low = [[-0.10, -0.05, 2.48], [0.06, -0.05, 2.48], [-0.06, -0.05, 2.58]]
    bag.add("stop-green", boxes(low, [[-0.06, -0.048, 2.72], [0.10, -0.048, 2.72], [0.06, -0.048, 2.62]]))
    bag.add("steel", fan((disc + np.array([0.0, 0.02, 0.0]))[::-1]))
    bag.add("poster", boxes([[-0.17, -0.05, 1.25]], [[0.17, -0.035, 1.85]]))
    return bag


def advertising_column() -> Bag:
    """Build a Litfass column: a drum of posters on a plinth, below a cornice and a low dome."""
    bag = Bag()
    bag.add("concrete", lathe([(0.66, 0.0), (0.66, 0.32), (0.60, 0.38)], 28))
    bag.add("poster", lathe([(0.58, 0.38), (0.58, 2.55)], 28, tile=1.9))
    bag.add("cabinet", lathe([(0.58, 2.55), (0.68, 2.6), (0.70, 2.72), (0.60, 2.8), (0.42, 2.98), (0.0, 3.1)], 28))
    return bag


def guard_rail(placement: Placement) -> Bag:
    """Build a pedestrian railing along y; its size is (length,)."""
    length = placement.size[0]
    bag = Bag()
    count = max(round(length / 1.8), 1)
    y = np.linspace(0.0, length, count + 1)
    post = boxes([[-0.025, -0.025, 0.0]], [[0.025, 0.025, 1.05]], skip=("-z",))
    bag.add("steel", repeat(post, np.stack([0 * y, y, 0 * y], -1)))
    rails = [[[0.0, 0.0, z], [0.0, length, z]] for z in (0.18, 1.05)]
    bag.add("steel", tubes(rails, np.full((2, 2), 0.021), 8))
    bars = np.arange(0.12, length, 0.12)
    bar = boxes([[-0.006, -0.006, 0.18]], [[0.006, 0.006, 1.05]], skip=("-z", "+z"))
    bag.add("steel", repeat(bar, np.stack([0 * bars, bars, 0 * bars], -1)))
    return bag


def tree_pit() -> Bag:
    """Build a square of grass and soil around a trunk, framed by stones."""
    bag = Bag()
    half = 0.52
    bag.add(
        "turf",
        quads([[(-half, -half, 0.012), (half, -half, 0.012), (half, half, 0.012), (-half, half, 0.012)]], tile=2.0),
    )
    edge = half + 0.08
    bag.add("kerb", boxes(
        [[-edge, -edge, 0.0], [-edge, half, 0.0], [-edge, -half, 0.0], [half, -half, 0.0]],
        [[edge, -half, 0.03], [edge, edge, 0.03], [-half, half, 0.03], [edge, half, 0.03]], skip=("-z",), tile=2.0,
    ))  # fmt: skip
    return bag


def mast() -> Bag:
    """Build a signal mast with an arm of 3.6 m over the road (+x), 5.4 m up."""
    bag = Bag()
    bag.add("steel", lathe([(0.11, 0.0), (0.11, 1.2), (0.08, 1.26), (0.065, 5.6), (0.0, 5.62)], 12))
    arm = [[[0.0, 0.0, 5.3], [1.2, 0.0, 5.42], [3.6, 0.0, 5.45]]]
    bag.add("steel", tubes(arm, np.array([[0.05, 0.045, 0.035]]), 9))
    bag.add("steel", tubes([[[0.0, 0.0, 4.7], [0.9, 0.0, 5.38]]], np.full((1, 2), 0.02), 7))
    return bag
