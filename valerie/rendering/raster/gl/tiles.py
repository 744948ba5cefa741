"""Square tiles of an image, which select the parts that a pass runs over. Rows count from the bottom, as in OpenGL."""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import View

#: Pixels per side: a multiple of a cell of sky light, and small compared with a distant person.
TILE: Final = 8

Mask = NDArray[np.bool_]
#: (N, 4) int: x0, y0, x1, y1 in pixels from the bottom left, ends exclusive; no two overlap.
Spans = NDArray[np.int64]


class Area(NamedTuple):
    """A rectangle of pixels or samples, counted from the bottom left as in OpenGL."""

    x: int
    y: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Slices (rows, columns) of an array whose rows count from the bottom."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def inside(self, other: Area) -> tuple[slice, slice]:
        """Return the slices of this area in an array that holds another one."""
        return Area(self.x - other.x, self.y - other.y, self.width, self.height).slices

    @property
    def span(self) -> Spans:
        """The area as a single part."""
        return np.array([[self.x, self.y, self.x + self.width, self.y + self.height]])

    def scaled(self, factor: int) -> Area:
        """Return the area in units that are smaller by a factor."""
        return Area(*(factor * number for number in self))

    def common(self, other: Area) -> Area:
        """Return the intersection with an area that overlaps this one."""
        x, y = max(self.x, other.x), max(self.y, other.y)
        right = min(self.x + self.width, other.x + other.width)
        top = min(self.y + self.height, other.y + other.height)
        return Area(x, y, right - x, top - y)


class TileGrid:
    """The tiles of one image size. Tiles at the right and upper border may be cut off.

    Attributes:
        shape: (rows, columns) of a mask with one entry per tile.
    """

    def __init__(self, view: View) -> None:
        self.width, self.height = view.width, view.height
        self.shape = (-(-view.height // TILE), -(-view.width // TILE))

    def none(self) -> Mask:
        """Return an empty mask."""
        return np.zeros(self.shape, np.bool_)

    def touching(self, area: Area) -> Mask:
        """Return the tiles that share a pixel with an area."""
        mask = self.none()
        x, y, width, height = area
        if width > 0 and height > 0:
            mask[y // TILE : -(-(y + height) // TILE), x // TILE : -(-(x + width) // TILE)] = True
        return mask

    def around(self, mask: Mask) -> Area:
        """Return the area of pixels that bounds a mask with at least one tile."""
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        x, y = int(columns[0]) * TILE, int(rows[0]) * TILE
        right = min((int(columns[-1]) + 1) * TILE, self.width)
        return Area(x, y, right - x, min((int(rows[-1]) + 1) * TILE, self.height) - y)

    def spans(self, mask: Mask) -> Spans:
        """Return the tiles of a mask as rectangles, one per run of neighbours in a row."""
        used = np.flatnonzero(mask.any(axis=1))
        if not used.size:
            return np.zeros((0, 4), np.int64)
        bordered = np.zeros((used.size, mask.shape[1] + 2), np.int8)
        bordered[:, 1:-1] = mask[used]
        edges = bordered[:, 1:] - bordered[:, :-1]
        row, first = np.nonzero(edges == 1)
        rows, last = used[row], np.nonzero(edges == -1)[1]
        x1, y1 = np.minimum(last * TILE, self.width), np.minimum((rows + 1) * TILE, self.height)
        return np.stack([first * TILE, rows * TILE, x1, y1], axis=1)

    def pixels(self, mask: Mask, area: Area) -> Mask:
        """Return a mask of an area's pixels, (height, width), that lie in the tiles of a mask."""
        x, y, width, height = area
        tiles = mask[y // TILE : -(-(y + height) // TILE), x // TILE : -(-(x + width) // TILE)]
        left, bottom = x % TILE, y % TILE
        return tiles.repeat(TILE, axis=0).repeat(TILE, axis=1)[bottom : bottom + height, left : left + width]

    def copy(self, pixels: NDArray[np.float16], into: NDArray[np.float16], mask: Mask, area: Area) -> None:
        """Copy those pixels of an area, (height, width, 3), that lie in the tiles of a mask."""
        # A pixel is copied ten times as fast as one opaque item than as three numbers.
        item = np.dtype((np.void, 3 * pixels.itemsize))
        np.copyto(into.view(item), pixels.view(item), where=self.pixels(mask, area)[..., None])

    def holding(self, pixels: Mask, x: int, y: int) -> Mask:
        """Return the tiles with a true pixel. ``pixels`` is a part of the image with its bottom left corner at (x, y)."""
        mask = self.none()
        height, width = pixels.shape
        if not pixels.size:
            return mask
        # Rows and columns of pixels at which a tile or the part begins.
        row_starts = np.flatnonzero((np.arange(y, y + height) % TILE == 0) | (np.arange(height) == 0))
        column_starts = np.flatnonzero((np.arange(x, x + width) % TILE == 0) | (np.arange(width) == 0))
        any_in = np.logical_or.reduceat(np.logical_or.reduceat(pixels, row_starts, axis=0), column_starts, axis=1)
        row, column = y // TILE, x // TILE
        mask[row : row + any_in.shape[0], column : column + any_in.shape[1]] = any_in
        return mask

    @staticmethod
    def reduced(values: NDArray[np.float32], *, largest: bool) -> NDArray[np.float32]:
        """Return the least (or largest) value in each tile of a part that begins at a tile's corner."""
        pick = np.maximum if largest else np.minimum
        rows, columns = np.arange(0, values.shape[0], TILE), np.arange(0, values.shape[1], TILE)
        reduced: NDArray[np.float32] = pick.reduceat(pick.reduceat(values, rows, axis=0), columns, axis=1)
        return reduced


def widened(mask: Mask, by: int = 1) -> Mask:
    """Return a mask whose true entries are spread to all neighbours at most ``by`` away, diagonals included."""
    if by < 1 or not mask.size:
        return mask
    kernel = np.ones((2 * by + 1, 2 * by + 1), np.uint8)
    # By default, a dilation treats everything outside the image as false.
    spread: Mask = cv2.dilate(mask.view(np.uint8), kernel).astype(np.bool_)
    return spread
