"""The end of a run that keeps no pictures, with Postgres (as in tests/unit/pipeline/work/test_retention.py)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.unit.pipeline.work.test_retention import alike, artifacts, document, objects, states, thumbnails
from tests.world.drawn import DrawnWorld
from tests.world.world import settings_of
from valerie.pipeline.control import lifecycle
from valerie.pipeline.control.gc import collect

pytestmark = pytest.mark.processes


def test_pictures_are_removed_once_no_run_keeps_them_and_made_again_for_a_later_run(
    new_database: Callable[[], str], tmp_path: Path
) -> None:
    world = DrawnWorld(settings_of(tmp_path, database_url=new_database()))
    keeper = world.work(document())
    stored, painted = objects(world), thumbnails(world, keeper)
    failing = world.work(document(retention="failures", detection_threshold=0.001))
    assert objects(world) == stored
    lifecycle.delete(world.context, keeper)
    numbers = world.work(document(retention="numbers"))
    assert (sorted(states(world, failing)), len(objects(world))) == (["done", *["parked"] * 3], 4)
    lifecycle.delete(world.context, failing)
    assert collect(world.context).products == 4
    assert objects(world) == set()
    assert all(alike(thumbnails(world, numbers), painted))
    assert len(artifacts(world, failing)) == 0
    again = world.work(document())
    assert (objects(world), set(states(world, again))) == (stored, {"done"})
    world.context.engine.dispose()
