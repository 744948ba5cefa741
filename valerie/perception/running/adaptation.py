"""Conversion of frames of any size to the input of a network, and of its labels to the frame's pixels.

A frame becomes one or more *pieces* of one size. The engine returns a label map for each piece. The maps are joined so that
every pixel of the frame has exactly one label and no padding remains.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.perception.documents.function import InputDocument


class Size(NamedTuple):
    """Height and width in pixels."""

    height: int
    width: int


class Span(NamedTuple):
    """One tile along one axis of the frame.

    Attributes:
        start: first pixel of the tile.
        first, end: the pixels of the frame that take their label from the tile, ``first`` inclusive.
    """

    start: int
    first: int
    end: int


@dataclass(frozen=True, slots=True)
class Adaptation:
    """The adaptation of frames of one size.

    Attributes:
        frame: size of the frames.
        piece: size of the network's input.
        labels: size of the engine's label map of a piece: the piece's, or the frame's if the frame was resized.
        rows, columns: tiles along each axis; one of each unless the frame is tiled.
    """

    frame: Size
    piece: Size
    labels: Size
    rows: tuple[Span, ...]
    columns: tuple[Span, ...]

    def pieces(self, picture: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
        """Cut a frame (H, W, 3) uint8 into pieces (h, w, 3), row by row."""
        if self.labels != self.piece:
            return [_resized(picture, self.piece)]
        return [
            _padded(picture[row.start :, column.start :][: self.piece.height, : self.piece.width], self.piece)
            for row in self.rows
            for column in self.columns
        ]

    def joined(self, labels: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
        """Join the label maps of the pieces, in their order, to (H, W)."""
        whole = np.empty(self.frame, np.uint8)
        places = [(row, column) for row in self.rows for column in self.columns]
        for (row, column), piece in zip(places, labels, strict=True):
            inside = piece[
                row.first - row.start : row.end - row.start, column.first - column.start : column.end - column.start
            ]
            whole[row.first : row.end, column.first : column.end] = inside
        return whole


def plan(document: InputDocument, height: int, width: int) -> Adaptation:
    """Return the plan for frames of a size.

    Raises:
        InvalidInput: the frame is larger than the fixed input of a network in mode ``pad``.
    """
    frame = Size(height, width)
    whole = (Span(0, 0, height),), (Span(0, 0, width),)
    if document.longest_side is not None and max(frame) > document.longest_side:
        return Adaptation(frame, _reduced(frame, document.longest_side, document.multiple_of), frame, *whole)
    if document.size is None:
        step = document.multiple_of
        piece = Size(height + -height % step, width + -width % step)
    else:
        piece = Size(document.size[1], document.size[0])
    if document.mode == "tile":
        rows = _spans(height, piece.height, document.overlap)
        return Adaptation(frame, piece, piece, rows, _spans(width, piece.width, document.overlap))
    if document.mode == "resize":
        return Adaptation(frame, piece, frame, *whole)
    if height > piece.height or width > piece.width:
        raise InvalidInput(
            "the frame is larger than the function's input; use mode resize or tile",
            field="input.size",
            value=f"{width} × {height}",
            limit=f"{piece.width} × {piece.height}",
        )
    return Adaptation(frame, piece, piece, *whole)


def _reduced(frame: Size, longest: int, step: int) -> Size:
    """Return the size with ``longest`` as its longer side, each side at the nearest multiple of ``step`` up to ``longest``."""
    factor, most = longest / max(frame), longest // step * step
    height, width = (min(max(step, round(side * factor / step) * step), most) for side in frame)
    return Size(height, width)


def _spans(length: int, tile: int, overlap: int) -> tuple[Span, ...]:
    """Return the fewest tiles that keep the overlap, evenly spaced, with a seam in the middle of each overlap."""
    if length <= tile:
        return (Span(0, 0, length),)
    count = math.ceil((length - overlap) / (tile - overlap))
    starts = [number * (length - tile) // (count - 1) for number in range(count)]
    seams = [0, *((after + before + tile) // 2 for before, after in pairwise(starts)), length]
    return tuple(Span(start, *seam) for start, seam in zip(starts, pairwise(seams), strict=True))


def _padded(picture: NDArray[np.uint8], size: Size) -> NDArray[np.uint8]:
    """Pad by repeating the last row and column: a new colour at the edge would change labels inside."""
    down, right = size.height - picture.shape[0], size.width - picture.shape[1]
    if down == right == 0:
        return picture
    return np.pad(picture, ((0, down), (0, right), (0, 0)), mode="edge")


def _resized(picture: NDArray[np.uint8], size: Size) -> NDArray[np.uint8]:
    """Resample by averaging areas if both sides shrink, else bilinearly, with pixel centres at halves."""
    shrinks = size.height <= picture.shape[0] and size.width <= picture.shape[1]
    resized = cv2.resize(
        np.ascontiguousarray(picture),
        (size.width, size.height),
        interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR_EXACT,
    )
    return np.asarray(resized, np.uint8)
