"""One's own function through real processes: registered while the worker runs, then rendered for, inferred with, reported."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.acceptance.system import System
from tests.world.boxes import spec, write_box_street
from valerie.perception.running.label_png import encode_png
from valerie.perception.running.small_network import small_onnx

ROOT = Path(__file__).parents[2]
pytestmark = [pytest.mark.processes, pytest.mark.timeout(600)]


def command(system: System, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A ``valerie`` command beside the running server."""
    return subprocess.run(
        [sys.executable, "-m", "valerie", *arguments, "--data-dir", str(system.settings.data_dir)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT), "VALERIE_TESTING_ENGINES": "true"},
    )


def test_functions_of_the_user_from_files_to_results(tmp_path: Path) -> None:
    write_box_street(tmp_path / "assets" / "box-street")
    onnx = small_onnx(tmp_path)[1]
    onnx.with_suffix(".yaml").write_text("output: {classes: [road, person]}\nengine: onnxruntime\n")
    own = tmp_path / "own.json"
    own.write_text(json.dumps(spec(xs=2, ys=2, name="own")))
    document = tmp_path / "uploads.yaml"
    document.write_text("name: uploads\nkind: predictions\noutput: {classes: [road, person]}\n")
    with System(tmp_path / "data", tmp_path / "assets", infer_engines="onnxruntime/fp32") as system:
        first = system.submit(spec(xs=2, ys=2))
        assert system.wait(first) == "completed"  # the worker runs, and knows of no other function
        before = system.objects()

        submitted = command(system, "submit", str(own), "--functions", str(onnx))
        assert submitted.returncode == 0, submitted.stderr
        (reference,) = re.findall(r"small\.onnx is registered as (small@[0-9a-f]{12});", submitted.stderr)
        run = submitted.stdout.strip()
        assert system.wait(run) == "completed"
        new_objects = system.objects().keys() - before.keys()
        assert {key.split("/")[1] for key in new_objects} == {"prediction"}, "a run that adds a function only infers"
        assert {row["function"] for row in system.rows(run)} == {reference}

        assert command(system, "function", "import", "--document", str(document)).returncode == 0
        run = system.submit(spec(xs=2, ys=2, name="uploads", functions=["uploads"]))
        system.wait(run, until=lambda progress: "awaiting-predictions: 8" in (progress["reason"] or ""))
        frames, labels = tmp_path / "frames", tmp_path / "labels"
        exported = command(system, "frames", "export", run, str(frames))
        assert "8 frames written" in exported.stdout, exported.stderr
        labels.mkdir()
        for path in frames.glob("*.png"):
            (labels / path.name).write_bytes(encode_png(np.ones((36, 64), np.uint8)))
        put = command(system, "predictions", "put", run, str(labels))
        assert put.stdout == "8 predictions uploaded, 0 already there, 0 refused\n", put.stderr
        assert system.wait(run) == "completed"
        assert {row["pacc"] for row in system.rows(run)} - {None} == {1.0}, "everything was called a person"
