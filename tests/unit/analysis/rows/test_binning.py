import numpy as np
import pytest

from valerie.analysis.rows.binning import MAX_BINS, bin_edges, bins_of
from valerie.errors import InvalidInput


def test_edges_are_multiples_of_the_width_and_cover_both_ends():
    np.testing.assert_allclose(bin_edges(17.2, 38.2, 5), [15, 20, 25, 30, 35, 40])


def test_a_value_on_the_last_edge_still_has_a_bin():
    np.testing.assert_allclose(bin_edges(0.0, 0.75, 0.05)[-2:], [0.75, 0.8])


def test_a_wide_range_gets_wider_bins_instead_of_too_many():
    edges = bin_edges(0, 100, 0.05)

    assert len(edges) - 1 <= MAX_BINS
    assert edges[1] - edges[0] == pytest.approx(5)


def test_a_single_value_has_one_bin():
    np.testing.assert_allclose(bin_edges(20.0, 20.0, 5), [20, 25])


def test_a_width_of_zero_is_refused():
    with pytest.raises(InvalidInput, match="width"):
        bin_edges(0, 1, 0)


def test_bins_have_the_means_and_counts_that_numpy_computes():
    generator = np.random.default_rng(0)
    x, pacc = generator.uniform(0, 30, 600), generator.uniform(0, 1, 600)
    x[::50], pacc[::70] = np.nan, np.nan
    rows = generator.random(600) < 0.7
    edges = np.array([0.0, 5, 10, 20, 30])
    bins = bins_of(x, pacc, rows, edges=edges, threshold=0.4)

    for b, low, high in zip(bins, edges[:-1], edges[1:], strict=True):
        inside = [i for i in range(600) if rows[i] and low <= x[i] < high and pacc[i] == pacc[i]]
        assert (b.low, b.high, b.n) == (low, high, len(inside))
        assert b.mean == pytest.approx(np.mean([pacc[i] for i in inside]))
        assert b.x == pytest.approx(np.mean([x[i] for i in inside]))
        assert b.detected == sum(pacc[i] >= 0.4 for i in inside)


def test_empty_bins_are_left_out():
    x, pacc = np.array([1.0, 21.0]), np.array([0.5, 0.6])
    edges = np.array([0.0, 10, 20, 30])
    bins = bins_of(x, pacc, x > 0, edges=edges, threshold=0.5)

    assert [(b.low, b.n) for b in bins] == [(0.0, 1), (20.0, 1)]
