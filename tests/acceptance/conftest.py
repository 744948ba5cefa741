from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.acceptance.system import System
from tests.world.boxes import write_box_street


@pytest.fixture(scope="session")
def assets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the asset ``box-street``: tiny, so that a restarted worker is at work again at once."""
    folder = tmp_path_factory.mktemp("assets")
    write_box_street(folder / "box-street")
    return folder


@pytest.fixture
def start(tmp_path: Path, assets: Path) -> Callable[..., System]:
    """Makes one-machine systems with the blank engine, each with a data folder of its own."""

    def make(name: str, **settings: object) -> System:
        return System(tmp_path / name, assets, **settings)

    return make
