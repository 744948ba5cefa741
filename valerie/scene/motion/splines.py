"""Cubic splines through keyframes at uneven times: C¹, local, and exactly at rest while the keyframes rest.

Between the keyframes k and k + 1, a time h apart, a value is the cubic Hermite polynomial of the values and tangents at
both ends. The tangent at a keyframe is that of the parabola through it and its neighbours, the Catmull–Rom tangent for uneven
times::

    d_k = (h_k δ_{k−1} + h_{k−1} δ_k) / (h_{k−1} + h_k)    δ_k = (p_{k+1} − p_k) / h_k

The first and the last keyframe take the tangent of their neighbour's parabola, so that movement at constant acceleration is
reproduced exactly. Before the first keyframe and after the last, the value is constant.

Sources: E. Catmull and R. Rom, "A class of local interpolating splines", Computer Aided Geometric Design, 1974, 317-326;
C. de Boor, "A Practical Guide to Splines", 1978, chapter IV (the same as Bessel's interpolation).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise


@dataclass(frozen=True, slots=True)
class Spline:
    """One number over time.

    Attributes:
        times: (K,) seconds, ascending, at least one.
        values: (K,).
        tangents: (K − 1, 2), per second, at the start and the end of each stretch between two keyframes.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]
    tangents: tuple[tuple[float, float], ...]

    def value(self, time: float) -> float:
        """Return the value at a time in seconds."""
        stretch = stretch_at(self.times, time)
        if stretch is None:
            return self.values[0] if time < self.times[0] else self.values[-1]
        u, h = self._share(stretch, time)
        if u == 0.0:
            return self.values[stretch]
        start, end = self.values[stretch : stretch + 2]
        leaving, arriving = (h * tangent for tangent in self.tangents[stretch])
        return (
            start
            + (end - start) * u * u * (3.0 - 2.0 * u)
            + u * (1.0 - u) * (leaving * (1.0 - u) - arriving * u)
        )  # fmt: skip

    def velocity(self, time: float, stretch: int | None = None) -> float:
        """Return the first derivative, per second; 0 outside the keyframes.

        Args:
            time: seconds.
            stretch: the stretch whose polynomial to use, e.g. at its end; None for the stretch that contains the time.
        """
        stretch = stretch_at(self.times, time) if stretch is None else stretch
        if stretch is None:
            return 0.0
        u, h = self._share(stretch, time)
        start, end = self.values[stretch : stretch + 2]
        leaving, arriving = self.tangents[stretch]
        rise = (end - start) / h
        return 6.0 * u * (1.0 - u) * rise + leaving * (1.0 - u) * (1.0 - 3.0 * u) + arriving * u * (3.0 * u - 2.0)

    def _share(self, stretch: int, time: float) -> tuple[float, float]:
        h = self.times[stretch + 1] - self.times[stretch]
        return (time - self.times[stretch]) / h, h


def stretch_at(times: Sequence[float], time: float) -> int | None:
    """Return the index of the stretch that contains a time, its start included and its end excluded; None outside them.

    The last keyframe itself belongs to no stretch.
    """
    index = bisect_right(times, time) - 1
    return index if 0 <= index < len(times) - 1 else None


def smooth(times: Sequence[float], values: Sequence[float], resting: Sequence[bool]) -> Spline:
    """Return the spline of the module's docstring.

    Args:
        times: (K,) seconds, ascending.
        values: (K,).
        resting: (K − 1,) True for a stretch at rest: its values are equal, and both ends have tangent 0, also on the side of
            the neighbouring stretch.
    """
    rises, steps = _rises(times, values)
    count = len(times)
    tangents = [0.0] * count
    if count == 2:
        tangents = [rises[0]] * 2
    for k in range(1, count - 1):
        tangents[k] = (steps[k] * rises[k - 1] + steps[k - 1] * rises[k]) / (steps[k - 1] + steps[k])
    if count > 2:
        tangents[0] = 2.0 * rises[0] - tangents[1]
        tangents[-1] = 2.0 * rises[-1] - tangents[-2]
    for k, rests in enumerate(resting):
        if rests:
            tangents[k] = tangents[k + 1] = 0.0
    return Spline(tuple(times), tuple(values), tuple(pairwise(tangents)))


def linear(times: Sequence[float], values: Sequence[float]) -> Spline:
    """Return straight lines between the keyframes. The velocity jumps at each keyframe."""
    rises, _ = _rises(times, values)
    return Spline(tuple(times), tuple(values), tuple((rise, rise) for rise in rises))


def unwrapped(degrees: Sequence[float]) -> tuple[float, ...]:
    """Unwrap angles so that each follows its predecessor by the shorter turn. Half a turn goes counter-clockwise (upwards)."""
    angles = [float(degrees[0])]
    for angle in degrees[1:]:
        turn = (angle - angles[-1] + 180.0) % 360.0 - 180.0
        angles.append(angles[-1] + (180.0 if turn == -180.0 else turn))
    return tuple(angles)


def _rises(times: Sequence[float], values: Sequence[float]) -> tuple[list[float], list[float]]:
    """Return the (K − 1) slopes and durations of the stretches."""
    steps = [b - a for a, b in pairwise(times)]
    return [(b - a) / h for (a, b), h in zip(pairwise(values), steps, strict=True)], steps
