"""Seeing, not luck: pACC compared with the score of the same pixels without the person."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from valerie.analysis.rows.frame_counts import groups, rows_of
from valerie.analysis.rows.table import EvaluationTable


@dataclass(frozen=True, slots=True)
class Seeing:
    """One group of persons whose background was inferred without movables.

    Attributes:
        function, sensor, character: the group; the character `valerie.analysis.rows.frame_counts.ALL` means all together.
        persons: number with both scores; a person counts once in each frame.
        pacc, pacc_empty: mean scores with and without the person.
        detected: number of persons with pACC ≥ the threshold.
        lucky: number of these whose pixels also reach the threshold without the person.
    """

    function: str
    sensor: str
    character: str
    persons: int
    pacc: float
    pacc_empty: float
    detected: int
    lucky: int


def seeing(table: EvaluationTable, *, threshold: float) -> tuple[Seeing, ...]:
    """Return every group in which persons have both scores."""
    pacc, empty = table.numbers("pacc"), table.numbers("pacc_empty")
    both = np.isfinite(pacc) & np.isfinite(empty)
    rows = []
    for group in groups(table):
        own = both & rows_of(table, group)
        if own.any():
            detected = own & (pacc >= threshold)
            rows.append(
                Seeing(
                    function=group.function,
                    sensor=group.sensor,
                    character=group.character,
                    persons=int(np.count_nonzero(own)),
                    pacc=float(pacc[own].mean()),
                    pacc_empty=float(empty[own].mean()),
                    detected=int(np.count_nonzero(detected)),
                    lucky=int(np.count_nonzero(detected & (empty >= threshold))),
                )
            )
    return tuple(rows)
