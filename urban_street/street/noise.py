"""Seamless noise: white noise filtered in the Fourier domain, so that every texture tiles by construction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float32]


def band_noise(
    shape: tuple[int, int], rng: np.random.Generator, *, longest: float, shortest: float = 2.0, slope: float = 1.0
) -> Field:
    """Periodic noise of zero mean and unit variance.

    Args:
        shape: rows, columns.
        rng: the source of the white noise.
        longest: wavelength in pixels above which there is no power.
        shortest: wavelength below which there is none.
        slope: amplitude falls as frequency to the minus ``slope`` (0 is white within the band, 1 is cloud-like).
    """
    spectrum = np.fft.rfft2(rng.standard_normal(shape, np.float32))
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None])
    band = (frequency >= 1.0 / longest) & (frequency <= 1.0 / shortest)
    gain = np.where(band, 1.0 / np.maximum(frequency, 1e-9) ** slope, 0.0)
    noise = np.fft.irfft2(spectrum * gain, s=shape)
    return (noise / max(float(noise.std()), 1e-12)).astype(np.float32)


def stretched_noise(
    shape: tuple[int, int], rng: np.random.Generator, *, rows: float, columns: float, slope: float = 1.0
) -> Field:
    """Periodic noise, longest ``rows`` pixels down and ``columns`` across: grain, streaks, runs."""
    spectrum = np.fft.rfft2(rng.standard_normal(shape, np.float32))
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None] * rows, np.fft.rfftfreq(shape[1])[None] * columns)
    gain = 1.0 / np.maximum(frequency, 1.0) ** (slope + 1.0)
    gain[0, 0] = 0.0
    noise = np.fft.irfft2(spectrum * gain, s=shape)
    return (noise / max(float(noise.std()), 1e-12)).astype(np.float32)


def hashed(cells: NDArray[np.int64], seed: int) -> Field:
    """Equal integers to equal numbers in [0, 1): a colour for every stone, without a table."""
    mixed = (cells.astype(np.uint64) + np.uint64(seed % 2**32)) * np.uint64(0x9E3779B97F4A7C15)
    mixed ^= mixed >> np.uint64(29)
    mixed *= np.uint64(0xBF58476D1CE4E5B9)
    mixed ^= mixed >> np.uint64(32)
    return ((mixed >> np.uint64(40)).astype(np.float64) / 2**24).astype(np.float32)


def smoothstep(low: float, high: float, value: NDArray[np.floating]) -> Field:
    """0 below ``low``, 1 above ``high``, smooth between."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    smooth: Field = (t * t * (3.0 - 2.0 * t)).astype(np.float32)
    return smooth


def srgb8(linear: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Linear reflectance in [0, 1] to sRGB bytes (IEC 61966-2-1)."""
    value = np.clip(linear, 0.0, 1.0)
    encoded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * np.power(np.maximum(value, 1e-8), 1.0 / 2.4) - 0.055)
    pixels: NDArray[np.uint8] = np.round(encoded * 255.0).astype(np.uint8)
    return pixels


def normal_map(height: NDArray[np.floating], texel: tuple[float, float]) -> NDArray[np.uint8]:
    """(H, W, 3) tangent-space normals of a periodic height field, as in glTF: x right, y up the picture, z out.

    Args:
        height: (H, W) metres.
        texel: size of a pixel in metres, across and down.
    """
    across = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) / (2.0 * texel[0])
    down = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) / (2.0 * texel[1])
    normals = np.stack([-across, down, np.ones_like(height)], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.round(normals * 127.0 + 128.0).clip(0, 255).astype(np.uint8)


def roughness_map(roughness: NDArray[np.floating], metallic: NDArray[np.floating] | None = None) -> NDArray[np.uint8]:
    """As `Material.roughness_texture` holds them; roughness needs no finer detail than half of the colour's.

    Args:
        roughness: (H, W) in [0, 1].
        metallic: likewise; None: 0.

    Returns:
        (H / 2, W / 2, 3).
    """
    texels = np.full((roughness.shape[0] // 2, roughness.shape[1] // 2, 3), 255, np.uint8)
    texels[..., 1] = np.round(np.clip(halved(roughness), 0.0, 1.0) * 255.0)
    texels[..., 2] = 0 if metallic is None else np.round(np.clip(halved(metallic), 0.0, 1.0) * 255.0)
    return texels


def halved(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Means of two by two pixels of (H, W) or (H, W, C)."""
    height, width, *channels = values.shape
    means: NDArray[np.floating] = values.reshape(height // 2, 2, width // 2, 2, *channels).mean(axis=(1, 3))
    return means


def toward(value: Field, target: NDArray[np.floating] | float, share: NDArray[np.floating]) -> Field:
    """``value`` where ``share`` is 0, ``target`` where it is 1."""
    mixed: Field = (value + (target - value) * share).astype(np.float32)
    return mixed
