"""How far a run is: counted block by block by the control loop, written as one document, read by whoever asks.

A finished block is never counted again, so a poll costs one row however large the run is, and counting costs what the
feeding window holds.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from typing import Any, Final

from sqlalchemy import Engine

from valerie.db import processes, products, runs
from valerie.db.engine import reading, writing
from valerie.pipeline.base.deadlines import awaiting_reason, deadlines
from valerie.runs.states import UPLOADED_ROUTE

#: stage → (total, done, failed) in the counts of a block.
_STAGES: Final = {
    "render": ("frames", "rendered", "render_failed"),
    "infer": ("evaluations", "inferred", "infer_failed"),
    "eval": ("evaluations", "evaluated", "eval_failed"),
}
#: A rate is measured over this long, or longer: until so many have finished, else a slow stage's would jump with each one.
_RATE_SECONDS: Final = 20.0
_RATE_COUNT: Final = 10
_RATE_LONGEST: Final = 300.0


class ProgressBook:
    """Counts of the runs that this process looks after; what it forgets is read again from the closed blocks."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._closed: dict[str, dict[int, dict[str, int]]] = {}
        self._history: dict[str, deque[tuple[float, dict[str, int]]]] = {}

    def forget(self) -> None:
        """Another process counted meanwhile: read the closed blocks again."""
        self._closed.clear()
        self._history.clear()

    def update(self, run: Any) -> bool:
        """Count ``run`` (a row), close its finished blocks, write its progress; True when nothing is left to do."""
        now = time.time()
        with reading(self._engine) as connection:
            row = runs.get(connection, run.id)
            open_blocks = runs.open_blocks(connection, run.id)
            counted = {
                block.number: (block, runs.count_block(connection, run.id, block.first, block.last))
                for block in open_blocks
            }
            if run.id not in self._closed:
                self._closed[run.id] = dict(runs.closed_counts(connection, run.id))
            unfinished = products.unfinished_by_route(connection)
            served = {offer["route"] for offer in processes.offers(connection, now=now)} | {UPLOADED_ROUTE}
            awaited = runs.awaited_count(connection, run.id) if deadlines(row.pins) else 0
        closed = self._closed[run.id]
        for number in counted:  # a retry opened it again
            closed.pop(number, None)
        finished = {number: counts for number, (_, counts) in counted.items() if _is_final(counts)}
        total = _sum([*closed.values(), *(counts for _, counts in counted.values())])
        closed.update(finished)
        document = self._document(row, total, unfinished, served, awaited, now)
        with writing(self._engine) as connection:
            for number, counts in finished.items():
                runs.close_block(connection, run.id, number, counts)
            runs.set_values(connection, run.id, progress=document, reason=document["reason"])
        return row.next_index >= row.variant_count and len(finished) == len(counted)

    def _document(
        self,
        run: Any,
        total: dict[str, int],
        unfinished: list[tuple[str, str, int]],
        served: set[str],
        awaited: int,
        now: float,
    ) -> dict[str, Any]:
        history = self._history.setdefault(run.id, deque())
        history.append((now, total))
        while now - history[0][0] > _RATE_LONGEST and len(history) > 2:
            history.popleft()
        unfed = run.variant_count - run.next_index
        fed = max(run.next_index, 1)
        stages = {}
        for stage, (all_of, done_of, failed_of) in _STAGES.items():
            done, failed = total[done_of], total[failed_of]
            # What is not fed yet is extrapolated from what is: a later variant may still be rejected.
            expected = total[all_of] + round(total[all_of] / fed * unfed)
            rate = finished_per_second([(at, counts[done_of]) for at, counts in history])
            left = expected - done - failed
            stages[stage] = {
                "done": done,
                "total": expected,
                "failed": failed,
                "running": sum(n for route, state, n in unfinished if state == "running" and _stage(route) == stage),
                "rate_per_s": round(rate, 3),
                "eta_s": round(left / rate, 1) if rate > 0 else (0.0 if left == 0 else None),
            }
        idle = sorted({route for route, _, _ in unfinished if _stage(route) != "eval"} - served)
        return {
            "state": run.state,
            "reason": f"no living worker serves the queue {', '.join(idle)}"
            if idle
            else awaiting_reason(awaited, run.pins),
            "variants": {"total": run.variant_count, "fed": run.next_index, "rejected": run.rejected_count},
            "frames": {"fed": total["frames"], "exact": unfed == 0},
            "stages": stages,
            "awaiting": awaited,
            "updated_at": now,
        }


def finished_per_second(history: Sequence[tuple[float, int]]) -> float:
    """How fast a stage is, from (seconds, finished so far), oldest first.

    Over the last 20 s, or longer until ten have finished: one that takes ten seconds each would else be once or twice as fast
    from one look to the next.
    """
    now, done = history[-1]
    for at, before in reversed(history):
        if now - at >= _RATE_SECONDS and done - before >= _RATE_COUNT:
            break
    return (done - before) / (now - at) if now > at else 0.0


def _stage(route: str) -> str:
    return route.partition(".")[0]


def _is_final(counts: dict[str, int]) -> bool:
    return all(counts[done] + counts[failed] == counts[total] for total, done, failed in _STAGES.values())


def _sum(parts: list[dict[str, int]]) -> dict[str, int]:
    names = {name for stage in _STAGES.values() for name in stage}
    return {name: sum(part.get(name, 0) for part in parts) for name in names}
