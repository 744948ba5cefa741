"""How runs share workers and feeding window: owners equally, and the runs of an owner by weight."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Final

from valerie.db.runs import RunRow
from valerie.runs.products.progress import StageProgress
from valerie.runs.products.states import Stage

#: A deadline multiplies the weight of a run by at most this.
MOST_URGENT: Final = 8.0


def parts_of(running: Sequence[RunRow], weights: Mapping[str, float]) -> dict[str, float]:
    """Return run to its part of the whole; runs without an owner are of one, the operator.

    Args:
        running: the runs that share.
        weights: run to its weight beside other runs of its owner.
    """
    of_owner: dict[str | None, float] = defaultdict(float)
    for run in running:
        of_owner[run.owner] += weights[run.id]
    return {run.id: weights[run.id] / of_owner[run.owner] / len(of_owner) for run in running}


def weights_of(running: Sequence[RunRow], now: float) -> dict[str, float]:
    """Return run to its weight beside other runs of its owner: that of its priority times its `urgency`.

    A run needs what its slowest stage has left, at the rate that the stage has for all runs of its owner.

    Args:
        running: all running runs.
        now: Unix seconds.
    """
    rates: dict[tuple[str | None, Stage], float] = defaultdict(float)
    for run in running:
        for stage, counted in _stages(run).items():
            rates[run.owner, stage] += counted.rate_per_s

    def urgency_of(run: RunRow) -> float:
        if run.deadline is None:
            return 1.0
        times = [
            counted.unfinished / rates[run.owner, stage]
            for stage, counted in _stages(run).items()
            if rates[run.owner, stage] > 0
        ]
        return urgency(run.deadline.timestamp() - now, max(times, default=0.0))

    return {run.id: run.priority.weight * urgency_of(run) for run in running}


def urgency(left: float, needed: float) -> float:
    """Return ``left / (left - needed)``, at most `MOST_URGENT`: with it, a run beside one of equal priority gets what it needs.

    Args:
        left: seconds until the deadline.
        needed: seconds that the rest of the run takes alone.
    """
    return min(MOST_URGENT, left / (left - needed)) if left > needed else MOST_URGENT


def _stages(run: RunRow) -> Mapping[Stage, StageProgress]:
    return {} if run.progress is None else run.progress.stages
