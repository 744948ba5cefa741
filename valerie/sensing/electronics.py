"""What happens between light and numbers: photons, the well, read noise, the converter, faulty pixels.

An exposed linear value v (1 is diffuse white) frees ``N = v · full_well / 2^headroom`` electrons on average. The pixel
counts ``Poisson(N)`` of them (shot noise), the amplifier adds a normal error of ``read_electrons``, the well holds no more
than ``full_well`` and no fewer than 0. The gain multiplies what was counted, so it amplifies noise and saturates earlier;
the converter tells ``2^bits`` levels apart between 0 and the full well. This is the Poisson–Gauss camera model of EMVA
Standard 1288 (release 4.0, 2021, section 2) without dark current.

From `_NORMAL_FROM` electrons on, the Poisson distribution is taken as normal with the same mean and variance, rounded by the
converter alone: its skewness is below 0.13 there.

Noise comes from a generator that is seeded per picture, faulty pixels from one that is seeded per specimen: both follow from
the run's seed and from what is in the picture, never from order or worker.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.sensing.settings import FaultyPixels, Noise

#: Electrons from which on the shot noise is drawn from a normal distribution.
_NORMAL_FROM: Final = 64.0

Floats = NDArray[np.float32]


def expose(values: Floats, noise: Noise, *, gain: float = 1.0, generator: np.random.Generator | None = None) -> Floats:
    """Count light.

    Args:
        values: any shape, exposed linear values, not negative.
        noise: the sensor.
        gain: factor after counting.
        generator: of the noise; not needed where there is none.

    Returns:
        The same shape: what the converter reports, in units of ``values``, 0 to ``2 ** headroom_ev``.
    """
    scale = np.float32(noise.full_well_electrons / 2.0**noise.headroom_ev)
    full = np.float32(noise.full_well_electrons)
    # The well is deeper than what noise can lift over it; light beyond twice its content only costs accuracy.
    electrons: Floats = np.minimum(values * scale, np.float32(2.0) * full)
    if (noise.shot or noise.read_electrons) and generator is not None:
        electrons = _noisy(electrons, noise, generator)
    counted: Floats = np.clip(electrons, np.float32(0.0), full)
    if gain != 1.0:
        counted = np.minimum(counted * np.float32(gain), full)
    if noise.adc_bits:
        levels = np.float32(2**noise.adc_bits - 1)
        counted = np.floor(counted * (levels / full) + np.float32(0.5)) * (full / levels)
    reported: Floats = counted / scale
    return reported


def _noisy(electrons: Floats, noise: Noise, generator: np.random.Generator) -> Floats:
    read_variance = np.float32(noise.read_electrons**2)
    drawn = generator.standard_normal(electrons.shape, np.float32)
    if not noise.shot:
        return electrons + np.float32(noise.read_electrons) * drawn
    noisy: Floats = electrons + np.sqrt(electrons + read_variance) * drawn
    few = electrons < _NORMAL_FROM
    if few.any():
        counted = generator.poisson(electrons[few]).astype(np.float32)
        noisy[few] = counted + np.float32(noise.read_electrons) * drawn[few]
    return noisy


def break_pixels(values: Floats, pixels: FaultyPixels, saturated: float, generator: np.random.Generator) -> Floats:
    """Dead pixels see nothing, hot ones are always full.

    A higher rate keeps the faulty pixels of a lower one. Hot pixels do not depend on how many are dead.

    Args:
        values: (H, W, 3) linear values.
        pixels: shares of the pixels.
        saturated: the value of a full well.
        generator: of the specimen.

    Returns:
        (H, W, 3), a new array.
    """
    chance = generator.random(values.shape[:2], np.float32)
    broken = values.copy()
    broken[chance < pixels.dead_rate] = 0.0
    broken[chance >= 1.0 - pixels.hot_rate] = saturated
    return broken
