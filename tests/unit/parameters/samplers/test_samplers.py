import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chisquare, qmc

from valerie.errors import InvalidInput
from valerie.parameters.samplers import SAMPLERS
from valerie.parameters.samplers.base import random_words
from valerie.parameters.samplers.latin_hypercube import LatinHypercubeSampler, permute
from valerie.parameters.samplers.quasi_monte_carlo import HaltonSampler, SobolSampler
from valerie.parameters.samplers.random import RandomSampler
from valerie.statistics.replicates import replicate_seeds, replicates


@pytest.mark.parametrize("name", SAMPLERS)
@given(
    count=st.integers(1, 300), dimensions=st.integers(1, 9), seed=st.integers(0, 2**128 - 1), data=st.data(),
)  # fmt: skip
@settings(max_examples=15)
def test_a_point_follows_from_seed_and_index_alone(
    name: str, count: int, dimensions: int, seed: int, data: st.DataObject
) -> None:
    start = data.draw(st.integers(0, count - 1))
    stop = data.draw(st.integers(start + 1, count))
    sampler = SAMPLERS[name](dimensions=dimensions, count=count, seed=seed)
    everything = sampler.points(0, count)
    assert everything.shape == (count, dimensions)
    assert (everything >= 0).all()
    assert (everything < 1).all()
    again = SAMPLERS[name](dimensions=dimensions, count=count, seed=seed).points(start, stop)
    assert (again == everything[start:stop]).all()


@pytest.mark.parametrize("name", SAMPLERS)
def test_seeds_give_different_points_and_zero_is_a_seed(name: str) -> None:
    zero, one = (SAMPLERS[name](dimensions=3, count=16, seed=seed).points(0, 16) for seed in (0, 1))
    assert not np.isclose(zero, one).any(axis=1).all()
    assert len(np.unique(zero[:, 0])) == 16


@pytest.mark.parametrize("count", [1, 2, 3, 5, 16, 17, 100, 1000])
def test_a_latin_hypercube_has_exactly_one_point_in_each_stratum(count: int) -> None:
    points = LatinHypercubeSampler(dimensions=4, count=count, seed=3).points(0, count)
    strata = np.floor(points * count).astype(int)
    for dimension in range(4):
        assert np.bincount(strata[:, dimension], minlength=count).tolist() == [1] * count


def test_a_million_strata_are_not_stored_and_not_missed() -> None:
    count = 1_000_000
    points = LatinHypercubeSampler(dimensions=1, count=count, seed=0).points(0, count)
    assert len(np.unique(np.floor(points * count))) == count


def test_the_permutations_of_a_latin_hypercube_are_uniform_and_independent() -> None:
    count, trials = 5, 4000
    first, pairs = np.zeros(count), np.zeros((count, count))
    for seed in range(trials):
        strata = np.floor(LatinHypercubeSampler(dimensions=2, count=count, seed=seed).points(0, 1) * count).astype(int)
        first[strata[0, 0]] += 1
        pairs[strata[0, 0], strata[0, 1]] += 1
    assert chisquare(first).pvalue > 1e-3
    assert chisquare(pairs.ravel()).pvalue > 1e-3


def test_neighbours_in_a_latin_hypercube_are_not_correlated() -> None:
    count = 4096
    points = LatinHypercubeSampler(dimensions=3, count=count, seed=1).points(0, count)
    correlations = np.corrcoef(np.column_stack([points[:-1], points[1:]]).T) - np.eye(6)
    assert np.abs(correlations).max() < 5 / np.sqrt(count)  # five standard deviations of independent points


@given(st.integers(1, 5000), st.integers(0, 2**64 - 1))
@settings(max_examples=40)
def test_the_permutation_is_a_bijection(count: int, seed: int) -> None:
    keys = random_words(seed, 0, 1, 10)[0]
    permuted = permute(np.arange(count, dtype=np.uint64), count, keys)
    assert (np.sort(permuted) == np.arange(count)).all()


def test_sobol_points_are_scipys() -> None:
    expected = qmc.Sobol(5, scramble=True, rng=np.random.default_rng(42)).random(256)
    assert (SobolSampler(dimensions=5, count=256, seed=42).points(0, 256) == expected).all()


def test_halton_points_are_scipys() -> None:
    expected = qmc.Halton(5, scramble=True, rng=np.random.default_rng(42)).random(100)
    assert (HaltonSampler(dimensions=5, count=100, seed=42).points(0, 100) == expected).all()


def test_low_discrepancy_designs_are_more_even_than_random_ones() -> None:
    discrepancy = {
        name: qmc.discrepancy(SAMPLERS[name](dimensions=3, count=512, seed=1).points(0, 512)) for name in SAMPLERS
    }
    assert discrepancy["sobol"] < discrepancy["random"] / 10
    assert discrepancy["halton"] < discrepancy["random"] / 10


def test_sobol_refuses_more_points_than_it_has() -> None:
    with pytest.raises(InvalidInput, match="count"):
        SobolSampler(dimensions=1, count=2**30 + 1, seed=0)


def test_random_points_are_uniform_and_their_words_do_not_change_between_releases() -> None:
    points = RandomSampler(dimensions=3, count=10_000, seed=7).points(0, 10_000)
    for dimension in range(3):
        assert chisquare(np.histogram(points[:, dimension], bins=20, range=(0, 1))[0]).pvalue > 1e-3
    reference = np.random.Philox(key=7).random_raw(8)
    assert (random_words(7, 0, 2, 4).ravel() == reference).all()
    assert (random_words(7, 1, 2, 3)[0] == reference[4:7]).all()


#: Name to the factory of one replicate.
REPLICATED = {"latin_hypercube": LatinHypercubeSampler, "sobol": SobolSampler, "halton": HaltonSampler}


@pytest.mark.parametrize("name", REPLICATED)
@pytest.mark.parametrize("count", [20, 37, 40, 128, 203])
def test_each_replicate_is_a_whole_design_with_a_seed_of_its_own(name: str, count: int) -> None:
    points = SAMPLERS[name](dimensions=3, count=count, seed=9).points(0, count)
    replicate = replicates(count)
    seeds = replicate_seeds(9, replicate.max() + 1)
    assert len(seeds) == (5 if count < 40 else 8)
    for number, seed in enumerate(seeds):
        own = points[replicate == number]
        whole = REPLICATED[name](dimensions=3, count=len(own), seed=seed).points(0, len(own))
        assert (own == whole).all()


@pytest.mark.parametrize("name", REPLICATED)
def test_replicates_are_scrambled_independently(name: str) -> None:
    """The means of two replicates are uncorrelated over seeds, and each has the small variance of an even design."""
    means = np.array(
        [SAMPLERS[name](dimensions=2, count=128, seed=seed).points(0, 128)[:, 0].reshape(16, 8).mean(axis=0)
         for seed in range(150)]
    )  # fmt: skip
    correlations = np.corrcoef(means.T)[np.triu_indices(8, k=1)]
    # 28 pairs of 150: |r| above 0.31 has a chance of 1 in 10,000 each.
    assert np.abs(correlations).max() < 0.31
    assert means.var() < 1 / 12 / 16 / 10


@pytest.mark.parametrize("name", REPLICATED)
def test_fewer_than_twenty_points_are_independent(name: str) -> None:
    firsts = np.array([SAMPLERS[name](dimensions=1, count=19, seed=seed).points(0, 19)[:, 0] for seed in range(200)])
    # Nineteen strata with one point each would give the same mean within 0.02; independent points vary by 0.066.
    assert firsts.mean(axis=1).std() > 0.05
