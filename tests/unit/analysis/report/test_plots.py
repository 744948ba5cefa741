import io
import json
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from valerie.analysis.analyze import analyze
from valerie.analysis.report.panels import COMBINED_COLOR, make_panel
from valerie.analysis.report.plots import plotly_figure, static_figure


@pytest.fixture
def panel(dropping_table):
    trends = analyze(dropping_table).trends
    return make_panel(dropping_table, trends, "distance_m", "b-net", "default", seed=0)


def test_the_interactive_figure_draws_the_panels_points_curves_and_bins(panel):
    data = plotly_figure(panel)["data"]
    curves = [trace for trace in data if trace["mode"] == "lines" and "name" in trace]

    assert [trace["x"] for trace in data if trace["mode"] == "markers"][:2] == [list(p.x) for p in panel.points]
    assert [trace["y"] for trace in curves] == [list(line.y) for line in panel.lines]
    assert [trace["line"]["dash"] == "solid" for trace in curves] == [bool(line.low) for line in panel.lines]
    assert curves[-1]["line"]["color"] == COMBINED_COLOR
    assert data[-1]["y"] == [mark.y for mark in panel.marks]
    json.dumps(data, allow_nan=False)


def test_a_band_runs_along_the_upper_and_back_along_the_lower_bound(panel):
    band = next(trace for trace in plotly_figure(panel)["data"] if trace.get("fill") == "toself")
    line = panel.lines[0]

    assert band["y"] == [*line.high, *reversed(line.low)]
    assert band["x"] == [*line.x, *reversed(line.x)]


def test_plotly_accepts_the_figure(panel):
    graph_objects = pytest.importorskip("plotly.graph_objects")
    graph_objects.Figure(plotly_figure(panel))  # validates every key and value


def test_the_static_figure_is_a_picture_with_the_curves_colours(panel):
    picture = np.asarray(Image.open(io.BytesIO(static_figure(panel))).convert("RGB"))
    colour = [int(COMBINED_COLOR[i : i + 2], 16) for i in (1, 3, 5)]

    assert picture.shape[1] == 900
    assert (np.abs(picture.astype(int) - colour).max(axis=2) < 12).sum() > 500


def test_the_static_figure_has_the_same_bytes_each_time(panel):
    assert static_figure(panel) == static_figure(panel)


def test_the_static_figure_can_be_svg(panel):
    root = ElementTree.fromstring(static_figure(panel, image_format="svg"))
    assert root.tag.endswith("svg")
