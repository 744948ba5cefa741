from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.world.blank import completed_run
from tests.world.drawn import DrawnWorld, spec
from tests.world.world import settings_of


@pytest.fixture(scope="session")
def deployed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A data folder (in ``data``) with a completed run of the blank engine, and its id; only to be read."""
    folder = tmp_path_factory.mktemp("cli")
    _, run_id = completed_run(folder)
    return folder, run_id


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A data folder with a completed run of drawn pictures, a person from near to far, and its id; only to be read."""
    folder = tmp_path_factory.mktemp("drawn") / "data"
    world = DrawnWorld(settings_of(folder))
    vary = [["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 1.0]]
    run_id = world.work(spec("approach", vary=vary, constants={"person-1.pos.x": 2.2}, cameras=["camera-1"]))
    world.context.engine.dispose()
    return folder, run_id


@pytest.fixture
def invoke(deployed: tuple[Path, str], monkeypatch: pytest.MonkeyPatch) -> CliRunner:
    folder, _ = deployed
    monkeypatch.setenv("VALERIE_ASSET_DIR", str(folder / "assets"))
    monkeypatch.setenv("VALERIE_BROKER_URL", "memory://")
    monkeypatch.setenv("VALERIE_TESTING_ENGINES", "true")
    monkeypatch.setenv("VALERIE_MIN_FREE_MB", "0")
    return CliRunner()
