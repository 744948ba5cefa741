from __future__ import annotations

import pytest

from valerie.pipeline.control.progress_counting import finished_per_second, seconds_left, with_waiting
from valerie.runs.products.progress import StageProgress
from valerie.runs.products.states import Stage


def steady(every_s: float, seconds: int) -> list[tuple[float, int]]:
    """Looks once a second at a stage that finishes one in every so many seconds."""
    return [(float(at), int(at / every_s)) for at in range(seconds + 1)]


@pytest.mark.parametrize("every_s", [0.1, 1.0, 7.0, 11.0])
def test_a_steady_stage_has_a_steady_rate(every_s: float) -> None:
    for seconds in range(200, 230):
        assert finished_per_second(steady(every_s, seconds)) == pytest.approx(1 / every_s, rel=0.11)


def test_a_change_of_pace_is_seen_within_half_a_minute() -> None:
    slow = steady(1.0, 100)
    then = [*slow, *((100.0 + at, 100 + 10 * at) for at in range(1, 26))]
    assert finished_per_second(then) == pytest.approx(10, rel=0.05)


def test_what_has_stopped_slows_down_until_nothing_is_known() -> None:
    stopped = [*steady(1.0, 60), *((60.0 + at, 60) for at in range(1, 41))]
    assert 0 < finished_per_second(stopped) < 0.5
    assert finished_per_second([(0.0, 5), (300.0, 5)]) == 0.0


def test_one_look_tells_nothing() -> None:
    assert finished_per_second([(3.0, 7)]) == 0.0


@pytest.mark.parametrize(
    ("history", "left", "expected"),
    [
        ([(0.0, 0), (40.0, 2)], 998, None),  # one every 20 s so far: 5 h 32 min
        ([(0.0, 100), (40.0, 109)], 998, None),  # what an earlier run finished says nothing about the rate
        ([(0.0, 0), (40.0, 10)], 90, 360.0),
        ([(0.0, 0), (300.0, 3)], 97, 9700.0),  # a slow stage has its estimate after 5 min
        ([(0.0, 0), (40.0, 3)], 0, 0.0),
        ([(0.0, 0), (600.0, 0)], 5, None),
    ],
)
def test_the_remaining_time_appears_when_ten_products_or_five_minutes_tell_the_rate(
    history: list[tuple[float, int]], left: int, expected: float | None
) -> None:
    assert seconds_left(history, left) == expected


@pytest.mark.parametrize(("infer_s", "expected"), [(4_500.0, 4_500.0), (None, None)])
def test_a_stage_that_waits_for_more_to_be_fed_ends_with_the_slowest_other(
    infer_s: float | None, expected: float | None
) -> None:
    own = {Stage.RENDER: 51_000.0, Stage.INFER: infer_s, Stage.EVAL: infer_s}
    stages = {
        stage: StageProgress(done=500, total=1_000, failed=0, running=0, rate_per_s=0.1, eta_s=seconds)
        for stage, seconds in own.items()
    }
    waiting = with_waiting(stages, [Stage.RENDER])
    assert [waiting[stage].eta_s for stage in Stage] == [expected, infer_s, infer_s]
