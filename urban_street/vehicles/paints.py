"""Paints of vehicles: their looks and frequencies."""

from __future__ import annotations

from typing import Final

from valerie.scene.graph.paints import Paint

Color = tuple[float, float, float]


def gloss(metallic: float) -> float:
    """Return the roughness of lacquered paint."""
    return 0.20 + 0.06 * metallic


#: Linear reflectance, metallic, frequency.
_BOUGHT: Final[dict[str, tuple[Color, float, float]]] = {
    "white": ((0.74, 0.74, 0.73), 0.0, 3.0),
    "silver": ((0.45, 0.46, 0.47), 0.6, 2.4),
    "grey": ((0.155, 0.16, 0.165), 0.5, 3.0),
    "black": ((0.012, 0.012, 0.014), 0.2, 2.6),
    "blue": ((0.022, 0.060, 0.20), 0.35, 1.6),
    "navy": ((0.010, 0.022, 0.065), 0.3, 1.0),
    "red": ((0.34, 0.013, 0.012), 0.15, 1.4),
    "green": ((0.035, 0.075, 0.05), 0.3, 0.6),
    "sand": ((0.34, 0.29, 0.21), 0.45, 0.7),
    "petrol": ((0.04, 0.13, 0.16), 0.4, 0.6),
    "orange": ((0.50, 0.12, 0.015), 0.1, 0.3),
    "yellow": ((0.62, 0.42, 0.02), 0.0, 0.3),
}
#: The paints by name.
PAINTS: Final = {
    name: Paint(base_color=color, metallic=metallic, roughness=gloss(metallic))
    for name, (color, metallic, _) in _BOUGHT.items()
}
#: Relative frequencies of the paints, in the order of `PAINTS`.
FREQUENCIES: Final = tuple(frequency for _, _, frequency in _BOUGHT.values())

#: Solid colours under a clear coat that mirrors sharply, as on a polished car. Only later vehicles offer them.
LACQUERS: Final = {
    f"lacquer-{name}": Paint(base_color=color, metallic=0.0, roughness=0.05)
    for name, color in {
        "black": (0.006, 0.006, 0.007),
        "red": (0.30, 0.008, 0.010),
        "white": (0.72, 0.72, 0.71),
        "blue": (0.010, 0.035, 0.19),
        "green": (0.008, 0.055, 0.030),
        "grey": (0.085, 0.090, 0.095),
    }.items()
}
#: All paints by name.
ALL_PAINTS: Final = PAINTS | LACQUERS
