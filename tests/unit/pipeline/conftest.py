from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.world.blank import SMALL, Pipeline
from tests.world.boxes import write_box_street


@pytest.fixture(scope="session")
def assets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("assets")
    write_box_street(folder / "box-street")
    return folder


@pytest.fixture
def pipelines(tmp_path: Path, assets: Path) -> Callable[..., Pipeline]:
    """Return a function that makes pipelines, each with its own data folder."""
    return lambda name="one", **settings: Pipeline(tmp_path / name, assets, **settings)


@pytest.fixture
def pipeline(pipelines: Callable[..., Pipeline]) -> Pipeline:
    return pipelines()


@pytest.fixture
def completed(pipeline: Pipeline) -> tuple[Pipeline, str]:
    run = pipeline.submit(SMALL)
    assert pipeline.run(run) == "completed"
    return pipeline, run
