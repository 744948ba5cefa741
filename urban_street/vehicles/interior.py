"""The cabin behind a car's windows: dashboard, steering wheel, seats, floor."""

from __future__ import annotations

import numpy as np

from urban_street.solids.rounded import bar, pillow, rod, rounded_outline, torus, turned
from urban_street.solids.surfaces import Bag, boxes
from urban_street.vehicles.designs import CarDesign
from urban_street.vehicles.shell import HOUSE, Shell


def cabin_half(design: CarDesign) -> float:
    """Return half of the cabin's width, metres."""
    return 0.5 * design.width - 0.16


def add_interior(bag: Bag, shell: Shell) -> None:
    """Add the cabin, about 2,000 triangles. The driver sits on the left (x < 0)."""
    d, fine = shell.design, shell.fine
    half = cabin_half(d)
    belt = float(np.interp(0.2, *np.array(d.belt).T))
    floor = float(np.interp(0.0, *np.array(d.sill).T)) + 0.09
    front, rear = d.pillar_base - 0.05, d.rear_base + 0.12
    bag.add("vehicle-interior", boxes([[-half, rear, floor - 0.02]], [[half, front + 0.1, floor]]))
    dash = rounded_outline(0.24, 0.15, 0.11, steps=4)
    bag.add("vehicle-interior", bar(dash + [front - 0.06, belt - 0.115], -half, half))
    bag.add(
        "vehicle-interior",
        boxes(
            [[-half, front + 0.05, floor], [-0.16, front - 0.85, floor]],
            [[half, front + 0.2, belt - 0.03], [0.16, front - 0.1, floor + 0.32]],
        ),
    )
    screen = boxes([[-0.13, -0.012, -0.075]], [[0.13, 0.0, 0.075]]).moved(
        turned(0, 12.0, (0.02, front - 0.31, belt - 0.01))
    )
    bag.add("vehicle-black-gloss", screen)
    driver = -0.36
    seat_y, seat_z = d.posts[0][0] + 0.22, floor + 0.10
    if not d.early:  # head rests stay below the roof, 0.97 m above the seat's foot and 0.45 m behind
        seat_y = min(max(seat_y, d.roof_rear + 0.60), front - 0.72)
        seat_z = min(seat_z, d.height - 0.10 - 0.97)
    for x in (driver, -driver):
        add_seat(bag, x, seat_y, seat_z, fine=fine)
    wheel_at = (driver, front - 0.40, belt - 0.075)
    bag.add("vehicle-interior", torus(0.182, 0.015, 24, 7).moved(turned(0, 68.0, wheel_at)))
    bag.add(
        "vehicle-interior",
        pillow((0.075, 0.06, 0.03), sides=12 if fine else 8, levels=5 if fine else 3).moved(turned(0, 68.0, wheel_at)),
    )
    spokes = [
        rod([(0.0, 0.0, -0.01), (0.17 * np.cos(a), 0.17 * np.sin(a), 0.0)], 0.017, 6).moved(turned(0, 68.0, wheel_at))
        for a in (0.1, np.pi - 0.1, 1.5 * np.pi)
    ]
    bag.add("vehicle-interior", *spokes, rod([wheel_at, (driver, front - 0.05, belt - 0.24)], 0.035, 8))
    # rear bench and parcel shelf
    bench = d.rear_axle + 0.42 if d.rear_axle + 0.42 < seat_y - 0.8 else seat_y - 0.82
    if not d.early:
        # The head rests, 0.9 m above the floor and 0.5 m behind, stay before the rear window.
        share = (floor + 0.92 - belt) / (d.rail[1] - belt)
        bench = max(bench, d.glass_tail + (d.roof_rear - d.glass_tail) * share + 0.54)
    shelf = float(np.interp(rear, *np.array(d.belt).T)) - 0.06
    if bench < seat_y - 0.66 or d.early:
        _add_bench(bag, bench, floor, min(half, 0.62), fine=fine)
        bag.add("vehicle-interior", boxes([[-half, rear - 0.02, shelf - 0.02]], [[half, bench - 0.36, shelf]]))
    elif d.back != "open":
        bag.add("vehicle-interior", boxes([[-half, rear - 0.02, shelf - 0.02]], [[half, seat_y - 0.62, shelf]]))
    bag.add("vehicle-interior", boxes([[-half, rear - 0.05, floor]], [[half, rear - 0.02, shelf]]))
    # mirror in the middle of the windscreen
    y, z = 0.5 * (d.roof_front + d.cowl) * 0.45 + 0.55 * d.roof_front - 0.02, d.height - 0.19
    if not d.early:
        glass = shell.house.points(np.array([[shell.house_length, 0.80 * HOUSE]]))[0]
        y, z = float(glass[1]) - 0.07, float(glass[2])
    bag.add(
        "vehicle-interior",
        pillow((0.115, 0.018, 0.032), sides=12 if fine else 8, levels=5 if fine else 3).moved(
            turned(0, 0.0, (0.0, y, z))
        ),
    )


def _add_bench(bag: Bag, bench: float, floor: float, wide: float, *, fine: bool) -> None:
    """Add a rear bench with two head rests."""
    bag.add(
        "vehicle-fabric",
        pillow((wide, 0.27, 0.10), sides=12 if fine else 8, levels=5 if fine else 3).moved(
            turned(0, 0.0, (0.0, bench + 0.02, floor + 0.17))
        ),
    )
    bag.add(
        "vehicle-fabric",
        pillow((wide, 0.075, 0.32), sides=12 if fine else 8, levels=5 if fine else 3).moved(
            turned(0, 20.0, (0.0, bench - 0.29, floor + 0.46))
        ),
    )
    for x in (-0.36, 0.36):
        bag.add(
            "vehicle-fabric",
            pillow((0.125, 0.045, 0.075), sides=12 if fine else 8, levels=5 if fine else 3).moved(
                turned(0, 12.0, (x, bench - 0.43, floor + 0.84))
            ),
        )


def add_seat(bag: Bag, x: float, y: float, z: float, *, fine: bool = True) -> None:
    """Add a front seat that faces +y; (x, y, z) is below the middle of the cushion."""
    bag.add(
        "vehicle-fabric",
        pillow((0.255, 0.27, 0.085), sides=12 if fine else 8, levels=5 if fine else 3).moved(
            turned(0, 6.0, (x, y, z + 0.13))
        ),
    )
    bag.add(
        "vehicle-fabric",
        pillow((0.245, 0.075, 0.31), sides=12 if fine else 8, levels=5 if fine else 3).moved(
            turned(0, 18.0, (x, y - 0.30, z + 0.46))
        ),
    )
    bag.add(
        "vehicle-fabric",
        pillow((0.135, 0.05, 0.09), sides=10 if fine else 6, levels=5 if fine else 3).moved(
            turned(0, 12.0, (x, y - 0.41, z + 0.88))
        ),
    )
    posts = [rod([(x + s, y - 0.385, z + 0.72), (x + s, y - 0.405, z + 0.83)], 0.008, 5) for s in (-0.06, 0.06)]
    bag.add("vehicle-chrome", *posts)
    bag.add("vehicle-interior", boxes([[x - 0.2, y - 0.24, z - 0.1]], [[x + 0.2, y + 0.2, z + 0.06]]))
