"""Textures of knitwear, T-shirts, coats, skirts and carried things (see `textures` for the layout)."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from urban_street.human.textures import (
    SLEEVE_START,
    TRUNK_SHARE,
    Colour,
    TextureCanvas,
    grid,
    line,
    noise,
    seam,
    trunk_grid,
    weave,
)

#: Texels per side of textures without a pattern.
_SMALL: Final = 64

Pattern = Literal["plain", "stripes", "checks", "dots", "pleats", "block", "border"]


def plain(colour: Colour, seed: int) -> TextureCanvas:
    """Paint one colour with little wear."""
    canvas = TextureCanvas.plain(colour, _SMALL)
    canvas.shade(1.0 + 0.02 * noise(np.random.default_rng(seed), (1.0, 1.0), _SMALL))
    return canvas


def tee(colour: Colour, other: Colour, seed: int, pattern: Pattern = "plain") -> TextureCanvas:
    """Paint a T-shirt or jersey, ribbed at neck and cuffs: plain, striped across, or with a band around the chest."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    u, v, trunk, height = trunk_grid()
    if pattern == "stripes":
        canvas.paint(
            other, np.clip(6.0 * (np.sin(np.where(trunk, height * 12.0, v * 22.0) * 2.0 * np.pi) - 0.2), 0.0, 1.0)
        )
    elif pattern == "block":
        canvas.paint(other, 1.0 * (((height > 0.30) & (height < 0.55) & trunk) | ((v > 0.72) & (v < 0.84))))
    weave(canvas, random, contrast=0.03, relief=0.12)
    for place in (0.25, 0.75):
        seam(canvas, u - place, trunk, dark=0.12)
    seam(canvas, height - 0.97, trunk, dark=0.18, width=0.003)
    arm = (v - SLEEVE_START) / (1.0 - SLEEVE_START)
    seam(canvas, arm - 0.93, v > SLEEVE_START, dark=0.18, width=0.006)
    return canvas


def sweater(colour: Colour, seed: int, *, pocket: bool = False) -> TextureCanvas:
    """Paint knitwear with ribs at hem and cuffs; with ``pocket``, a hooded sweater with a pouch and cords."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    weave(canvas, random, contrast=0.05, relief=0.22)
    u, v, trunk, height = trunk_grid()
    ribs = np.sin(u * 2.0 * np.pi * 90.0)
    arm = (v - SLEEVE_START) / (1.0 - SLEEVE_START)
    edge = (trunk & (height > 0.92)) | ((v > SLEEVE_START) & (arm > 0.88))
    canvas.height += np.where(edge, 0.9 * ribs, 0.25 * np.sin(v * 2.0 * np.pi * 120.0))
    canvas.shade(np.where(edge, 0.93, 1.0))
    seam(canvas, height - 0.92, trunk, dark=0.15, width=0.003)
    if pocket:
        front = np.abs(u - 0.5)
        pouch = np.maximum(front / np.where(height < 0.70, 0.085, 0.125), np.abs(height - 0.75) / 0.145)
        seam(canvas, pouch - 1.0, trunk, dark=0.35, width=0.04)
        canvas.paint((225, 222, 215), 0.8 * line(front - 0.035, 0.004) * ((height > 0.06) & (height < 0.24)))
    return canvas


def coat(colour: Colour, button: Colour, seed: int, *, belt: bool = False) -> TextureCanvas:
    """Paint the upper part of a coat: lapels, two rows of buttons, pockets; `coat_skirt` continues it."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    weave(canvas, random, contrast=0.06, relief=0.2)
    u, v, trunk, height = trunk_grid()
    front = np.abs(u - 0.5)
    lapel = (front < 0.07 * (1.0 - height / 0.42)) & (height < 0.42) & trunk
    canvas.height += 1.8 * lapel
    canvas.shade(
        1.0 - 0.30 * line(front - 0.07 * np.clip(1.0 - height / 0.42, 0.0, 1.0), 0.006) * ((height < 0.42) & trunk)
    )
    seam(canvas, u - 0.53, trunk & (height > 0.40), dark=0.4, width=0.004)
    for place in (0.50, 0.66, 0.82):
        for side in (0.472, 0.528):
            distance = np.hypot(u - side, (v - place * TRUNK_SHARE) * 0.75)
            canvas.paint(button, 1.0 * (distance < 0.0075))
            canvas.height += 1.5 * (distance < 0.0075)
    if belt:
        band = trunk & (height > 0.90)
        canvas.shade(np.where(band, 0.82, 1.0))
        canvas.height += 1.5 * band
        canvas.paint((60, 48, 34), 0.9 * ((front < 0.022) & band))
    for place in (0.25, 0.75):
        seam(canvas, u - place, trunk)
    arm = (v - SLEEVE_START) / (1.0 - SLEEVE_START)
    seam(canvas, arm - 0.86, v > SLEEVE_START, dark=0.3, width=0.01)
    return canvas


def coat_skirt(colour: Colour, seed: int) -> TextureCanvas:
    """Paint the lower part of a coat, from the waist down: overlapping fronts, pockets, a vent."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    weave(canvas, random, contrast=0.06, relief=0.2)
    u, v = grid()
    seam(canvas, u - 0.53, dark=0.45, width=0.004)
    canvas.height += 1.6 * np.clip((0.53 - u) / 0.01, 0.0, 1.0) * (u > 0.40)
    seam(canvas, np.minimum(u, 1.0 - u), v > 0.45, dark=0.45)
    for side in (0.33, 0.67):
        box = np.maximum(np.abs(u - side) / 0.055, np.abs(v - 0.26) / 0.035)
        seam(canvas, box - 1.0, dark=0.35, width=0.06)
    seam(canvas, v - 0.96, dark=0.15, width=0.004)
    return canvas


def skirt(colour: Colour, other: Colour, seed: int, pattern: Pattern = "plain") -> TextureCanvas:
    """Paint a skirt or the lower part of a dress; u runs around, v from waist to hem."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    u, v = grid()
    if pattern == "dots":
        row = np.floor(v * 26.0)
        along = (u * 44.0 + 0.5 * (row % 2.0)) % 1.0 - 0.5
        canvas.paint(other, np.clip(6.0 * (0.24 - np.hypot(along, (v * 26.0) % 1.0 - 0.5)), 0.0, 1.0))
    elif pattern == "checks":
        lines = 0.5 * (np.sin(u * 2.0 * np.pi * 14.0) > 0.55) + 0.5 * (np.sin(v * 2.0 * np.pi * 9.0) > 0.55)
        canvas.paint(other, 0.85 * lines)
        canvas.paint((20, 20, 24), 0.5 * (np.abs(np.sin(u * np.pi * 14.0 + 0.6)) < 0.05))
    elif pattern == "pleats":
        fold = (u * 40.0) % 1.0
        canvas.shade(1.0 - 0.28 * np.clip(1.0 - fold / 0.25, 0.0, 1.0))
        canvas.height += 5.0 * fold
    elif pattern == "border":
        canvas.paint(other, 1.0 * ((v > 0.90) & (np.sin(v * 260.0) > -0.6)))
        petals = np.hypot((u * 26.0) % 1.0 - 0.5, (v * 12.0) % 1.0 - 0.5)
        canvas.paint(other, 0.8 * (petals < 0.12))
        canvas.height += 2.5 * np.sin(u * 2.0 * np.pi * 18.0) * (np.abs(u - 0.5) < 0.16)  # pleats in front
    weave(canvas, random, contrast=0.04, relief=0.14)
    seam(canvas, v - 0.03, dark=0.25, width=0.003)
    seam(canvas, v - 0.97, dark=0.2, width=0.003)
    return canvas


def blouse(colour: Colour, other: Colour, seed: int, pattern: Pattern = "plain") -> TextureCanvas:
    """Paint the upper part of a dress, in the skirt's pattern."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    u, v = grid()
    if pattern == "dots":
        rows = v * 52.0
        along = (u * 44.0 + 0.5 * (np.floor(rows) % 2.0)) % 1.0 - 0.5
        canvas.paint(other, np.clip(6.0 * (0.24 - np.hypot(along, rows % 1.0 - 0.5)), 0.0, 1.0))
    weave(canvas, random, contrast=0.04, relief=0.14)
    for place in (0.25, 0.75):
        seam(canvas, u - place, v < TRUNK_SHARE, dark=0.15)
    return canvas


def suit(colour: Colour, shirt: Colour, tie: Colour, seed: int) -> TextureCanvas:
    """Paint a jacket with lapels over a shirt and a tie, two buttons, a breast pocket and flaps."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    u, v, trunk, height = trunk_grid()
    front = np.abs(u - 0.5)
    opening = 0.062 * np.clip(1.0 - height / 0.46, 0.0, 1.0)
    inside = (front < opening) & trunk
    canvas.paint(shirt, 1.0 * inside)
    knot = 0.010 + 0.010 * np.clip(height / 0.46, 0.0, 1.0)
    canvas.paint(tie, 1.0 * (inside & (front < knot)))
    seam(canvas, front - knot, inside, dark=0.35, width=0.003)
    weave(canvas, random, contrast=0.04, relief=0.12)
    lapel = (front >= opening) & (front < opening + 0.045 * np.clip(1.0 - height / 0.50, 0.0, 1.0)) & trunk
    canvas.height += 2.0 * lapel
    seam(canvas, front - opening, trunk & (height < 0.47), dark=0.45, width=0.005)
    seam(canvas, front - opening - 0.045 * np.clip(1.0 - height / 0.50, 0.0, 1.0), trunk & (height < 0.5), dark=0.3)
    seam(canvas, u - 0.515, trunk & (height > 0.46), dark=0.45, width=0.004)
    for place in (0.50, 0.62):
        distance = np.hypot(u - 0.495, (v - place * TRUNK_SHARE) * 0.75)
        canvas.paint((22, 20, 20), 1.0 * (distance < 0.006))
    for side in (0.36, 0.64):
        box = np.maximum(np.abs(u - side) / 0.05, np.abs(height - 0.74) / 0.03)
        seam(canvas, box - 1.0, trunk, dark=0.35, width=0.06)
    canvas.paint(shirt, 0.9 * ((np.abs(u - 0.415) < 0.022) & (np.abs(height - 0.34) < 0.008)))
    for place in (0.25, 0.75):
        seam(canvas, u - place, trunk)
    arm = (v - SLEEVE_START) / (1.0 - SLEEVE_START)
    canvas.paint(shirt, 0.95 * ((v > SLEEVE_START) & (arm > 0.965)))
    return canvas


def vest(colour: Colour, band: Colour, seed: int) -> TextureCanvas:
    """Paint a high-visibility vest (EN ISO 20471): two bands around the trunk, one over each shoulder, a zip."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    weave(canvas, random, contrast=0.03, relief=0.10)
    u, v, trunk, height = trunk_grid()
    front = np.abs(u - 0.5)
    behind = np.minimum(u, 1.0 - u)
    for place in (0.60, 0.82):
        canvas.paint(band, 1.0 * (trunk & (np.abs(height - place) < 0.042)))
    braces = (np.abs(front - 0.085) < 0.017) | (np.abs(behind - 0.085) < 0.017)
    canvas.paint(band, 1.0 * (trunk & (height < 0.60) & braces))
    canvas.paint((60, 62, 64), 0.8 * line(front, 0.003) * trunk)
    canvas.shade(1.0 + 0.05 * np.sin(u * 2.0 * np.pi * 150.0) * np.sin(v * 2.0 * np.pi * 150.0))
    return canvas


def cardigan(colour: Colour, under: Colour, seed: int) -> TextureCanvas:
    """Paint an open-necked cardigan with buttons over a blouse or shirt, ribbed at hem and cuffs."""
    canvas = sweater(colour, seed)
    u, v, trunk, height = trunk_grid()
    front = np.abs(u - 0.5)
    opening = 0.048 * np.clip(1.0 - height / 0.36, 0.0, 1.0)
    canvas.paint(under, 1.0 * ((front < opening) & trunk))
    seam(canvas, front - opening, trunk & (height < 0.37), dark=0.35, width=0.005)
    canvas.height += 1.2 * ((np.abs(front - opening - 0.010) < 0.010) & trunk)
    seam(canvas, front - opening - 0.020, trunk, dark=0.2, width=0.003)
    for place in (0.42, 0.56, 0.70, 0.84):
        distance = np.hypot(u - 0.503, (v - place * TRUNK_SHARE) * 0.75)
        canvas.paint((214, 200, 176), 1.0 * (distance < 0.0065))
    return canvas


def denim_jacket(colour: Colour, thread: Colour, seed: int) -> TextureCanvas:
    """Paint a denim jacket: twill, yoke, breast pockets, two slanted seams, buttons and double stitches."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    weave(canvas, random, contrast=0.08, relief=0.14)
    u, v, trunk, height = trunk_grid()
    front = np.abs(u - 0.5)
    canvas.shade(1.0 + 0.05 * np.sin((u + v) * 2.0 * np.pi * 128.0))
    canvas.shade(1.0 + 0.22 * line(front - 0.11, 0.06) * line(height - 0.5, 0.3) * trunk)
    stitch = 0.55 * (np.sin((u + v) * 660.0) > -0.2)
    lines = [
        front - 0.020,
        np.where(front < 0.2, height - 0.30, 1.0),
        height - 0.93,
        front - 0.075 - 0.05 * (0.9 - height),
    ]
    for distance in lines:
        seam(canvas, distance, trunk, dark=0.35, width=0.004)
        canvas.paint(thread, stitch * line(distance - 0.010, 0.0026) * trunk)
    for side in (0.385, 0.615):
        box = np.maximum(np.abs(u - side) / 0.042, np.abs(height - 0.36) / 0.055)
        seam(canvas, box - 1.0, trunk, dark=0.35, width=0.05)
    for place in np.arange(0.12, 0.95, 0.16):
        canvas.paint((170, 150, 110), 1.0 * (np.hypot(u - 0.505, (v - place * TRUNK_SHARE) * 0.75) < 0.006))
    arm = (v - SLEEVE_START) / (1.0 - SLEEVE_START)
    seam(canvas, arm - 0.90, v > SLEEVE_START, dark=0.35, width=0.008)
    return canvas


def sports(colour: Colour, stripe: Colour, seed: int) -> TextureCanvas:
    """Paint sports trousers with a stripe down the outside of each leg."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    u, v = grid()
    canvas.paint(stripe, 1.0 * (np.abs(u - 0.5) < 0.028))
    weave(canvas, random, contrast=0.03, relief=0.08)
    seam(canvas, v - 0.05, dark=0.2, width=0.004)
    seam(canvas, np.minimum(u, 1.0 - u), dark=0.2)
    return canvas


def sari(blouse_colour: Colour, cloth: Colour, border: Colour, seed: int) -> TextureCanvas:
    """Paint a short blouse under the end of a sari, which runs from the right hip over the left shoulder and down the back."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(blouse_colour)
    u, _, trunk, height = trunk_grid()
    # u grows to the right: in front, the upper edge rises from the right hip (u 0.75) to the left shoulder (u 0.40).
    edge = np.interp(
        u, [0.0, 0.12, 0.25, 0.32, 0.42, 0.56, 0.75, 0.86, 1.0], [0.30, 0.0, 0.0, 0.0, 0.06, 0.36, 0.86, 0.80, 0.30]
    )
    draped = trunk & (height > edge)
    canvas.paint(cloth, 1.0 * draped)
    canvas.height += 2.2 * np.sin((height - edge) * 2.0 * np.pi * 9.0) * draped
    canvas.paint(border, 1.0 * (draped & (height < edge + 0.075)))
    weave(canvas, random, contrast=0.04, relief=0.12)
    seam(canvas, height - edge, trunk & (edge > 0.0), dark=0.4, width=0.006)
    return canvas


def scarf(colour: Colour, seed: int) -> TextureCanvas:
    """Paint soft cloth wound around the head: folds that run askew."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    u, v = grid()
    winding = np.sin(2.0 * np.pi * (7.0 * v + 2.2 * np.abs(u - 0.5) + 0.15 * noise(random, (30.0, 30.0))))
    canvas.height += 3.0 * winding
    canvas.shade(1.0 + 0.07 * winding)
    weave(canvas, random, contrast=0.04, relief=0.10)
    return canvas


def knit(colour: Colour, other: Colour, seed: int) -> TextureCanvas:
    """Paint a knitted cap: ribs from the crown, a turned-up edge in another colour."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    u, v = grid()
    canvas.paint(other, np.clip((v - 0.62) * 60.0, 0.0, 1.0))
    canvas.height += 1.3 * np.sin(u * 2.0 * np.pi * 56.0)
    canvas.shade(1.0 + 0.10 * np.sin(u * 2.0 * np.pi * 56.0) + 0.04 * noise(random, (1.0, 1.0)))
    return canvas


def felt(colour: Colour, band: Colour, seed: int) -> TextureCanvas:
    """Paint a hat or peaked cap: panels, and a band where the brim begins."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour)
    weave(canvas, random, contrast=0.05, relief=0.1)
    u, v = grid()
    for panel in range(6):
        seam(canvas, np.abs(u - (panel + 0.5) / 6.0), v < 0.7, dark=0.2)
    canvas.paint(band, 1.0 * ((v > 0.64) & (v < 0.78)))
    return canvas


def bag(colour: Colour, seed: int) -> TextureCanvas:
    """Paint leather or nylon with seams and a zip."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour, 256)
    canvas.shade(1.0 + 0.05 * noise(random, (2.0, 2.0), 256))
    canvas.height += 0.3 * noise(random, (1.2, 1.2), 256)
    _, v = grid(256)
    seam(canvas, v - 0.30, dark=0.4, width=0.01)
    canvas.paint((150, 148, 140), 0.7 * line(v - 0.30, 0.005))
    seam(canvas, v - 0.72, dark=0.3, width=0.01)
    return canvas


def paper(colour: Colour, seed: int) -> TextureCanvas:
    """Paint a paper bag with a coloured field on its side."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour, 128)
    canvas.shade(1.0 + 0.04 * noise(random, (2.0, 2.0), 128))
    canvas.height += 1.2 * noise(random, (8.0, 3.0), 128)
    u, v = grid(128)
    canvas.paint((156, 38, 34), 0.9 * (np.hypot(u - 0.5, v - 0.45) < 0.22))
    return canvas


def cardboard(colour: Colour, seed: int) -> TextureCanvas:
    """Paint the side of a cardboard box: tape along the middle, and a printed sign."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour, 256)
    canvas.shade(1.0 + 0.03 * noise(random, (0.6, 6.0), 256))
    u, v = grid(256)
    canvas.paint((196, 162, 112), 0.8 * (np.abs(v - 0.5) < 0.06))
    seam(canvas, v - 0.5, dark=0.25, width=0.004)
    canvas.paint(
        (60, 44, 34), 0.8 * ((np.abs(u - 0.78) < 0.10) & (np.abs(v - 0.76) < 0.07) & (np.sin(u * 160.0) > -0.3))
    )
    return canvas


def canopy(colour: Colour, seed: int) -> TextureCanvas:
    """Paint an umbrella's cloth: eight panels with seams along the ribs, and a hem."""
    random = np.random.default_rng(seed)
    canvas = TextureCanvas.plain(colour, 256)
    canvas.shade(1.0 + 0.03 * noise(random, (1.0, 1.0), 256))
    u, v = grid(256)
    rib = np.abs((u * 8.0 + 0.5) % 1.0 - 0.5)
    canvas.shade(1.0 - 0.35 * line(rib, 0.02))
    canvas.shade(1.0 - 0.25 * line(v - 0.97, 0.015))
    return canvas
