"""Planted worlds have the truth that they state, and a failing cell is called failing."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import bench_coverage, planted
from valerie.statistics.replicates import replicates


@pytest.mark.parametrize("design", planted.DESIGNS)
@pytest.mark.parametrize("weigh", [planted.alike, planted.pixels])
def test_the_truth_is_what_many_draws_come_to(design: str, weigh: planted.World) -> None:
    world = planted.REPORTED["piled"]
    draws = planted.draw(world, design, units=40, repetitions=500, seed=1, replicates=replicates(40), weigh=weigh)
    per_unit = (draws.values * draws.weights).sum(axis=2), draws.weights.sum(axis=2)
    mean = per_unit[0].sum() / per_unit[1].sum()
    error = np.sqrt(((per_unit[0] - mean * per_unit[1]) ** 2).sum()) / per_unit[1].sum()
    assert abs(mean - planted.truth(world, design, weigh)) < 4 * error


def test_a_replicate_of_sobol_points_has_one_point_in_every_cell_of_its_nets() -> None:
    points: list[np.ndarray] = []

    def world(u: np.ndarray) -> np.ndarray:
        points.append(u)
        return u[..., 0]

    planted.draw(world, "sobol", units=32, repetitions=3, seed=0, replicates=np.repeat(np.arange(2), 16))
    (u,) = points
    for replicate in u[:, :, 0].reshape(-1, 16, planted.DIMENSIONS):
        for dimension in range(planted.DIMENSIONS):
            assert sorted((replicate[:, dimension] * 16).astype(int)) == list(range(16))
        # The first two dimensions are a (0, 4, 2)-net.
        assert len(set(map(tuple, (replicate[:, :2] * 4).astype(int)))) == 16


def test_no_world_is_both_for_tuning_and_reported() -> None:
    reported = {world.__name__ for world in planted.REPORTED.values()}
    assert not reported & {world.__name__ for world in planted.TUNING.values()}


def test_a_method_that_is_too_narrow_fails_its_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = bench_coverage.measure("mean", "independent", "rare", 20, worlds=planted.REPORTED, repetitions=300)
    assert cell.failures == ()
    assert cell.estimand == "design_box"
    assert cell.others["bootstrap"][0] < 0.9

    def too_narrow(draws: planted.Draws, design: str) -> object:
        for interval in intervals(draws, design):
            assert isinstance(interval, bench_coverage.Interval)
            yield bench_coverage.Interval(
                interval.estimate, interval.high, interval.estimate, 0.95, 20, interval.method, interval.estimand
            )

    intervals = bench_coverage.intervals
    monkeypatch.setattr(bench_coverage, "intervals", too_narrow)
    narrow = bench_coverage.measure("mean", "independent", "rare", 20, worlds=planted.REPORTED, repetitions=300)
    assert narrow.failures == ("coverage",)
