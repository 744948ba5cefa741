"""Replicates of an even design."""

from __future__ import annotations

import numpy as np
import pytest

from valerie.errors import InvalidInput
from valerie.statistics.replicates import replicate_seeds, replicates


@pytest.mark.parametrize(("count", "number"), [(1, 1), (19, 19), (20, 5), (39, 5), (40, 8), (256, 8), (1001, 8)])
def test_points_are_divided_evenly_into_replicates(count: int, number: int) -> None:
    sizes = np.bincount(replicates(count))
    assert len(sizes) == number
    assert sizes.sum() == count
    assert sizes.max() - sizes.min() <= 1


def test_every_beginning_of_a_design_has_its_replicates_alike() -> None:
    points = replicates(100)
    for stop in range(1, 101):
        sizes = np.bincount(points[:stop], minlength=8)
        assert sizes.max() - sizes.min() <= 1


def test_no_point_is_no_design() -> None:
    with pytest.raises(InvalidInput, match="count"):
        replicates(0)


def test_replicates_have_seeds_of_their_own_that_follow_from_one() -> None:
    seeds = replicate_seeds(0, 8)
    assert len(set(seeds)) == 8
    assert all(0 <= seed < 2**128 for seed in seeds)
    assert replicate_seeds(0, 8) == seeds
    assert not set(seeds) & set(replicate_seeds(1, 8))
    assert replicate_seeds(0, 5) == seeds[:5]
