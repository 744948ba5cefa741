"""Seamless noise: white noise filtered in the Fourier domain, so that every texture tiles by construction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float32]


def band_noise(
    shape: tuple[int, int],
    rng: np.random.Generator,
    *,
    longest: float,
    shortest: float = 2.0,
    slope: float = 1.0,
    tall: float = 1.0,
) -> Field:
    """Return periodic noise of zero mean and unit variance.

    Args:
        shape: rows, columns.
        rng: the source of the white noise.
        longest: wavelength in pixels above which there is no power.
        shortest: wavelength in pixels below which there is no power.
        slope: amplitude falls as frequency to the power −``slope`` (0 is white within the band, 1 is cloud-like).
        tall: height of a pixel on the ground as a multiple of its width. Wavelengths are in widths.
    """
    # Columns without power are left out, and the rows of negative frequencies have the gain of the positive ones.
    rows, columns = np.fft.rfftfreq(shape[0])[:, None] / tall, np.fft.rfftfreq(shape[1])
    frequency = np.hypot(rows, columns[columns <= 1.0 / shortest])
    band = (frequency >= 1.0 / longest) & (frequency <= 1.0 / shortest)
    gain = np.where(band, 1.0 / np.maximum(frequency, 1e-9) ** slope, 0.0)
    gain = np.concatenate([gain, gain[(shape[0] - 1) // 2 : 0 : -1]])
    spectrum = np.fft.rfft(rng.standard_normal(shape, np.float32))[:, : gain.shape[1]]
    noise = np.fft.irfft(np.fft.ifft(np.fft.fft(spectrum, axis=0) * gain, axis=0), shape[1])
    return (noise / max(float(noise.std()), 1e-12)).astype(np.float32)


def stretched_noise(
    shape: tuple[int, int], rng: np.random.Generator, *, rows: float, columns: float, slope: float = 1.0
) -> Field:
    """Return periodic noise with wavelengths up to ``rows`` pixels down and ``columns`` across: grain, streaks, runs."""
    spectrum = np.fft.rfft2(rng.standard_normal(shape, np.float32))
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None] * rows, np.fft.rfftfreq(shape[1])[None] * columns)
    gain = 1.0 / np.maximum(frequency, 1.0) ** (slope + 1.0)
    gain[0, 0] = 0.0
    noise = np.fft.irfft2(spectrum * gain, s=shape)
    return (noise / max(float(noise.std()), 1e-12)).astype(np.float32)


def hashed(cells: NDArray[np.int64], seed: int) -> Field:
    """Map equal integers to equal numbers in [0, 1): a colour for every stone, without a table."""
    bits = (cells.astype(np.uint64) + np.uint64(seed % 2**32)) * np.uint64(0x9E3779B97F4A7C15)
    bits ^= bits >> np.uint64(29)
    bits *= np.uint64(0xBF58476D1CE4E5B9)
    bits ^= bits >> np.uint64(32)
    return ((bits >> np.uint64(40)).astype(np.float64) / 2**24).astype(np.float32)


def smoothstep(low: float, high: float, value: NDArray[np.floating]) -> Field:
    """Return a smooth step from 0 below ``low`` to 1 above ``high``."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    smooth: Field = (t * t * (3.0 - 2.0 * t)).astype(np.float32)
    return smooth


def toward(value: Field, target: NDArray[np.floating] | float, share: NDArray[np.floating]) -> Field:
    """Return a blend: ``value`` at ``share`` 0, ``target`` at 1."""
    blend: Field = (value + (target - value) * share).astype(np.float32)
    return blend
