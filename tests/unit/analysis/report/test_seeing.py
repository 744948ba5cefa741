import numpy as np
import pytest

from tests.planted_tables import planted_table
from valerie.analysis.report.seeing import seeing


def test_detections_that_count_without_the_person_are_lucky() -> None:
    table = planted_table([0.9, 0.8, 0.2, 0.6, np.nan], range(5), pacc_empty=[0.7, 0.1, 0.9, np.nan, np.nan])
    (row,) = seeing(table, threshold=0.5)
    # The third is luck without a detection; the fourth has no score of the empty scene.
    assert (row.persons, row.detected, row.lucky) == (3, 2, 1)
    assert (row.pacc, row.pacc_empty) == (pytest.approx(1.9 / 3), pytest.approx(1.7 / 3))


def test_nothing_is_said_where_backgrounds_were_not_inferred() -> None:
    assert seeing(planted_table([0.9], [0]), threshold=0.5) == ()
