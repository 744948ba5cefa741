"""Effects of rain on a road: wet share of the surface, depth of the water, friction of tyres."""

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


def road_friction(rain: float) -> float:
    """Return the peak coefficient of friction between new tyres and the road at 50 km/h in ``rain`` mm/h, 0.85 when dry.

    Bosch Automotive Handbook, "Coefficients of static friction for pneumatic tires on various surfaces": dry 0.85, wet
    (0.2 mm of water) 0.65, heavy rain (1 mm) 0.55, puddles (2 mm) 0.5; linear in between. It is metadata and does not affect
    pictures.
    """
    return float(np.interp(water_mm(rain), _FRICTION_MM, _FRICTION))
