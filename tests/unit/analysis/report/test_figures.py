"""The numbers of a report's figures are those of the long table."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest

from valerie.analysis.analyze import analyze
from valerie.analysis.findings.importance import explanations
from valerie.analysis.report.figures import figure_tables
from valerie.analysis.rows.frame_counts import ALL
from valerie.analysis.trends.trends import Trends


@pytest.fixture(scope="module")
def trends(dropping_table):
    return analyze(dropping_table, seed=7).trends


@pytest.fixture(scope="module")
def figures(dropping_table, trends):
    return {
        name: table.to_pylist()
        for name, table in figure_tables(dropping_table, trends, explanations(dropping_table, seed=7)).items()
    }


@pytest.fixture(scope="module")
def rows(dropping_table):
    return [row for row in dropping_table.arrow.to_pylist() if row["pacc"] is not None]


def test_bins_average_the_rows_between_their_edges(figures, rows):
    counted = 0
    for part in figures["bins"]:
        inside = [
            row["pacc"]
            for row in rows
            if row["function"] == part["function"]
            and part["character"] in (row["character"], ALL)
            and row[part["column"]] is not None
            and part["low"] <= row[part["column"]] < part["high"]
        ]
        assert part["n"] == len(inside)
        assert part["mean"] == pytest.approx(np.mean(inside))
        counted += len(inside)
    assert counted > len(rows)


def test_levels_and_the_strongest_pair_average_the_rows_at_a_level(figures, rows):
    scores = defaultdict(list)
    for row in rows:
        scores[row["function"], row["camera"]].append(row["pacc"])
    cameras = [row for row in figures["levels"] if row["factor"] == "camera"]
    assert {(row["by_level"], row["level"]): (row["persons"], row["pacc"]) for row in cameras} == {
        key: (len(own), pytest.approx(np.mean(own))) for key, own in scores.items()
    }
    of_pair = [row for row in figures["strongest-pair"] if row["function"] == rows[0]["function"]]
    assert sum(row["persons"] for row in of_pair) == sum(row["function"] == rows[0]["function"] for row in rows)


def test_curves_have_their_band_and_contradicted_polynomials_are_left_out(figures, trends):
    lines = {(row["column"], row["function"], row["character"], row["line"]) for row in figures["curves"]}
    expected = set()
    for trend in trends.items:
        group = trend.column, trend.function, trend.character
        expected |= {(*group, "curve")} if trend.curve is not None else set()
        polynomial = trend.polynomial
        expected |= {(*group, "polynomial")} if polynomial is not None and not polynomial.contradicted else set()
    assert lines == expected
    banded = [row for row in figures["curves"] if row["low"] is not None]
    assert all(row["low"] <= row["pacc"] <= row["high"] for row in banded)
    # Where neighbouring places are alike, a curve has no band.
    of_curves = {(*key, "curve") for key in {key[:3] for key in lines if key[3] == "curve"}}
    without = {
        (trend.column, trend.function, trend.character, "curve")
        for trend in trends.items
        if trend.curve is not None and not trend.curve.low
    }
    columns = "column", "function", "character", "line"
    assert {tuple(row[name] for name in columns) for row in banded} == of_curves - without != set()


def test_distributions_count_each_person_once_in_each_frame(figures, dropping_table):
    views = dropping_table.arrow.select(["frame_id", "instance_id", "distance_m"]).to_pylist()
    persons = {(view["frame_id"], view["instance_id"]) for view in views if view["distance_m"] is not None}
    everyone = [row for row in figures["distributions"] if (row["column"], row["character"]) == ("distance_m", ALL)]
    assert sum(row["persons"] for row in everyone) == len(persons)
    ends = [row["value"] for row in figures["quantiles"] if (row["column"], row["character"]) == ("distance_m", ALL)]
    assert ends == sorted(ends)


def test_figures_without_numbers_are_left_out(dropping_table):
    nobody = dropping_table.select(np.zeros(len(dropping_table), np.bool_))
    assert figure_tables(nobody, Trends(0.5, 0, ()), ()) == {}
