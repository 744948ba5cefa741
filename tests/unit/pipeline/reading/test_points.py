"""Points of scatter plots over what a run asked for and varied, against the long table."""

from __future__ import annotations

from typing import Any

import pytest

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.reading.points import plot_axes, read_points
from valerie.pipeline.reading.tables import read_table
from valerie.runs.resolving.spec import parse, resolve
from valerie.scene.assets.asset import load_asset

VARIED = "scene.person-1.trajectory.key-2.pos.x"


@pytest.fixture
def run(pipeline: Pipeline) -> str:
    """Two suns and two ways to walk, three moments each, with light."""
    document: dict[str, Any] = spec(xs=1, ys=1, cameras=["camera-2"], sequence=[3, "500 ms"], annotations=["light"])
    document["vary"] = {
        "person-1.trajectory.key-2.pos.x": {"choice": [1.0, 0.5]},
        "sun-1.elevation": {"choice": [20.0, 50.0]},
    }
    document["trajectories"] = {"person-1": [[0, -1, 4], [1, 1, 4]]}
    run_id = pipeline.submit(document)
    assert pipeline.run(run_id) == "completed"
    return run_id


def test_every_axis_of_a_run_gives_the_values_of_its_column(pipeline: Pipeline, run: str) -> None:
    stored = read_run(pipeline.context, run)
    resolved = stored.resolved
    columns = [axis.column for axis in plot_axes(resolved)]
    assert {"bearing_deg", "aspect_deg", "irradiance", "shadow_share", "contrast", "time_s", VARIED} <= set(columns)
    # The sun's elevation stands once, whichever way the sun was given; its azimuth does not differ.
    assert [column for column in columns if "sun" in column] == ["sun_elevation_deg"]
    table = [row for row in read_table(pipeline.context.engine, stored).arrow.to_pylist() if row["pacc"] is not None]
    assert len(table) == 12
    for column in columns:
        points = read_points(pipeline.context, run, column, limit=1000)
        plotted = sorted(zip(points.variant, points.time, points.x, strict=True))
        expected = ((row["variant_index"], int(row["frame_id"].rpartition(".")[2]), row[column]) for row in table)
        assert plotted == sorted(point for point in expected if point[2] is not None), column
    assert len(set(read_points(pipeline.context, run, "time_s", limit=1000).x)) == 3


def test_an_angle_with_limits_is_plotted_in_degrees() -> None:
    document: dict[str, Any] = {"name": "tilted", "asset": "urban-street", "functions": ["f"]}
    document["vary"] = {"camera-1.pitch": {"choice": [0.0, 5.0]}}
    axes = plot_axes(resolve(parse(document), load_asset("urban-street").manifest))
    assert [axis.unit for axis in axes if axis.column == "scene.camera-1.pitch"] == ["°"]
