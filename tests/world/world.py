"""A deployment in one process, worked off step by step; its broker records."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sqlalchemy import make_url, select

from valerie.db import processes, runs
from valerie.db.claiming import Job
from valerie.db.engine import open_database, reading, writing
from valerie.db.migrate import migrate
from valerie.db.models import Product
from valerie.db.processes import WorkerRow
from valerie.db.publishing import Finished
from valerie.db.runs import RunRow
from valerie.errors import TransientError
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.control.submit import submit
from valerie.pipeline.work.finish import finish_run
from valerie.pipeline.work.makers.evaluation import EvaluateMaker
from valerie.pipeline.work.stages import LooksAhead, MayEnd, make_products
from valerie.runs.products.pins import AnyOffer
from valerie.runs.products.ready import Ready
from valerie.runs.products.states import Stage, stage_of
from valerie.runs.resolving.spec import parse
from valerie.settings import Settings, load_settings

_STAGES = (Stage.RENDER, Stage.INFER, Stage.EVAL)

# Nobody gives signs of life for the workers of a world.
processes.ALIVE_SECONDS = 1e9


def settings_of(folder: Path, **values: Any) -> Settings:
    """Return the settings of a deployment in one folder; its broker does not answer unless ``values`` names another one."""
    nobody = f"redis+socket://{folder}/nobody.sock?virtual_host=0"
    return load_settings({}, data_dir=folder, **{"broker_url": nobody, "min_free_mb": 0, **values})


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

    def queue_lengths(self, routes: Collection[str]) -> dict[str, int]:
        if self.down:
            raise TransientError("the broker does not answer")
        return {route: sum(1 for item in self.ready if item.route == route) for route in routes}


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
        finished: Finished = self._maker.make(job)
        self.made.append((job.kind, job.digest))
        return finished


@cache
def _migrated() -> bytes:
    """Return the file of an empty database. Copying it costs a hundredth of the migrations."""
    with TemporaryDirectory() as folder:
        engine = open_database(f"sqlite:///{folder}/empty.db")
        migrate(engine)
        engine.dispose()
        return Path(folder, "empty.db").read_bytes()


class World:
    """A whole deployment in one process.

    Args:
        settings: of the deployment.
        makers: return the makers of the stages before evaluation, which is always the product's own.
    """

    def __init__(self, settings: Settings, makers: Callable[[Context], Mapping[Stage, Any]]) -> None:
        self.settings = settings
        self.broker = RecordingBroker()
        file = Path(make_url(settings.database_url).database or "")
        new = settings.database_url.startswith("sqlite") and not file.exists()
        if new:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(_migrated())
        self.context: Context = replace(open_context(settings), broker=self.broker)  # type: ignore[arg-type]
        if not new:
            migrate(self.context.engine)
        own = {**makers(self.context), Stage.EVAL: EvaluateMaker(self.context)}
        self.makers = {stage: Watched(own[stage]) for stage in _STAGES}
        self.loop = ControlLoop(self.context)

    def offer(self, worker: str, *offers: AnyOffer, stage: Stage = Stage.RENDER) -> None:
        """Register a worker that never dies."""
        now = time.time()
        row = WorkerRow(worker, stage, "h", 1, offers, started_at=now, seen_at=now)
        with writing(self.context.engine) as connection:
            processes.register_worker(connection, row)

    def submit(self, document: dict[str, Any], **keywords: Any) -> str:
        return submit(self.context, parse(document), **keywords)

    def step(self, limit: int | None = None) -> int:
        """Do one round of the control loop, then take all messages of the moment; return the number of products worked on.

        With ``limit``, take the messages of so many products, last stages first: an unfinished run has some of everything.
        """
        self.loop.tick(everything=True)
        batch, self.broker.ready = self.broker.ready, []
        if limit is not None:
            batch.sort(key=lambda ready: _STAGES.index(stage_of(ready.route)), reverse=True)
            batch, self.broker.ready = batch[:limit], batch[limit:]
        for stage, maker in self.makers.items():
            digests = [ready.digest for ready in batch if stage_of(ready.route) == stage]
            if digests:
                make_products(self.context, maker, digests)
        finishing, self.broker.finish = self.broker.finish, []
        for run_id in finishing:
            finish_run(self.context, run_id)
        return len(batch)

    def run(self, run_id: str, *, until: Sequence[str] = ()) -> str:
        """Step until the run ended, or is in one of ``until``; return its state."""
        # Pauses before another attempt are of the clock, however many steps fit into them.
        latest = time.monotonic() + 60.0
        while time.monotonic() < latest:
            if self.step():
                latest = time.monotonic() + 60.0
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
        counts = Counter(kind for maker in self.makers.values() for kind, _ in maker.made)
        for maker in self.makers.values():
            maker.made.clear()
        return dict(counts)
