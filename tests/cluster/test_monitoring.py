"""The files for Prometheus and Grafana: valid, tested on planted series, and about metrics that exist."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from tests.world.blank import SMALL, Pipeline
from valerie.pipeline.control.monitoring import metrics

FOLDER = Path(__file__).parents[2] / "deploy" / "monitoring"


def promtool(*arguments: str | Path) -> None:
    if shutil.which("promtool") is None:
        pytest.fail("promtool is not installed: apt-get install prometheus")
    done = subprocess.run(["promtool", *arguments], cwd=FOLDER, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def expressions() -> list[str]:
    panels = json.loads((FOLDER / "grafana.json").read_text("utf-8"))["panels"]
    return [target["expr"] for panel in panels for target in panel["targets"]]


def test_alerts_come_where_they_should_and_nowhere_else() -> None:
    promtool("check", "rules", "alerts.yaml")
    promtool("test", "rules", "alerts-test.yaml")


def test_the_panels_have_valid_expressions(tmp_path: Path) -> None:
    rules = [{"record": f"panel_{number}", "expr": expression} for number, expression in enumerate(expressions())]
    path = tmp_path / "panels.yaml"
    path.write_text(yaml.safe_dump({"groups": [{"name": "panels", "rules": rules}]}))
    promtool("check", "rules", path)


def test_panels_and_alerts_name_metrics_that_exist(assets: Path, tmp_path: Path) -> None:
    pipeline = Pipeline(tmp_path, assets)
    pipeline.run(pipeline.submit(SMALL))
    exist = set(re.findall(r"^# TYPE (\w+)", metrics(pipeline.context), re.MULTILINE))
    named = set(re.findall(r"valerie_\w+", " ".join(expressions()) + (FOLDER / "alerts.yaml").read_text("utf-8")))
    named = {name.removesuffix("_bucket") for name in named}
    assert named <= {*exist, "valerie_queue_messages", "valerie_products"}
    assert len(named) >= 6
