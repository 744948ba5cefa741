"""One workbench, two sources: what a server and a data folder answer is the same and agrees with the drawn scenes."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import valerie
from services.api.app import create_app
from tests.world.blank import SMALL, street_pipeline
from tests.world.drawn import CHARACTERS, FUNCTIONS, DrawnRuns, draw_runs, spec
from tests.world.serving import served
from tests.world.street import Street
from tests.world.world import settings_of
from valerie.client import ServerProblemError, ServerUnavailableError
from valerie.errors import NotFound, UnknownName, ValerieError
from valerie.labels import PERSON, to_train_ids
from valerie.rendering.base import View
from valerie.scene.assets.asset import asset_manifest
from valerie.workbench.workbench import Frame, Workbench

#: Rows and columns of the drawn pictures.
SIZE = (54, 96)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> DrawnRuns:
    return draw_runs(settings_of(tmp_path_factory.mktemp("drawn") / "data"))


@pytest.fixture(scope="module")
def url(drawn: DrawnRuns) -> Iterator[str]:
    with served(create_app(settings_of(drawn.folder), control=False)) as client:
        yield str(client.base_url).rstrip("/")


@pytest.fixture(params=["server", "folder"])
def place(request: pytest.FixtureRequest, drawn: DrawnRuns, url: str) -> str:
    return url if request.param == "server" else str(drawn.folder)


@pytest.fixture
def workbench(place: str) -> Iterator[Workbench]:
    with valerie.connect(place) as workbench:
        yield workbench


def test_the_newest_runs_come_first_with_their_states(workbench: Workbench, drawn: DrawnRuns) -> None:
    assert [run.id for run in workbench.runs()] == [drawn.waiting, drawn.running, drawn.failed, drawn.finished]
    assert [run.name for run in workbench.runs(limit=1)] == ["waiting"]
    assert workbench.run(drawn.finished).progress().state == "completed"
    assert workbench.run(drawn.finished).wait(progress=True).id == drawn.finished
    with pytest.raises((NotFound, ServerProblemError), match="r0000000000"):
        workbench.run("r0000000000").progress()


def test_a_plan_counts_what_the_spec_says(workbench: Workbench, tmp_path: Path) -> None:
    document = spec("planned")
    plan = workbench.plan(document)
    assert (plan.variants, plan.cameras) == (24, ("camera-1", "camera-2"))
    file = tmp_path / "spec.yaml"
    file.write_text(str(document).replace("'", '"'), "utf-8")
    assert workbench.plan(file).variants == 24
    with pytest.raises(ValerieError, match=r"vary\.0"):
        workbench.plan({**document, "vary": [["person-1.pos.q", "CHOICE", 1]]})


def test_rows_are_those_that_an_expression_selects(workbench: Workbench, drawn: DrawnRuns) -> None:
    run = workbench.run(drawn.finished)
    every = run.rows()
    far = run.rows("distance_m > 25 and function == 'semantic-fpn-small'")
    distances, functions = (every[name].to_pylist() for name in ("distance_m", "function"))
    pairs = zip(distances, functions, strict=True)
    expected = sum(one is not None and one > 25 and name == "semantic-fpn-small" for one, name in pairs)
    assert 0 < far.num_rows == expected < every.num_rows
    assert set(every["scene.person-1.character"].to_pylist()) == set(CHARACTERS)
    with pytest.raises((UnknownName, ServerProblemError), match="did you mean distance_m"):
        run.rows("distance > 25")


def test_arrays_of_a_frame_are_what_was_drawn_and_what_was_counted(workbench: Workbench, drawn: DrawnRuns) -> None:
    frames = workbench.run(drawn.finished).frames("camera == 'camera-1' and pacc >= 0")
    assert len({frame.id for frame in frames}) == len(frames) > 3
    manifest, _ = asset_manifest("drawn-street", asset_dir=drawn.folder / "assets")
    for frame in frames[:4]:
        (row, *_) = frame.rows.to_pylist()
        values = {definition.path: definition.default for definition in manifest.parameters}
        values |= {name: row[name] for name in row if name.startswith("scene.")}
        street = Street(values, View("camera-1", SIZE[1], SIZE[0]))
        np.testing.assert_array_equal(frame.truth, street.truth().class_map)
        assert frame.picture.shape == (*SIZE, 3)
        assert frame.picture.dtype == np.uint8
        for function in FUNCTIONS:
            _counts_agree(frame, function)
        with pytest.raises(UnknownName, match="semantic-fpn-small"):
            frame.prediction("semantic-fpn")


def _counts_agree(frame: Frame, function: str) -> None:
    of_function = [row for row in frame.rows.to_pylist() if row["function"] == function]
    predicted, person = frame.prediction(function) == PERSON.id, frame.truth == PERSON.id
    assert np.count_nonzero(predicted & person) == sum(row["tp"] for row in of_function)
    assert np.count_nonzero(~predicted & person) == sum(row["fn"] for row in of_function)
    evaluated = to_train_ids(frame.truth) != 255
    wrong = frame.errors(function)
    assert not wrong[~evaluated].any()
    accuracy = 1 - np.count_nonzero(wrong) / np.count_nonzero(evaluated)
    assert accuracy == pytest.approx(of_function[0]["pixel_accuracy"])


def test_results_of_an_ended_run_are_typed_and_those_of_another_are_refused(
    workbench: Workbench, drawn: DrawnRuns
) -> None:
    run = workbench.run(drawn.finished)
    assert run.summary().frames == len({row["frame_id"] for row in run.rows().select(["frame_id"]).to_pylist()})
    assert run.findings().comparisons > 0
    assert run.verdicts() == ()
    assert run.report().startswith("<!DOCTYPE html>")
    with pytest.raises(ValerieError, match="running"):
        workbench.run(drawn.running).findings()


def test_notebooks_show_runs_and_frames(workbench: Workbench, drawn: DrawnRuns) -> None:
    run = workbench.run(drawn.finished)
    shown = run._repr_html_()
    assert "mean pACC" in shown
    assert run.id in shown
    assert "submitted" in workbench.run(drawn.waiting)._repr_html_()
    frame = run.frames("pacc >= 0")[0]
    assert 'src="data:image/jpeg;base64,' in frame._repr_html_()
    assert FUNCTIONS[0] in frame._repr_html_()
    assert (repr(frame), repr(run)) == (f"<frame {frame.id}, sensor default>", f"<run {run.id}: finished, completed>")


def test_the_same_answers_can_be_awaited(place: str, drawn: DrawnRuns) -> None:
    async def ask() -> tuple[list[str], int, int, list[NDArray[Any]]]:
        async with await valerie.connect_async(place) as workbench:
            run = await (await workbench.run(drawn.finished)).wait()
            (frame, *_), rows, plan = await asyncio.gather(
                run.frames("pacc >= 0"), run.rows(), workbench.plan(spec("planned"))
            )
            reading = frame.picture(), frame.truth(), frame.prediction(FUNCTIONS[0]), frame.errors(FUNCTIONS[0])
            arrays = await asyncio.gather(*reading)
            return [run.id for run in await workbench.runs()], rows.num_rows, plan.variants, list(arrays)

    ids, rows, variants, arrays = asyncio.run(ask())
    with valerie.connect(place) as workbench:
        run = workbench.run(drawn.finished)
        frame = run.frames("pacc >= 0")[0]
        expected = [frame.picture, frame.truth, frame.prediction(FUNCTIONS[0]), frame.errors(FUNCTIONS[0])]
        assert (ids, rows, variants) == ([run.id for run in workbench.runs()], run.rows().num_rows, 24)
    for array, other in zip(arrays, expected, strict=True):
        np.testing.assert_array_equal(array, other)


def test_everything_about_a_run_can_be_awaited(place: str, drawn: DrawnRuns) -> None:
    async def ask() -> list[object]:
        async with await valerie.connect_async(place) as workbench:
            run = await (await workbench.run(drawn.finished)).wait(progress=True)
            return list(await asyncio.gather(run.findings(), run.summary(), run.verdicts(), run.report()))

    with valerie.connect(place) as workbench:
        run = workbench.run(drawn.finished)
        assert asyncio.run(ask()) == [run.findings(), run.summary(), run.verdicts(), run.report()]


def test_a_folder_without_a_server_starts_nothing_and_waits_for_nothing(drawn: DrawnRuns, tmp_path: Path) -> None:
    with valerie.connect(drawn.folder) as workbench:
        with pytest.raises(ServerUnavailableError, match=r"valerie up --data-dir"):
            workbench.submit(spec("nobody"))
        with pytest.raises(ServerUnavailableError, match="is running: no server runs"):
            workbench.run(drawn.running).wait()
    with pytest.raises(NotFound, match=r"valerie up --data-dir .*empty"):
        valerie.connect(tmp_path / "empty")
    assert list(tmp_path.iterdir()) == []


def test_a_run_is_submitted_to_a_server_and_waited_for(tmp_path: Path) -> None:
    pipeline = street_pipeline(tmp_path)
    app = create_app(pipeline.context.settings, control=False)
    with served(app) as client, valerie.connect(str(client.base_url)) as workbench:
        run = workbench.submit(SMALL)
        assert run.progress().state == "submitted"
        worker = threading.Thread(target=pipeline.run, args=(run.id,))
        worker.start()
        assert run.wait().progress().state == "completed"
        worker.join()
        assert run.rows().num_rows > 0
        with pytest.raises(ServerProblemError, match="asset"):
            workbench.submit({"name": "one", "asset": "nowhere"})
