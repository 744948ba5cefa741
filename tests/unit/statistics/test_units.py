"""Sampling units follow from the design."""

from __future__ import annotations

import numpy as np
import pytest

from valerie.errors import InvalidInput, UnknownName
from valerie.statistics.units import Estimand, places, sampling_units


def test_a_grid_on_one_site_is_all_there_is() -> None:
    variants = np.repeat(np.arange(12), 3)
    units = sampling_units("grid", variants, sites=np.full(36, 7))
    assert units.estimand is Estimand.LISTED_GRID
    assert sampling_units("points", variants).estimand is Estimand.LISTED_GRID


def test_a_grid_on_several_sites_has_whole_sites_as_units_whatever_is_crossed_with_them() -> None:
    sites, suns, cameras = (axis.ravel() for axis in np.meshgrid([101, 7, 55], range(4), range(2), indexing="ij"))
    variants = sites * 10 + suns
    units = sampling_units("grid", variants, sites=sites)
    assert units.estimand is Estimand.SITES
    assert units.count == 3
    for camera in (0, 1):
        assert (units.index[cameras == camera] == np.repeat([2, 0, 1], 4)).all()


def test_a_random_design_has_variants_with_all_their_rows_as_units() -> None:
    units = sampling_units("random", np.array([40, 40, 12, 30, 12]), sites=np.array([1, 1, 2, 1, 2]))
    assert units.estimand is Estimand.DESIGN_BOX
    assert units.index.tolist() == [2, 2, 0, 1, 0]
    assert units.replicate is None


@pytest.mark.parametrize("design", ["sobol", "halton", "latin_hypercube"])
def test_an_even_design_keeps_the_replicate_of_each_variant(design: str) -> None:
    variants, replicate = np.array([5, 5, 6, 8, 7]), np.array([0, 0, 0, 1, 1])
    units = sampling_units(design, variants, replicate=replicate)
    assert units.replicate is not None
    assert units.replicate.tolist() == [0, 0, 1, 1]
    in_one_piece = sampling_units(design, variants).replicate
    assert in_one_piece is not None
    assert in_one_piece.tolist() == [0, 0, 0, 0]


def test_units_of_fewer_rows_are_numbered_anew_and_keep_their_replicates() -> None:
    units = sampling_units("sobol", np.array([0, 1, 1, 2, 3]), replicate=np.array([0, 0, 0, 1, 1]))
    fewer = units.of(np.array([False, True, True, False, True]))
    assert fewer.index.tolist() == [0, 0, 1]
    assert fewer.count == 2
    assert fewer.replicate is not None
    assert fewer.replicate.tolist() == [0, 1]


def test_a_place_is_a_position_of_all_persons_on_one_site() -> None:
    positions = np.array([[1.0, 2.0], [1.0, 2.0], [1.0, 3.0], [1.0, 2.0]])
    assert places(positions).index.tolist() == [0, 0, 1, 0]
    on_two_sites = places(positions, np.array([4, 4, 4, 5]))
    assert on_two_sites.count == 3
    assert on_two_sites.index.tolist()[0] == on_two_sites.index.tolist()[1] != on_two_sites.index.tolist()[3]


def test_without_varied_positions_everything_is_one_place() -> None:
    assert places(np.zeros((3, 0))).index.tolist() == [0, 0, 0]


def test_an_unknown_design_is_refused_with_its_name() -> None:
    with pytest.raises(UnknownName, match="sobool"):
        sampling_units("sobool", np.arange(3))


def test_labels_need_one_entry_for_every_row() -> None:
    with pytest.raises(InvalidInput, match="sites"):
        sampling_units("grid", np.arange(3), sites=np.arange(2))


def test_a_variant_of_two_replicates_is_refused() -> None:
    with pytest.raises(InvalidInput, match="replicate"):
        sampling_units("sobol", np.array([1, 1]), replicate=np.array([0, 1]))
