"""Pictures that a completed run does not keep are removed; the numbers and what other runs keep stay."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from typer.testing import CliRunner

from services.api.app import create_app
from tests.world.drawn import FUNCTIONS, DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.cli.main import app
from valerie.errors import TransientError
from valerie.pipeline.base.context import Context
from valerie.pipeline.control import gc, lifecycle
from valerie.pipeline.control.copy_run import copy_run
from valerie.pipeline.control.gc import collect
from valerie.pipeline.control.planning import plan_run
from valerie.pipeline.evidence.exporting import export_evidence
from valerie.pipeline.exploring.thumbnails import Tile, Tiles
from valerie.pipeline.reading.frame_details import list_frames
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.resolving.spec import parse

PLACES = ["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 10.0]


def document(**more: Any) -> dict[str, Any]:
    return spec("kept", vary=[PLACES], functions=[FUNCTIONS[0]], cameras=["camera-1"], **more)


@pytest.fixture
def world(tmp_path: Path) -> DrawnWorld:
    return DrawnWorld(settings_of(tmp_path))


@pytest.fixture
def api(world: DrawnWorld) -> Iterator[httpx.Client]:
    with served(create_app(world.settings, control=False)) as client:
        yield client


def objects(world: DrawnWorld) -> set[str]:
    return {info.key for info in world.context.store.list("products") if "/statics/" not in info.key}


def states(world: DrawnWorld, run: str) -> list[str]:
    return [frame.state for frame in list_frames(world.context, run, after=None, limit=1000)]


def rows(api: httpx.Client, run: str) -> list[dict[str, object]]:
    items = api.get(f"/v1/runs/{run}/evaluations").raise_for_status().json()["items"]
    return [{name: value for name, value in item.items() if "frame" not in name and name != "run_id"} for item in items]


def test_a_run_that_keeps_numbers_has_them_and_its_frames_say_why_there_is_no_picture(
    world: DrawnWorld, api: httpx.Client
) -> None:
    everything = world.work(document())
    numbers = rows(api, everything)
    lifecycle.delete(world.context, everything)
    collect(world.context)
    assert objects(world) == set()
    run = world.work(document(retention="numbers"))
    assert world.state(run) == "completed"
    assert objects(world) == set()
    assert rows(api, run) == numbers
    frame = api.get(f"/v1/runs/{run}/frames").json()["items"][0]["id"]
    detail = api.get(f"/v1/frames/{frame}").json()
    assert detail["removed"] == "retention: numbers"
    assert detail["evaluations"][0]["state"] == "done"
    assert detail["evaluations"][0]["miou"] is not None
    for kind in ("picture", "truth", "prediction"):
        answer = api.get(f"/v1/frames/{frame}/image", params={"kind": kind})
        assert answer.status_code == 409
        assert "removed when its run completed (retention: numbers)" in answer.json()["detail"]
    assert "<html" in api.get(f"/v1/runs/{run}/report").text
    assert collect(world.context).products == 0, "the numbers are of products that the run links to"


def test_a_run_that_keeps_failures_keeps_the_frames_of_missed_persons_and_a_sample(
    world: DrawnWorld, api: httpx.Client
) -> None:
    everything = world.work(document())
    scores = [row["pacc"] for row in rows(api, everything)]
    bound = sorted(score for score in scores if isinstance(score, float))[1]
    lifecycle.delete(world.context, everything)
    collect(world.context)
    run = world.work(document(retention="failures", detection_threshold=bound))
    kept = [state == "done" for state in states(world, run)]
    # None of the four variants is in the sample: zlib.crc32(b"0") … crc32(b"3") are 9, 3, 17 and 11 modulo 20.
    assert kept == [isinstance(score, float) and score < bound for score in scores]
    assert sum(kept) == 1


def test_what_another_run_keeps_stays_whichever_ends_first(world: DrawnWorld) -> None:
    keeper = world.work(document())
    stored = objects(world)
    first = world.work(document(retention="numbers", description="first"))
    assert objects(world) == stored
    assert set(states(world, keeper)) == set(states(world, first)) == {"done"}
    lifecycle.delete(world.context, keeper)
    world.work(document(retention="numbers", description="second"))
    assert objects(world) == set(), "neither of the runs that are left keeps them"


def test_what_nobody_keeps_after_a_deletion_is_collected_and_its_numbers_stay(
    world: DrawnWorld, api: httpx.Client
) -> None:
    keeper = world.work(document())
    run = world.work(document(retention="numbers"))
    numbers = rows(api, run)
    lifecycle.delete(world.context, keeper)
    stored = len(objects(world))
    assert collect(world.context, dry_run=True).products == stored
    assert collect(world.context).products == stored
    assert objects(world) == set()
    assert (rows(api, run), set(states(world, run))) == (numbers, {"parked"})


def test_what_a_run_links_while_it_is_collected_stays(world: DrawnWorld, monkeypatch: pytest.MonkeyPatch) -> None:
    lifecycle.delete(world.context, world.work(document()))
    stored, delete = objects(world), gc.delete_unwanted
    later: list[str] = []

    def link_first(context: Context, keys: Sequence[str]) -> None:
        if not later:
            later.append(world.work(document()))
        delete(context, keys)

    monkeypatch.setattr(gc, "delete_unwanted", link_first)
    gc.collect(world.context, now=datetime.now(UTC) + timedelta(hours=2))
    assert (objects(world), set(states(world, later[0]))) == (stored, {"done"})


def test_a_later_run_makes_the_removed_pictures_again_and_its_plan_counts_them(world: DrawnWorld) -> None:
    world.work(document(retention="numbers"))
    later = document()
    assert plan_run(world.context, parse(later)).renders == 9  # a background, four layers, four truths
    world.made()
    run = world.work(later)
    assert world.made() == {"background": 1, "layer": 4, "truth": 4, "prediction": 4}
    assert set(states(world, run)) == {"done"}


def test_a_retry_makes_all_again_and_removes_them_at_the_end(world: DrawnWorld) -> None:
    broken = [True]
    run = world.work(
        document(retention="numbers"),
        broken=lambda job: job.kind == "layer" and job.frame.key.variant == 2 and broken[0],
    )
    assert (world.state(run), objects(world)) == ("completed-with-failures", set())
    broken.clear()
    broken.append(False)
    lifecycle.retry(world.context, run)
    assert world.run(run) == "completed"
    assert objects(world) == set()


def test_the_plan_says_what_stays_and_the_digest_of_the_results_is_the_same(world: DrawnWorld) -> None:
    plans = [plan_run(world.context, parse(document(retention=kept))) for kept in ("all", "failures", "numbers")]
    assert len({plan.spec_digest for plan in plans}) == 1
    assert [[note.startswith("retention: of ") for note in plan.notes[-1:]] for plan in plans[1:]] == [[True], [True]]
    assert "numbers, report and up to" in plans[2].notes[-1]


def test_an_export_of_frames_counts_those_that_were_removed(world: DrawnWorld, tmp_path: Path) -> None:
    run = world.work(document(retention="numbers"))
    place = ["--data-dir", str(world.settings.data_dir)]
    shown = CliRunner().invoke(app, ["frames", "export", run, str(tmp_path / "frames"), *place]).output
    assert "0 frames written, 0 already there, 4 removed (retention: numbers)" in shown
    assert "run the same command later" not in shown


def test_a_run_that_keeps_failures_keeps_what_its_evidence_shows(world: DrawnWorld, tmp_path: Path) -> None:
    run = world.work(spec("kept", retention="failures", detection_threshold=0.001))
    evidence = export_evidence(world.context, run, tmp_path / "evidence")
    kept = states(world, run)
    assert 0 < evidence.frames <= kept.count("done") < len(kept)


#: What the dashboard's grid asks for: kind of picture, and whether cropped.
GRIDS = [(kind, crop) for kind in ("picture", "errors") for crop in (False, True)]
PERSON = 24_001


def thumbnails(world: DrawnWorld, run: str) -> list[NDArray[np.int64]]:
    """The grids of a run's four frames, read by a process that has not painted them before."""
    tiles = [Tile(FrameKey(run, variant, 0), PERSON, FUNCTIONS[0], "default") for variant in range(4)]
    sheets = (Tiles(world.context).sheet(tiles, kind=kind, crop=crop, width=160) for kind, crop in GRIDS)
    return [np.asarray(Image.open(io.BytesIO(sheet)), np.int64) for sheet in sheets]


def artifacts(world: DrawnWorld, run: str) -> dict[str, bytes]:
    """The objects of a run that hold thumbnails, by name."""
    listed = world.context.store.list(f"runs/{run}")
    return {info.key.split("/")[2]: world.context.store.get(info.key) for info in listed if "thumbnails" in info.key}


def files(packed: Iterable[bytes]) -> list[str]:
    return sorted(name for data in packed for name in zipfile.ZipFile(io.BytesIO(data)).namelist())


def alike(some: Sequence[NDArray[np.int64]], others: Sequence[NDArray[np.int64]]) -> list[bool]:
    """True if sheets show the same, apart from the loss of one more encoding."""
    return [float(np.abs(one - other).mean()) < 3.0 for one, other in zip(some, others, strict=True)]


def test_thumbnails_remain_of_pictures_that_are_removed(world: DrawnWorld, tmp_path: Path) -> None:
    everything = world.work(document())
    painted = thumbnails(world, everything)
    assert artifacts(world, everything) == {}
    lifecycle.delete(world.context, everything)
    collect(world.context)
    grey = [np.full_like(one, 128) for one in painted]
    assert not any(alike(painted, grey))
    run = world.work(document(retention="numbers"))
    assert objects(world) == set()
    assert all(alike(thumbnails(world, run), painted))
    packed = artifacts(world, run)
    assert list(packed) == ["thumbnails-0-0.zip"]
    assert len(files(packed.values())) == 4 * len(GRIDS), "of four frames, with one person, function and sensor"
    other = DrawnWorld(settings_of(tmp_path / "other"))
    copy_run(world.context, other.context, run)
    assert all(alike(thumbnails(other, run), painted))
    lifecycle.delete(world.context, run)
    assert list(world.context.store.list(f"runs/{run}")) == []


def test_thumbnails_of_a_long_sequence_are_in_objects_of_fifty_frames(world: DrawnWorld) -> None:
    held = document(retention="numbers", sequence={"frames": 60, "step": "100 ms"}) | {
        "constants": {"sun-1.elevation": 40}
    }
    run = world.work(held | {"vary": [["person-1.pos.y", "HOMOGENEOUS", 10.0, 10.0, 1.0]]})
    assert sorted(artifacts(world, run)) == ["thumbnails-0-0.zip", "thumbnails-0-50.zip"]
    counted = [len({name.split("/")[0] for name in files([data])}) for data in artifacts(world, run).values()]
    assert sorted(counted) == [10, 50]
    last = Tile(FrameKey(run, 0, 0, 59), PERSON, FUNCTIONS[0], "default")
    shown = Tiles(world.context).sheet([last], kind="picture", crop=False, width=160)
    assert np.asarray(Image.open(io.BytesIO(shown))).std() > 5.0, "not grey"


def test_thumbnails_are_of_the_frames_that_are_removed_and_of_no_others(world: DrawnWorld) -> None:
    run = world.work(document(retention="failures", detection_threshold=0.001))
    removed = {f"{k}.0.0" for k, state in enumerate(states(world, run)) if state != "done"}
    assert 0 < len(removed) < 4
    assert {name.split("/")[0] for name in files(artifacts(world, run).values())} == removed


def test_thumbnails_are_shown_once_the_last_run_that_keeps_the_pictures_is_deleted(world: DrawnWorld) -> None:
    keeper = world.work(document())
    painted = thumbnails(world, keeper)
    run = world.work(document(retention="numbers"))
    assert [float(np.abs(one - other).max()) for one, other in zip(thumbnails(world, run), painted, strict=True)] == [
        0.0
    ] * len(GRIDS), "the pictures themselves are shown while they are there"
    lifecycle.delete(world.context, keeper)
    collect(world.context)
    assert objects(world) == set()
    assert all(alike(thumbnails(world, run), painted))


@pytest.mark.parametrize("gone", [False, True])
def test_a_process_killed_while_it_removes_pictures_leaves_what_the_next_one_needs(
    world: DrawnWorld, monkeypatch: pytest.MonkeyPatch, *, gone: bool
) -> None:
    everything = world.work(document())
    painted = thumbnails(world, everything)
    lifecycle.delete(world.context, everything)
    collect(world.context)
    store = world.context.store
    delete, failed = store.delete, []

    def killed(keys: str | Iterable[str]) -> None:
        if failed:
            delete(keys)
            return
        failed.append(True)
        if gone:
            delete(keys)
        raise TransientError("killed before the commit")

    monkeypatch.setattr(store, "delete", killed)
    run = world.work(document(retention="numbers"))
    assert failed
    assert (world.state(run), objects(world)) == ("completed", set())
    assert all(alike(thumbnails(world, run), painted))


def test_a_picture_that_a_retry_makes_gets_its_thumbnail(world: DrawnWorld) -> None:
    broken = [True]
    run = world.work(
        document(retention="numbers"),
        broken=lambda job: job.kind == "layer" and job.frame.key.variant == 2 and broken[0],
    )
    before = files(artifacts(world, run).values())
    assert {name.split("/")[0] for name in before} == {"0.0.0", "1.0.0", "3.0.0"}
    broken[0] = False
    lifecycle.retry(world.context, run)
    assert world.run(run) == "completed"
    after = files(artifacts(world, run).values())
    assert {name for name in after if name not in before} == {
        name.replace("1.0.0", "2.0.0") for name in before if name.startswith("1.")
    }


def test_the_plan_counts_the_bytes_of_thumbnails(world: DrawnWorld) -> None:
    everything, numbers = (plan_run(world.context, parse(document(retention=kept))) for kept in ("all", "numbers"))
    more = numbers.bytes - everything.bytes
    run = world.work(document(retention="numbers"))
    stored = sum(map(len, artifacts(world, run).values()))
    assert stored < more < 20 * stored, "of two persons in each frame, since one may be absent"
