"""The API shows an archived run as before, and changes it only when its rows are back."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from services.api.app import create_app
from tests.world import boxes
from tests.world.archived import answers, rows_of
from tests.world.blank import street_pipeline
from tests.world.drawn import FUNCTIONS, DrawnRuns, DrawnWorld
from tests.world.drawn import spec as drawn_spec
from tests.world.serving import served
from tests.world.world import World, settings_of
from valerie.local.folder import Folder
from valerie.pipeline.base.context import open_context
from valerie.pipeline.control.refine import RefinedPart, refine_run
from valerie.pipeline.evidence.exporting import export_evidence
from valerie.pipeline.export.datasets import export_run
from valerie.pipeline.export.export_plan import ExportSettings
from valerie.pipeline.reading.reports import compare_runs, report_with
from valerie.pipeline.retraining.weakness import selected_region
from valerie.pipeline.work.replay import replay_frame
from valerie.runs.products.frame_keys import FrameKey
from valerie.settings import Settings


def shown(settings: Settings, runs: list[str]) -> dict[str, Any]:
    """Return what a fresh server shows; one that has read the runs would remember them."""
    with served(create_app(settings, control=False)) as api:
        return answers(api, runs)


def archived(settings: Settings, runs: list[str], word: str = "archive") -> None:
    with served(create_app(settings, control=False)) as api:
        for run in runs:
            answer = api.post(f"/v1/runs/{run}/{word}")
            assert (answer.status_code, answer.json()["archived"]) == (200, word == "archive"), answer.text


@pytest.fixture
def marked(drawn: DrawnRuns, tmp_path: Path) -> tuple[Settings, list[str]]:
    """A copy of a run with every product and one with failed products, both with marks."""
    shutil.copytree(drawn.folder, tmp_path / "data")
    settings = settings_of(tmp_path / "data")
    runs = [drawn.finished, drawn.failed]
    with served(create_app(settings, control=False)) as api:
        for run in runs:
            for mark in (
                {"tags": ["night"], "note": "all of it"},
                {"kind": "frame", "name": "0.1.0", "note": "odd shadow", "tags": ["odd"]},
            ):
                assert api.put(f"/v1/runs/{run}/marks", json=mark).status_code == 200
    return settings, runs


def test_every_route_answers_as_before(marked: tuple[Settings, list[str]]) -> None:
    settings, runs = marked
    before = shown(settings, runs)
    assert {status for status, _, _ in before.values()} == {200, 404, 409, 422}
    assert sum(status == 200 for status, _, _ in before.values()) > 100
    archived(settings, runs[:1])
    one = shown(settings, runs)
    assert {address for address in before if before[address] != one[address]} == set()
    archived(settings, runs[1:])
    both = shown(settings, runs)
    assert {address for address in before if before[address] != both[address]} == set()


def test_all_rows_come_back(marked: tuple[Settings, list[str]]) -> None:
    settings, runs = marked
    engine = open_context(settings).engine
    before = rows_of(engine)
    archived(settings, runs)
    within = rows_of(engine)
    assert within["variants"] != before["variants"]
    assert not {row[0] for name in ("blocks", "variants", "frames", "evaluations") for row in within[name]} & set(runs)
    archived(settings, runs, "unarchive")
    after = rows_of(engine)
    assert {name for name in before if before[name] != after[name]} == {"audit"}
    engine.dispose()


def annotated(folder: Path) -> tuple[World, str]:
    pipeline = street_pipeline(folder)
    return pipeline, pipeline.submit(boxes.spec(xs=2, ys=2, annotations=["normals", "boxes", "joints", "light"]))


def bent(folder: Path) -> tuple[World, str]:
    world = DrawnWorld(settings_of(folder / "data"))
    sensors = [{"name": "default"}, {"name": "bent", "distortion": {"k1": -0.9}}]
    vary = [["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 10.0]]
    return world, world.submit(drawn_spec("bent", sensors=sensors, vary=vary))


@pytest.mark.parametrize(("make", "table"), [(annotated, "person_lights"), (bent, "person_views")])
def test_runs_with_annotations_or_distorted_truth_answer_as_before(
    tmp_path: Path, make: Callable[[Path], tuple[World, str]], table: str
) -> None:
    world, run = make(tmp_path)
    assert world.run(run) == "completed"
    before, rows = shown(world.settings, [run]), rows_of(world.context.engine)
    archived(world.settings, [run])
    after = shown(world.settings, [run])
    assert {address for address in before if before[address] != after[address]} == set()
    archived(world.settings, [run], "unarchive")
    back = rows_of(world.context.engine)
    assert rows[table]
    assert {name for name in rows if rows[name] != back[name]} == {"audit"}


def test_an_archived_run_changes_only_after_its_rows_are_back(marked: tuple[Settings, list[str]]) -> None:
    settings, (_, failed) = marked
    with served(create_app(settings, control=False)) as api:
        api.post(f"/v1/runs/{failed}/archive")
        changes = [
            api.post(f"/v1/runs/{failed}/retry"),
            api.post(f"/v1/runs/{failed}/resume"),
            api.put(f"/v1/runs/{failed}/marks", json={"tags": ["day"]}),
            api.put(f"/v1/runs/{failed}/marks", json={"kind": "frame", "name": "0.1.0", "note": "x"}),
            api.put(f"/v1/frames/{failed}.0.0.0/prediction", content=b"", headers={"Content-Type": "image/png"}),
        ]
        for answer in changes:
            assert (answer.status_code, f"valerie archive --undo {failed}" in answer.text) == (409, True), answer.text
        api.post(f"/v1/runs/{failed}/unarchive")
        assert api.put(f"/v1/runs/{failed}/marks", json={"tags": ["day"]}).status_code == 200
        assert api.post(f"/v1/runs/{failed}/retry").status_code == 200


def test_a_run_that_has_not_ended_is_refused(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    for run in (drawn.running, drawn.waiting):
        answer = fresh.post(f"/v1/runs/{run}/archive")
        assert (answer.status_code, "when it has ended" in answer.text) == (409, True)
    assert fresh.post(f"/v1/runs/{'0' * 13}/archive").status_code == 404
    assert fresh.post(f"/v1/runs/{drawn.finished}/unarchive").json()["archived"] is False


def test_an_archived_run_is_deleted_with_its_archive(fresh: httpx.Client, drawn: DrawnRuns, tmp_path: Path) -> None:
    run = drawn.finished
    fresh.post(f"/v1/runs/{run}/archive")
    assert list((tmp_path / "data/artifacts/runs" / run).glob("archive.*"))
    assert fresh.delete(f"/v1/runs/{run}").status_code == 204
    assert fresh.get(f"/v1/runs/{run}/frames").status_code == 404
    assert not (tmp_path / "data/artifacts/runs" / run).exists() or not list(
        (tmp_path / "data/artifacts/runs" / run).iterdir()
    )


def computed(settings: Settings, runs: list[str], folder: Path) -> dict[str, Any]:
    """Return what commands compute from the rows of two runs, and the bytes of the files that they write."""
    context = open_context(settings)
    first, second = runs
    export_evidence(context, first, folder / "evidence")
    export_run(context, first, folder / "set", ExportSettings(formats=("coco", "parquet"), predictions=FUNCTIONS[:1]))
    beside = compare_runs(context, first, second, across=("sun-1.elevation",))
    answers: dict[str, Any] = {
        "compare": repr(beside),
        "selected": repr(compare_runs(context, first, first, functions=FUNCTIONS, where="distance_m > 20")),
        "refine": refine_run(context, first, RefinedPart(where="pacc < 0.9")),
        "weak": selected_region(context, first, "pacc < 0.9", FUNCTIONS[0]),
        "failures": Folder(context, "").failures(second),
        "report": report_with(context, first, other=beside).html,
        "replay": [(one.digest, one.verdict) for one in replay_frame(context, FrameKey(first, 0, 0))],
    }
    context.engine.dispose()
    files = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    return answers | files


def test_commands_compute_the_same(marked: tuple[Settings, list[str]], tmp_path: Path) -> None:
    settings, runs = marked
    before = computed(settings, runs, tmp_path / "before")
    archived(settings, runs)
    after = computed(settings, runs, tmp_path / "after")
    assert before.keys() == after.keys()
    assert {name for name in before if before[name] != after[name]} == set()
