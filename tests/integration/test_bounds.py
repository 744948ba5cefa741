"""Functions that hang or ask for too much, through real processes: they fail with their reasons, the worker lives on."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.acceptance.system import System
from tests.plugin_package import GREEDY, write_greedy
from tests.world.boxes import spec, write_box_street

pytestmark = [pytest.mark.processes, pytest.mark.timeout(600)]


def test_greedy_functions_fail_with_their_reasons_and_the_worker_lives_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(write_greedy(tmp_path / "packages")), prepend=":")
    write_box_street(tmp_path / "assets" / "box-street")
    rule: dict[str, object] = {}
    exec(GREEDY, rule)
    with System(
        tmp_path / "data",
        tmp_path / "assets",
        plugins="greedy-functions",
        infer_functions="blank,sleeper,glutton",
        infer_seconds=3,
        infer_memory_mb=2_000,
        max_attempts=1,
    ) as system:
        worker = system.processes("infer")[-1]
        run = system.submit(spec(xs=2, ys=2, functions=["sleeper", "glutton", "blank"]))
        assert system.wait(run) == "completed-with-failures"

        troubles = set()
        for variant in range(4):
            for camera in range(2):
                picture = system.client.get(f"/v1/frames/{run}.{variant}.{camera}.0/image").content
                if rule["troubles"](np.asarray(Image.open(BytesIO(picture)))):  # type: ignore[operator]
                    troubles.add((variant, camera))
        assert 0 < len(troubles) < 8

        labels: dict[str, set[tuple[int, int]]] = {}
        for one in system.client.get(f"/v1/runs/{run}/failures").json():
            if one["kind"] == "prediction":
                assert one["error"]["attempts"] == 1
                place = (one["variant_index"], one["camera_index"])
                labels.setdefault(one["error"]["message"], set()).add(place)
        slow = labels.pop("sleeper took longer than 3 s (VALERIE_INFER_SECONDS)")
        ((message, greedy),) = labels.items()
        assert message.startswith("glutton needs more memory than it may have: ")
        assert message.endswith("limit: 2000 MB (VALERIE_INFER_MEMORY_MB)")
        assert slow == greedy == troubles, "exactly the frames that make trouble"

        rows = [row for row in system.rows(run) if row["function"] == "blank"]
        assert len({(row["variant_index"], row["camera"]) for row in rows}) == 8
        assert worker.is_running(), "its process was replaced, not the worker"
        again = system.submit(spec(xs=1, ys=3, name="again"))
        assert system.wait(again) == "completed"
