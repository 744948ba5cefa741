"""Runs worked off by the real control loop and stages in this process, with drawn products."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from sketch.makers import SketchMaker

from valerie.db import processes, runs
from valerie.db.engine import reading, writing
from valerie.db.migrate import migrate
from valerie.db.products import Job, Ready
from valerie.perception.shipped import function_card
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.control.submit import submit
from valerie.pipeline.work.finish import finish_run
from valerie.pipeline.work.makers.evaluation import EvaluateMaker
from valerie.pipeline.work.stages import run_stage
from valerie.runs.spec import parse
from valerie.settings import Settings, load_settings

FUNCTIONS = ("deeplabv3plus-small", "semantic-fpn-small")
CLASS = "sketch-1"
_ORDER = {"eval": 0, "infer": 1, "render": 2}


class Bell:
    """A broker that keeps what it is told."""

    def __init__(self) -> None:
        self.ready: list[Ready] = []
        self.finish: list[str] = []

    def send_products(self, ready: Any) -> None:
        self.ready.extend(ready)

    def send_finish(self, run_id: str) -> None:
        self.finish.append(run_id)

    def queue_length(self, route: str) -> int:
        return sum(1 for one in self.ready if one[2] == route)


def settings_of(folder: Path, **values: Any) -> Settings:
    """A deployment in one folder whose broker does not answer, unless ``values`` names one that does."""
    nobody = f"redis+socket://{folder}/nobody.sock?virtual_host=0"
    return load_settings(data_dir=folder, **{"broker_url": nobody, "min_free_mb": 0, **values})


def open_sketch(settings: Settings, *, infer_class: str = CLASS) -> tuple[Context, Bell]:
    """A migrated database with one worker per stage that offers drawn products, functions as if in ``infer_class``."""
    context = open_context(settings)
    migrate(context.engine)
    bell = Bell()
    context = replace(context, broker=bell)  # type: ignore[arg-type]
    now = time.time()
    render = [
        {"stage": "render", "name": name, "numeric_class": CLASS, "revision": 1, "route": f"render.{name}.{CLASS}"}
        for name in ("raster", "truth")
    ]
    infer = [
        {
            "stage": "infer", "name": name, "numeric_class": infer_class, "route": f"infer.{infer_class}",
            "digest": function_card(name).digest,
            "card": {
                "name": name, "digest": function_card(name).digest, "architecture": name, "precision": "fp32", "engine": "sketch",
                "provenance": {},
            },
        }
        for name in FUNCTIONS
    ]  # fmt: skip
    with writing(context.engine) as connection:
        for number, (stage, offers) in enumerate((("render", render), ("infer", infer), ("eval", []))):
            processes.register_worker(
                connection,
                {
                    "id": f"sketch-{stage}",
                    "stage": stage,
                    "host": "workstation",
                    "pid": 4000 + number,
                    "offers": offers,
                    "started_at": now - 3600,
                    "seen_at": now + 10**6,
                },
            )
    return context, bell


def spec(name: str, *, width: int = 96, height: int = 54, **more: Any) -> dict[str, Any]:
    """Eighteen variants: the paper's positions, thinned out, and both pedestrians; one x stands inside a house."""
    return {
        "name": name,
        "asset": "urban-street",
        "vary": [
            ["person-1.pos.x", "HOMOGENEOUS", -1.0, 6.0, 3.5],
            ["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 15.0],
            ["person-1.character", "CHOICE", ["yellow-shirt", "black-outfit"]],
        ],
        "resolution": {"width": width, "height": height},
        "functions": list(FUNCTIONS),
        **more,
    }


def work(
    context: Context,
    bell: Bell,
    document: dict[str, Any],
    *,
    broken: Callable[[Job], bool] = lambda job: False,
    products: int | None = None,
) -> str:
    """Submit a run and work it off; with ``products``, stop after about so many and leave the run unfinished."""
    run_id = submit(context, parse(document))
    loop = ControlLoop(context)
    sketch, evaluate = SketchMaker(context, broken), EvaluateMaker(context)
    made = 0
    while True:
        loop._next_count = 0.0
        loop.tick()
        if products is not None and made >= products:
            return run_id
        # Later stages first, a few at a time: an unfinished run has some of everything.
        waiting = sorted(bell.ready, key=lambda one: (_ORDER[one[2].partition(".")[0]], one[3], one[1]))
        size = len(waiting) if products is None else min(24, products - made)
        batch, bell.ready[:] = waiting[:size], waiting[size:]
        made += len(batch)
        for stage, maker in (("render", sketch), ("infer", sketch), ("eval", evaluate)):
            digests = [digest for digest, _, route, _ in batch if route.partition(".")[0] == stage]
            if digests:
                run_stage(context, maker, digests)
        if run_id in bell.finish:
            bell.finish.clear()
            finish_run(context, run_id)
            return run_id


def state_of(context: Context, run_id: str) -> str:
    """The state that a run has now."""
    with reading(context.engine) as connection:
        return str(runs.get(connection, run_id).state)
