"""A small run, written row by row: one variant, one camera, one function."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Engine, insert

from valerie.db.engine import writing
from valerie.db.models import Evaluation, Frame, Product, Run, Variant
from valerie.db.statements import insert_ignoring
from valerie.runs.resolving.spec import parse


def digest(name: str) -> str:
    return name.ljust(32, "0")


def product(name: str, kind: str, *inputs: str, state: str = "waiting", **values: Any) -> dict[str, Any]:
    a, b = (*(digest(i) for i in inputs), None, None)[:2]
    stage = {"prediction": "infer", "evaluation": "eval"}.get(kind, "render")
    row = {
        "digest": digest(name),
        "kind": kind,
        "state": state,
        "route": stage,
        "cache_group": "g",
        "turn": 0.0,
        "attempts": 0,
    }
    return {**row, "input_a": a, "input_b": b, **values}


def run(run_id: str, state: str = "running") -> dict[str, Any]:
    return {
        "id": run_id,
        "name": run_id,
        "state": state,
        "spec": parse({"name": run_id, "asset": "urban-street"}),
        "spec_digest": "s",
        "asset_digest": "a",
        "iteration": 0,
        "variant_count": 1,
        "next_index": 1,
        "rejected_count": 0,
        "created_at": datetime.now(UTC),
    }


def write_run(engine: Engine, run_id: str = "r1", state: str = "running") -> None:
    """A run with background b, layer l, truth t, prediction p (of l and b), evaluation e (of p and t)."""
    with writing(engine) as connection:
        connection.execute(insert(Run), run(run_id, state))
        connection.execute(insert(Variant), {"run_id": run_id, "index": 0, "block": 0, "assignment": {"x": 1}})
        insert_ignoring(
            connection,
            Product,
            [
                product("b", "background"),
                product("l", "layer"),
                product("t", "truth"),
                product("p", "prediction", "l", "b"),
                product("e", "evaluation", "p", "t"),
            ],
        )
        key = {"run_id": run_id, "variant_index": 0, "camera_index": 0, "time_index": 0}
        connection.execute(
            insert(Frame), {**key, "background": digest("b"), "layer": digest("l"), "truth": digest("t")}
        )
        connection.execute(
            insert(Evaluation),
            {**key, "sensor_index": 0, "function_index": 0, "prediction": digest("p"), "scores": digest("e")},
        )
