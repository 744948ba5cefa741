"""Inference engines: pieces of pictures in, ids of the function's classes out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from valerie.perception.running.adaptation import Size

Compiled = TypeVar("Compiled")


class InferenceEngine(Protocol):
    """A network that is ready to run.

    The engine does everything between 8-bit pixels and ids: channel order, normalisation, network, upsampling of the logits,
    largest class. So full-size logits never leave it.
    """

    @property
    def name(self) -> str:
        """Name of the engine, e.g. ``torch``."""
        ...

    @property
    def precision(self) -> str:
        """Precision of the computation, read back, e.g. ``fp32``."""
        ...

    @property
    def numeric_class(self) -> str:
        """Everything that may change the last bits of a result: engine, version, device, precision, kernels, threads, batch."""
        ...

    @property
    def batch_size(self) -> int:
        """Best number of pieces at once."""
        ...

    def answer(self, piece: NDArray[np.uint8]) -> NDArray[Any]:
        """Return the network's output for one piece (h, w, 3) uint8, to compare engines.

        Returns:
            Logits or probabilities (C, rows, columns) float32 in the network's resolution. A network that returns labels, or
            has one class, may return ids (h, w) instead.
        """
        ...

    def ids(self, pieces: NDArray[np.uint8], labels: Size) -> NDArray[np.uint8]:
        """Return the ids of the function's classes.

        Args:
            pieces: (n, h, w, 3) uint8 sRGB, n at most `batch_size`.
            labels: height and width of the result.

        Returns:
                (n, height, width) uint8; 255 is void.
        """
        ...

    def close(self) -> None: ...


class Recent(Generic[Compiled]):
    """Networks compiled for the last few sizes; a run uses one or two, and each has its own copy of the weights."""

    def __init__(self, compile_for: Callable[[Size, Size], Compiled], *, keep: int = 2) -> None:
        self._compile = compile_for
        self._held: LRUCache[tuple[Size, Size], Compiled] = LRUCache(keep)

    def get(self, piece: Size, labels: Size) -> Compiled:
        """Return the network for pieces and label maps of these sizes, compiled if necessary."""
        key = (piece, labels)
        if key not in self._held:
            while len(self._held) >= self._held.maxsize:  # before compiling, since each holds the weights
                self._held.popitem()
            self._held[key] = self._compile(piece, labels)
        return self._held[key]

    def clear(self) -> None:
        """Drop all compiled networks."""
        self._held.clear()
