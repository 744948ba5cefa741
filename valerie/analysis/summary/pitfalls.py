"""Warnings of faults that make the numbers of a run meaningless; they precede all results."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from valerie.analysis.rows.frame_counts import frame_counts
from valerie.analysis.rows.picture_faults import picture_faults
from valerie.analysis.rows.table import EvaluationTable

_METERS: Final = " Where the exposure is fixed, auto_exposure: true meters it."
#: Advice on each fault.
_ADVICE: Final = {"black": _METERS, "white": _METERS, "constant": ""}
#: Largest number of frames that a warning lists.
_LISTED: Final = 3


def pitfalls(table: EvaluationTable) -> tuple[str, ...]:
    """Return the warnings about a run, as sentences; rates and verdicts still include all rows."""
    return (*_silent_functions(table), *_empty_pictures(table))


def _silent_functions(table: EvaluationTable) -> Iterator[str]:
    counts = frame_counts(table)
    functions = table.codes("function")
    seen = ~np.logical_or.reduce([np.zeros(len(table), bool), *picture_faults(table).values()])[counts.row]
    for name in functions.names:
        looks = functions.where(name)[counts.row]
        called, visible = (counts.tp + counts.fp)[looks].sum(), (counts.tp + counts.fn)[looks].sum()
        if visible and not called:
            reason = " Its class map may be wrong." if seen[looks].any() else ""
            yield f"{name} never predicts a person: it calls no pixel of {np.count_nonzero(looks):,} pictures person.{reason}"


def _empty_pictures(table: EvaluationTable) -> Iterator[str]:
    frames, sensors = table.codes("frame_id"), table.codes("sensor")
    measured = np.isfinite(table.numbers("picture_mean"))
    pictures = frames.index * max(len(sensors.names), 1) + sensors.index
    total = len(np.unique(pictures[measured]))
    for fault, rows in picture_faults(table).items():
        _, first = np.unique(pictures[measured & rows], return_index=True)
        faulty = np.flatnonzero(measured & rows)[first]
        if len(faulty):
            # Several pictures can share a frame: one for each sensor.
            named = list(dict.fromkeys(frames.names[frames.index[row]] for row in faulty))
            listed, more = named[:_LISTED], ", …" if len(named) > _LISTED else ""
            verb = "is" if len(faulty) == 1 else "are"
            yield f"{len(faulty):,} of {total:,} pictures {verb} {fault} (frames {', '.join(listed)}{more}).{_ADVICE[fault]}"
