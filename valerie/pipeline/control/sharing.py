"""How runs share workers and feeding window: owners equally, and the runs of an owner by weight."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

from valerie.db.runs import RunRow


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
