import numpy as np
import pytest

from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.trends.trends import AXES, find_trends
from valerie.measures import Source
from valerie.statistics.curves import Shape


@pytest.fixture
def trends(dropping_table):
    return find_trends(dropping_table, seed=0)


def test_there_is_a_trend_per_axis_function_and_character_and_combined(trends):
    result = {(t.column, t.function, t.character) for t in trends.items}
    expected = {
        (axis.name, function, character)
        for axis in AXES
        # Light is empty in this run, and time has a single value.
        if axis.source is not Source.LIGHT and axis.name != "time_s"
        for function in ("a-net", "b-net")
        for character in ("black-outfit", "yellow-shirt", "all")
    }

    assert result == expected


def test_time_is_an_axis_of_runs_that_know_several_moments(synthetic, parameters):
    law = lambda _function, _character, distance, _occlusion, _noise: 0.9 if distance < 30 else 0.5  # noqa: E731
    rows = synthetic(law, xs=np.linspace(-2, 7, 6).tolist(), ys=np.linspace(5, 33, 8).tolist())
    for row in rows:
        row["time_s"] = row["scene.person-1.pos.y"] / 10  # as if the person walked away
    table = EvaluationTable.from_rows(rows, parameters)
    result = find_trends(table, seed=0)
    trend = next(t for t in result.of("time_s", "a-net", "default") if t.character == "all")
    assert [b.low for b in trend.bins][:2] == [0.5, 1.0]
    assert trend.bins[0].mean > trend.bins[-1].mean


def test_a_constant_law_gives_a_flat_curve(trends):
    (trend,) = [t for t in trends.of("distance_m", "b-net", "default") if t.character == "black-outfit"]

    assert trend.curve is not None
    assert trend.polynomial is not None
    assert trend.polynomial.degree == 0
    assert trend.curve.shape is Shape.LEVEL
    assert trend.polynomial.y[0] == pytest.approx(0.7, abs=0.01)
    assert trend.curve.y[0] == pytest.approx(0.7, abs=0.01)


def test_a_step_lowers_the_curve_and_shows_in_the_bins(trends):
    (trend,) = [t for t in trends.of("distance_m", "a-net", "default") if t.character == "all"]

    assert trend.curve is not None
    assert trend.curve.shape is Shape.FALLING
    assert trend.curve.y[0] == pytest.approx(0.9, abs=0.02)
    assert trend.curve.y[-1] == pytest.approx(0.5, abs=0.02)
    assert trend.curve.low[-1] <= 0.5 <= trend.curve.high[-1]
    assert all(b.mean == pytest.approx(0.9 if b.high <= 30 else 0.5, abs=0.02) for b in trend.bins)
    assert {round(b.high - b.low, 9) for b in trend.bins} == {5.0}


def test_all_characters_of_an_axis_share_their_edges(trends):
    bins = {t.character: {b.low for b in t.bins} for t in trends.of("distance_m", "a-net", "default")}

    assert bins["black-outfit"] == bins["yellow-shirt"] == bins["all"]


def test_a_single_character_has_no_trend_of_all_together(synthetic, parameters):
    rows = synthetic(lambda *law: 0.7 + 0.1 * law[-1], xs=[0.0, 2.0], ys=[5.0, 9.0, 13.0, 20.0], characters=("only",))
    table = EvaluationTable.from_rows(rows, parameters)
    trends = find_trends(table, seed=0)

    assert {t.character for t in trends.items} == {"only"}


def test_persons_without_pacc_do_not_bend_the_curve(dropping_table):
    hidden = np.zeros(len(dropping_table), bool)
    hidden[::7] = True
    columns = {name: dropping_table.arrow[name].to_pylist() for name in dropping_table.arrow.column_names}
    columns["pacc"] = [None if h else v for h, v in zip(hidden, columns["pacc"], strict=True)]
    columns["undefined_reason"] = ["fully hidden" if h else None for h in hidden]
    table = EvaluationTable.from_columns(columns, dropping_table.parameters)
    trends = find_trends(table, seed=0)
    total = sum(t.curve.rows for t in trends.items if t.column == "distance_m" and t.character == "all" and t.curve)

    assert total == len(table) - hidden.sum()
