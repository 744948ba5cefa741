"""The statistics that a requirement can bound."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valerie.errors import InvalidInput, UnknownName
from valerie.measures import Source, measure_of, names_from
from valerie.runs.statistic import SCORES, parse_statistic

VALUES = np.array([0.0, 0.2, 0.5, 0.9, 1.0, np.nan])


@pytest.mark.parametrize(
    ("text", "quantity", "scores", "at_least"),
    [
        ("mean(pacc) >= 0.8", "mean(pacc)", [0.0, 0.2, 0.5, 0.9, 1.0], 0.8),
        ("mean( iou ) <= 30 %", "mean(iou)", [1.0, 0.8, 0.5, 0.1, 0.0], 0.7),
        ("share(pacc >= 0.5) >= 95%", "share(pacc >= 0.5)", [0, 0, 1, 1, 1], 0.95),
        ("share(pacc ≤ 20 %) ≤ 0.05", "share(pacc <= 0.2)", [0, 0, 1, 1, 1], 0.95),
        ("quantile(pacc, 0.05) >= 0.9", "share(pacc >= 0.9)", [0, 0, 0, 1, 1], 0.95),
        ("quantile(miou, 90 %) <= 0.5", "share(miou <= 0.5)", [1, 1, 1, 0, 0], 0.9),
    ],
)
def test_every_statistic_is_a_lower_bound_of_a_mean_of_scores(
    text: str, quantity: str, scores: list[float], at_least: float
) -> None:
    statistic = parse_statistic(text)
    assert statistic.quantity == quantity
    assert statistic.at_least == at_least  # exactly, so that a grid is counted exactly
    judged = statistic.scores(VALUES)
    assert judged[:-1].tolist() == pytest.approx(scores)
    assert np.isnan(judged[-1])
    own = np.array(scores, np.float64)
    assert statistic.shown(own.mean()) == pytest.approx(own.mean() if statistic.sign == ">=" else 1 - own.mean())


@given(
    st.lists(st.floats(0, 1), min_size=1, max_size=60), st.floats(0, 1), st.sampled_from([0.05, 0.1, 0.25, 0.5, 0.9])
)
def test_a_quantile_is_that_of_numpy(values: list[float], threshold: float, order: float) -> None:
    """The quantile reaches a threshold if and only if the share of values on that side does."""
    column = np.array(values)
    for sign, method in ((">=", "higher"), ("<=", "inverted_cdf")):
        statistic = parse_statistic(f"quantile(pacc, {order}) {sign} {threshold!r}")
        met = statistic.scores(column).mean() >= statistic.at_least - 1e-12
        if sign == ">=":
            # At most a share `order` of the values lies below the threshold.
            assert met == (np.count_nonzero(column < threshold) <= order * len(column) + 1e-9)
        else:
            assert met == (np.quantile(column, order, method=method) <= threshold)


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("mean(pacc)", InvalidInput, "not a statistic with a bound"),
        ("mean(pacc) > 0.8", InvalidInput, "limit: mean"),
        ("median(pacc) >= 0.8", UnknownName, "median"),
        ("mean(pac) >= 0.8", UnknownName, "did you mean pacc"),
        ("mean(occlusion_rate) >= 0.8", UnknownName, "unknown score 'occlusion_rate'"),
        ("mean(fp) <= 100", InvalidInput, "bound a share or a quantile"),
        ("mean(pacc) >= 80", InvalidInput, "between 0 and 1"),
        ("mean(pacc) >= 1e", InvalidInput, "'1e' is not a number"),
        ("share(pacc) >= 0.8", InvalidInput, "a share is of a comparison"),
        ("quantile(pacc) >= 0.8", InvalidInput, "a quantile has a score and an order"),
        ("quantile(pacc, 5) >= 0.8", InvalidInput, "between 0 and 1"),
        ("mean(pacc) >= 0.8; drop", InvalidInput, "not a statistic"),
    ],
)
def test_what_is_no_statistic_is_refused_with_the_right_form(text: str, error: type[InvalidInput], words: str) -> None:
    with pytest.raises(error, match=r"requirements\.0\.statistic") as refusal:
        parse_statistic(text, field="requirements.0.statistic")
    assert words in str(refusal.value)


@given(st.text(max_size=40))
def test_any_text_is_a_statistic_or_refused(text: str) -> None:
    for form in (text, f"mean({text}) >= 0.5", f"share(pacc >= {text}) >= 0.5", f"mean(pacc) >= {text}"):
        try:
            statistic = parse_statistic(form)
        except InvalidInput:
            continue
        assert 0 <= statistic.at_least <= 1


def test_every_score_of_a_function_can_be_bounded() -> None:
    of_persons = {"tp", "fn", "pacc", "pacc_empty"}
    assert of_persons | {"precision", "iou", "pixel_accuracy", "miou", "fwiou", "macc", "fp"} <= set(SCORES)
    for name in names_from(Source.PERSON_SCORE, Source.FRAME_SCORE):
        statistic = parse_statistic(f"share({name} >= 0.5) >= 0.5")
        assert statistic.of_persons == (measure_of(name).source is Source.PERSON_SCORE)
    assert all(parse_statistic(f"share({name} >= 0.5) >= 0.5").of_persons for name in of_persons)
