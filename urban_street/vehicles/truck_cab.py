"""The inside of a truck's cab: seats on springs, dashboard, steering wheel, tunnel, bunk."""

from __future__ import annotations

from typing import Final

import numpy as np

from urban_street.solids.rounded import bar, pillow, rod, rounded_outline, torus, turned
from urban_street.solids.surfaces import Bag, boxes
from urban_street.vehicles.interior import add_seat

#: Half of the inner width, height of the floor, x of the driver, metres.
_HALF: Final = 0.98
_FLOOR: Final = 1.00
_DRIVER: Final = -0.55


def equip_cab(body: Bag) -> None:
    """Add everything that one sees through the windows; the driver would sit on the left."""
    body.add("vehicle-interior", boxes([[-_HALF, 2.08, _FLOOR - 0.02]], [[_HALF, 3.5, _FLOOR]]))
    body.add(
        "vehicle-trim", boxes([[-_HALF, 2.06, _FLOOR], [-_HALF, 2.06, 2.24]], [[_HALF, 2.10, 2.25], [_HALF, 3.0, 2.27]])
    )
    _dashboard(body)
    _steering_wheel(body)
    for x in (_DRIVER, -_DRIVER):
        add_seat(body, x, 2.66, _FLOOR + 0.20)
        body.add("vehicle-interior", boxes([[x - 0.16, 2.46, _FLOOR]], [[x + 0.16, 2.84, _FLOOR + 0.16]]))
        for arm in (-0.27, 0.27):
            body.add(
                "vehicle-interior",
                pillow((0.03, 0.16, 0.025), sides=10, levels=5).moved(turned(0, 4.0, (x + arm, 2.60, _FLOOR + 0.56))),
            )
    # the tunnel over the engine with the gear lever, and the bunk behind the seats
    body.add("vehicle-interior", bar(rounded_outline(0.42, 0.14, 0.08) + [2.86, _FLOOR + 0.12], -0.20, 0.20))
    lever = [(0.12, 3.02, _FLOOR + 0.24), (0.10, 2.94, _FLOOR + 0.52)]
    body.add(
        "vehicle-interior",
        rod(lever, 0.012, 6),
        pillow((0.03, 0.03, 0.045), sides=10, levels=5).moved(turned(0, 12.0, lever[1])),
    )
    body.add(
        "vehicle-fabric",
        pillow((_HALF - 0.04, 0.16, 0.07), squareness=0.25, sides=16, levels=5).moved(
            turned(0, 0.0, (0.0, 2.26, 1.62))
        ),
    )
    body.add(
        "vehicle-seat",
        boxes([[x - 0.05, 2.08, 1.30] for x in (-0.90, 0.90)], [[x + 0.05, 2.16, 2.20] for x in (-0.90, 0.90)]),
    )
    # sun visors, rear-view camera's screen, papers behind the windscreen
    for x in (-0.50, 0.50):
        body.add(
            "vehicle-trim",
            boxes([[-0.34, -0.008, -0.09]], [[0.34, 0.008, 0.09]]).moved(turned(0, -28.0, (x, 3.14, 2.10))),
        )
    body.add("vehicle-white", boxes([[0.38, 3.34, 1.405]], [[0.62, 3.50, 1.41]]))
    body.add(
        "vehicle-high-visibility",
        pillow((0.22, 0.03, 0.26), squareness=0.5, sides=14, levels=7).moved(turned(0, 18.0, (-_DRIVER, 2.25, 1.66))),
    )


def _dashboard(body: Bag) -> None:
    top = bar(rounded_outline(0.20, 0.15, 0.10, steps=5) + [3.32, 1.25], -_HALF, _HALF)
    body.add("vehicle-interior", top, boxes([[-_HALF, 3.30, _FLOOR]], [[_HALF, 3.46, 1.20]]))
    # the part towards the driver: binnacle, instruments, screen, vents
    body.add(
        "vehicle-interior",
        pillow((0.30, 0.13, 0.11), squareness=0.5, sides=18, levels=7).moved(turned(0, 0.0, (_DRIVER, 3.22, 1.38))),
    )
    body.add("vehicle-interior", boxes([[-0.24, 3.06, 1.10]], [[0.20, 3.20, 1.40]]))
    body.add(
        "vehicle-black-gloss",
        boxes([[-0.13, -0.014, -0.08]], [[0.13, 0.0, 0.08]]).moved(turned(0, 14.0, (-0.02, 3.06, 1.33))),
    )
    dials = [turned(0, 76.0, (_DRIVER + x, 3.085, 1.40)) for x in (-0.11, 0.11)]
    body.add("vehicle-chrome", *(torus(0.062, 0.007, 18, 6).moved(dial) for dial in dials))
    vents = [(x, 3.115, 1.30) for x in (-0.93, 0.40, 0.70, 0.93)]
    body.add(
        "vehicle-gap",
        boxes([np.subtract(v, [0.05, 0.004, 0.03]) for v in vents], [np.add(v, [0.05, 0.02, 0.03]) for v in vents]),
    )


def _steering_wheel(body: Bag) -> None:
    at = turned(0, 42.0, (_DRIVER, 2.99, 1.40))
    spokes = [
        rod([(0.0, 0.0, -0.03), (0.20 * np.cos(a), 0.20 * np.sin(a), 0.0)], 0.018, 6) for a in (0.0, np.pi, 1.5 * np.pi)
    ]
    rim = torus(0.225, 0.017, 28, 8)
    hub = pillow((0.075, 0.065, 0.035), sides=14, levels=5)
    body.add("vehicle-interior", *(piece.moved(at) for piece in (rim, hub, *spokes)))
    body.add("vehicle-interior", rod([tuple(at[:3, 3]), (_DRIVER, 3.24, 1.10)], 0.05, 8))
