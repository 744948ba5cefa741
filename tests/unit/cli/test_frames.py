"""`valerie frames export` from a real server and from the data folder: pictures and annotations, named after frames."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from services.api.app import create_app
from tests.world.blank import Pipeline
from tests.world.boxes import spec, write_box_street
from tests.world.serving import served
from valerie.cli.main import app
from valerie.client import ServerProblemError
from valerie.db import frames
from valerie.db.engine import reading
from valerie.errors import RenderingError, UnknownName
from valerie.pipeline.control import lifecycle
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.runs.products.frame_keys import FrameKey

KINDS = ("normals", "boxes", "joints", "flow", "velocity", "light")
Export = Callable[..., str]


@pytest.fixture
def pipeline(tmp_path: Path) -> Pipeline:
    write_box_street(tmp_path / "assets" / "box-street")
    return Pipeline(tmp_path / "one", tmp_path / "assets")


@pytest.fixture(params=["server", "folder"])
def export(request: pytest.FixtureRequest, pipeline: Pipeline, tmp_path: Path) -> Iterator[Export]:
    """Runs the command into the folder ``out``; what it prints for people."""

    def run(*arguments: str) -> str:
        result = CliRunner().invoke(app, ["frames", "export", *arguments, *place], catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return result.output

    if request.param == "folder":
        place = ["--data-dir", str(pipeline.settings.data_dir)]
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("VALERIE_ASSET_DIR", str(pipeline.settings.asset_dir))
            yield run
        return
    with served(create_app(pipeline.settings, control=False)) as client:
        place = ["--url", str(client.base_url), "--data-dir", str(tmp_path)]
        yield run


def walking(**more: Any) -> dict[str, Any]:
    """One variant seen by one camera at three moments."""
    document = spec(xs=1, ys=1, cameras=["camera-2"], sequence=[3, "500 ms"], **more)
    document["vary"] = {"person-1.trajectory.key-2.pos.x": {"choice": [1.0]}}
    return {**document, "trajectories": {"person-1": [[0, -1, 4], [2, 1, 4]]}}


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_every_annotation_of_the_run_comes_along_and_reads_back_as_it_is_stored(
    pipeline: Pipeline, export: Export, tmp_path: Path
) -> None:
    run = pipeline.submit(walking(annotations=list(KINDS)))
    pipeline.run(run)
    out = tmp_path / "out"
    assert "3 frames written, 0 already there" in export(run, str(out))
    ids = [f"{run}.0.0.{time}" for time in range(3)]
    assert names(out) == sorted(f"{frame}{end}" for frame in ids for end in (".png", *(f"_{k}.npz" for k in KINDS)))
    reader = ProductReader(pipeline.context.store)
    with reading(pipeline.context.engine) as connection:
        links = frames.annotation_links(connection, FrameKey(run, 0, 0, 1))
    arrays = {kind: np.load(io.BytesIO((out / f"{ids[1]}_{kind}.npz").read_bytes())) for kind in KINDS}
    assert (arrays["normals"]["octahedral"] == reader.normals(links["normals"].product).octahedral).all()
    assert (arrays["boxes"]["corners"] == reader.boxes(links["boxes"].product).corners).all()
    assert arrays["joints"]["instances"].tolist() == [24001]
    moved = arrays["flow"]["vectors"][18, 32]  # the blank engine's person walks to the right
    assert moved == pytest.approx([reader.flow(links["flow"].product).vectors[18, 32, 0], 0.0])
    assert moved[0] > 0.1
    assert arrays["velocity"]["vectors"].shape == (36, 64, 2)
    assert (arrays["light"]["instances"].tolist(), arrays["light"]["irradiance"].tolist()) == ([24001], [0.5])
    assert set(arrays["light"]) == {"instances", "irradiance", "shadow_share", "contrast"}
    assert np.asarray(Image.open(out / f"{ids[0]}.png")).shape == (36, 64, 3)


def test_only_what_is_named_is_fetched_and_what_is_there_is_not_fetched_again(
    pipeline: Pipeline, export: Export, tmp_path: Path
) -> None:
    run = pipeline.submit(spec(xs=2, ys=1, cameras=["camera-1"], annotations=["normals", "boxes"]))
    pipeline.run(run)
    out = tmp_path / "out"
    export(run, str(out), "--annotations", "none")
    assert names(out) == [f"{run}.0.0.0.png", f"{run}.1.0.0.png"]
    picture = out / f"{run}.0.0.0.png"
    picture.write_bytes(b"kept")
    assert "2 frames written, 0 already there" in export(run, str(out), "--annotations", "boxes")
    assert [name for name in names(out) if "_" in name] == [f"{run}.0.0.0_boxes.npz", f"{run}.1.0.0_boxes.npz"]
    assert picture.read_bytes() == b"kept"
    assert "0 frames written, 2 already there" in export(run, str(out), "--annotations", "boxes")
    with pytest.raises(
        (ServerProblemError, UnknownName), match="unknown annotation of the run 'normal'; did you mean normals"
    ):
        export(run, str(out), "--annotations", "normal")


def test_a_frame_whose_annotation_failed_is_counted_with_what_helps(
    pipeline: Pipeline, export: Export, tmp_path: Path
) -> None:
    def refuse(job: Any) -> None:
        if job.kind == "boxes" and job.frame.key.variant == 0:
            raise RenderingError("no boxes today")

    pipeline.makers["render"].before = refuse
    run = pipeline.submit(spec(xs=2, ys=1, cameras=["camera-1"], annotations=["boxes"]))
    pipeline.run(run)
    output = export(run, str(tmp_path / "out"))
    assert "1 frame written" in output
    assert f"1 without all annotations (boxes failed for good; `valerie retry {run}` tries again)" in output
    pipeline.makers["render"].before = lambda _: None
    lifecycle.retry(pipeline.context, run)
    pipeline.run(run)
    assert "1 frame written, 1 already there" in export(run, str(tmp_path / "out"))
