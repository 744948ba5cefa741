"""What moves while the shutter is open, and while the rows are read one after another.

Both look the scene up at another moment than the frame's: what is at p now, and moves with velocity v(p), is at q = p + v(p) t
at time t. The picture is read pixel by pixel, so p has to be found for a given q, and more than one surface may come there.
Three are looked at: the one that is at q now; the fastest one in the neighbourhood that really arrives at q, if it lies in
front; and, where neither does, what the nearer one uncovers. Velocities are constant while the shutter is open.

Sources: M. Potmesil and I. Chakravarty, "Modeling motion blur in computer-generated images", SIGGRAPH 1983,
doi:10.1145/800059.801169; M. McGuire et al., "A reconstruction filter for plausible motion blur", I3D 2012,
doi:10.1145/2159616.2159639 (the fastest of a neighbourhood, and depth); C.-K. Liang et al., "Analysis and compensation of rolling
shutter effect", IEEE TIP 17(8), 2008, doi:10.1109/TIP.2008.925384.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.sensing.resampling import bilinear

#: Pixels between two looks along the longest track, and the most looks.
_STRIDE: Final = 1.0
_MOST_LOOKS: Final = 64
#: A surface arrives where its own movement fits the one looked along: to so many pixels and this share of the way.
_NEAR_PIXELS, _NEAR_SHARE = 0.5, 0.25
#: A surface lies in front of another if its depth is less than this share of the other's; what moves also hides what is no
#: farther in front of it than the second: a foot the ground on which it stands.
_IN_FRONT, _AT_THE_SAME_PLACE = 0.99, 1.01
#: Movements below this many pixels are none.
_STILL: Final = 0.02

Floats = NDArray[np.float32]
Places = NDArray[np.float64]


class Movement:
    """How everything that a camera sees moves across its image.

    Args:
        velocity: (H, W, 2) float32, pixels per second to the right and down; see `valerie.rendering.annotations.flow`.
        depth: (H, W) float32, metres; inf where nothing is hit.
    """

    def __init__(self, velocity: Floats, depth: Floats) -> None:
        self._velocity = velocity
        self._depth = depth
        self._fastest: dict[int, Floats] = {}
        #: Pixels per second.
        self.highest_speed = float(np.sqrt(np.max(np.sum(velocity.astype(np.float64) ** 2, axis=2), initial=0.0)))

    def area(self, seconds: float) -> tuple[slice, slice] | None:
        """Rows and columns outside of which nothing comes from elsewhere within so much time; None: nowhere."""
        moves = np.hypot(*np.moveaxis(self._dominant(seconds), 2, 0)) * seconds > _STILL
        rows, columns = np.flatnonzero(moves.any(axis=1)), np.flatnonzero(moves.any(axis=0))
        if not rows.size:
            return None
        return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)

    def source(self, x: Places, y: Places, seconds: Places, reach_s: float) -> tuple[Places, Places]:
        """Where in the image of the frame's moment that stands which is seen at places (x, y) at other moments.

        Args:
            x, y: pixel coordinates of any shape; 0 is the centre of the first pixel.
            seconds: after the frame's moment, of a shape that fits.
            reach_s: the largest of their magnitudes.
        """
        x, y, seconds = np.broadcast_arrays(x, y, seconds)
        here = self._nearest(x, y)
        own = self._velocity[here]
        found_x, found_y = x - own[..., 0] * seconds, y - own[..., 1] * seconds
        there = self._nearest(found_x, found_y)
        depth_here, depth_there = self._depth[here], self._depth[there]
        # What is uncovered is farther away; something nearer that does not come along must not be drawn out.
        stays = ~self._arrives(self._velocity[there], own, seconds) & (depth_there < depth_here * _IN_FRONT)
        found_x, found_y = np.where(stays, x, found_x), np.where(stays, y, found_y)
        depth = np.where(stays, depth_here, depth_there)
        fastest = self._dominant(reach_s)[here]
        other_x, other_y = x - fastest[..., 0] * seconds, y - fastest[..., 1] * seconds
        there = self._nearest(other_x, other_y)
        comes = self._arrives(self._velocity[there], fastest, seconds) & (
            self._depth[there] <= depth * _AT_THE_SAME_PLACE
        )
        return np.where(comes, other_x, found_x), np.where(comes, other_y, found_y)

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
        """(H, W, 2): the highest velocity among all that could come to a pixel within so much time."""
        size = max(int(np.ceil(self.highest_speed * seconds)), 1)
        if size not in self._fastest:
            self._fastest[size] = _fastest_around(self._velocity, size)
        return self._fastest[size]


def taken(light: Floats, movement: Movement, row_seconds: Places, exposure_s: float) -> Floats:
    """The light of a shutter that is open for a while and read row by row.

    Args:
        light: (H, W, 3), linear, of the frame's moment.
        movement: in the same image.
        row_seconds: (H, 1) or (H, W), when the exposure of each pixel is half over, after the frame's moment.
        exposure_s: how long it is.

    Returns:
        (H, W, 3); the same array where nothing moves.
    """
    reach = float(np.max(np.abs(row_seconds))) + 0.5 * exposure_s
    area = movement.area(reach)
    if area is None:
        return light
    rows, columns = area
    looks = int(np.ceil(movement.highest_speed * exposure_s / _STRIDE)) + 1 if exposure_s else 1
    looks = min(looks, _MOST_LOOKS)
    x = np.arange(columns.start, columns.stop, dtype=np.float64)[None, :]
    y = np.arange(rows.start, rows.stop, dtype=np.float64)[:, None]
    moments = row_seconds[rows] if row_seconds.shape[1] == 1 else row_seconds[rows, columns]
    total = np.zeros((rows.stop - rows.start, columns.stop - columns.start, light.shape[2]), np.float32)
    for k in range(looks):
        open_for = ((k + 0.5) / looks - 0.5) * exposure_s
        total += bilinear(light, *movement.source(x, y, moments + open_for, reach))
    result = light.copy()
    result[area] = total / np.float32(looks)
    return result


def read_times(height: int, line_time_s: float) -> Places:
    """(H, 1) seconds at which rows are read, after the frame's moment: that is when the middle of the image is read."""
    return ((np.arange(height, dtype=np.float64) - 0.5 * (height - 1)) * line_time_s)[:, None]


def _fastest_around(velocity: Floats, size: int) -> Floats:
    """The highest velocity in the tile of ``size`` × ``size`` pixels around each pixel, and in the eight tiles about it."""
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
