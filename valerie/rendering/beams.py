"""The light distribution of a dipped beam: one formula for all engines.

*Across* and *up* are tangents of angles from the lamp's axis, to its right and upwards. Below the cut-off the beam is brightest
near the axis and falls off on all sides. Above it, only stray light is left. The cut-off is level to the left of the axis and
rises by 15° to the right: the asymmetrical passing beam of UN Regulation 112, for right-hand traffic. With 12,000 cd and an aim
of 0.57° below the horizontal, the numbers meet the regulation's limits (class B, 01 series of amendments).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Tangents = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DippedBeam:
    """The parameters of the formula.

    Attributes:
        spread: (across, up) tangents at which the intensity has fallen to a quarter.
        rise: slope of the cut-off on the right, a tangent.
        edge: width of the transition from light to dark below the cut-off, a tangent.
        stray: share of the light above the cut-off.
    """

    spread: tuple[float, float]
    rise: float
    edge: float
    stray: float

    def share(self, across: Tangents, up: Tangents) -> Tangents:
        """Return the share of the lamp's intensity in each direction; the arrays have one shape.

        (stray + (1 − stray) · s((rise · max(across, 0) − up) / edge)) / ((1 + (across / spread₀)²)² (1 + (up / spread₁)²)²),
        where s is the cubic smooth step from 0 to 1.
        """
        below = np.clip((self.rise * np.maximum(across, 0.0) - up) / self.edge, 0.0, 1.0)
        cut = self.stray + (1.0 - self.stray) * below * below * (3.0 - 2.0 * below)
        falloff = (1.0 + (across / self.spread[0]) ** 2) * (1.0 + (up / self.spread[1]) ** 2)
        return np.asarray(cut / (falloff * falloff), np.float64)

    def flux(self) -> float:
        """Return the approximate luminous flux of a lamp of 1 cd, in lumens, without stray light and the rise of the cut-off."""
        return math.pi / 2 * self.spread[0] * math.pi / 4 * self.spread[1]


DIPPED: Final = DippedBeam(
    spread=(0.25, 0.105), rise=math.tan(math.radians(15.0)), edge=math.tan(math.radians(0.4)), stray=0.02
)
