"""Confusion of a function in selected evaluations, and the evaluations behind each cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from threading import Lock
from typing import Final

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from valerie.db import results
from valerie.db.archives import reading_run
from valerie.errors import InvalidInput, UnknownName
from valerie.labels import TRAIN_LABELS, VOID_NAME
from valerie.metrics.matrix import SHAPE, ConfusionMatrix
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.exploring.exploration import Exploration, Selection
from valerie.storage.codecs import decode_counts

#: Names of the rows of a matrix; its columns have these and `VOID_NAME`.
CLASSES: Final = tuple(label.name for label in TRAIN_LABELS)
#: Most evaluations of a function that are read: 76 MB, a few seconds.
MAX_EVALUATIONS: Final = 50_000
_KEPT: Final = 2


@dataclass(frozen=True, slots=True)
class ConfusionCell:
    """A cell of the matrix: pixels of the class ``truth`` that are predicted as ``predicted`` (a class, or `VOID_NAME`)."""

    truth: str
    predicted: str

    @property
    def place(self) -> tuple[int, int]:
        """Row and column of the cell.

        Raises:
            UnknownName: no such class.
        """
        for field, name, known in (
            ("truth", self.truth, CLASSES),
            ("predicted", self.predicted, (*CLASSES, VOID_NAME)),
        ):
            if name not in known:
                raise UnknownName("class", name, known, field=field)
        return CLASSES.index(self.truth), (*CLASSES, VOID_NAME).index(self.predicted)


@dataclass(frozen=True, slots=True)
class CellFrame:
    """An evaluation in a cell: the number of its first selected row, and its pixels there."""

    row: int
    pixels: int


@dataclass(frozen=True, slots=True)
class Confusion:
    """Confusion of a function in the selected evaluations.

    Attributes:
        function: its name.
        evaluations: number of them.
        classes: names of the rows; columns have the same, then void.
        counts: pixels, 19 rows of 20.
        frames: the evaluations with most pixels in the wanted cell, most first; empty without one.
    """

    function: str
    evaluations: int
    classes: tuple[str, ...]
    counts: list[list[int]]
    frames: list[CellFrame]


@dataclass(frozen=True, slots=True, eq=False)
class _Matrices:
    """The matrices of all evaluations of a function, (N, 19, 20) uint32, and the place of each (frame id, sensor)."""

    places: dict[tuple[str, str], int]
    counts: NDArray[np.uint32]


class Confusions:
    """Confusion matrices of one process; the last few functions are kept."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._lock = Lock()
        self._kept: LRUCache[tuple[tuple[str, ...], str, datetime | None], _Matrices] = LRUCache(_KEPT)

    def confusion(
        self,
        run_ids: Sequence[str],
        exploration: Exploration,
        selection: Selection,
        function: str,
        *,
        cell: ConfusionCell | None = None,
        limit: int = 48,
    ) -> Confusion:
        """Return the confusion of a function in the evaluations that have a selected row.

        Args:
            run_ids: the runs of the exploration.
            exploration, selection: the rows.
            function: one of them.
            cell: whose evaluations are wanted.
            limit: the largest number of these.

        Raises:
            UnknownName: no row has this function, or there is no such class.
            InvalidInput: the runs have more than `MAX_EVALUATIONS`.
        """
        place = None if cell is None else cell.place
        functions = exploration.table.codes("function")
        if function not in functions.names:
            raise UnknownName("function", function, functions.names, field="function")
        key = tuple(run_ids), function, exploration.read_at
        with self._lock:
            if key not in self._kept:
                self._kept[key] = self._read(run_ids, function)
            matrices = self._kept[key]
        rows, chosen = _chosen(exploration, selection.rows & functions.where(function), matrices)
        counts = matrices.counts[chosen]
        frames = []
        if place is not None:
            pixels = counts[:, place[0], place[1]]
            order = np.argsort(-pixels.astype(np.int64), kind="stable")[:limit]
            frames = [CellFrame(int(rows[k]), int(pixels[k])) for k in order if pixels[k]]
        total: ConfusionMatrix = counts.sum(axis=0, dtype=np.int64)
        return Confusion(function, len(chosen), CLASSES, total.tolist(), frames)

    def _read(self, run_ids: Sequence[str], function: str) -> _Matrices:
        places: dict[tuple[str, str], int] = {}
        counts: list[NDArray[np.uint32]] = []
        for run_id in run_ids:
            spec = read_run(self._context, run_id).resolved.spec
            if function not in spec.functions:
                continue
            with reading_run(self._context.engine, run_id) as connection:
                for sensor, setting in enumerate(spec.sensors):
                    predictions = results.predictions(connection, run_id, sensor, spec.functions.index(function))
                    if len(counts) + len(predictions) > MAX_EVALUATIONS:
                        raise InvalidInput(
                            "too many evaluations for a confusion matrix", field="run", limit=f"{MAX_EVALUATIONS:,}"
                        )
                    for frame, stored in predictions.items():
                        places[str(frame), setting.name] = len(counts)
                        counts.append(decode_counts(stored.confusion).astype(np.uint32))
        return _Matrices(places, np.array(counts, np.uint32).reshape(-1, *SHAPE))


def _chosen(
    exploration: Exploration, rows: NDArray[np.bool_], matrices: _Matrices
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first row of each evaluation among some rows, and the place of its matrix."""
    numbers = np.flatnonzero(rows)
    frames, sensors = (exploration.table.codes(name) for name in ("frame_id", "sensor"))
    evaluation = frames.index[numbers] * len(sensors.names) + sensors.index[numbers]
    _, first = np.unique(evaluation, return_index=True)
    numbers = numbers[np.sort(first)]
    names = [(frames.names[frames.index[n]], sensors.names[sensors.index[n]]) for n in numbers.tolist()]
    # A row may be newer than the matrices.
    known = [
        (n, matrices.places[name]) for n, name in zip(numbers.tolist(), names, strict=True) if name in matrices.places
    ]
    pairs = np.array(known, np.int64).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
