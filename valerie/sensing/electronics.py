"""Sensor electronics: shot noise, full well, read noise, analogue-digital converter and faulty pixels.

An exposed linear value v (1 is diffuse white) frees ``N = v · full_well / 2^headroom`` electrons on average. The pixel
counts ``Poisson(N)`` of them (shot noise). The amplifier adds a normal error with standard deviation ``read_electrons``. The
count is clipped to 0 … ``full_well``. The gain multiplies the count; it thus amplifies noise and saturates earlier. The converter
quantizes 0 … full well to ``2^bits`` levels. This is the Poisson–Gauss camera model of EMVA Standard 1288 (release 4.0, 2021,
section 2) without dark current.

From `_NORMAL_FROM` electrons on, a normal distribution of equal mean and variance replaces the Poisson distribution, whose
skewness is below 0.13 there. Only the converter rounds the result.

The seed of the noise depends on the image, and the seed of faulty pixels on the specimen. Both also depend on the run's seed, but
never on order or worker.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.sensing.settings import FaultyPixels, Noise

#: Number of electrons from which on shot noise is normally distributed.
_NORMAL_FROM: Final = 64.0

Floats = NDArray[np.float32]


def expose(values: Floats, noise: Noise, *, gain: float = 1.0, generator: np.random.Generator | None = None) -> Floats:
    """Count light in electrons and convert the count.

    Args:
        values: exposed linear values, not negative, of any shape.
        noise: noise, full well and converter of the sensor.
        gain: factor after counting.
        generator: source of random numbers; None without noise.

    Returns:
        The converter's output in units of ``values``, 0 to ``2 ** headroom_ev``, of the same shape.
    """
    scale = np.float32(noise.full_well_electrons / 2.0**noise.headroom_ev)
    full = np.float32(noise.full_well_electrons)
    # No noise reduces twice the full well to less than the full well, and more light would only lose accuracy.
    electrons: Floats = np.minimum(values * scale, np.float32(2.0) * full)
    if (noise.shot or noise.read_electrons) and generator is not None:
        electrons = _noisy(electrons, noise, generator)
    counts: Floats = np.clip(electrons, np.float32(0.0), full)
    if gain != 1.0:
        counts = np.minimum(counts * np.float32(gain), full)
    if noise.adc_bits:
        levels = np.float32(2**noise.adc_bits - 1)
        counts = np.floor(counts * (levels / full) + np.float32(0.5)) * (full / levels)
    reported: Floats = counts / scale
    return reported


def _noisy(electrons: Floats, noise: Noise, generator: np.random.Generator) -> Floats:
    read_variance = np.float32(noise.read_electrons**2)
    normal = generator.standard_normal(electrons.shape, np.float32)
    if not noise.shot:
        return electrons + np.float32(noise.read_electrons) * normal
    noisy: Floats = electrons + np.sqrt(electrons + read_variance) * normal
    few = electrons < _NORMAL_FROM
    if few.any():
        counts = generator.poisson(electrons[few]).astype(np.float32)
        noisy[few] = counts + np.float32(noise.read_electrons) * normal[few]
    return noisy


def break_pixels(values: Floats, pixels: FaultyPixels, saturated: float, generator: np.random.Generator) -> Floats:
    """Make dead pixels black and hot pixels saturated.

    A higher rate keeps the faulty pixels of a lower one. The choice of hot pixels does not depend on the rate of dead ones.

    Args:
        values: (H, W, 3) linear values.
        pixels: rates of dead and hot pixels.
        saturated: the value of a full well.
        generator: source of random numbers, seeded by the specimen.

    Returns:
        (H, W, 3), a new array.
    """
    chance = generator.random(values.shape[:2], np.float32)
    broken = values.copy()
    broken[chance < pixels.dead_rate] = 0.0
    broken[chance >= 1.0 - pixels.hot_rate] = saturated
    return broken
