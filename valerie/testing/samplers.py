"""Contract of samplers: subclass `SamplerContract`, override its fixture ``factory``, and run it with pytest."""

from __future__ import annotations

import numpy as np
import pytest

from valerie.parameters.samplers import SamplerFactory


class SamplerContract:
    """Tests of a sampler. ``counts`` are the numbers of variants that they try."""

    counts: tuple[int, ...] = (1, 7, 64)

    @pytest.fixture
    def factory(self) -> SamplerFactory:
        """Return the factory of the sampler under test."""
        raise NotImplementedError("override the fixture `factory`")

    def test_points_lie_in_the_unit_cube(self, factory: SamplerFactory) -> None:
        for count in self.counts:
            points = factory(dimensions=3, count=count, seed=0).points(0, count)
            assert points.shape == (count, 3)
            assert points.dtype == np.float64
            assert ((points >= 0) & (points < 1)).all()

    def test_a_point_follows_from_seed_and_index_alone(self, factory: SamplerFactory) -> None:
        count = self.counts[-1]
        whole = factory(dimensions=2, count=count, seed=5).points(0, count)
        for start in (0, 1, count // 2, count - 1):
            alone = factory(dimensions=2, count=count, seed=5).points(start, start + 1)
            assert np.array_equal(alone[0], whole[start])

    def test_seed_zero_is_a_seed_and_seeds_differ(self, factory: SamplerFactory) -> None:
        count = self.counts[-1]

        def points(seed: int) -> np.ndarray:
            return factory(dimensions=2, count=count, seed=seed).points(0, count)

        assert np.array_equal(points(0), points(0))
        assert not np.array_equal(points(0), points(1))

    def test_one_dimension_is_enough_and_points_do_not_repeat(self, factory: SamplerFactory) -> None:
        count = self.counts[-1]
        points = factory(dimensions=1, count=count, seed=1).points(0, count)
        assert len(np.unique(points)) == count

    def test_every_quarter_of_every_axis_is_reached(self, factory: SamplerFactory) -> None:
        points = factory(dimensions=4, count=64, seed=3).points(0, 64)
        assert all(len(set((points[:, axis] * 4).astype(int))) == 4 for axis in range(4))
