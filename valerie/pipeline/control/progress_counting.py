"""Count the progress of runs, block by block, into one document.

A finished block is never counted again, so a poll reads one row, however large the run is, and the cost of counting is
bounded by the feeding window.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from sqlalchemy import Engine

from valerie.db import fed_blocks, processes, runs, totals
from valerie.db.engine import database_time, reading, writing
from valerie.db.runs import RunRow
from valerie.db.totals import Backlog
from valerie.pipeline.base.deadlines import awaiting_reason, deadlines
from valerie.runs.products.progress import BlockCounts, FrameProgress, Progress, StageProgress, VariantProgress
from valerie.runs.products.states import ProductState, RunState, Stage, stage_of

#: A rate is measured over at least this time and at least this many: that of a slow stage would jump with each one.
_RATE_SECONDS: Final = 20.0
_RATE_COUNT: Final = 10
_RATE_LONGEST: Final = 300.0


@dataclass(frozen=True, slots=True)
class _Look:
    """The database at one moment: a run, and the work and workers of all runs.

    Attributes:
        now: Unix seconds.
        run: row of the run.
        total: counts of all its blocks.
        backlog: unfinished products of all runs.
        served: queues that living workers serve.
        awaited: number of its predictions that are yet to be uploaded.
    """

    now: float
    run: RunRow
    total: BlockCounts
    backlog: Sequence[Backlog]
    served: frozenset[str]
    awaited: int


class ProgressBook:
    """Counts of the runs of this process; a cache over the finished blocks."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._closed: dict[str, dict[int, BlockCounts]] = {}
        self._history: dict[str, deque[tuple[float, BlockCounts]]] = {}
        self._unfinished: dict[str, int] = {}

    def unfinished(self, run_id: str) -> int:
        """Return an upper bound of the run's unfinished products: some are shared with other runs, or within it.

        Predictions that users have yet to upload and their scores are left out.
        """
        if run_id not in self._unfinished:
            self.update(run_id)
        return self._unfinished[run_id]

    def note_fed(self, run_id: str, products: int) -> None:
        """Add products that were written since the last `update`."""
        self._unfinished[run_id] = self.unfinished(run_id) + products

    def forget(self) -> None:
        """Clear the cache, because another process has counted in the meantime."""
        self._closed.clear()
        self._history.clear()
        self._unfinished.clear()

    def update(self, run_id: str) -> bool:
        """Count a run, close its finished blocks and write its progress; return True if nothing is left to do."""
        with reading(self._engine) as connection:
            now = database_time(connection)
            run = runs.get(connection, run_id)
            counted = {
                block.number: fed_blocks.count_block(connection, run_id, block.first, block.last)
                for block in fed_blocks.open_blocks(connection, run_id)
            }
            if run_id not in self._closed:
                self._closed[run_id] = fed_blocks.closed_counts(connection, run_id)
            backlog = totals.backlog(connection)
            served = frozenset(offer.route for offer in processes.offers(connection, now=now))
            awaited = runs.awaited_count(connection, run_id) if deadlines(run.pins) else 0
        closed = self._closed[run_id]
        for number in counted:  # a retry opened it again
            closed.pop(number, None)
        total = BlockCounts.total([*closed.values(), *counted.values()])
        finished = {number: counts for number, counts in counted.items() if counts.is_final}
        closed.update(finished)
        self._unfinished[run_id] = max(0, total.unfinished - 2 * awaited)
        progress = self._progress(_Look(now, run, total, backlog, served, awaited))
        with writing(self._engine) as connection:
            for number, counts in finished.items():
                fed_blocks.close_block(connection, run_id, number, counts)
            state, reason = RunState.RUNNING, progress.reason
            if not runs.change_state(
                connection, run_id, expected=(state,), state=state, progress=progress, reason=reason
            ):  # it was paused or ended meanwhile, for a reason of its own
                runs.set_values(connection, run_id, progress=progress)
        return run.next_index >= run.variant_count and len(finished) == len(counted)

    def _progress(self, look: _Look) -> Progress:
        run = look.run
        history = self._history.setdefault(run.id, deque())
        if history and look.now < history[-1][0]:  # the clock was set back
            history.clear()
        history.append((look.now, look.total))
        while len(history) > 2 and look.now - history[1][0] >= _RATE_LONGEST:
            history.popleft()
        own = set[str]() if run.pins is None else run.pins.routes
        idle = sorted(own.intersection(route for route, _, _ in look.backlog) - look.served)
        reason = f"no living worker serves the queue {', '.join(idle)}" if idle else None
        return Progress(
            state=run.state,
            reason=reason or awaiting_reason(look.awaited, run.pins),
            variants=VariantProgress(total=run.variant_count, fed=run.next_index, rejected=run.rejected_count),
            frames=FrameProgress(fed=look.total.frames, exact=run.next_index == run.variant_count),
            stages=_stages(look, history),
            awaiting=look.awaited,
            updated_at=look.now,
        )


def _stages(look: _Look, history: Sequence[tuple[float, BlockCounts]]) -> dict[Stage, StageProgress]:
    stages = {stage: _stage_progress(stage, look, history) for stage in Stage}
    if look.run.next_index == look.run.variant_count:
        return stages
    return with_waiting(stages, [stage for stage in Stage if look.total.stage(stage).unfinished == 0])


def with_waiting(stages: Mapping[Stage, StageProgress], waiting: Collection[Stage]) -> dict[Stage, StageProgress]:
    """Give the stages that wait for more to be fed the remaining time of the slowest other stage, which decides when that is.

    A fast stage stands still while the feeding window is full. By its own rate, which falls all that time, it would never end.
    """
    times = [progress.eta_s for stage, progress in stages.items() if stage not in waiting]
    slowest = max((seconds for seconds in times if seconds is not None), default=None)
    return {
        stage: progress.model_copy(update={"eta_s": slowest}) if stage in waiting else progress
        for stage, progress in stages.items()
    }


def _stage_progress(stage: Stage, look: _Look, history: Sequence[tuple[float, BlockCounts]]) -> StageProgress:
    counts = look.total.stage(stage)
    fed, unfed = max(look.run.next_index, 1), look.run.variant_count - look.run.next_index
    # The rest is extrapolated from the variants that have rows, since later ones may be rejected.
    expected = counts.total + round(counts.total / fed * unfed)
    finished = [(at, total.stage(stage).done) for at, total in history]
    return StageProgress(
        done=counts.done,
        total=expected,
        failed=counts.failed,
        running=sum(
            products
            for route, state, products in look.backlog
            if state is ProductState.RUNNING and stage_of(route) is stage
        ),
        rate_per_s=round(finished_per_second(finished), 3),
        eta_s=seconds_left(finished, expected - counts.done - counts.failed),
    )


def finished_per_second(history: Sequence[tuple[float, int]]) -> float:
    """Return the rate of a stage, per second.

    It is measured over the last 20 s, or longer until ten have finished: otherwise the rate of a stage that takes ten
    seconds for each would double or halve from one count to the next.

    Args:
        history: (seconds, finished so far), oldest first.
    """
    now, done = history[-1]
    for at, before in reversed(history):
        if now - at >= _RATE_SECONDS and done - before >= _RATE_COUNT:
            break
    return (done - before) / (now - at) if now > at else 0.0


def seconds_left(history: Sequence[tuple[float, int]], left: int) -> float | None:
    """Return the time that the rest of a stage takes, in seconds; None while too little has finished to tell.

    Ten must have finished, or 5 min have passed: the first ones also wait for workers that start and functions that load.

    Args:
        history: (seconds, finished so far), oldest first.
        left: number that are not finished.
    """
    if left == 0:
        return 0.0
    (start, before), (now, done) = history[0], history[-1]
    rate = finished_per_second(history)
    if rate == 0 or (done - before < _RATE_COUNT and now - start < _RATE_LONGEST):
        return None
    return round(left / rate, 1)
