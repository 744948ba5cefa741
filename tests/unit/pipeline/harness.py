"""The whole pipeline in one process, step by step: the real database, store, control loop and makers; a broker that records."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import select

from tests.acceptance.system import spec, write_box_street
from valerie.db import processes, runs
from valerie.db.engine import reading, writing
from valerie.db.migrate import migrate
from valerie.db.models import Product
from valerie.db.processes import WorkerRow
from valerie.db.products import Finished, Job
from valerie.db.runs import RunRow
from valerie.errors import TransientError
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.control.submit import submit
from valerie.pipeline.functions.probe import probe_engine, probe_function
from valerie.pipeline.work.finish import finish_run
from valerie.pipeline.work.makers.evaluation import EvaluateMaker
from valerie.pipeline.work.makers.inference import InferMaker
from valerie.pipeline.work.makers.rendering import RenderMaker
from valerie.pipeline.work.stages import LooksAhead, MayEnd, run_stage
from valerie.runs.pins import AnyOffer
from valerie.runs.products import Ready
from valerie.runs.spec import parse
from valerie.runs.states import Stage, stage_of
from valerie.settings import load_settings

#: 12 places, two cameras: 24 frames.
SMALL = spec(xs=4, ys=3)


class RecordingBroker:
    """Keeps messages in lists; ``down`` refuses them as a stopped Redis does."""

    def __init__(self) -> None:
        self.ready: list[Ready] = []
        self.finish: list[str] = []
        self.down = False

    def send_products(self, ready: Sequence[Ready]) -> None:
        if self.down:
            raise TransientError("the broker does not answer")
        self.ready += ready

    def send_finish(self, run_id: str) -> None:
        if self.down:
            raise TransientError("the broker does not answer")
        self.finish.append(run_id)

    def queue_length(self, route: str) -> int:
        return sum(1 for item in self.ready if item.route == route)


class Watched:
    """A maker that counts its products, and fails where a test wants it."""

    def __init__(self, maker: Any) -> None:
        self._maker = maker
        self.made: list[tuple[str, str]] = []
        self.before: Callable[[Job], None] = lambda _job: None

    def expect(self, jobs: Sequence[Job]) -> None:
        if isinstance(self._maker, LooksAhead):
            self._maker.expect(jobs)

    def before_end(self, tell: Callable[[str], None]) -> None:
        if isinstance(self._maker, MayEnd):
            self._maker.before_end(tell)

    def make(self, job: Job) -> Finished:
        self.before(job)
        finished = self._maker.make(job)
        self.made.append((job.kind, job.digest))
        return finished


class Pipeline:
    """A whole deployment in one process."""

    def __init__(self, folder: Path, assets: Path, *, workers: bool = True, **settings: Any) -> None:
        values = {"resend_seconds": 0.1, "sweep_seconds": 0.01, "max_attempts": 2, "min_free_mb": 0}
        values |= {"infer_memory_mb": 0, **settings}  # by default no limit on the process that runs the tests
        self.settings = load_settings(
            {}, data_dir=folder, asset_dir=assets, broker_url="memory://", testing_engines=True, **values
        )
        folder.mkdir(parents=True, exist_ok=True)
        self.broker = RecordingBroker()
        self.context: Context = dataclasses.replace(open_context(self.settings), broker=self.broker)  # type: ignore[arg-type]
        migrate(self.context.engine)
        self.makers = {
            "render": Watched(RenderMaker(self.context)),
            "infer": Watched(InferMaker(self.context)),
            "eval": Watched(EvaluateMaker(self.context)),
        }
        self.loop = ControlLoop(self.context)
        if workers:
            self.add_worker()

    def add_worker(self) -> None:
        self.offer("w", *probe_engine("blank"), *probe_function("blank"))

    def offer(self, worker: str, *offers: AnyOffer) -> None:
        """Register a worker that never dies."""
        now = time.time()
        row = WorkerRow(worker, Stage.RENDER, "h", 1, offers, started_at=now, seen_at=now + 1e6)
        with writing(self.context.engine) as connection:
            processes.register_worker(connection, row)

    def submit(self, document: dict[str, Any] = SMALL, **keywords: Any) -> str:
        return submit(self.context, parse(document), **keywords)

    def step(self) -> None:
        """One round of the control loop, then all messages of the moment."""
        self.loop._next_count = self.loop._next_probe = self.loop._next_sweep = 0.0
        self.loop.tick()
        batch, self.broker.ready = self.broker.ready, []
        for stage, maker in self.makers.items():
            digests = [ready.digest for ready in batch if stage_of(ready.route) == stage]
            if digests:
                run_stage(self.context, maker, digests)
        finishing, self.broker.finish = self.broker.finish, []
        for run_id in finishing:
            finish_run(self.context, run_id)

    def run(self, run_id: str, *, until: Sequence[str] = ()) -> str:
        """Step until the run ended, or is in one of ``until``; return its state."""
        # Pauses before another attempt are of the clock, however many steps fit into them.
        latest = time.monotonic() + 60.0
        while time.monotonic() < latest:
            self.step()
            state = self.state(run_id)
            if state in (*until, "completed", "completed-with-failures", "cancelled", "failed"):
                return state
            time.sleep(0.01)
        raise AssertionError(f"still {self.state(run_id)}: {self.row(run_id).progress}")

    def row(self, run_id: str) -> RunRow:
        with reading(self.context.engine) as connection:
            return runs.get(connection, run_id)

    def state(self, run_id: str) -> str:
        return self.row(run_id).state

    def products(self) -> list[Any]:
        with reading(self.context.engine) as connection:
            return list(connection.execute(select(*Product.__table__.columns).order_by(Product.digest)))

    def made(self) -> dict[str, int]:
        """Return the number of products made so far, by kind; reset the count."""
        counts: dict[str, int] = {}
        for maker in self.makers.values():
            for kind, _ in maker.made:
                counts[kind] = counts.get(kind, 0) + 1
            maker.made.clear()
        return counts


def completed_run(folder: Path) -> tuple[Pipeline, str]:
    """A completed run of `SMALL` with the blank engine below ``folder`` (``data``, ``assets``), and its id."""
    write_box_street(folder / "assets" / "box-street")
    pipeline = Pipeline(folder / "data", folder / "assets")
    run_id = pipeline.submit()
    assert pipeline.run(run_id) == "completed"
    return pipeline, run_id
