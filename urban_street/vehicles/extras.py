"""What only some cars have on their bodies: boxes and signs on the roof, wings, steps, a spare wheel, strips of chrome."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from urban_street.solids.rounded import bar, pillow, renormalled, rod, rounded_outline, turned
from urban_street.solids.surfaces import Bag, boxes, lathe, sheet
from urban_street.vehicles.shell import Shell, roof_place


def _bars(bag: Bag, shell: Shell, places: tuple[float, ...], *, above: float = 0.06) -> float:
    """Add bars across the roof, and return the height of their upper edge, metres."""
    half = shell.design.rail[0] - 0.06
    top = max(float(roof_place(shell, 0.0, y)[2]) for y in places) + above
    for y in places:
        bag.add("vehicle-satin", rod([(-half, y, top - 0.012), (half, y, top - 0.012)], 0.012, 8, caps=True))
        feet = [roof_place(shell, x, y) for x in (-half, half)]
        bag.add(
            "vehicle-plastic",
            *(rod([(*foot[:2], foot[2] - 0.01), (foot[0], y, top - 0.012)], 0.016, 6) for foot in feet),
        )
    return top


def _middle(shell: Shell) -> tuple[float, float]:
    """Return the y of the middle of the roof, and half of its length, metres."""
    d = shell.design
    return 0.5 * (d.roof_front + d.roof_rear), 0.5 * (d.roof_front - d.roof_rear)


def _roof_box(bag: Bag, shell: Shell) -> None:
    y, half = _middle(shell)
    top = _bars(bag, shell, (y - 0.42, y + 0.36))
    shape = pillow((0.36, min(0.96, half), 0.165), squareness=0.42, sides=28, levels=13)
    points = shape.positions
    points[:, 2] *= 1.0 - 0.45 * np.clip(points[:, 1] / half, 0.0, 1.0) ** 2  # lower in front
    bag.add("vehicle-black-gloss", shape.moved(turned(0, 0.0, (0.16, y, top + 0.14))))
    bag.add("vehicle-plastic", pillow((0.366, min(0.97, half), 0.014), squareness=0.42, sides=28, levels=3).moved(
        turned(0, 0.0, (0.16, y, top + 0.135))))  # fmt: skip


def _roof_rack(bag: Bag, shell: Shell) -> None:
    y, half = _middle(shell)
    reach, wide = 0.72 * half, shell.design.rail[0] - 0.10
    top = _bars(bag, shell, tuple(np.linspace(y - reach, y + reach, 4).tolist()), above=0.075)
    corners = [(-wide, y - reach), (wide, y - reach), (wide, y + reach), (-wide, y + reach), (-wide, y - reach)]
    for z in (top, top + 0.08):
        bag.add("vehicle-plastic", rod([(a, b, z) for a, b in corners], 0.014, 6))
    posts = [
        rod([(a, b, top), (a, b, top + 0.08)], 0.011, 5)
        for a in (-wide, wide)
        for b in np.linspace(y - reach, y + reach, 6)
    ]
    bag.add("vehicle-plastic", *posts)
    slats = np.linspace(-wide + 0.12, wide - 0.12, 6)
    bag.add(
        "vehicle-plastic",
        boxes([[a - 0.03, y - reach, top - 0.006] for a in slats], [[a + 0.03, y + reach, top + 0.006] for a in slats]),
    )


def _light_bar(bag: Bag, shell: Shell) -> None:
    d = shell.design
    y = d.roof_front - 0.34
    z = float(roof_place(shell, 0.0, y)[2])
    half = d.rail[0] - 0.12
    bag.add("vehicle-plastic", boxes([[-half, y - 0.13, z - 0.02]], [[half, y + 0.13, z + 0.035]]))
    for x in (-0.5 * half - 0.10, 0.5 * half + 0.10):
        bag.add("vehicle-beacon", pillow((0.5 * half - 0.11, 0.125, 0.05), squareness=0.35, sides=20, levels=7).moved(
            turned(0, 0.0, (x, y, z + 0.085))))  # fmt: skip
    bag.add("vehicle-white", boxes([[-0.19, y - 0.10, z + 0.03]], [[0.19, y + 0.10, z + 0.11]]))


def _taxi_sign(bag: Bag, shell: Shell) -> None:
    y = shell.design.roof_front - 0.36
    z = float(roof_place(shell, 0.0, y)[2])
    bag.add("vehicle-plastic", boxes([[-0.24, y - 0.09, z - 0.02]], [[0.24, y + 0.09, z + 0.02]]))
    outline = np.array([(-0.075, 0.0), (0.075, 0.0), (0.045, 0.13), (-0.045, 0.13)]) + [y, z + 0.02]
    bag.add("vehicle-yellow", bar(outline, -0.22, 0.22))
    for side in (-1.0, 1.0):
        word = [(x, y + side * 0.063, z + 0.085) for x in (-0.14, 0.14)]
        bag.add("vehicle-gap", rod(word, 0.020, 4, caps=True))


def _beacon(bag: Bag, shell: Shell) -> None:
    y = shell.design.roof_front - 0.40
    z = float(roof_place(shell, 0.0, y)[2])
    profile = [(0.070, -0.02), (0.070, 0.02), (0.058, 0.03), (0.054, 0.11), (0.030, 0.135), (0.0, 0.14)]
    bag.add("vehicle-amber", lathe(profile, 20).moved(turned(2, 0.0, (0.0, y, z))))


def _spoiler(bag: Bag, shell: Shell) -> None:
    """Add an edge that prolongs the roof above the rear window."""
    places = np.linspace(-0.80, 0.80, 17)
    edge = shell.roof_edge(np.abs(places)) * np.column_stack([np.sign(places), np.ones(17), np.ones(17)])
    profile = np.array(
        [(0.16, -0.035), (0.16, -0.002), (0.0, 0.006), (-0.14, 0.004), (-0.15, -0.006), (-0.12, -0.018), (0.02, -0.045)]
    )
    taper = 1.0 - 0.45 * np.abs(places / 0.80) ** 3
    points = edge[:, None] + np.concatenate([np.zeros((17, 7, 1)), profile[None] * taper[:, None, None]], axis=2)
    bag.add("paint", renormalled(sheet(np.swapaxes(points, 0, 1), closed=True)))


def _wing(bag: Bag, shell: Shell) -> None:
    d = shell.design
    y = -0.5 * d.length + 0.36
    z = float(np.interp(y, *np.array(d.belt).T)) + 0.15
    half = 0.5 * d.width - 0.24
    outline = np.array([(0.17, -0.012), (0.15, 0.006), (-0.15, 0.030), (-0.17, 0.028), (-0.02, -0.008)])
    bag.add("vehicle-black-gloss", bar(outline + [y, z], -half, half))
    for side in (-1.0, 1.0):
        x = side * (half - 0.26)
        bag.add("vehicle-black-gloss", rod([(x, y - 0.02, z - 0.24), (x, y, z)], 0.018, 6))
        low, high = sorted((side * half, side * (half + 0.014)))
        bag.add("vehicle-black-gloss", boxes([[low, y - 0.18, z - 0.05]], [[high, y + 0.18, z + 0.06]]))


def _spare_wheel(bag: Bag, shell: Shell) -> None:
    d = shell.design
    radius = 0.94 * d.tyre
    at = shell.ring.points(np.array([[0.0, float(shell.height_of(6.3))]]))[0]
    cover = [(0.0, 0.20), (0.62 * radius, 0.20), (0.90 * radius, 0.185), (radius, 0.13), (radius, 0.0), (0.0, -0.02)][
        ::-1
    ]
    turn = turned(0, 90.0, (0.10, at[1], at[2] - 0.06))
    bag.add("vehicle-tyre", lathe(cover[1:3], 28).moved(turn))
    bag.add("vehicle-plastic", lathe(cover[3:], 28).moved(turn))
    bag.add("vehicle-plastic", lathe([cover[2], cover[3]], 28).moved(turn))


def _bull_bar(bag: Bag, shell: Shell) -> None:
    """Add a bumper with a winch and a bar before the grille."""
    d = shell.design
    y = 0.5 * d.length + 0.09
    low = float(np.interp(y, *np.array(d.sill).T))
    half = 0.5 * d.width - 0.22
    bumper = bar(rounded_outline(0.085, 0.10, 0.03) + [y, low + 0.10], -half, half)
    bag.add("vehicle-plastic", bumper)
    hoop = [(-0.42, y, low + 0.18), (-0.40, y + 0.01, low + 0.56), (0.40, y + 0.01, low + 0.56), (0.42, y, low + 0.18)]
    bag.add("vehicle-plastic", rod(hoop, 0.026, 10))
    for x in (-0.62, 0.62):
        bag.add("vehicle-lamp-clear", pillow((0.055, 0.02, 0.055), squareness=0.9, sides=14, levels=5).moved(
            turned(0, 0.0, (x, y + 0.07, low + 0.11))))  # fmt: skip


def _steps(bag: Bag, shell: Shell) -> None:
    d = shell.design
    z = float(np.interp(0.0, *np.array(d.sill).T)) - 0.02
    for side in (-1.0, 1.0):
        x = side * (0.5 * d.width - 0.10)
        line = [(x, d.rear_axle + d.arch + 0.10, z), (x, d.front_axle - d.arch - 0.10, z)]
        bag.add("vehicle-satin", rod(line, 0.042, 10, caps=True))


def _chrome_bumpers(bag: Bag, shell: Shell) -> None:
    """Add a chrome bar before nose and tail, with over-riders, and a strip along the bonnet."""
    for front in (True, False):
        t = np.linspace(0.0, 0.62 * shell.design.width, 17)
        along = shell.outline.length - t if front else t
        plan, normal = shell.outline.at(along)
        z = float(np.interp((1 if front else -1) * 0.5 * shell.design.length, *np.array(shell.design.sill).T)) + 0.09
        right = np.column_stack([plan + 0.035 * normal, np.full(len(t), z)])
        line = np.concatenate([(right * [-1.0, 1.0, 1.0])[:0:-1], right])
        bag.add("vehicle-chrome", *(rod(line + [0.0, 0.0, up], 0.030, 10, caps=True) for up in (-0.022, 0.022)))
        for x in (-0.30, 0.30):
            y = float(np.interp(abs(x), right[:, 0], right[:, 1]))
            bag.add(
                "vehicle-chrome",
                pillow((0.030, 0.045, 0.085), squareness=0.8, sides=14, levels=9).moved(turned(0, 0.0, (x, y, z))),
            )


#: Adds an extra to the body.
EXTRAS: Final[dict[str, Callable[[Bag, Shell], None]]] = {
    "roof-box": _roof_box,
    "roof-rack": _roof_rack,
    "roof-beacon": _beacon,
    "light-bar": _light_bar,
    "taxi-sign": _taxi_sign,
    "spoiler": _spoiler,
    "wing": _wing,
    "spare-wheel": _spare_wheel,
    "bull-bar": _bull_bar,
    "steps": _steps,
    "chrome-bumpers": _chrome_bumpers,
}
