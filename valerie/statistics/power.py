"""Numbers of places that a test needs, to plan a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.special import nctdtr, stdtrit

from valerie.errors import InvalidInput

#: Above this many places, no run is affordable.
MAX_PLACES: Final = 10_000_000


def power(places: int, effect: float, deviation: float, *, alpha: float, parameters: int = 1) -> float:
    """Return the chance that a one-sided Student's t test at ``alpha`` detects an effect (noncentral t).

    Args:
        places: number of places.
        effect: the true mean.
        deviation: standard deviation of one place's figure.
        alpha: level in the direction of the effect; half of a two-sided level.
        parameters: coefficients that the places also have to determine (1: the mean alone).
    """
    degrees = places - parameters
    if degrees < 1:
        return 0.0
    critical = -float(stdtrit(degrees, alpha))
    shift = abs(effect) / deviation * np.sqrt(places)
    return 1.0 if shift > 37 + critical else 1 - float(nctdtr(degrees, shift, critical))


def places_needed(
    effect: float, deviation: float, *, alpha: float = 0.025, power_wanted: float = 0.9, parameters: int = 1
) -> int | None:
    """Return the smallest number of places that reaches the power; None above `MAX_PLACES`.

    Args:
        effect: difference to detect, not 0.
        deviation: standard deviation of one place's figure.
        alpha: level in the direction of the effect; half of a two-sided level.
        power_wanted: probability of detecting the effect.
        parameters: coefficients that the places also have to determine.

    Raises:
        InvalidInput: the effect is 0, or a probability lies outside 0…1.

    Source: Cohen 1988, *Statistical Power Analysis for the Behavioral Sciences*, chapter 2.
    """
    if effect == 0:
        raise InvalidInput("has to differ from 0", field="effect", value=effect)
    for field, value in (("alpha", alpha), ("power_wanted", power_wanted)):
        if not 0 < value < 1:
            raise InvalidInput("has to lie between 0 and 1", field=field, value=value)
    fewest = parameters + 1
    if deviation <= 0:
        return fewest

    def enough(places: int) -> bool:
        return power(places, effect, deviation, alpha=alpha, parameters=parameters) >= power_wanted

    return smallest(enough, fewest)


def smallest(enough: Callable[[int], bool], fewest: int) -> int | None:
    """Return the smallest number from ``fewest`` on that is enough, if more always are; None above `MAX_PLACES`."""
    high = fewest
    while not enough(high):
        high *= 2
        if high > MAX_PLACES:
            return None
    low = max(high // 2, fewest - 1)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high
