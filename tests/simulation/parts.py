"""The simulated database, broker, store and maker, each with its faults."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from obstore.store import MemoryStore
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import OperationalError

from tests.simulation.schedule import Schedule
from valerie.broker import FINISH, TaskMessage, messages_of
from valerie.db.claiming import Job
from valerie.db.measured import MeasuredPerson, SeenPerson
from valerie.db.publishing import Finished
from valerie.errors import MissingInput, NotFound, StorageFull, StorageUnavailable, TransientError
from valerie.runs.products.ready import Ready
from valerie.runs.products.states import EVAL_QUEUE, ProductKind
from valerie.storage import envelope
from valerie.storage.keys import product_key
from valerie.storage.store import ArtifactStore


@dataclass(eq=False)
class Fault:
    """A fault; ``felt`` once it changed what a process of the product does or sees."""

    name: str
    felt: bool = False


class Weather:
    """Current disturbances.

    Attributes:
        lost, doubled: shares of messages.
        delay: largest delay of a message, seconds.
    """

    def __init__(self, schedule: Schedule) -> None:
        self.lost = self.doubled = self.delay = 0.0
        self._schedule = schedule
        self._spells: list[tuple[float, Fault]] = []

    @property
    def clear_at(self) -> float:
        """Time after which only messages are disturbed, seconds of the schedule."""
        return max((until for until, _ in self._spells), default=0.0)

    def begin(self, fault: Fault, until: float) -> None:
        """Let a fault last until a moment of the schedule."""
        self._spells.append((until, fault))

    def meets(self, name: str) -> bool:
        """Return True if a process meets faults of this name now; they are felt."""
        met = [fault for until, fault in self._spells if fault.name == name and until > self._schedule.now]
        for fault in met:
            fault.felt = True
        return bool(met)


class Database:
    """Stand-in for an engine: other processes may run before each transaction, and it may be locked."""

    def __init__(self, engine: Engine, schedule: Schedule, weather: Weather) -> None:
        self._engine, self._schedule, self._weather = engine, schedule, weather

    @contextmanager
    def begin(self) -> Iterator[Connection]:
        self._wait()
        with self._engine.begin() as connection:
            yield connection

    @contextmanager
    def connect(self) -> Iterator[Connection]:
        self._wait()
        with self._engine.connect() as connection:
            yield connection

    def _wait(self) -> None:
        self._schedule.pause()
        if self._schedule.random.random() < 0.5 and self._weather.meets("lock database"):
            raise OperationalError("BEGIN", {}, sqlite3.OperationalError("database is locked"))


class Queues:
    """The broker: messages get lost, doubled, late and out of order."""

    def __init__(self, schedule: Schedule, weather: Weather) -> None:
        self._schedule, self._weather = schedule, weather
        self.messages: list[tuple[float, TaskMessage]] = []

    def send_products(self, ready: Iterable[Ready]) -> None:
        self._send(messages_of(ready))

    def send_finish(self, run_id: str) -> None:
        self._send([TaskMessage(FINISH, run_id, EVAL_QUEUE)])

    def queue_lengths(self, routes: Collection[str]) -> dict[str, int]:
        self._answer()
        return {route: sum(1 for _, message in self.messages if message.queue == route) for route in routes}

    def take(self, queues: Collection[str]) -> TaskMessage | None:
        """Remove and return a message that has arrived in one of ``queues``; None without any."""
        arrived = [
            place
            for place, (moment, message) in enumerate(self.messages)
            if message.queue in queues and moment <= self._schedule.now
        ]
        if not arrived or self._weather.meets("restart broker") or self._weather.meets("hang broker"):
            return None
        return self.messages.pop(self._schedule.random.choice(arrived))[1]

    def redeliver(self, message: TaskMessage, after: float) -> None:
        """Return a message of a dead worker to its queue."""
        self.messages.append((self._schedule.now + after, message))

    def _send(self, messages: list[TaskMessage]) -> None:
        if not messages:
            return
        self._answer()
        for message in messages:
            chance = self._schedule.random.random()
            copies = 0 if chance < self._weather.lost else 2 if chance > 1 - self._weather.doubled else 1
            for _ in range(copies):
                late = self._schedule.random.random() * self._weather.delay
                self.messages.append((self._schedule.now + late, message))

    def _answer(self) -> None:
        self._schedule.pause()
        if self._weather.meets("hang broker"):
            self._schedule.sleep(4.0)
            raise TransientError("the broker hangs")
        if self._weather.meets("restart broker"):
            raise TransientError("the broker is away")


class Store(ArtifactStore):
    """The product's store in memory, at times full or read-only."""

    def __init__(self, schedule: Schedule, weather: Weather) -> None:
        super().__init__(MemoryStore(), url="memory:")
        self._schedule, self._weather = schedule, weather
        self._damaged: dict[str, Fault] = {}

    def put(self, key: str, data: bytes, *, replace: bool = False) -> bool:
        self._schedule.pause()
        if self._weather.meets("fill store"):
            raise StorageFull("no space left")
        if self._weather.meets("read-only store"):
            raise StorageUnavailable("read-only file system")
        self._damaged.pop(key, None)
        return super().put(key, data, replace=replace)

    def get(self, key: str) -> bytes:
        if key in self._damaged:
            self._damaged[key].felt = True
        return super().get(key)

    def damage(self, fault: Fault) -> str | None:
        """Truncate or delete a random object; return its key. The fault is felt by whoever reads it."""
        keys = sorted(info.key for info in self.list("products"))
        if not keys:
            return None
        key = self._schedule.random.choice(keys)
        if fault.name == "tear object":
            super().put(key, super().get(key)[:-7], replace=True)
        else:
            self.delete(key)
        self._damaged[key] = fault
        return key


@dataclass
class Maker:
    """Makes products whose bytes and rows depend only on their digests."""

    schedule: Schedule
    store: Store
    poison: set[str] = field(default_factory=set)

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.work.stages.Maker`."""
        frame = job.frame.products
        if job.kind is ProductKind.PREDICTION:
            self._read("background", frame.background)
            self._read("layer", frame.layer)
        if job.kind is ProductKind.EVALUATION:
            assert job.look is not None
            self._read("truth", frame.truth)
            self._read("prediction", job.look.prediction)
        self.schedule.sleep(self.schedule.random.expovariate(3.0))
        data = bytes_of(job.kind, job.digest)
        if job.kind is not ProductKind.EVALUATION:
            self.store.put(product_key(job.kind, job.digest), data)
        pixels = pixels_of(job.digest)
        views = (SeenPerson(24001, {"pixel_area": pixels}, None, None),) if job.kind is ProductKind.TRUTH else ()
        scores = ()
        if job.kind is ProductKind.EVALUATION:
            scores = (MeasuredPerson(24001, {"tp": pixels, "fn": 1, "pacc": None}),)
        return Finished(job.digest, len(data), 1, 0.1, person_views=views, person_scores=scores)

    def _read(self, kind: str, digest: str) -> None:
        try:
            data = self.store.get(product_key(kind, digest))
        except NotFound:
            raise MissingInput(kind, digest) from None
        if not envelope.intact(data):
            raise MissingInput(kind, digest)


@cache
def bytes_of(kind: str, digest: str) -> bytes:
    """Return the stored bytes of a product."""
    return envelope.pack(kind, {"digest": np.frombuffer(digest.encode(), np.uint8)}, {})


def pixels_of(digest: str) -> int:
    """Return the pixel count in the rows of a product."""
    return int(digest[:6], 16)
