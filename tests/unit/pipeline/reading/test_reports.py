"""Reports with another run beside: frames are the same where the scene is."""

from __future__ import annotations

import pytest

from tests.world.blank import SMALL, Pipeline
from tests.world.boxes import spec
from valerie.analysis.claims.claims import parse_claims
from valerie.db import runs
from valerie.db.engine import reading
from valerie.errors import Conflict, InvalidInput
from valerie.pipeline.reading.reports import compare_runs, report_with
from valerie.runs.moments import duration

CLAIMS = parse_claims(
    {
        "title": "A paper",
        "claims": [{"id": "seen", "says": "Everybody is seen.", "quantity": {"of": "pacc", "low": 0.99}}],
        "numbers": [{"what": "mean pACC", "of": "pacc", "value": 0.8927}],
    }
)


def test_runs_are_compared_scene_by_scene_and_the_report_shows_it(pipeline: Pipeline) -> None:
    here = pipeline.submit()
    # A row of places more, another sensor, and the variants in another order.
    there = pipeline.submit(spec(xs=5, ys=3, name="dark", sensors=[{"name": "dark", "exposure_ev": -2.0}]))
    assert [pipeline.run(run) for run in (here, there)] == ["completed"] * 2
    comparison = compare_runs(pipeline.context, here, there, claims=CLAIMS)
    assert (comparison.frames, comparison.frames_here, comparison.frames_there) == (24, 24, 30)
    assert comparison.differs == (
        "sensors.0.name (default here, dark there)",
        "sensors.0.exposure_ev (0.0 here, -2.0 there)",
    )
    (function,) = comparison.functions
    assert function.slices[0].pairs == 24  # the second person of each frame stands outside
    assert [conclusion.text for conclusion in comparison.conclusions] == ["Everybody is seen."]
    report = report_with(pipeline.context, here, claims=CLAIMS, other=there)
    assert [entry.says for entry in report.source.ledger] == ["Everybody is seen."]
    for words in (
        "Beside dark (blank)",
        "A paper: claims beside this run",
        "89.27",
        "24 frames show the same scenes",
        "Duration",
        "Report written on",
    ):
        assert words in report.html.replace("\u00a0", " ")
    with reading(pipeline.context.engine) as connection:
        spent = runs.cpu_seconds(connection, here)
    assert spent
    assert all(f"{kind} {duration(seconds)}" in report.html for kind, seconds in spent.items())


def test_another_street_and_a_running_run_are_refused(pipeline: Pipeline) -> None:
    here = pipeline.submit()
    moved = pipeline.submit(SMALL | {"constants": {"sun-1.azimuth": 77.0}})
    assert [pipeline.run(run) for run in (here, moved)] == ["completed"] * 2
    with pytest.raises(InvalidInput, match="share no scene"):
        compare_runs(pipeline.context, here, moved)
    waiting = pipeline.submit(spec(xs=1, ys=1))
    with pytest.raises(Conflict, match="has no results"):
        compare_runs(pipeline.context, here, waiting)
