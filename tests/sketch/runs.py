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
from valerie.db.processes import WorkerRow
from valerie.db.products import Job
from valerie.perception.base import FunctionCard
from valerie.perception.shipped import function_card
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.control.submit import submit
from valerie.pipeline.work.finish import finish_run
from valerie.pipeline.work.makers.evaluation import EvaluateMaker
from valerie.pipeline.work.stages import run_stage
from valerie.runs.pins import AnyOffer, FunctionOffer, Offer
from valerie.runs.products import Ready
from valerie.runs.spec import parse
from valerie.runs.states import Stage, route_of, stage_of
from valerie.settings import Settings, load_settings

FUNCTIONS = ("deeplabv3plus-small", "semantic-fpn-small")
CLASS = "sketch-1"
_ORDER = {Stage.EVAL: 0, Stage.INFER: 1, Stage.RENDER: 2}


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
        return sum(1 for one in self.ready if one.route == route)


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
    render = tuple(
        Offer(stage=Stage.RENDER, name=name, numeric_class=CLASS, revision=1, route=route_of(Stage.RENDER, name, CLASS))
        for name in ("raster", "truth")
    )
    infer = tuple(
        FunctionOffer(
            stage=Stage.INFER, name=name, numeric_class=infer_class, revision=1, route=route_of(Stage.INFER, infer_class),
            digest=function_card(name).digest,
            card=FunctionCard(name, function_card(name).digest, name, "fp32", "sketch", {}),
        )
        for name in FUNCTIONS
    )  # fmt: skip
    stages: dict[Stage, tuple[AnyOffer, ...]] = {Stage.RENDER: render, Stage.INFER: infer, Stage.EVAL: ()}
    with writing(context.engine) as connection:
        for number, (stage, offers) in enumerate(stages.items()):
            times = {"started_at": now - 3600, "seen_at": now + 10**6}
            row = WorkerRow(f"sketch-{stage}", stage, "workstation", 4000 + number, offers, **times)
            processes.register_worker(connection, row)
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
        waiting = sorted(bell.ready, key=lambda one: (_ORDER[stage_of(one.route)], one.cache_group, one.kind))
        size = len(waiting) if products is None else min(24, products - made)
        batch, bell.ready[:] = waiting[:size], waiting[size:]
        made += len(batch)
        for stage, maker in (("render", sketch), ("infer", sketch), ("eval", evaluate)):
            digests = [ready.digest for ready in batch if stage_of(ready.route) == stage]
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
