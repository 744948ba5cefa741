"""The bodies of cars in traffic besides those of the first street (`urban_street.vehicles.designs`)."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from urban_street.vehicles.designs import (
    EARLY_CARS,
    ESTATE,
    HATCHBACK,
    SEDAN,
    SUV,
    VAN,
    CarDesign,
    Line,
    Section,
)

_ROUND_NOSE: Final = ((0.0, 0.0), (0.36, 0.05), (0.62, 0.16), (0.82, 0.36), (0.94, 0.70), (0.98, 1.10))
_BLUNT_NOSE: Final = ((0.0, 0.0), (0.50, 0.02), (0.78, 0.06), (0.92, 0.16), (0.960, 0.40), (0.976, 0.90))
_BLUNT_TAIL: Final = ((0.0, 0.0), (0.55, 0.006), (0.86, 0.025), (0.955, 0.10), (0.980, 0.30), (0.988, 0.9))
_ROUND_TAIL: Final = ((0.0, 0.0), (0.44, 0.04), (0.70, 0.13), (0.87, 0.30), (0.955, 0.62), (1.0, 1.30))


def _upright(sections: dict[str, Section], share: float) -> dict[str, Section]:
    """Return sections whose flanks lean in above the shoulder by only a ``share`` as much."""
    return {
        name: tuple((inset if rail < 5 else share * inset, z) for rail, (inset, z) in enumerate(section))
        for name, section in sections.items()
    }


def _disc(place: float, share: float, radius: float, *, half: float, tall: float) -> Line:
    """Return the outline of a round lamp on the nose.

    Args:
        place: of its middle along the bow, in half widths.
        share: of the height from sill to belt at the nose.
        radius: metres.
        half, tall: half width, and height from sill to belt at the nose, metres.
    """
    nose = np.array(HATCHBACK.sections["nose"])[:, 1]
    angle = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
    rails = np.interp(share + radius / tall * np.sin(angle), nose, np.arange(9.0))
    return tuple(zip((place + radius / half * np.cos(angle)).tolist(), rails.tolist(), strict=True))


def _checks(y0: float, y1: float, count: int) -> tuple[tuple[str, float, float, float, float], ...]:
    """Return two rows of alternating blue and yellow fields along the flanks."""
    stops = np.linspace(y0, y1, count + 1).tolist()
    colours = ("vehicle-blue", "vehicle-yellow")
    return tuple(
        (colours[(k + row) % 2], start, stop, *rails)
        for k, (start, stop) in enumerate(pairwise(stops))
        for row, rails in enumerate(((2.8, 3.9), (3.9, 4.8)))
    )


_BAND_LAMP: Final = ((0.0, 5.6), (0.98, 5.6), (1.28, 5.7), (1.32, 6.6), (1.0, 6.7), (0.0, 6.7))
_SQUARE_TAIL: Final = ((0.62, 5.2), (0.99, 5.2), (1.10, 5.2), (1.12, 6.75), (1.0, 6.75), (0.62, 6.75))
_TALL_TAIL: Final = ((0.80, 4.6), (0.97, 4.6), (0.99, 7.4), (0.82, 7.4))
_SLIM_HEAD: Final = ((0.46, 5.55), (0.99, 6.35), (1.40, 7.0), (1.38, 6.4), (1.04, 5.3), (0.60, 4.95))

_CITY_CAR: Final = replace(
    HATCHBACK, name="city-car", length=3.58, width=1.64, height=1.51, front_axle=1.16, rear_axle=-1.19, tyre=0.290,
    arch=0.332, sill=((-1.79, 0.29), (-1.55, 0.245), (-0.9, 0.195), (0.9, 0.19), (1.5, 0.20), (1.79, 0.22)),
    belt=((-1.79, 0.985), (-1.3, 0.985), (-0.6, 0.955), (0.4, 0.925), (0.8, 0.915), (1.15, 0.89), (1.45, 0.84), (1.79, 0.74)),
    nose_plan=_ROUND_NOSE, tail_plan=_ROUND_TAIL, cowl=1.12, pillar_base=0.86, pillar_top=0.20, roof_front=0.36,
    roof_rear=-1.50, rear_top=-1.38, glass_tail=-1.70, rear_base=-1.56, rail=(0.585, 1.405),
    posts=((-0.20, -0.26), (-0.92, -0.94)), doors=(0.90, -0.14, -0.96), quarter=(-1.14, -1.02),
    head=_disc(0.80, 0.79, 0.098, half=0.82, tall=0.52), projectors=((0.5, 0.062),), bars=(2, 3),
    tail_lamp=_disc(0.86, 0.80, 0.105, half=0.82, tall=0.70), grille=((0.0, 4.9), (0.40, 5.0), (0.38, 5.3), (0.0, 5.25)),
    rims=("six", "star", "cover"), tyre_width=0.175, rim_share=0.68,
)  # fmt: skip

_MICROCAR: Final = replace(
    _CITY_CAR, name="microcar", length=2.74, width=1.62, height=1.55, front_axle=0.90, rear_axle=-0.95, tyre=0.288,
    arch=0.325, sill=((-1.37, 0.30), (-1.1, 0.25), (-0.6, 0.20), (0.6, 0.20), (1.1, 0.21), (1.37, 0.23)),
    belt=((-1.37, 1.02), (-0.9, 1.01), (-0.4, 0.985), (0.2, 0.955), (0.6, 0.935), (0.9, 0.90), (1.15, 0.85), (1.37, 0.77)),
    nose_plan=tuple((x, 0.72 * d) for x, d in _ROUND_NOSE), tail_plan=tuple((x, 0.72 * d) for x, d in _ROUND_TAIL), cowl=1.00,
    pillar_base=0.76, pillar_top=0.10, roof_front=0.26, roof_rear=-1.08, rear_top=-0.98, glass_tail=-1.26, rear_base=-1.12,
    rail=(0.58, 1.44), posts=((-0.36, -0.38), (-0.94, -0.92)), doors=(0.80, -0.36, -0.80), quarter=(-0.84, -0.78),
    two_doors=True, roof="vehicle-black-gloss", bars=(0, 3), rims=("six", "turbine"),
    head=_disc(0.82, 0.78, 0.088, half=0.81, tall=0.54), tail_lamp=_disc(0.84, 0.82, 0.085, half=0.81, tall=0.72),
)  # fmt: skip

_THREE_DOOR: Final = replace(
    HATCHBACK, name="three-door", length=3.98, width=1.74, height=1.43, front_axle=1.20, rear_axle=-1.29, tyre=0.310,
    arch=0.352, sill=((-1.99, 0.28), (-1.75, 0.235), (-0.95, 0.185), (0.95, 0.18), (1.65, 0.19), (1.99, 0.20)),
    belt=((-1.99, 1.01), (-1.5, 1.01), (-0.8, 0.97), (0.3, 0.925), (0.85, 0.91), (1.2, 0.88), (1.6, 0.825), (1.99, 0.735)),
    cowl=1.08, pillar_base=0.82, pillar_top=0.02, roof_front=0.18, roof_rear=-1.46, rear_top=-1.34, glass_tail=-1.86,
    rear_base=-1.72, rail=(0.61, 1.335), posts=((-0.48, -0.54), (-1.30, -1.16)), doors=(0.90, -0.42, -1.00),
    quarter=(-1.34, -1.14), two_doors=True, head=_SLIM_HEAD, extras=("spoiler",), bars=(3, 4),
    rims=("double", "mesh", "five"), tail_lamp=((0.62, 5.5), (0.98, 5.3), (1.16, 5.6), (1.18, 7.1), (1.0, 7.1), (0.66, 6.6)),
    roof="vehicle-black-gloss",
)  # fmt: skip

_NOTCHBACK: Final = replace(
    SEDAN, name="notchback", length=4.34, width=1.68, height=1.40, front_axle=1.30, rear_axle=-1.22, tyre=0.304, arch=0.345,
    sill=((-2.17, 0.33), (-1.9, 0.27), (-0.9, 0.22), (1.1, 0.21), (1.85, 0.23), (2.17, 0.25)),
    belt=((-2.17, 0.92), (-1.95, 0.945), (-1.5, 0.94), (-0.8, 0.925), (0.4, 0.905), (0.95, 0.90), (1.4, 0.885), (1.8, 0.86),
        (2.05, 0.83), (2.17, 0.78)), nose_plan=_BLUNT_NOSE, tail_plan=_BLUNT_TAIL,
    sections=_upright(HATCHBACK.sections, 0.55), cowl=0.98, pillar_base=0.80, pillar_top=0.30, roof_front=0.42,
    roof_rear=-1.02, rear_top=-0.94, glass_tail=-1.42, rear_base=-1.28, rail=(0.60, 1.315), bonnet_crown=0.05,
    boot_crown=0.025, posts=((-0.14, -0.18), (-0.94, -0.80)), doors=(0.86, -0.10, -0.98), quarter=(-1.06, -0.84),
    head=((0.60, 4.9), (0.98, 4.9), (1.10, 5.0), (1.10, 6.4), (0.98, 6.4), (0.60, 6.4)), bars=(7, 2),
    grille=((0.0, 5.0), (0.55, 5.0), (0.55, 6.3), (0.0, 6.3)), intake=((0.0, 1.6), (0.55, 1.6), (0.55, 2.3), (0.0, 2.3)),
    tail_lamp=_SQUARE_TAIL, plate=(3.4, 5.9), rims=("cover", "steel"), tyre_width=0.175, rim_share=0.62,
    livery=(("vehicle-plastic", -2.0, 2.0, 3.5, 3.8),),
)  # fmt: skip

_COUPE: Final = replace(
    SEDAN, name="coupe", length=4.58, width=1.86, height=1.36, front_axle=1.44, rear_axle=-1.34, tyre=0.336, arch=0.376,
    sill=((-2.29, 0.29), (-2.0, 0.23), (-1.0, 0.18), (1.15, 0.175), (1.95, 0.18), (2.29, 0.185)),
    belt=((-2.29, 0.98), (-2.05, 1.00), (-1.5, 0.965), (-0.8, 0.92), (0.4, 0.885), (1.0, 0.87), (1.5, 0.83), (1.95, 0.77),
        (2.15, 0.72), (2.29, 0.66)), cowl=1.02, pillar_base=0.76, pillar_top=-0.14, roof_front=0.0, roof_rear=-0.98,
    rear_top=-0.92, glass_tail=-1.92, rear_base=-1.74, rail=(0.60, 1.262), posts=((-0.52, -0.56), (-1.24, -0.80)),
    doors=(0.92, -0.46, -1.04), quarter=(-1.28, -0.82), two_doors=True, head=_SLIM_HEAD, bars=(4, 5),
    rims=("mesh", "double", "turbine"), rim_share=0.75, tyre_width=0.24,
    grille=((0.0, 4.0), (0.34, 4.1), (0.46, 5.4), (0.0, 5.5)), tail_lamp=_BAND_LAMP, plate=(3.4, 4.9),
)  # fmt: skip

_CONVERTIBLE: Final = replace(
    _COUPE, name="convertible", length=4.36, width=1.80, height=1.33, front_axle=1.34, rear_axle=-1.26, tyre=0.322,
    arch=0.362, sill=((-2.18, 0.29), (-1.9, 0.235), (-0.95, 0.19), (1.1, 0.185), (1.85, 0.19), (2.18, 0.195)),
    belt=((-2.18, 0.95), (-1.95, 0.965), (-1.5, 0.955), (-0.8, 0.925), (0.4, 0.905), (0.95, 0.89), (1.4, 0.85),
        (1.8, 0.795), (2.02, 0.74), (2.18, 0.68)), cowl=1.02, pillar_base=0.76, pillar_top=0.16, roof_front=0.32,
    roof_rear=-0.9, rear_top=-0.86, glass_tail=-1.34, rear_base=-1.20, rail=(0.60, 1.336),
    posts=((-0.36, -0.40), (-1.0, -0.80)), doors=(0.92, -0.40, -1.0), quarter=(-1.1, -0.82), back="open", fin=False,
    bars=(4, 4), rims=("five", "mesh"), tail_lamp=SEDAN.tail_lamp, plate=(3.6, 5.2), boot_crown=0.06, head=HATCHBACK.head,
    extras=(),
)  # fmt: skip

_SPORTS_CAR: Final = replace(
    _COUPE, name="sports-car", length=4.46, width=1.93, height=1.23, front_axle=1.30, rear_axle=-1.26, tyre=0.338, arch=0.374,
    sill=((-2.23, 0.28), (-1.95, 0.20), (-1.0, 0.15), (1.1, 0.145), (1.9, 0.14), (2.23, 0.15)),
    belt=((-2.23, 0.90), (-1.9, 0.93), (-1.3, 0.93), (-0.7, 0.86), (0.2, 0.80), (0.8, 0.80), (1.25, 0.795), (1.7, 0.70),
        (2.0, 0.62), (2.23, 0.54)), nose_plan=_ROUND_NOSE, cowl=1.22, pillar_base=0.92, pillar_top=-0.02, roof_front=0.14,
    roof_rear=-0.62, rear_top=-0.56, glass_tail=-1.64, rear_base=-1.38, rail=(0.575, 1.13), bonnet_crown=0.02,
    boot_crown=0.05, posts=((-0.44, -0.40), (-1.0, -0.52)), doors=(1.00, -0.40, -1.0), quarter=(-0.92, -0.50), bars=(3, 3),
    rims=("star", "double"), rim_share=0.77, tyre_width=0.27,
    head=((0.54, 5.3), (0.96, 6.2), (1.26, 7.2), (1.30, 6.5), (1.06, 5.1), (0.66, 4.6)), plate=(3.2, 4.0),
    grille=((0.0, 3.1), (0.30, 3.1), (0.26, 3.6), (0.0, 3.6)),
    intake=((0.0, 1.4), (0.82, 1.5), (0.88, 2.5), (0.6, 2.6), (0.0, 2.4)),
    tail_lamp=((0.36, 5.2), (0.98, 5.2), (1.20, 5.4), (1.20, 7.0), (0.98, 7.0), (0.36, 6.9)), extras=("wing",),
)  # fmt: skip

_ELECTRIC_SALOON: Final = replace(
    SEDAN, name="electric-saloon", length=4.76, width=1.90, height=1.45, front_axle=1.50, rear_axle=-1.42, tyre=0.342,
    arch=0.38, sill=((-2.38, 0.30), (-2.05, 0.23), (-1.0, 0.18), (1.2, 0.175), (2.0, 0.19), (2.38, 0.20)),
    belt=((-2.38, 1.02), (-2.1, 1.035), (-1.6, 0.99), (-0.8, 0.945), (0.4, 0.915), (1.0, 0.90), (1.5, 0.86), (1.95, 0.79),
        (2.2, 0.73), (2.38, 0.66)), nose_plan=_ROUND_NOSE, tail_plan=_ROUND_TAIL, cowl=1.40, pillar_base=1.08,
    pillar_top=0.02, roof_front=0.18, roof_rear=-1.30, rear_top=-1.20, glass_tail=-2.06, rear_base=-1.86, rail=(0.63, 1.345),
    posts=((-0.14, -0.26), (-1.06, -0.96)), doors=(1.12, -0.08, -1.12), quarter=(-1.48, -1.14), head=_SLIM_HEAD,
    tail_lamp=_BAND_LAMP, bars=(0, 3), rims=("aero", "turbine"), rim_share=0.74,
    projectors=((0.25, 0.032), (0.42, 0.032), (0.59, 0.030)), roof="vehicle-black-gloss", plate=(3.4, 4.9),
    grille=((0.0, 4.3), (0.30, 4.35), (0.26, 4.6), (0.0, 4.6)), intake=((0.0, 1.4), (0.6, 1.5), (0.66, 2.5), (0.0, 2.5)),
)  # fmt: skip

_LIMOUSINE: Final = replace(
    SEDAN, name="limousine", length=5.18, width=1.92, height=1.49, front_axle=1.66, rear_axle=-1.46, tyre=0.352, arch=0.392,
    sill=((-2.59, 0.30), (-2.25, 0.24), (-1.1, 0.19), (1.3, 0.185), (2.2, 0.19), (2.59, 0.20)),
    belt=((-2.59, 0.985), (-2.3, 1.015), (-1.7, 1.00), (-0.8, 0.965), (0.4, 0.94), (1.0, 0.93), (1.6, 0.90), (2.1, 0.85),
        (2.4, 0.80), (2.59, 0.74)), nose_plan=_BLUNT_NOSE, cowl=1.24, pillar_base=0.98, pillar_top=0.14, roof_front=0.30,
    roof_rear=-1.42, rear_top=-1.32, glass_tail=-2.00, rear_base=-1.84, rail=(0.66, 1.395),
    posts=((-0.20, -0.28), (-1.26, -1.16)), doors=(1.06, -0.14, -1.22), quarter=(-1.60, -1.26), bars=(-11, 3),
    grille=((0.0, 3.7), (0.40, 3.8), (0.42, 6.2), (0.0, 6.3)), plate=(2.6, 5.3),
    head=((0.54, 5.2), (0.99, 5.5), (1.24, 6.3), (1.24, 6.6), (0.98, 6.5), (0.58, 6.2)), rims=("ten", "mesh"),
    tyre_width=0.245, rim_share=0.73, intake=((0.0, 1.3), (0.62, 1.4), (0.72, 2.0), (0.0, 2.0)),
    tail_lamp=((0.52, 5.6), (0.98, 5.6), (1.22, 5.7), (1.22, 6.6), (1.0, 6.6), (0.52, 6.5)),
)  # fmt: skip

_CLASSIC_CAR: Final = replace(
    _NOTCHBACK, name="classic-car", length=4.08, width=1.58, height=1.46, front_axle=1.22, rear_axle=-1.18, tyre=0.312,
    arch=0.345, sill=((-2.04, 0.36), (-1.8, 0.31), (-0.9, 0.27), (1.0, 0.27), (1.7, 0.31), (2.04, 0.36)),
    belt=((-2.04, 0.84), (-1.8, 0.93), (-1.3, 0.96), (-0.7, 0.955), (0.4, 0.945), (0.8, 0.945), (1.2, 0.93), (1.6, 0.90),
        (1.85, 0.86), (2.04, 0.76)), nose_plan=_ROUND_NOSE, tail_plan=_ROUND_TAIL, sections=HATCHBACK.sections, cowl=0.76,
    pillar_base=0.60, pillar_top=0.28, roof_front=0.40, roof_rear=-1.00, rear_top=-0.90, glass_tail=-1.34, rear_base=-1.20,
    rail=(0.53, 1.35), bonnet_crown=0.10, boot_crown=0.05, posts=((-0.26, -0.28), (-0.92, -0.76)), doors=(0.66, -0.22, -0.94),
    quarter=(-1.02, -0.82), head=_disc(0.80, 0.72, 0.105, half=0.79, tall=0.44), projectors=((0.5, 0.085),), bars=(-9, 2),
    grille=((0.0, 3.2), (0.34, 3.4), (0.30, 5.4), (0.0, 5.8)), intake=((0.0, 1.2), (0.20, 1.2), (0.20, 2.5), (0.0, 2.5)),
    tail_lamp=_disc(0.84, 0.66, 0.060, half=0.79, tall=0.48), plate=(2.4, 4.3), rims=("hub-cap",), tyre_width=0.16,
    rim_share=0.60, extras=("chrome-bumpers",), beyond=(0.06, 0.0), roof="vehicle-cream", livery=(), fin=False,
)  # fmt: skip

_CROSSOVER: Final = replace(
    SUV, name="crossover", length=4.30, width=1.82, height=1.57, front_axle=1.30, rear_axle=-1.32, tyre=0.345, arch=0.392,
    sill=((-2.15, 0.35), (-1.85, 0.29), (-1.0, 0.235), (1.05, 0.235), (1.8, 0.25), (2.15, 0.265)),
    belt=((-2.15, 1.12), (-1.6, 1.10), (-0.8, 1.04), (0.4, 1.00), (0.9, 0.99), (1.35, 0.965), (1.75, 0.915), (1.98, 0.86),
        (2.15, 0.79)), tail_plan=_ROUND_TAIL, cowl=1.12, pillar_base=0.86, pillar_top=0.04, roof_front=0.20, roof_rear=-1.34,
    rear_top=-1.24, glass_tail=-1.94, rear_base=-1.78, rail=(0.63, 1.465), posts=((-0.26, -0.34), (-1.08, -1.00)),
    doors=(0.94, -0.20, -1.08), quarter=(-1.46, -1.14), head=_SLIM_HEAD, tail_lamp=_BAND_LAMP, roof="vehicle-black-gloss",
    roof_rails=False, bars=(3, 4), rims=("turbine", "double"), extras=("spoiler",), plate=(3.4, 4.9),
)  # fmt: skip

_LARGE_SUV: Final = replace(
    SUV, name="large-suv", length=4.94, width=1.99, height=1.80, front_axle=1.56, rear_axle=-1.40, tyre=0.386, arch=0.432,
    sill=((-2.47, 0.38), (-2.15, 0.31), (-1.1, 0.27), (1.25, 0.27), (2.1, 0.29), (2.47, 0.31)),
    belt=((-2.47, 1.20), (-1.8, 1.18), (-0.9, 1.16), (0.5, 1.15), (1.1, 1.145), (1.6, 1.13), (2.05, 1.10), (2.30, 1.06),
        (2.47, 0.99)), nose_plan=_BLUNT_NOSE, tail_plan=_BLUNT_TAIL, sections=_upright(HATCHBACK.sections, 0.7), cowl=1.20,
    pillar_base=1.00, pillar_top=0.34, roof_front=0.48, roof_rear=-2.12, rear_top=-2.02, glass_tail=-2.34, rear_base=-2.20,
    rail=(0.72, 1.69), posts=((-0.14, -0.20), (-1.12, -1.14)), doors=(1.06, -0.08, -1.12), quarter=(-1.96, -1.80),
    bars=(-9, 4), cladding=False, grille=((0.0, 3.5), (0.46, 3.6), (0.48, 6.2), (0.0, 6.3)),
    head=((0.56, 5.0), (0.98, 5.2), (1.14, 5.6), (1.14, 6.3), (0.56, 6.2)), tail_lamp=_TALL_TAIL,
    rims=("ten", "double", "five"), tyre_width=0.265, plate=(2.8, 5.3), extras=("steps",),
)  # fmt: skip

_OFF_ROADER: Final = replace(
    _LARGE_SUV, name="off-roader", length=4.32, width=1.84, height=1.90, front_axle=1.34, rear_axle=-1.24, tyre=0.390,
    arch=0.440, sill=((-2.16, 0.46), (-1.9, 0.40), (-1.0, 0.36), (1.1, 0.36), (1.9, 0.40), (2.16, 0.44)),
    belt=((-2.16, 1.22), (-1.6, 1.22), (0.5, 1.20), (1.0, 1.19), (1.5, 1.175), (1.9, 1.15), (2.05, 1.12), (2.16, 1.07)),
    nose_plan=(*_BLUNT_NOSE[:-1], (0.955, 0.62)), tail_plan=(*_BLUNT_TAIL[:-1], (0.978, 0.6)),
    sections=_upright(HATCHBACK.sections, 0.35), cowl=0.86, pillar_base=0.76, pillar_top=0.50, roof_front=0.60,
    roof_rear=-2.00, rear_top=-1.94, glass_tail=-2.08, rear_base=-1.98, rail=(0.74, 1.82), bonnet_crown=0.03,
    posts=((-0.16, -0.18), (-0.98, -1.0)), doors=(0.80, -0.10, -1.00), quarter=(-1.80, -1.72),
    head=_disc(0.74, 0.72, 0.100, half=0.92, tall=0.64), projectors=((0.5, 0.080),), bars=(-7, 2),
    grille=((0.0, 4.3), (0.44, 4.3), (0.44, 6.0), (0.0, 6.0)), cladding=True,
    intake=((0.0, 1.2), (0.5, 1.2), (0.5, 2.5), (0.0, 2.5)), rims=("six", "steel"), rim_share=0.58,
    extras=("spare-wheel", "roof-rack", "bull-bar"), beyond=(0.20, 0.17), roof_rails=False, plate=(2.8, 3.0),
)  # fmt: skip

_MPV: Final = replace(
    ESTATE, name="mpv", length=4.70, width=1.87, height=1.69, front_axle=1.46, rear_axle=-1.40, tyre=0.332, arch=0.376,
    sill=((-2.35, 0.30), (-2.05, 0.25), (-1.0, 0.20), (1.2, 0.20), (2.0, 0.21), (2.35, 0.22)),
    belt=((-2.35, 1.06), (-1.8, 1.06), (-0.8, 1.03), (0.4, 1.00), (1.0, 0.985), (1.5, 0.955), (1.9, 0.885), (2.15, 0.81),
        (2.35, 0.71)), cowl=1.60, pillar_base=1.26, pillar_top=0.30, roof_front=0.46, roof_rear=-1.98, rear_top=-1.90,
    glass_tail=-2.24, rear_base=-2.10, rail=(0.68, 1.58), posts=((-0.02, -0.10), (-1.08, -1.12)), doors=(1.24, 0.04, -1.10),
    quarter=(-1.90, -1.72), tail_lamp=_TALL_TAIL, bars=(4, 4), rims=("ten", "five", "star"),
    head=((0.54, 5.1), (0.98, 5.7), (1.40, 7.5), (1.42, 6.6), (1.10, 4.9), (0.70, 4.6)),
)  # fmt: skip

_LEISURE_VAN: Final = replace(
    _MPV, name="leisure-van", length=4.40, width=1.83, height=1.83, front_axle=1.34, rear_axle=-1.36, tyre=0.316, arch=0.360,
    sill=((-2.20, 0.31), (-1.95, 0.27), (-1.0, 0.22), (1.1, 0.22), (1.85, 0.23), (2.20, 0.24)),
    belt=((-2.20, 1.10), (-0.8, 1.08), (0.4, 1.06), (0.9, 1.05), (1.35, 1.02), (1.75, 0.955), (2.0, 0.885), (2.20, 0.79)),
    nose_plan=HATCHBACK.nose_plan, tail_plan=_BLUNT_TAIL, sections=_upright(HATCHBACK.sections, 0.7), cowl=1.40,
    pillar_base=1.14, pillar_top=0.46, roof_front=0.60, roof_rear=-2.04, rear_top=-1.98, glass_tail=-2.14, rear_base=-2.04,
    rail=(0.70, 1.735), posts=((0.06, 0.02), (-1.00, -1.02)), doors=(1.16, 0.10, -1.02), quarter=(-1.84, -1.78),
    rims=("cover", "six", "five"), roof_rails=False, livery=(("vehicle-plastic", -1.9, 1.6, 3.3, 3.7),), extras=(),
    cladding=True,
)  # fmt: skip

_CITY_VAN: Final = replace(
    _LEISURE_VAN, name="city-van", height=1.86, rail=(0.715, 1.765), panel_van=True, rims=("steel", "cover"),
    extras=("roof-rack",), beyond=(0.0, 0.17), livery=(), length=4.46, posts=((0.10, 0.06), (-0.94, -0.96)),
    doors=(1.16, 0.14, -0.96), bars=(3, 3), cladding=False,
    head=((0.54, 5.4), (0.98, 5.6), (1.30, 6.9), (1.30, 7.2), (1.0, 6.9), (0.58, 6.2)),
)  # fmt: skip

_MINIBUS: Final = replace(
    VAN, name="minibus", tail_plan=(*_BLUNT_TAIL[:-1], (0.98, 0.9)), panel_van=False, height=1.97, rail=(0.79, 1.85),
    sections=_upright(HATCHBACK.sections, 0.7), posts=((0.62, 0.56), (-0.62, -0.64)), doors=(1.66, 0.68, -0.64),
    quarter=(-2.12, -2.08), bars=(4, 3), rims=("five", "cover", "ten"), roof_rails=True,
    grille=((0.0, 5.0), (0.56, 5.1), (0.58, 6.4), (0.0, 6.4)),
)  # fmt: skip

_HIGH_ROOF_VAN: Final = replace(
    VAN, name="high-roof-van", tail_plan=(*_BLUNT_TAIL[:-1], (0.978, 0.9)), length=5.56, width=2.02, height=2.58,
    front_axle=1.78, rear_axle=-1.62, tyre=0.348, arch=0.40,
    sill=((-2.78, 0.40), (-2.4, 0.35), (-1.0, 0.30), (1.4, 0.30), (2.4, 0.29), (2.78, 0.30)),
    belt=((-2.78, 1.26), (1.1, 1.26), (1.75, 1.24), (2.1, 1.19), (2.4, 1.10), (2.6, 1.02), (2.78, 0.92)),
    nose_plan=_BLUNT_NOSE, sections=_upright(HATCHBACK.sections, 0.6), cowl=2.12, pillar_base=1.88, pillar_top=1.04,
    roof_front=1.16, roof_rear=-2.62, rear_top=-2.56, glass_tail=-2.70, rear_base=-2.62, rail=(0.80, 2.44),
    posts=((0.80, 0.74), (-0.74, -0.76)), doors=(1.92, 0.84, -0.76), quarter=(-2.1, -2.1), bars=(4, 4),
    rims=("steel", "cover"), rim_share=0.62, tail_lamp=_TALL_TAIL, grille=((0.0, 5.0), (0.62, 5.1), (0.62, 6.3), (0.0, 6.4)),
    extras=("roof-beacon",), livery=(("vehicle-plastic", -2.6, 2.3, 2.9, 3.4),), plate=(3.0, 5.3), glass_top=0.68,
)  # fmt: skip

_AMBULANCE: Final = replace(
    _HIGH_ROOF_VAN, name="ambulance", extras=("light-bar",), bars=(3, 4), rims=("cover",),
    livery=(*_checks(-2.55, 1.85, 10), ("vehicle-red", -2.7, 1.95, 4.8, 5.3)),
)  # fmt: skip

_PICK_UP: Final = replace(
    SUV, name="pick-up", length=5.28, width=1.87, height=1.80, front_axle=1.72, rear_axle=-1.42, tyre=0.378, arch=0.428,
    sill=((-2.64, 0.52), (-2.3, 0.44), (-1.1, 0.38), (1.3, 0.37), (2.25, 0.36), (2.64, 0.37)),
    belt=((-2.64, 1.12), (-2.2, 1.12), (-0.8, 1.12), (0.5, 1.11), (1.2, 1.105), (1.75, 1.085), (2.2, 1.05), (2.45, 1.0),
        (2.64, 0.93)), nose_plan=_BLUNT_NOSE, tail_plan=_BLUNT_TAIL, sections=_upright(HATCHBACK.sections, 0.6), cowl=1.36,
    pillar_base=1.14, pillar_top=0.46, roof_front=0.60, roof_rear=-0.72, rear_top=-0.68, glass_tail=-0.86, rear_base=-0.80,
    rail=(0.665, 1.70), posts=((0.14, 0.08), (-0.70, -0.62)), doors=(1.20, 0.20, -0.62), quarter=(-0.76, -0.655), bars=(3, 2),
    hatch=False, back="bed", grille=((0.0, 3.9), (0.54, 4.0), (0.54, 6.1), (0.0, 6.2)),
    tail_lamp=((0.86, 4.4), (0.98, 4.4), (1.0, 7.4), (0.86, 7.4)),
    head=((0.58, 4.7), (0.98, 4.9), (1.14, 5.4), (1.16, 6.3), (0.58, 6.2)), rims=("six", "five"), rim_share=0.60,
    tyre_width=0.255, roof_rails=False, plate=(2.6, 2.6), extras=("steps",),
)  # fmt: skip

_CAB: Final = replace(
    _HIGH_ROOF_VAN, height=2.16, length=5.60, rail=(0.80, 2.06), front_axle=1.80, rear_axle=-1.56, roof_rear=0.66,
    rear_top=0.68, glass_tail=0.56, rear_base=0.60, posts=((0.80, 0.80), (0.72, 0.74)), doors=(1.92, 0.84, 0.70),
    quarter=(0.66, 0.70), pillar_top=1.20, roof_front=1.34, two_doors=True, back="box", extras=(), livery=(), glass_top=1.0,
    fin=False,
)  # fmt: skip

_BOX_VAN: Final = replace(
    _CAB, name="box-van", beyond=(0.0, 0.68), box=(-2.77, 0.62, 2.06, 0.86, 2.83, 0.0), rims=("steel",),
)  # fmt: skip

_CAMPER: Final = replace(
    _CAB, name="camper", beyond=(0.05, 0.72), box=(-2.76, 0.62, 2.10, 0.84, 2.84, 1.66), rims=("cover", "steel"),
)  # fmt: skip

_TOURING_ESTATE: Final = replace(
    ESTATE, name="touring-estate", length=4.86, width=1.87, extras=("roof-box",), beyond=(0.0, 0.36), height=1.47,
    rail=(0.655, 1.375), sill=((-2.43, 0.29), (-2.1, 0.235), (-1.0, 0.185), (1.2, 0.18), (2.05, 0.185), (2.43, 0.19)),
    belt=((-2.43, 1.0), (-2.1, 1.0), (-1.6, 0.985), (-0.8, 0.95), (0.4, 0.92), (1.0, 0.905), (1.5, 0.868), (1.95, 0.82),
        (2.25, 0.76), (2.43, 0.69)), roof_rear=-1.80, rear_top=-1.72, glass_tail=-2.28, rear_base=-2.14, rear_axle=-1.38,
    front_axle=1.52, bars=(-13, 4), grille=((0.0, 4.0), (0.40, 4.1), (0.46, 5.7), (0.0, 5.8)), head=_SLIM_HEAD,
    tail_lamp=_BAND_LAMP, plate=(3.2, 4.9), rims=("double", "mesh", "ten"), rim_share=0.73,
)  # fmt: skip

_POLICE_CAR: Final = replace(
    ESTATE, name="police-car", extras=("light-bar",), beyond=(0.0, 0.11), livery=_checks(-2.0, 1.9, 9),
    rims=("five", "steel"), bars=(6, 4), roof_rails=False, grille=((0.0, 4.0), (0.46, 4.1), (0.50, 5.5), (0.0, 5.6)),
)  # fmt: skip

_TAXI: Final = replace(
    _MPV, name="taxi", length=4.56, height=1.74, rail=(0.69, 1.63), extras=("taxi-sign",), beyond=(0.0, 0.12),
    rims=("cover", "steel"), roof_rear=-1.90, rear_top=-1.84, glass_tail=-2.16, rear_base=-2.04, quarter=(-1.86, -1.72),
    cowl=1.36, pillar_base=1.10, sections=_upright(HATCHBACK.sections, 0.75), bars=(-13, 3),
    head=_disc(0.70, 0.76, 0.100, half=0.93, tall=0.52),
    belt=((-2.28, 1.07), (-0.8, 1.04), (0.4, 1.02), (0.9, 1.01), (1.4, 0.985), (1.85, 0.93), (2.1, 0.87), (2.28, 0.76)),
    sill=((-2.28, 0.30), (-2.0, 0.25), (-1.0, 0.20), (1.2, 0.20), (1.95, 0.21), (2.28, 0.23)), roof_rails=False,
    grille=((0.0, 3.4), (0.36, 3.6), (0.34, 6.0), (0.0, 6.2)), nose_plan=_BLUNT_NOSE, projectors=((0.5, 0.066),),
    livery=(("vehicle-black-gloss", -1.1, 1.24, 1.4, 1.9),), posts=((0.02, -0.04), (-1.06, -1.10)), doors=(1.16, 0.06, -1.08),
)  # fmt: skip

#: The bodies that came after those of the first street.
_LATER: Final = (
    _CITY_CAR, _MICROCAR, _THREE_DOOR, _NOTCHBACK, _COUPE, _CONVERTIBLE, _SPORTS_CAR, _ELECTRIC_SALOON, _LIMOUSINE, _CLASSIC_CAR,
    _CROSSOVER, _LARGE_SUV, _OFF_ROADER, _MPV, _LEISURE_VAN, _CITY_VAN, _MINIBUS, _HIGH_ROOF_VAN, _AMBULANCE, _PICK_UP, _BOX_VAN,
    _CAMPER, _TOURING_ESTATE, _POLICE_CAR, _TAXI,
)  # fmt: skip
#: All bodies by name.
CARS: Final[dict[str, CarDesign]] = EARLY_CARS | {design.name: design for design in _LATER}
