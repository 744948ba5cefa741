"""Weights of runs by priority and deadline."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime

import pytest

from tests.world.blank import Pipeline
from valerie.db.runs import RunRow
from valerie.pipeline.control.sharing import MOST_URGENT, urgency, weights_of
from valerie.runs.products.progress import FrameProgress, Progress, StageProgress, VariantProgress
from valerie.runs.products.states import Priority, RunState, Stage

NOW = datetime(2026, 12, 1, 6, tzinfo=UTC).timestamp()


@pytest.mark.parametrize("needed", [0.0, 100.0, 1_800.0, 3_000.0, 3_150.0])
def test_beside_a_run_of_equal_priority_it_gets_at_least_what_it_needs(needed: float) -> None:
    weight = urgency(3_600.0, needed)
    assert 3_600.0 * weight / (weight + 1) >= needed
    assert 1.0 <= weight <= MOST_URGENT


def test_it_grows_as_the_time_gets_short_and_keeps_its_bound_after_the_deadline() -> None:
    weights = [urgency(float(left), 100.0) for left in range(10_000, -200, -10)]
    assert weights == sorted(weights)
    assert weights[0] == pytest.approx(1.0, abs=0.02)
    assert {urgency(left, 100.0) for left in (110.0, 100.0, 0.0, -1e6, -math.inf)} == {MOST_URGENT}


def counted(run: RunRow, left: int, rate: float) -> RunRow:
    """A run with so many frames and evaluations left, of which so many end per second."""
    stage = StageProgress(done=10, total=left + 12, failed=2, running=0, rate_per_s=rate, eta_s=None)
    progress = Progress(
        state=RunState.RUNNING,
        reason=None,
        variants=VariantProgress(total=1, fed=1, rejected=0),
        frames=FrameProgress(fed=1, exact=True),
        stages=dict.fromkeys(Stage, stage),
        awaiting=0,
        updated_at=NOW,
    )
    return replace(run, progress=progress)


def in_hours(hours: float) -> datetime:
    return datetime.fromtimestamp(NOW + 3600 * hours, UTC)


def test_what_a_run_needs_is_measured_by_all_runs_of_its_owner(pipeline: Pipeline) -> None:
    ids = [pipeline.submit(owner=owner) for owner in ("a", "a", "b")]
    urgent, other, foreign = (pipeline.row(run_id) for run_id in ids)
    urgent = replace(counted(urgent, left=3_600, rate=0.5), deadline=in_hours(2))
    runs = [urgent, counted(other, left=9_999, rate=0.5), counted(foreign, left=9_999, rate=100.0)]
    # Alone, it would take an hour of its two.
    assert weights_of(runs, NOW) == dict(zip(ids, [2.0, 1.0, 1.0], strict=True))
    assert weights_of(runs, NOW + 2 * 3600)[urgent.id] == MOST_URGENT


def test_priority_counts_too_and_a_deadline_far_ahead_or_unmeasured_does_nothing(pipeline: Pipeline) -> None:
    high = pipeline.row(pipeline.submit(priority=Priority.HIGH))
    assert weights_of([replace(high, deadline=in_hours(1))], NOW) == {high.id: 4.0}
    slow = replace(counted(high, left=3_600, rate=0.0), deadline=in_hours(1))
    assert weights_of([slow], NOW) == {high.id: 4.0}
    late = replace(counted(high, left=1, rate=1.0), deadline=in_hours(-1))
    assert weights_of([late], NOW) == {high.id: 4.0 * MOST_URGENT}
