"""The outlook on a run's deadline, in words."""

from __future__ import annotations

import pytest

from valerie.runs.products.progress import FrameProgress, Progress, StageProgress, VariantProgress, outlook
from valerie.runs.products.states import RunState, Stage

NOW = 1_796_104_800.0
RUNNING = RunState.RUNNING


def progress(*times: float | None) -> Progress:
    """A run whose stages take so many seconds from `NOW` on."""
    stages = [StageProgress(done=1, total=9, failed=0, running=1, rate_per_s=0.1, eta_s=seconds) for seconds in times]
    return Progress(
        state=RUNNING,
        reason=None,
        variants=VariantProgress(total=1, fed=1, rejected=0),
        frames=FrameProgress(fed=1, exact=True),
        stages=dict(zip(Stage, stages, strict=False)),
        awaiting=0,
        updated_at=NOW,
    )


@pytest.mark.parametrize(
    ("counted", "state", "left", "words"),
    [
        (progress(7_200, 600, 60), RUNNING, 10_800, "deadline in 3 h 0 min, done in about 2 h 0 min"),
        (progress(7_200, 600, 60), RUNNING, 4_800, "deadline in 1 h 20 min, will be missed by about 40 min 0 s"),
        (progress(60, 60, 60), RUNNING, -600, "deadline passed 10 min 0 s ago, will be missed by about 11 min 0 s"),
        (progress(60, None, 60), RUNNING, 600, "deadline in 10 min 0 s"),
        (progress(), RUNNING, 600, "deadline in 10 min 0 s"),
        (None, RunState.SUBMITTED, 600, "deadline in 10 min 0 s"),
        (progress(60, 60, 60), RunState.PAUSED, -60, "deadline passed 1 min 0 s ago"),
        (progress(60, 60, 60), RunState.COMPLETED, 600, None),
    ],
)
def test_the_outlook_follows_from_the_slowest_stage(
    counted: Progress | None, state: RunState, left: float, words: str | None
) -> None:
    assert outlook(counted, state, left, NOW) == words


def test_time_since_the_count_has_passed() -> None:
    assert outlook(progress(90, 90, 90), RUNNING, 600, NOW + 30) == "deadline in 10 min 0 s, done in about 1 min 0 s"
    assert outlook(progress(90, 90, 90), RUNNING, 600, NOW + 300) == "deadline in 10 min 0 s, done in about 0 s"
