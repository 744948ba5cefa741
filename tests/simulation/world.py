"""One seeded schedule: two runs, two control loops, five workers, a user who intervenes, and faults."""

from __future__ import annotations

import hashlib
import sqlite3
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from tests.simulation.parts import Database, Fault, Maker, Queues, Store, Weather, pixels_of
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
from valerie.pipeline.control.loop import ROLE, ControlLoop
from valerie.pipeline.work.finish import Keep, finish_run
from valerie.pipeline.work.stages import serve_queue
from valerie.runs.products.states import EVAL_QUEUE

LEASE = 5.0
MAX_ATTEMPTS = 3
#: Faults are drawn until so many were felt.
FELT = 5
#: Mean time between two faults, and the time after which there are none, seconds.
PAUSE, LAST_FAULT = 0.7, 60.0
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
    "waiting": {"ready", "failed", "parked"},
    "ready": {"running", "failed", "parked"},
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
SELECT count(*) FROM products AS p CROSS JOIN frames AS f ON p.digest IN (f.background, f.layer, f.truth)
  CROSS JOIN runs AS r ON r.id = f.run_id WHERE p.state = 'parked' AND r.state = 'running'
"""
_HOLDER = "SELECT 1 FROM leases WHERE name = ? AND owner = ?"
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
        drawn, felt: numbers of faults, and of those that had an effect.
        steps, seconds: number of steps, and the virtual time until all runs ended.
        standstill: longest time without progress of any product after the last disturbance, seconds.
        first: from the end of the last fault, though a process may still be frozen, until the next product was
            rendered, seconds; None if none was left.
        products: number of products.
        trace: log of all steps and faults.
    """

    violations: tuple[str, ...]
    digest: str
    drawn: int
    felt: int
    steps: int
    seconds: float
    standstill: float
    first: float | None
    products: int
    trace: tuple[str, ...]


class _Deployment:
    """Two submitted runs that share most products, and the engine of all schedules, which keeps compiled statements.

    Attributes:
        runs: their ids.
        context: of a process, with the engine.
        clock: of the engine.
    """

    def __init__(self) -> None:
        folder = Path(tempfile.mkdtemp(prefix="valerie-simulation-"))
        write_box_street(folder / "assets" / "box-street")
        pipeline = Pipeline(
            folder / "data", folder / "assets", lease_seconds=LEASE, heartbeat_seconds=1.0, resend_seconds=2.0,
            sweep_seconds=1.0, max_attempts=MAX_ATTEMPTS,
        )  # fmt: skip
        specs = spec(xs=3, ys=1, name="one camera", cameras=["camera-1"]), spec(xs=2, ys=1, name="two cameras")
        self.runs = tuple(pipeline.submit(document) for document in specs)
        self._start = sqlite3.connect(":memory:")  # a forked process may use it, too
        pipeline.context.engine.raw_connection().driver_connection.backup(self._start)  # type: ignore[union-attr]
        self._start.executescript(_WATCH)
        self.clock: Callable[[], float] = lambda: 0.0
        self._engine = open_database("sqlite://", clock=lambda: self.clock())
        self.context = replace(pipeline.context, engine=self._engine)

    def restart(self, schedule: Schedule) -> Any:
        """Return the connection of the engine, whose database is again what it was at the start."""
        self.clock = schedule.clock
        raw: Any = self._engine.raw_connection().driver_connection
        self._start.backup(raw)
        return raw


@cache
def _deployment() -> _Deployment:
    return _Deployment()


class _AtOnce(Executor):
    """Runs calls in the thread of the caller."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def run_schedule(seed: int, faults: Sequence[str] = FAULTS) -> Outcome:
    """Run the schedule of a seed; one in which too few of all faults were felt is drawn again."""
    outcome = Simulation(seed, faults).run()
    attempt = 1
    while tuple(faults) == FAULTS and outcome.felt < FELT and not outcome.violations:
        attempt += 1
        outcome = Simulation(f"{seed}, {attempt}", faults).run()
    return outcome


class Simulation:
    """See `tests.simulation`."""

    def __init__(
        self, seed: int | str, faults: Sequence[str] = FAULTS, *, planned: Sequence[tuple[float, str]] = ()
    ) -> None:
        deployment = _deployment()
        self._runs = deployment.runs
        self._schedule = Schedule(seed, self._check)
        self._random = self._schedule.random
        self._weather = Weather(self._schedule)
        self._queues = Queues(self._schedule, self._weather)
        self._store = Store(self._schedule, self._weather)
        self._violations: list[str] = []
        self._moved_at = self._standstill = 0.0
        self._disturbed_at = self._ended_at = max((moment for moment, _ in planned), default=0.0)
        self._first: float | None = None
        self._planned = planned
        self._kinds, self._count = faults, 0
        self._faults: list[Fault] = []
        self._acts: dict[str, Fault] = {}
        self._sql = raw = deployment.restart(self._schedule)
        self._changes, self._states = -1, [""]
        raw.create_function("moved", 6, self._moved)
        raw.create_function("tried", 2, self._tried)
        raw.create_function("viewed", 2, self._viewed)
        self._base = replace(
            deployment.context,
            engine=Database(deployment.context.engine, self._schedule, self._weather),
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
            self._weather.delay = self._random.choice((0.0, 1.0, 5.0))
            self._count = FELT

    def run(self) -> Outcome:
        """Run the schedule to its end."""
        schedule = self._schedule
        for name, body in (
            ("control-1", self._control), ("control-2", self._control), ("render-1", self._worker("render")),
            ("render-2", self._worker("render")), ("infer-1", self._worker("infer")), ("eval-1", self._worker("eval")),
            ("eval-2", self._worker("eval")),
        ):  # fmt: skip
            schedule.at(0.0, lambda name=name, body=body: self._start(name, body))  # type: ignore[misc]
        for moment, name in self._planned:
            schedule.at(moment, lambda name=name: self._happen(name))  # type: ignore[misc]
        schedule.at(self._random.expovariate(1 / PAUSE), self._draw)
        schedule.at(5.0, self._look)
        schedule.run(self._over)
        digest = self._digest()
        products = self._sql.execute("SELECT count(*) FROM products").fetchone()[0]
        return Outcome(
            tuple(self._violations), digest, len(self._faults), self._felt(), schedule.steps, schedule.now,
            self._standstill, self._first, products, tuple(schedule.trace),
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
            self._schedule.sleep(self._random.uniform(1.5, 3.5))

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

    def _felt(self) -> int:
        return sum(fault.felt for fault in self._faults)

    def _calm(self) -> bool:
        """Return True if there are no further faults, and the last one is over."""
        drawn = self._felt() >= self._count or self._schedule.now > LAST_FAULT
        return drawn and self._schedule.now > self._disturbed_at

    def _draw(self) -> None:
        """Let faults happen until enough of them were felt."""
        if self._felt() >= self._count or self._schedule.now > LAST_FAULT:
            return
        self._happen(self._random.choice(self._kinds))
        self._schedule.at(self._schedule.now + self._random.expovariate(1 / PAUSE), self._draw)

    def _happen(self, name: str) -> None:
        fault = Fault(name)
        self._faults.append(fault)
        over = self._disturb(fault)
        self._disturbed_at = max(self._disturbed_at, over)
        if not name.startswith("freeze"):
            self._ended_at = max(self._ended_at, over)

    def _disturb(self, fault: Fault) -> float:
        """Begin a fault, and return when it is over."""
        schedule, random, weather = self._schedule, self._random, self._weather
        schedule.note(f"fault: {fault.name}")
        until = schedule.now + random.uniform(1.0, 8.0)
        over = schedule.now
        match fault.name.split():
            case "kill", kind:
                self._kill(self._any(kind), fault)
            case "freeze", kind:
                name = self._any(kind)
                over = self._processes[name][0].frozen_until = schedule.now + random.uniform(0.5, 2.5) * LEASE
                fault.felt = self._works(name)
            case ("restart" | "hang", "broker") | ("fill" | "read-only", "store") | ("lock", "database"):
                weather.begin(fault, until)
                over = until
            case "empty", "broker":
                fault.felt = bool(self._queues.messages)
                self._queues.messages.clear()
            case "tear" | "lose", "object":
                schedule.note(f"  {self._store.damage(fault)}")
            case "clock", way:
                schedule.jump += 7200.0 if way == "forward" else -7200.0
                fault.felt = True
            case kind, "ahead", "dies":
                name, over = self._any(kind), schedule.now + 3.0
                self._processes[name][0].skew = 7200.0
                schedule.at(schedule.now + random.uniform(0.5, 3.0), lambda: self._kill(name, fault))
            case "cancel", "and", "resume":
                run_id, after = random.choice(self._runs), random.uniform(0.0, 4.0)
                over = schedule.now + after
                self._user("cancel", lambda context: lifecycle.cancel(context, run_id), fault)
                schedule.at(over, lambda: self._user("resume", lambda context: lifecycle.resume(context, run_id)))
            case "storm", *_:
                over = schedule.now + _STORM_SECONDS
                for run_id in self._runs:
                    for _ in range(20):
                        action = random.choice((lifecycle.cancel, lifecycle.resume, lifecycle.retry))
                        self._later(random.uniform(0.0, _STORM_SECONDS), action, run_id)
                    self._later(_STORM_SECONDS, lifecycle.resume, run_id)
            case ("retry",):
                run_id = random.choice(self._runs)
                self._user("retry", lambda context: lifecycle.retry(context, run_id), fault)
        return over

    def _later(self, seconds: float, action: Callable[[Context, str], None], run_id: str) -> None:
        def act() -> None:
            self._user(f"{action.__name__} {run_id}", lambda context: action(context, run_id))

        self._schedule.at(self._schedule.now + seconds, act)

    def _works(self, name: str) -> bool:
        """Return True if a process serves a message or has the role of the control loop."""
        process = self._processes[name][0]
        return process in self._held or (
            process.alive and self._sql.execute(_HOLDER, (ROLE, process.name)).fetchone() is not None
        )

    def _any(self, kind: str) -> str:
        workers = [name for name in self._processes if not name.startswith("control")]
        names = workers if kind == "worker" else [name for name in self._processes if name.startswith(kind)]
        busy = [name for name in names if self._processes[name][0] in self._held]
        return self._random.choice(sorted(busy or names))

    def _kill(self, name: str, fault: Fault) -> None:
        process, body = self._processes[name]
        if not process.alive:
            return
        fault.felt = self._works(name)
        self._schedule.note(f"  {process.name} is killed")
        self._schedule.kill(process)
        message = self._held.pop(process, None)
        if message is not None and self._random.random() < 0.8:
            self._queues.redeliver(message, self._random.uniform(0.0, 4.0))
        self._schedule.at(self._schedule.now + self._random.uniform(0.5, 4.0), lambda: self._start(name, body))

    def _user(self, name: str, act: Callable[[Context], None], fault: Fault | None = None) -> None:
        """Let a user act once; a fault is felt if that changes a run or a product."""
        self._numbers += 1
        process = Process(f"user#{self._numbers}")
        if fault is not None:
            self._acts[process.name] = fault
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
        calm = self._calm()
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
            if actor in self._acts:
                self._acts[actor].felt = True
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
        if self._sql.total_changes == self._changes:  # nothing was written since
            return
        self._changes = self._sql.total_changes
        self._states = [row[0] for row in self._sql.execute("SELECT state FROM runs")]
        if self._sql.execute(_LOST).fetchone()[0]:
            self._violation("a running run has parked products, which nothing will make ready")

    def _over(self) -> bool:
        if self._violations:
            return True
        late = self._calm() and self._schedule.now > self._disturbed_at + PATIENCE
        if late:
            counts = self._sql.execute("SELECT state, route, count(*) FROM products GROUP BY 1, 2").fetchall()
            self._violation(f"after {self._schedule.now:.0f} s the runs are {self._states}; products: {counts}")
        return late or all(state == "completed" for state in self._states)

    def _digest(self) -> str:
        rows = self._sql.execute(_RESULT).fetchall()
        objects = sorted((info.key, self._store.get(info.key)) for info in self._store.list("runs"))
        return hashlib.sha256(repr((rows, objects)).encode()).hexdigest()[:16]
