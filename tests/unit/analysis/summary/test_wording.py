"""Sentences about missing intervals."""

import numpy as np
import pytest

from valerie.analysis.summary.wording import refusal_sentences
from valerie.statistics.intervals import mean_interval
from valerie.statistics.units import Units, sampling_units

TWENTY = sampling_units("random", np.arange(20))


@pytest.mark.parametrize(
    ("units", "weights", "words"),
    [
        (sampling_units("grid", np.arange(20)), np.ones(20), ("listed", "5 more sites")),
        (sampling_units("random", np.arange(20) // 5), np.ones(20), ("4 variants are too few", "2 more would do")),
        (TWENTY, np.r_[np.ones(19), 200.0], ("20 variants are worth only 1.2 of equal size",)),
    ],
)
def test_a_missing_interval_has_one_sentence_however_often_it_is_missing(
    units: Units, weights: np.ndarray, words: tuple[str, ...]
) -> None:
    refusal = mean_interval(np.linspace(0.1, 0.9, 20), units, weights=weights)
    present = mean_interval(np.linspace(0.1, 0.9, 20), TWENTY)
    (sentence,) = refusal_sentences([refusal, None, present, refusal])
    assert sentence.startswith("No confidence interval: ")
    assert all(word in sentence for word in words)
