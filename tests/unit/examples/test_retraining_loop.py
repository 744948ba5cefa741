"""The example of the loop back to training, through its own function, on a drawn run and drawn frames."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from PIL import Image

from examples.retraining.loop import FUNCTION, close_the_loop
from tests.world.drawn import TOWN, DrawnWorld, installed_town, spec
from tests.world.training import DRAWS, class_here, draw_frames
from tests.world.world import settings_of
from valerie.perception.importing.function_file import read_header
from valerie.runs.study.retraining import RetrainSettings
from valerie.storage.keys import run_key

WEAK = "pacc < 0.9 and distance_m > 25"
ALONG_THE_STREET = [["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 5.0]]


@pytest.fixture(scope="module", autouse=True)
def town(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with installed_town(tmp_path_factory.mktemp("town")):
        yield


@pytest.mark.timeout(900)
def test_a_run_is_shown_beside_two_new_versions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("valerie.pipeline.retraining.retrain.render_training_frames", draw_frames)
    deployment = settings_of(tmp_path / "data")
    world = DrawnWorld(deployment, infer_class=class_here(FUNCTION, deployment))
    run_id = world.work(spec("validation", asset=TOWN, vary=ALONG_THE_STREET, functions=[FUNCTION]))
    settings = RetrainSettings(
        frames=2, sites=1, width=160, height=96, steps=1, batch=2, held_out_frames=0, broad_share=0.5
    )
    document = close_the_loop(world.context, run_id, WEAK, settings, tmp_path / "out")
    comparison = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert comparison == json.loads(json.dumps(document))
    versions = [FUNCTION, f"{FUNCTION}-targeted", f"{FUNCTION}-random"]
    assert comparison["versions"] == versions
    assert set(comparison["changes"]) == set(versions[1:])

    table = world.context.store.get(run_key(run_id, "evaluations.csv")).decode()
    rows = [row for row in csv.DictReader(io.StringIO(table)) if row["function"] == FUNCTION and row["pacc"]]
    found, all_pixels = (sum(int(row[name]) for row in rows) for name in ("tp", "fn"))
    everyone = comparison["groups"][0]
    before, *after = everyone["sides"]
    assert (everyone["name"], everyone["persons"]) == ("all persons", len(rows))
    assert before["pacc_mean"] == pytest.approx(sum(float(row["pacc"]) for row in rows) / len(rows))
    assert before["pacc_pooled"] == pytest.approx(found / (found + all_pixels))
    assert len(after) == 2
    assert all(0 <= side["pacc_pooled"] <= 1 for side in after)
    weak = sum(float(row["pacc"]) < 0.9 and float(row["distance_m"]) > 25 for row in rows)
    groups = {group["name"]: group for group in comparison["groups"]}
    assert groups[f"selected by the scores of {FUNCTION}"]["persons"] == weak > 0

    weights = set()
    for name in ("targeted", "random"):
        training_set = comparison["training_sets"][name]
        header = read_header(tmp_path / "out" / f"{name}.safetensors")
        weights.add(header.digest)
        assert training_set["frames"] == int(header.provenance["frames"]) == 2
        assert training_set["drawn"] == (2 * DRAWS if name == "targeted" else 2)
        assert training_set["reference"].startswith(f"{FUNCTION}-{name}@")
        assert (header.provenance["retrained-from-run"], header.provenance["retrained-where"]) == (run_id, WEAK)
    assert len(weights) == 2
    with Image.open(tmp_path / "out" / "comparison.png") as picture:
        assert len(picture.convert("L").getcolors(256) or ()) > 8, "something is drawn"
    printed = capsys.readouterr().out
    assert "all persons" in printed
    assert all(name in printed for name in versions)
