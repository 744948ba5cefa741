"""A run is cancelled, resumed, retried or deleted as a whole or not at all."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[3]))

from sketch.runs import Bell, open_sketch, settings_of, spec, state_of, work

from valerie.db import products, runs
from valerie.db.engine import reading
from valerie.errors import Conflict
from valerie.pipeline.base.context import Context
from valerie.pipeline.control import lifecycle
from valerie.runs.states import ProductState

ONE = {"vary": [["person-1.pos.y", "HOMOGENEOUS", 5.0, 5.0, 1.0]], "cameras": ["camera-1"]}


@pytest.fixture
def deployed(tmp_path: Path) -> tuple[Context, Bell]:
    return open_sketch(settings_of(tmp_path))


def failed_run(context: Context, bell: Bell) -> str:
    return work(context, bell, spec("r", **ONE), broken=lambda job: job.kind == "layer")


def states(context: Context, run_id: str) -> dict[str, list[str]]:
    with reading(context.engine) as connection:
        return {state: found for state in ProductState if (found := runs.linked_digests(connection, run_id, [state]))}


def test_a_retry_that_breaks_off_changes_nothing(
    deployed: tuple[Context, Bell], monkeypatch: pytest.MonkeyPatch
) -> None:
    context, bell = deployed
    run_id = failed_run(context, bell)
    before = states(context, run_id)

    def killed(*_: Any) -> None:
        raise RuntimeError("the process was killed here")

    monkeypatch.setattr(products, "revive", killed)
    with pytest.raises(RuntimeError):
        lifecycle.retry(context, run_id)
    assert state_of(context, run_id) == "completed-with-failures"
    assert states(context, run_id) == before


def test_a_retry_makes_failed_products_wanted_again_and_sends_messages_for_them(deployed: tuple[Context, Bell]) -> None:
    context, bell = deployed
    run_id = failed_run(context, bell)
    failed = states(context, run_id)["failed"]
    assert len(failed) == 1 + 2 + 2, "the layer, and the predictions and evaluations that needed it"
    bell.ready.clear()
    lifecycle.retry(context, run_id)
    assert state_of(context, run_id) == "running"
    now = states(context, run_id)
    assert "failed" not in now
    assert [ready.digest for ready in bell.ready] == now["ready"]
    assert set(failed) == {*now["ready"], *now["waiting"]}


def test_what_cannot_be_done_names_the_states_in_which_it_can(deployed: tuple[Context, Bell]) -> None:
    context, bell = deployed
    run_id = failed_run(context, bell)
    with pytest.raises(Conflict, match="is completed-with-failures; this is possible when it is paused, cancelled"):
        lifecycle.resume(context, run_id)


def test_a_deleted_runs_own_objects_are_gone_and_its_products_stay(deployed: tuple[Context, Bell]) -> None:
    context, bell = deployed
    run_id = work(context, bell, spec("r", **ONE))
    assert context.store.usage(f"runs/{run_id}").objects == 4
    kept = context.store.usage("products").objects
    lifecycle.delete(context, run_id)
    assert context.store.usage(f"runs/{run_id}").objects == 0
    assert context.store.usage("products").objects == kept > 0
