import numpy as np
import pytest

from valerie.analysis.analyze import analyze
from valerie.analysis.panels import MAX_POINTS, make_panel
from valerie.analysis.table import EvaluationTable


@pytest.fixture(scope="module")
def trends_of():
    return lambda table: analyze(table, resamples=200).trends


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
    curves = {t.character: t.curve for t in trends.of("distance_m", "b-net", "default")}

    assert [line.character for line in panel.lines] == ["black-outfit", "yellow-shirt", "all"]
    for line in panel.lines:
        np.testing.assert_allclose(line.y, np.array(curves[line.character].y) * 100, atol=1e-3)
        assert all(low <= y <= high for low, y, high in zip(line.low, line.y, line.high, strict=True))


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


def test_binned_means_are_drawn_with_their_interval(dropping_table, trends_of):
    trends = trends_of(dropping_table)
    panel = make_panel(dropping_table, trends, "distance_m", "a-net", "default", seed=0)
    bins = next(t.bins for t in trends.of("distance_m", "a-net", "default") if t.character == "all")

    assert [mark.x for mark in panel.marks] == [b.x for b in bins if b.mean_interval]
    assert all(mark.low <= mark.y <= mark.high for mark in panel.marks)
