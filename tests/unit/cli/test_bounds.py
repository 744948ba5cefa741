"""Commands that predict in their own process hold functions to the same bounds as workers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.plugin_package import GREEDY, write_greedy
from tests.unit.datasets.frames import labelled
from valerie.cli.shell import Exit
from valerie.datasets import cityscapes

ROOT = Path(__file__).parents[3]


@pytest.mark.processes
@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("function", "code", "said"),
    [
        ("sleeper", Exit.TOOK_TOO_LONG, "valerie: sleeper took longer than 1 s"),
        ("glutton", Exit.ENVIRONMENT, "limit: 3000 MB (VALERIE_INFER_MEMORY_MB)"),
    ],
)
def test_evaluate_ends_with_the_reason_where_a_function_hangs_or_asks_for_too_much(
    tmp_path: Path, function: str, code: Exit, said: str
) -> None:
    rule: dict[str, object] = {}
    exec(GREEDY, rule)
    frame = next(one for one in map(labelled, range(99)) if rule["troubles"](np.asarray(one.picture)))  # type: ignore[operator]
    cityscapes.write_picture(tmp_path / "set", "val", frame)
    cityscapes.write_labels(tmp_path / "set", "val", frame)
    environment = {
        **os.environ,
        "PYTHONPATH": f"{ROOT}:{write_greedy(tmp_path / 'packages')}",
        "VALERIE_DATA_DIR": str(tmp_path / "data"),
        "VALERIE_PLUGINS": "greedy-functions",
        "VALERIE_INFER_SECONDS": "1",
        "VALERIE_INFER_MEMORY_MB": "3000",
    }
    done = subprocess.run(
        [sys.executable, "-m", "valerie", "evaluate", "--dataset", str(tmp_path / "set"), "--function", function],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
        env=environment,
    )
    assert done.returncode == code, done.stderr
    assert said in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
