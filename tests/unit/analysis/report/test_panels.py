from dataclasses import replace

import numpy as np
import pytest

from valerie.analysis.analyze import analyze
from valerie.analysis.report.panels import MAX_POINTS, make_panel
from valerie.analysis.rows.table import EvaluationTable


@pytest.fixture(scope="module")
def trends_of():
    return lambda table: analyze(table).trends


def test_a_panel_has_a_point_for_every_person_in_shown_units(dropping_table, trends_of):
    panel = make_panel(dropping_table, trends_of(dropping_table), "occlusion_rate", "a-net", "default", seed=0)
    rows = dropping_table.codes("function").where("a-net") & dropping_table.codes("character").where("black-outfit")
    (points,) = [p for p in panel.points if p.character == "black-outfit"]

    assert panel.total == panel.drawn == 900
    np.testing.assert_allclose(points.x, dropping_table.numbers("occlusion_rate")[rows] * 100, atol=1e-3)
    np.testing.assert_allclose(points.y, dropping_table.numbers("pacc")[rows] * 100, atol=1e-2)
    assert points.frames == tuple(dropping_table.arrow["frame_id"].filter(rows).to_pylist())


def test_curves_are_drawn_in_per_cent_for_each_character_and_combined(dropping_table, trends_of):
    trends = trends_of(dropping_table)
    panel = make_panel(dropping_table, trends, "distance_m", "b-net", "default", seed=0)
    shown = {t.character: t for t in trends.of("distance_m", "b-net", "default")}
    curves = [line for line in panel.lines if line.low]
    polynomials = [line for line in panel.lines if not line.low]

    assert [line.character for line in curves] == ["black-outfit", "yellow-shirt", "all"]
    for line in curves:
        np.testing.assert_allclose(line.y, np.array(shown[line.character].curve.y) * 100, atol=1e-3)
        assert all(low <= y <= high for low, y, high in zip(line.low, line.y, line.high, strict=True))
    for line in polynomials:
        np.testing.assert_allclose(line.y, np.array(shown[line.character].polynomial.y) * 100, atol=1e-3)
    assert polynomials


def test_a_polynomial_that_its_bins_contradict_is_named_and_not_drawn(dropping_table, trends_of):
    trends = trends_of(dropping_table)
    contradicted = tuple(
        replace(item, polynomial=replace(item.polynomial, contradicted=item.character == "all"))
        for item in trends.items
    )
    panel = make_panel(dropping_table, replace(trends, items=contradicted), "distance_m", "a-net", "default", seed=0)

    assert panel.contradicted == ("all",)
    assert [line.character for line in panel.lines if not line.low] == ["black-outfit", "yellow-shirt"]


def test_characters_differ_by_colour_and_by_symbol(dropping_table, trends_of):
    panel = make_panel(dropping_table, trends_of(dropping_table), "distance_m", "a-net", "default", seed=0)
    styles = [points.style for points in panel.points]

    assert len({style.color for style in styles}) == len({style.symbol for style in styles}) == 2


def test_of_too_many_points_a_sample_is_drawn_that_the_seed_determines(synthetic, parameters, trends_of):
    rows = synthetic(lambda *_: 0.5, xs=np.arange(20.0).tolist(), ys=np.arange(5, 35.0).tolist(), functions=("net",))
    table = EvaluationTable.from_rows(rows, parameters)
    trends = trends_of(table)
    panels = [make_panel(table, trends, "distance_m", "net", "default", seed=seed) for seed in (0, 0, 1)]

    assert panels[0].total == len(rows) > MAX_POINTS
    assert panels[0].drawn == sum(len(points.x) for points in panels[0].points) == MAX_POINTS
    assert panels[0] == panels[1] != panels[2]


def test_binned_means_are_drawn(dropping_table, trends_of):
    trends = trends_of(dropping_table)
    panel = make_panel(dropping_table, trends, "distance_m", "a-net", "default", seed=0)
    bins = next(t.bins for t in trends.of("distance_m", "a-net", "default") if t.character == "all")

    assert [(mark.x, mark.y) for mark in panel.marks] == [(b.x, 100 * b.mean) for b in bins]
    assert f"n = {bins[0].n}" in panel.marks[0].label


def test_a_character_without_a_trend_is_named(synthetic_table, trends_of):
    def law(_function, character, distance, _occlusion, noise):
        return 0.5 + 0.02 * noise - (0.02 * (distance - 20) if character == "black-outfit" else 0)

    table = synthetic_table(law, xs=[0.0, 4.0, 8.0], ys=np.arange(5, 35.0, 3).tolist(), functions=("net",))
    panel = make_panel(table, trends_of(table), "distance_m", "net", "default", seed=0)

    assert panel.level == ("yellow-shirt",)
