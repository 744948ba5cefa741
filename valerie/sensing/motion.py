"""Motion blur.

It needs the scene at moments other than the frame's. A surface point that is at p now and moves with velocity v(p) is at
q = p + v(p) t at time t. The output is computed pixel by pixel, so the task is to find p for each q, and several surfaces may
arrive at q. There are three candidates: the surface at q now; the fastest surface nearby, if it really arrives at q and lies in
front; and the background that a surface uncovers as it moves away. Velocities are constant while the shutter is open.

Sources: M. Potmesil and I. Chakravarty, "Modeling motion blur in computer-generated images", SIGGRAPH 1983,
doi:10.1145/800059.801169; M. McGuire et al., "A reconstruction filter for plausible motion blur", I3D 2012,
doi:10.1145/2159616.2159639 (the fastest of a neighbourhood, and depth).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.sensing.resampling import bilinear

#: Distance of samples along the longest track, pixels, and the largest number of samples.
_STRIDE: Final = 1.0
_MOST_SAMPLES: Final = 64
#: A surface arrives if its own motion differs from the assumed motion by at most these pixels plus this share of the distance.
_NEAR_PIXELS, _NEAR_SHARE = 0.5, 0.25
#: A surface lies in front of another if its depth is below the first share of the other's. A moving surface also hides one that
#: is nearer by less than the second share, as a foot hides the ground on which it stands.
_IN_FRONT, _AT_THE_SAME_PLACE = 0.99, 1.01
#: Distance below which a surface counts as still, pixels.
_STILL: Final = 0.02

Floats = NDArray[np.float32]
Places = NDArray[np.float64]


class Movement:
    """The motion of all visible surfaces across the image.

    Args:
        velocity: (H, W, 2) float32, pixels per second to the right and down; see `valerie.rendering.annotations.flow`.
        depth: (H, W) float32, metres; inf for the sky.
    """

    def __init__(self, velocity: Floats, depth: Floats) -> None:
        self._velocity = velocity
        self._depth = depth
        self._fastest: dict[int, Floats] = {}
        #: Pixels per second.
        self.highest_speed = float(np.sqrt(np.max(np.sum(velocity.astype(np.float64) ** 2, axis=2), initial=0.0)))

    def area(self, seconds: float) -> tuple[slice, slice] | None:
        """Return the rows and columns that motion may change within ``seconds``; None if there are none."""
        moves = np.hypot(*np.moveaxis(self._dominant(seconds), 2, 0)) * seconds > _STILL
        rows, columns = np.flatnonzero(moves.any(axis=1)), np.flatnonzero(moves.any(axis=0))
        if not rows.size:
            return None
        return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)

    def source(self, x: Places, y: Places, seconds: Places | np.float64, reach_s: float) -> tuple[Places, Places]:
        """Return the coordinates, in the image of the frame's moment, of the surfaces that (x, y) show at other moments.

        Args:
            x, y: pixel coordinates; 0 is the centre of the first pixel.
            seconds: time after the frame's moment; all three shapes broadcast.
            reach_s: the largest magnitude of ``seconds``.
        """
        x, y, seconds = np.broadcast_arrays(x, y, seconds)
        here = self._nearest(x, y)
        own = self._velocity[here]
        source_x, source_y = x - own[..., 0] * seconds, y - own[..., 1] * seconds
        there = self._nearest(source_x, source_y)
        depth_here, depth_there = self._depth[here], self._depth[there]
        # An uncovered background lies farther away. A nearer surface that does not move with it must not be smeared.
        stays = ~self._arrives(self._velocity[there], own, seconds) & (depth_there < depth_here * _IN_FRONT)
        source_x, source_y = np.where(stays, x, source_x), np.where(stays, y, source_y)
        depth = np.where(stays, depth_here, depth_there)
        fastest = self._dominant(reach_s)[here]
        other_x, other_y = x - fastest[..., 0] * seconds, y - fastest[..., 1] * seconds
        there = self._nearest(other_x, other_y)
        comes = self._arrives(self._velocity[there], fastest, seconds) & (
            self._depth[there] <= depth * _AT_THE_SAME_PLACE
        )
        return np.where(comes, other_x, source_x), np.where(comes, other_y, source_y)

    def _nearest(self, x: Places, y: Places) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        height, width = self._depth.shape
        column = np.clip(np.floor(x + 0.5), 0, width - 1).astype(np.intp)
        return np.clip(np.floor(y + 0.5), 0, height - 1).astype(np.intp), column

    @staticmethod
    def _arrives(velocity: Floats, along: Floats, seconds: Places) -> NDArray[np.bool_]:
        off = np.hypot(velocity[..., 0] - along[..., 0], velocity[..., 1] - along[..., 1]) * np.abs(seconds)
        way = np.hypot(along[..., 0], along[..., 1]) * np.abs(seconds)
        fits: NDArray[np.bool_] = off <= _NEAR_PIXELS + _NEAR_SHARE * way
        return fits

    def _dominant(self, seconds: float) -> Floats:
        """Return the highest velocity, (H, W, 2), among surfaces that could reach each pixel within ``seconds``."""
        size = max(int(np.ceil(self.highest_speed * seconds)), 1)
        if size not in self._fastest:
            self._fastest[size] = _fastest_around(self._velocity, size)
        return self._fastest[size]


def collect_light(light: Floats, movement: Movement, exposure_s: float) -> Floats:
    """Return the light that an open shutter collects.

    Args:
        light: (H, W, 3), linear, in the middle of the exposure.
        movement: motion in the same image.
        exposure_s: duration of the exposure, seconds.

    Returns:
        (H, W, 3); the input array itself if nothing moves.
    """
    reach = 0.5 * exposure_s
    area = movement.area(reach)
    if area is None:
        return light
    rows, columns = area
    samples = min(int(np.ceil(movement.highest_speed * exposure_s / _STRIDE)) + 1, _MOST_SAMPLES)
    x = np.arange(columns.start, columns.stop, dtype=np.float64)[None, :]
    y = np.arange(rows.start, rows.stop, dtype=np.float64)[:, None]
    total = np.zeros((rows.stop - rows.start, columns.stop - columns.start, light.shape[2]), np.float32)
    for k in range(samples):
        offset = ((k + 0.5) / samples - 0.5) * exposure_s
        total += bilinear(light, *movement.source(x, y, np.float64(offset), reach))
    result = light.copy()
    result[area] = total / np.float32(samples)
    return result


def _fastest_around(velocity: Floats, size: int) -> Floats:
    """Return the highest velocity in each pixel's tile of ``size`` × ``size`` pixels and in the eight tiles around it."""
    height, width = velocity.shape[:2]
    down, across = -(-height // size), -(-width // size)
    padded = np.zeros((down * size, across * size, 2), np.float32)
    padded[:height, :width] = velocity
    tiles = padded.reshape(down, size, across, size, 2).swapaxes(1, 2).reshape(down, across, size * size, 2)
    index = np.argmax(np.sum(tiles * tiles, axis=3), axis=2)[..., None, None]
    best = np.take_along_axis(tiles, index, axis=2)[:, :, 0]
    around = np.zeros((down + 2, across + 2, 2), np.float32)
    around[1:-1, 1:-1] = best
    for row in range(3):
        for column in range(3):
            other = around[row : row + down, column : column + across]
            faster = np.sum(other * other, axis=2) > np.sum(best * best, axis=2)
            best = np.where(faster[..., None], other, best)
    whole: Floats = best.repeat(size, axis=0).repeat(size, axis=1)[:height, :width]
    return whole
