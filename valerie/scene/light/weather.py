"""Effects of rain, snow and fallen leaves: wet and covered shares of surfaces, friction of tyres, light in falling snow."""

from __future__ import annotations

from typing import Final

import numpy as np

#: Metres from the crown of the road to its edge, cross fall, mean depth of the asphalt's texture in millimetres.
_DRAINAGE_M: Final = 3.3
_CROSS_FALL: Final = 0.025
_TEXTURE_MM: Final = 0.5
#: Millimetres of water on a road that is merely wet.
_WET_MM: Final = 0.2
#: Peak friction of new tyres at 50 km/h over millimetres of water: dry, wet, heavy rain, puddles.
_FRICTION_MM: Final = (0.0, _WET_MM, 1.0, 2.0)
_FRICTION: Final = (0.85, 0.65, 0.55, 0.5)
#: Peak friction of tyres on hard-packed snow.
_SNOW_FRICTION: Final = 0.2
#: Metres of fresh snow that cover tanh 1 = 76 % of the ground.
COVERING_M: Final = 0.025


def wetness(rain: float) -> float:
    """Return the share of upward surfaces that water covers at ``rain`` mm/h, 0 dry … 1 wet; above 0.9 from 2 mm/h on."""
    return float(1 - np.exp(-rain / 0.8))


def water_mm(rain: float) -> float:
    """Return the millimetres of water on a lane of 3.3 m with 2.5 % cross fall at ``rain`` mm/h.

    It is a film of 0.2 mm on wet surfaces, and the water above the texture: Gallaway et al. 1979, "Pavement and geometric
    design criteria for minimizing hydroplaning", FHWA-RD-79-31, 0.01485 T^0.11 L^0.43 I^0.59 / S^0.42 − T.
    """
    texture = _TEXTURE_MM
    depth: float = 0.01485 * texture**0.11 * _DRAINAGE_M**0.43 * rain**0.59 / _CROSS_FALL**0.42 - texture
    return _WET_MM * wetness(rain) + max(depth, 0.0)


def snow_cover(depth: float) -> float:
    """Return the share of the ground that ``depth`` metres of fresh snow cover, 0…1.

    tanh(depth / 2.5 z₀) with the roughness length z₀ = 1 cm of bare ground and 100 kg/m³: G.-Y. Niu and Z.-L. Yang, "An
    observation-based formulation of snow cover fraction", J. Geophys. Res. 112, 2007, doi:10.1029/2007JD008674.
    """
    return float(np.tanh(depth / COVERING_M))


def snow_extinction(snowfall: float) -> float:
    """Return the extinction coefficient of falling dry snow for ``snowfall`` mm/h of water, per metre, at 550 nm.

    (5.42e-5 λ + 5.4958776) S^1.38 dB/km: Recommendation ITU-R P.1817-1, table 2. An object keeps 2 % of its contrast over 3 km
    in 1 mm/h, and over 450 m in 4 mm/h.
    """
    decibels = (5.42e-5 * 550.0 + 5.4958776) * snowfall**1.38
    return float(decibels * np.log(10) / 10 / 1000)


def flakes_per_m3(snowfall: float) -> float:
    """Return the number of flakes in a cubic metre of air that melt to drops of more than 1 mm, for ``snowfall`` mm/h of water.

    K. Gunn and J. Marshall, "The distribution with size of aggregate snowflakes", J. Meteorology 15, 1958,
    doi:10.1175/1520-0469(1958)015<0452:TDWSOA>2.0.CO;2: N₀ exp(−Λ D) per m³ and mm, N₀ = 3,800 S^−0.87, Λ = 2.55 S^−0.48 / mm.
    """
    if snowfall <= 0:
        return 0.0
    slope = 2.55 * snowfall**-0.48
    return float(3800.0 * snowfall**-0.87 / slope * np.exp(-slope))


def road_friction(rain: float, snow_depth: float = 0.0) -> float:
    """Return the peak coefficient of friction between new tyres and the road at 50 km/h, 0.85 when dry.

    Bosch Automotive Handbook, "Coefficients of static friction for pneumatic tires on various surfaces": dry 0.85, wet
    (0.2 mm of water) 0.65, heavy rain (1 mm) 0.55, puddles (2 mm) 0.5; linear in between. Where snow lies, that of hard-packed
    snow, 0.2 (J. Wong, Theory of Ground Vehicles, 4th edition, 2008, table 1.3), by its cover. Leaves do not count. It is
    metadata and does not affect pictures.

    Args:
        rain: mm/h.
        snow_depth: metres of lying snow.
    """
    bare = float(np.interp(water_mm(rain), _FRICTION_MM, _FRICTION))
    return bare + snow_cover(snow_depth) * (_SNOW_FRICTION - bare)
