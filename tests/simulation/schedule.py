"""Virtual time, and processes that run, freeze and die in it."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from random import Random
from typing import Any

from greenlet import getcurrent, greenlet


class Killed(BaseException):
    """Ends a process at its current step."""


@dataclass(eq=False)
class Process:
    """A simulated process.

    Attributes:
        name: unique; also its name in leases.
        skew: how far its clock is ahead, seconds.
        frozen_until: time before which it does nothing, seconds of the schedule.
        alive: False once it was killed.
        threads: its greenlets.
    """

    name: str
    skew: float = 0.0
    frozen_until: float = 0.0
    alive: bool = True
    threads: list[greenlet] = field(default_factory=list)


class Schedule:
    """Runs processes in an order determined by a seed, and calls ``after`` after each step."""

    def __init__(self, seed: int | str, after: Callable[[], None]) -> None:
        self.random = Random(seed)
        self.now = 0.0
        self.jump = 0.0
        self.trace: list[str] = []
        self.steps = 0
        self._after = after
        self._queue: list[tuple[float, float, int, Any]] = []
        self._numbers = itertools.count()
        self._of: dict[greenlet, Process] = {}

    def note(self, text: str) -> None:
        """Add a line to the trace."""
        self.trace.append(f"{self.now:8.2f}  {text}")

    @property
    def process(self) -> Process | None:
        """The running process."""
        return self._of.get(getcurrent())

    def clock(self) -> float:
        """Unix seconds as the running process sees them."""
        process = self.process
        return 1_800_000_000.0 + self.now + self.jump + (process.skew if process else 0.0)

    def at(self, moment: float, call: Callable[[], None]) -> None:
        """Call a function between two steps."""
        self._push(moment, call)

    def spawn(self, process: Process, body: Callable[[], None]) -> greenlet:
        """Start a thread of a process."""

        def run() -> None:
            with suppress(Killed):
                body()

        thread = greenlet(run)
        thread.parent = self._hub
        self._of[thread] = process
        process.threads.append(thread)
        self._push(self.now, thread)
        return thread

    def sleep(self, seconds: float) -> None:
        """Suspend the running thread, so that others run."""
        self._push(self.now + seconds, getcurrent())
        self._hub.switch()

    def pause(self) -> None:
        """Suspend the running thread for at most a millisecond."""
        self.sleep(0.001 * self.random.random())

    def kill(self, process: Process) -> None:
        """Kill a process; call this only between two steps."""
        process.alive = False
        for thread in process.threads:
            if thread:  # greenlet: True once it has started and until it ends
                thread.throw(Killed)

    @contextmanager
    def beating(self, seconds: float, beat: Callable[[], None]) -> Iterator[None]:
        """See `valerie.pipeline.base.context.beating_in_a_thread`."""
        process = self.process
        assert process is not None
        stopped = False

        def body() -> None:
            while True:
                self.sleep(seconds)
                if stopped:
                    return
                beat()

        self.spawn(process, body)
        try:
            yield
        finally:
            stopped = True

    def run(self, until: Callable[[], bool]) -> None:
        """Run steps until ``until`` returns True, then kill all processes."""
        self._hub = getcurrent()
        while not until():
            moment, _, _, what = heapq.heappop(self._queue)
            self.now = max(self.now, moment)
            if not isinstance(what, greenlet):
                what()
            elif not what.dead:
                process = self._of[what]
                if not process.alive:  # killed before this thread took its first step
                    continue
                if process.frozen_until > self.now:
                    self._push(process.frozen_until, what)
                    continue
                what.switch()
            self.steps += 1
            self._after()
        for process in set(self._of.values()):
            self.kill(process)

    _hub: greenlet

    def _push(self, moment: float, what: Any) -> None:
        # Events at the same moment are in random order.
        heapq.heappush(self._queue, (moment, self.random.random(), next(self._numbers), what))
