"""Curves of car bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PchipInterpolator

from urban_street.solids.surfaces import Floats


class PlanOutline:
    """Half of a plan outline (x ≥ 0), from the middle of the tail to the middle of the nose, by arc length.

    Args:
        points: (M, 2) control points (x, y), metres. The first and the last have x = 0.
    """

    def __init__(self, points: ArrayLike) -> None:
        control = np.asarray(points, np.float64)
        chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(control, axis=0), axis=1))])
        ends: Any = ((1, np.array([1.0, 0.0])), (1, np.array([-1.0, 0.0])))
        spline = CubicSpline(chord, control, bc_type=ends)
        fine = spline(np.linspace(0.0, chord[-1], 1501))
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
        self.length = float(arc[-1])
        self._curve = CubicSpline(arc[::10], fine[::10], bc_type=ends)
        self._slope = self._curve.derivative()
        self._arc, self._y = arc, np.maximum.accumulate(fine[:, 1])
        self._x = fine[:, 0]

    def at(self, t: Floats) -> tuple[Floats, Floats]:
        """Return the points, (N, 2), and outward unit normals, (N, 2), at arc lengths (N,)."""
        slope = self._slope(t)
        slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
        return self._curve(t), np.stack([slope[..., 1], -slope[..., 0]], -1)

    def at_y(self, y: ArrayLike) -> Floats:
        """Return the arc lengths at which the outline passes ``y``."""
        rising = self._y + 1e-9 * np.arange(len(self._y))
        return np.asarray(np.interp(np.asarray(y, np.float64), rising, self._arc))

    def at_x(self, x: ArrayLike, *, front: bool) -> Floats:
        """Return the arc lengths at which the nose, or the tail, is at distance ``x`` from the middle."""
        wide = int(np.argmax(self._x))
        distances = np.asarray(x, np.float64)
        if front:
            falling = self._x[wide:][::-1]
            return np.asarray(np.interp(distances, np.maximum.accumulate(falling), self._arc[wide:][::-1]))
        return np.asarray(np.interp(distances, np.maximum.accumulate(self._x[: wide + 1]), self._arc[: wide + 1]))


def smooth(places: Sequence[float] | Floats, values: ArrayLike) -> PchipInterpolator:
    """Return a curve through (place, value…) that does not overshoot and is level beyond its ends."""
    x = np.asarray(places, np.float64)
    y = np.asarray(values, np.float64)
    pad = 0.5 * float(np.ptp(x)) + 1.0
    return PchipInterpolator(
        np.concatenate([[x[0] - pad], x, [x[-1] + pad]]), np.concatenate([y[:1], y, y[-1:]]), extrapolate=True
    )


def hermite(knots: Floats, values: Floats, at: Floats, creases: Sequence[int] = ()) -> Floats:
    """Interpolate row-wise by cubics: row n of ``values`` (N, K) over row n of ``knots`` (N, K), at (N,) places.

    Tangents are those of the parabola through three neighbours. At a crease, each side has its own.
    """
    width = np.diff(knots, axis=1)
    slope = np.diff(values, axis=1) / width
    inner = (slope[:, :-1] * width[:, 1:] + slope[:, 1:] * width[:, :-1]) / (width[:, :-1] + width[:, 1:])
    right = np.concatenate([slope[:, :1], inner, slope[:, -1:]], axis=1)  # tangent of the piece that begins here
    left = right.copy()
    for k in creases:
        right[:, k], left[:, k] = slope[:, k], slope[:, k - 1]
    piece = np.clip((knots[:, 1:-1] <= at[:, None]).sum(axis=1), 0, knots.shape[1] - 2)
    row = np.arange(len(at))
    h = width[row, piece]
    t = (at - knots[row, piece]) / h
    v0, v1 = values[row, piece], values[row, piece + 1]
    m0, m1 = right[row, piece] * h, left[row, piece + 1] * h
    return np.asarray(
        (2 * t**3 - 3 * t**2 + 1) * v0 + (t**3 - 2 * t**2 + t) * m0 + (3 * t**2 - 2 * t**3) * v1 + (t**3 - t**2) * m1
    )
