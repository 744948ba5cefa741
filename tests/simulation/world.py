"""One seeded schedule: two runs, two control loops, five workers, a user who intervenes, and faults."""

from __future__ import annotations

import hashlib
import math
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from sqlalchemy import Engine

from tests.simulation.parts import Database, Maker, Queues, Store, Weather, pixels_of
from tests.simulation.schedule import Process, Schedule
from tests.world.blank import Pipeline
from tests.world.boxes import spec, write_box_street
from valerie.broker import FINISH, TaskMessage
from valerie.db.engine import open_database
from valerie.db.results import FailedLink
from valerie.db.runs import RunRow
from valerie.errors import Conflict, TransientError
from valerie.pipeline.base.context import Context
from valerie.pipeline.control import lifecycle
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.work.finish import Keep, finish_run
from valerie.pipeline.work.stages import serve_queue
from valerie.runs.products.states import EVAL_QUEUE

LEASE = 10.0
MAX_ATTEMPTS = 4
FIRST_FAULT, LAST_FAULT = 1.0, 25.0
#: Time limit of a run after the last fault, seconds: a lease, the sweeps, and pauses before further attempts.
PATIENCE = 150.0
FAULTS = (
    "kill worker",
    "kill worker",
    "kill control",
    "freeze worker",
    "freeze worker",
    "freeze control",
    "restart broker",
    "hang broker",
    "empty broker",
    "fill store",
    "read-only store",
    "tear object",
    "lose object",
    "clock forward",
    "clock back",
    "worker ahead dies",
    "control ahead dies",
    "lock database",
    "cancel and resume",
    "retry",
)
STORM = "storm of cancel, resume, retry"
#: Faults that leave no render worker to two small runs, with their times.
OUTAGE = (
    (0.5, "freeze render-1"),
    (1.0, "kill render-2"),
    (1.5, "restart broker"),
    (2.0, STORM),
)
#: Time limit until a product is rendered after an outage, seconds.
AFTER_OUTAGE = LEASE
_STORM_SECONDS = 3.0
_MOVES = {
    "waiting": {"ready", "failed"},
    "ready": {"running", "failed"},
    "running": {"done", "ready", "failed", "waiting", "parked"},
    "done": {"waiting"},
    "failed": {"waiting", "ready"},
    "parked": {"waiting", "ready"},
}
_WATCH = """
CREATE TRIGGER moved AFTER UPDATE OF state ON products WHEN OLD.state <> NEW.state BEGIN
  SELECT moved(NEW.digest, OLD.state, NEW.state, OLD.lease_owner, OLD.lease_until, NEW.route); END;
CREATE TRIGGER tried AFTER UPDATE OF attempts ON products BEGIN SELECT tried(NEW.digest, NEW.attempts); END;
CREATE TRIGGER viewed AFTER INSERT ON person_views BEGIN SELECT viewed(NEW.truth, NEW.pixel_area); END;
CREATE TRIGGER scored AFTER INSERT ON person_scores BEGIN SELECT viewed(NEW.digest, NEW.tp); END;
"""
_LOST = """
SELECT count(*) FROM products AS p JOIN frames AS f ON p.digest IN (f.background, f.layer, f.truth)
  JOIN runs AS r ON r.id = f.run_id WHERE p.state = 'parked' AND r.state = 'running'
"""
_RESULT = """
SELECT f.run_id, f.variant_index, f.camera_index, p.digest, p.state, p.bytes, v.pixel_area, s.tp, s.fn FROM frames AS f
  JOIN evaluations AS e USING (run_id, variant_index, camera_index, time_index)
  JOIN products AS p ON p.digest IN (f.background, f.layer, f.truth, e.prediction, e.scores)
  LEFT JOIN person_views AS v ON v.truth = p.digest LEFT JOIN person_scores AS s ON s.digest = p.digest
  ORDER BY 1, 2, 3, 4
"""


@dataclass(frozen=True)
class Outcome:
    """The outcome of a schedule.

    Attributes:
        violations: violated invariants.
        digest: of all rows and objects.
        faults, steps, seconds: numbers of faults and steps, and the virtual time until all runs ended.
        standstill: longest time without progress of any product after the last disturbance, seconds.
        first: from the end of the last fault, though a process may still be frozen, until the next product was
            rendered, seconds; None if none was left.
        products: number of products.
        trace: log of all steps and faults.
    """

    violations: tuple[str, ...]
    digest: str
    faults: int
    steps: int
    seconds: float
    standstill: float
    first: float | None
    products: int
    trace: tuple[str, ...]


@cache
def _template() -> tuple[Any, Engine, tuple[str, ...]]:
    """Return a deployment with two submitted runs that share most products."""
    folder = Path(tempfile.mkdtemp(prefix="valerie-simulation-"))
    write_box_street(folder / "assets" / "box-street")
    pipeline = Pipeline(
        folder / "data", folder / "assets", lease_seconds=LEASE, heartbeat_seconds=2.0, resend_seconds=4.0,
        sweep_seconds=1.0, max_attempts=MAX_ATTEMPTS,
    )  # fmt: skip
    names = tuple(pipeline.submit(spec(xs=xs, ys=1, name=f"run-{xs}")) for xs in (3, 4))
    return pipeline, pipeline.context.engine, names


class _AtOnce(Executor):
    """Runs calls in the thread of the caller."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Simulation:
    """See `tests.simulation`."""

    def __init__(self, seed: int, faults: Sequence[str] = FAULTS, *, planned: Sequence[tuple[float, str]] = ()) -> None:
        pipeline, template, self._runs = _template()
        self._schedule = Schedule(seed, self._check)
        self._random = self._schedule.random
        self._weather = Weather()
        self._queues = Queues(self._schedule, self._weather)
        self._store = Store(self._schedule, self._weather)
        self._violations: list[str] = []
        self._moved_at = self._disturbed_at = self._ended_at = self._standstill = 0.0
        self._first: float | None = None
        self._faults: list[tuple[float, str]] = list(planned)
        self._engine = open_database("sqlite://", clock=self._schedule.clock)
        raw: Any = self._engine.raw_connection().driver_connection
        source: Any = template.raw_connection()
        source.driver_connection.backup(raw)
        source.close()
        self._sql = raw
        raw.create_function("moved", 6, self._moved)
        raw.create_function("tried", 2, self._tried)
        raw.create_function("viewed", 2, self._viewed)
        raw.executescript(_WATCH)
        self._base = replace(
            pipeline.context,
            engine=Database(self._engine, self._schedule, self._weather),
            store=self._store,
            broker=self._queues,
            elapsed=lambda: self._schedule.now,
            beating=self._schedule.beating,
        )
        self._processes: dict[str, tuple[Process, Callable[[Process, Context], None]]] = {}
        self._held: dict[Process, TaskMessage] = {}
        self._numbers = 0
        if faults:
            self._weather.lost, self._weather.doubled = self._random.choice(((0, 0), (0.05, 0.2), (0.3, 0.05)))
            self._weather.delay = self._random.choice((0.0, 1.0, 8.0))
            count = self._random.randint(5, 9)
            times = sorted(self._random.uniform(FIRST_FAULT, LAST_FAULT) for _ in range(count))
            self._faults = [(moment, self._random.choice(faults)) for moment in times]

    def run(self) -> Outcome:
        """Run the schedule to its end."""
        schedule = self._schedule
        for name, body in (
            ("control-1", self._control), ("control-2", self._control), ("render-1", self._worker("render")),
            ("render-2", self._worker("render")), ("infer-1", self._worker("infer")), ("eval-1", self._worker("eval")),
            ("eval-2", self._worker("eval")),
        ):  # fmt: skip
            schedule.at(0.0, lambda name=name, body=body: self._start(name, body))  # type: ignore[misc]
        for moment, fault in self._faults:
            schedule.at(moment, lambda fault=fault: self._disturb(fault))  # type: ignore[misc]
        schedule.at(5.0, self._look)
        schedule.run(self._over)
        digest = self._digest()
        products = self._sql.execute("SELECT count(*) FROM products").fetchone()[0]
        self._engine.dispose()
        return Outcome(
            tuple(self._violations), digest, len(self._faults), schedule.steps, schedule.now, self._standstill, self._first,
            products, tuple(schedule.trace),
        )  # fmt: skip

    # -- processes -------------------------------------------------------------------------------------------------------

    def _start(self, name: str, body: Callable[[Process, Context], None]) -> None:
        self._numbers += 1
        process = Process(f"{name}#{self._numbers}")
        self._processes[name] = (process, body)
        context = replace(self._base, owner=process.name)
        self._schedule.spawn(process, lambda: body(process, context))

    def _control(self, process: Process, context: Context) -> None:
        loop = ControlLoop(context, proposer=_AtOnce())
        while True:
            try:
                loop.tick(everything=True)
            except TransientError as error:
                self._schedule.note(f"{process.name} waits: {error}")
            self._schedule.sleep(self._random.uniform(1.0, 2.5))

    def _worker(self, stage: str) -> Callable[[Process, Context], None]:
        def work(process: Process, context: Context) -> None:
            maker = Maker(self._schedule, self._store)
            queues = {route for route in self._routes() if route.startswith(stage)} | (
                {EVAL_QUEUE} if stage == "eval" else set()
            )
            while True:
                message = self._queues.take(queues)
                if message is None:
                    self._schedule.sleep(self._random.uniform(0.1, 0.6))
                    continue
                self._held[process] = message
                try:
                    if message.task == FINISH:
                        finish_run(context, message.argument, write=self._write)
                    else:
                        serve_queue(context, maker, message.argument)
                except TransientError as error:  # Celery logs it
                    self._schedule.note(f"{process.name} gives up a message: {error}")
                del self._held[process]

        return work

    @cache  # noqa: B019  one call per simulation
    def _routes(self) -> list[str]:
        pins = self._sql.execute("SELECT offers FROM workers").fetchall()
        import orjson

        return [offer["route"] for (offers,) in pins for offer in orjson.loads(offers)]

    def _write(self, context: Context, run: RunRow, failures: Sequence[FailedLink], keep: Keep) -> None:
        keep("table", b"results")

    # -- faults ----------------------------------------------------------------------------------------------------------

    def _disturb(self, fault: str) -> None:
        schedule, random, weather = self._schedule, self._random, self._weather
        schedule.note(f"fault: {fault}")
        self._lasting(schedule.now)
        until = schedule.now + random.uniform(2.0, 15.0)
        what, _, _ = fault.partition(" ")
        match fault:
            case "kill worker" | "kill control" | "kill render-2":
                self._kill(self._any(fault.split()[1]))
            case "freeze worker" | "freeze control" | "freeze render-1":
                process = self._processes[self._any(fault.split()[1])][0]
                process.frozen_until = schedule.now + random.uniform(0.5, 2.5) * LEASE
                self._disturbed_at = max(self._disturbed_at, process.frozen_until)
            case "restart broker":
                weather.away = max(weather.away, until)
            case "hang broker":
                weather.hung = max(weather.hung, until)
            case "empty broker":
                self._queues.messages.clear()
            case "fill store":
                weather.full = max(weather.full, until)
            case "read-only store":
                weather.read_only = max(weather.read_only, until)
            case "tear object" | "lose object":
                schedule.note(f"  {self._store.damage(tear=what == 'tear')}")
            case "clock forward" | "clock back":
                schedule.jump += 7200.0 if fault == "clock forward" else -7200.0
            case "worker ahead dies" | "control ahead dies":
                name = self._any(what)
                self._processes[name][0].skew = 7200.0
                schedule.at(schedule.now + random.uniform(0.5, 6.0), lambda: self._kill(name))
                self._lasting(schedule.now + 6.0)
            case "lock database":
                weather.locked = max(weather.locked, until)
            case "cancel and resume":
                run_id, after = random.choice(self._runs), random.uniform(0.0, 8.0)
                self._user("cancel", lambda context: lifecycle.cancel(context, run_id))
                schedule.at(
                    schedule.now + after,
                    lambda: self._user("resume", lambda context: lifecycle.resume(context, run_id)),
                )
                self._lasting(schedule.now + after)
            case _ if fault == STORM:
                for run_id in self._runs:
                    for _ in range(20):
                        action = random.choice((lifecycle.cancel, lifecycle.resume, lifecycle.retry))
                        self._later(random.uniform(0.0, _STORM_SECONDS), action, run_id)
                    self._later(_STORM_SECONDS, lifecycle.resume, run_id)
                self._lasting(schedule.now + _STORM_SECONDS)
            case "retry":
                run_id = random.choice(self._runs)
                self._user("retry", lambda context: lifecycle.retry(context, run_id))
        self._lasting(weather.clear_at)

    def _lasting(self, until: float) -> None:
        """Note that a fault lasts until a time of the schedule."""
        self._disturbed_at, self._ended_at = max(self._disturbed_at, until), max(self._ended_at, until)

    def _later(self, seconds: float, action: Callable[[Context, str], None], run_id: str) -> None:
        def act() -> None:
            self._user(f"{action.__name__} {run_id}", lambda context: action(context, run_id))

        self._schedule.at(self._schedule.now + seconds, act)

    def _any(self, kind: str) -> str:
        workers = [name for name in self._processes if not name.startswith("control")]
        names = workers if kind == "worker" else [name for name in self._processes if name.startswith(kind)]
        busy = [name for name in names if self._processes[name][0] in self._held]
        return self._random.choice(sorted(busy or names))

    def _kill(self, name: str) -> None:
        process, body = self._processes[name]
        if not process.alive:
            return
        self._schedule.note(f"  {process.name} is killed")
        self._schedule.kill(process)
        message = self._held.pop(process, None)
        if message is not None and self._random.random() < 0.8:
            self._queues.redeliver(message, self._random.uniform(0.0, 8.0))
        self._schedule.at(self._schedule.now + self._random.uniform(0.5, 4.0), lambda: self._start(name, body))

    def _user(self, name: str, act: Callable[[Context], None]) -> None:
        self._numbers += 1
        process = Process(f"user#{self._numbers}")
        context = replace(self._base, owner=process.name)

        def body() -> None:
            try:
                act(context)
                self._schedule.note(f"user: {name}")
            except (Conflict, TransientError) as error:
                self._schedule.note(f"user: {name} is refused: {error}")

        self._schedule.spawn(process, body)

    def _look(self) -> None:
        """Act as a user who regularly resumes or retries runs that ended without all results."""
        calm = self._schedule.now > max(self._disturbed_at, LAST_FAULT)
        for run_id, state, reason in self._sql.execute("SELECT id, state, reason FROM runs").fetchall():
            if calm and state in ("cancelled", "paused") and not (reason or "").startswith("storage"):
                self._user("resume", lambda context, run_id=run_id: lifecycle.resume(context, run_id))  # type: ignore[misc]
            elif calm and state in ("failed", "completed-with-failures"):
                self._user("retry", lambda context, run_id=run_id: lifecycle.retry(context, run_id))  # type: ignore[misc]
        self._schedule.at(self._schedule.now + 5.0, self._look)

    # -- invariants ------------------------------------------------------------------------------------------------------

    def _violation(self, text: str) -> None:
        self._schedule.note(f"VIOLATION: {text}")
        self._violations.append(text)

    def _moved(self, digest: str, old: str, new: str, owner: str | None, until: float | None, route: str) -> None:
        try:
            process = self._schedule.process
            actor = process.name if process else "nobody"
            if new not in _MOVES[old]:
                self._violation(f"product {digest[:6]} went from {old} to {new} by {actor}")
            if old == "running" and owner != actor and (new == "done" or (until or 0.0) >= self._schedule.clock()):
                self._violation(f"{actor} moved product {digest[:6]} to {new}, which {owner} holds")
            rendered = new == "done" and route.startswith("render")
            if rendered and self._first is None and self._schedule.now > self._ended_at:
                self._first = self._schedule.now - self._ended_at
            if new in ("done", "failed", "ready", "running"):
                # Counts only after the last disturbance, and not after the last product.
                gap = self._schedule.now - max(self._moved_at, self._disturbed_at)
                self._standstill = max(self._standstill, gap)
                self._moved_at = self._schedule.now
        except Exception as error:
            self._violation(f"error in the simulation: {error!r}")

    def _tried(self, digest: str, attempts: int) -> None:
        if not 0 <= attempts <= MAX_ATTEMPTS:
            self._violation(f"product {digest[:6]} was tried {attempts} times")

    def _viewed(self, digest: str, pixels: int) -> None:
        if pixels != pixels_of(digest):
            self._violation(f"the rows of product {digest[:6]} are not its own")

    def _check(self) -> None:
        if self._sql.execute(_LOST).fetchone()[0]:
            self._violation("a running run has parked products, which nothing will make ready")

    def _over(self) -> bool:
        if self._violations:
            return True
        states = [row[0] for row in self._sql.execute("SELECT state FROM runs")]
        late = self._schedule.now > max(self._disturbed_at, LAST_FAULT) + PATIENCE
        if late:
            counts = self._sql.execute("SELECT state, route, count(*) FROM products GROUP BY 1, 2").fetchall()
            self._violation(f"after {self._schedule.now:.0f} s the runs are {states}; products: {counts}")
        done = all(state == "completed" for state in states)
        return late or (done and self._schedule.now > max((moment for moment, _ in self._faults), default=-math.inf))

    def _digest(self) -> str:
        rows = self._sql.execute(_RESULT).fetchall()
        objects = sorted((info.key, self._store.get(info.key)) for info in self._store.list("runs"))
        return hashlib.sha256(repr((rows, objects)).encode()).hexdigest()[:16]
