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


def test_a_day_run_is_compared_with_a_dusk_run_across_the_light_that_each_holds(pipeline: Pipeline) -> None:
    day = pipeline.submit()
    dusk = pipeline.submit(SMALL | {"constants": {"sun-1.elevation": 12, "sun-1.azimuth": 250}})
    swept = pipeline.submit(
        spec(xs=4, ys=3, vary=[*SMALL["vary"], ["sun-1.elevation", "HOMOGENEOUS", 10.0, 20.0, 10.0]])
    )
    assert [pipeline.run(run) for run in (day, dusk, swept)] == ["completed"] * 3
    light = ("sun-1.elevation", "scene.sun-1.azimuth")
    comparison = compare_runs(pipeline.context, day, dusk, across=light)
    assert (comparison.frames, comparison.frames_here, comparison.frames_there) == (24, 24, 24)
    assert comparison.differs == ("sun-1.elevation (45 here, 12 there)", "sun-1.azimuth (140 here, 250 there)")
    for pair in (*comparison.functions[0].fell, *comparison.functions[0].rose):
        assert pair.frame_here.partition(".")[2] == pair.frame_there.partition(".")[2]
    # One of the two does not suffice, and the refusal names both.
    with pytest.raises(InvalidInput, match=r"--across sun-1.azimuth --across sun-1.elevation` pairs"):
        compare_runs(pipeline.context, day, dusk, across=light[:1])
    with pytest.raises(InvalidInput, match=r"--across: no parameter .* own: sun-1.azimuth, sun-1.elevation; got moon"):
        compare_runs(pipeline.context, day, dusk, across=("moon",))
    with pytest.raises(InvalidInput, match=rf"--across: varies inside run {swept}; .*: none; got sun-1.elevation"):
        compare_runs(pipeline.context, day, swept, across=light[:1])
    # No option helps where a run varies the light.
    with pytest.raises(InvalidInput, match=r"what differs: vary; no --across pairs"):
        compare_runs(pipeline.context, day, swept)


def test_a_comparison_of_selected_rows_refuses_a_selection_by_scores(pipeline: Pipeline) -> None:
    here, there = pipeline.submit(), pipeline.submit(SMALL | {"name": "again"})
    assert [pipeline.run(run) for run in (here, there)] == ["completed"] * 2
    comparison = compare_runs(pipeline.context, here, there, where="person-1.pos.y < 3.3 and camera == 'camera-1'")
    assert (comparison.frames, comparison.functions[0].slices[0].pairs) == (8, 8)
    with pytest.raises(InvalidInput, match="--where: a comparison of scores cannot select by them"):
        compare_runs(pipeline.context, here, there, where="pacc < 0.5")
    with pytest.raises(InvalidInput, match="--where: selects no row"):
        compare_runs(pipeline.context, here, there, where="person-1.pos.y > 70")


def test_another_street_and_a_running_run_are_refused(pipeline: Pipeline) -> None:
    here = pipeline.submit()
    moved = pipeline.submit(SMALL | {"constants": {"sun-1.azimuth": 77.0}})
    assert [pipeline.run(run) for run in (here, moved)] == ["completed"] * 2
    options = "--across sun-1.azimuth"
    with pytest.raises(InvalidInput, match=rf"no frame .* same scene.*: constants.* {options}` pairs") as refused:
        compare_runs(pipeline.context, here, moved)
    assert refused.value.value == moved
    waiting = pipeline.submit(spec(xs=1, ys=1))
    with pytest.raises(Conflict, match="has no results"):
        compare_runs(pipeline.context, here, waiting)
