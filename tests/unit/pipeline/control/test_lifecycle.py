"""A run is cancelled, resumed, retried or deleted as a whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.world.drawn import DrawnWorld, spec
from tests.world.world import settings_of
from valerie.db import products, runs
from valerie.db.engine import reading
from valerie.errors import Conflict
from valerie.pipeline.control import lifecycle
from valerie.runs.products.states import ProductState
from valerie.storage.keys import PRODUCTS, run_prefix

ONE = {"vary": [["person-1.pos.y", "HOMOGENEOUS", 5.0, 5.0, 1.0]], "cameras": ["camera-1"]}


@pytest.fixture
def world(tmp_path: Path) -> DrawnWorld:
    return DrawnWorld(settings_of(tmp_path))


def failed_run(world: DrawnWorld) -> str:
    return world.work(spec("r", **ONE), broken=lambda job: job.kind == "layer")


def states(world: DrawnWorld, run_id: str) -> dict[str, list[str]]:
    with reading(world.context.engine) as connection:
        return {state: found for state in ProductState if (found := runs.linked_digests(connection, run_id, [state]))}


def test_a_retry_that_breaks_off_changes_nothing(world: DrawnWorld, monkeypatch: pytest.MonkeyPatch) -> None:
    run_id = failed_run(world)
    before = states(world, run_id)

    def killed(*_: Any) -> None:
        raise RuntimeError("the process was killed here")

    monkeypatch.setattr(products, "revive", killed)
    with pytest.raises(RuntimeError):
        lifecycle.retry(world.context, run_id)
    assert world.state(run_id) == "completed-with-failures"
    assert states(world, run_id) == before


def test_a_retry_makes_failed_products_wanted_again_and_sends_messages_for_them(world: DrawnWorld) -> None:
    run_id = failed_run(world)
    failed = states(world, run_id)["failed"]
    assert len(failed) == 1 + 2 + 2, "the layer, and the predictions and evaluations that needed it"
    world.broker.ready.clear()
    lifecycle.retry(world.context, run_id)
    assert world.state(run_id) == "running"
    now = states(world, run_id)
    assert "failed" not in now
    assert [ready.digest for ready in world.broker.ready] == now["ready"]
    assert set(failed) == {*now["ready"], *now["waiting"]}


def test_what_cannot_be_done_names_the_states_in_which_it_can(world: DrawnWorld) -> None:
    run_id = failed_run(world)
    with pytest.raises(Conflict, match="is completed-with-failures; this is possible when it is paused, cancelled"):
        lifecycle.resume(world.context, run_id)


def test_a_deleted_runs_own_objects_are_gone_and_its_products_stay(world: DrawnWorld) -> None:
    run_id = world.work(spec("r", **ONE))
    assert list(world.context.store.list(run_prefix(run_id)))
    kept = list(world.context.store.list(PRODUCTS))
    lifecycle.delete(world.context, run_id)
    assert not list(world.context.store.list(run_prefix(run_id)))
    assert kept
    assert list(world.context.store.list(PRODUCTS)) == kept
