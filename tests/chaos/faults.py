"""The faults. Each is a function that does one, and returns when it is over; its disturbance lasts as long as the call."""

from __future__ import annotations

import signal
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random

import httpx
import psutil
import psycopg
import redis
from sqlalchemy import Engine
from sqlalchemy.exc import DBAPIError

from tests.acceptance.system import System
from tests.chaos.link import Link
from tests.world.postgres import PostgresServer
from tests.world.processes import kill
from valerie.embedded import redis_server
from valerie.embedded.guarded_process import python_command
from valerie.embedded.supervisor import WORKERS, service_environment
from valerie.storage.keys import PRODUCTS
from valerie.storage.store import open_store

_STEP_SECONDS = 7200
_SOURCES = Path(__file__).parent


@dataclass(frozen=True)
class Target:
    """A system that works on a run.

    Attributes:
        system: its processes.
        run_id: the run.
        engine: a connection of the test to the database.
        server: of its database; None on SQLite.
        artifacts: folder of its store: a small file system of its own where the machine permits to mount one.
        dials: files with a number that the processes read: of `CLOCKS`, the seconds by which their clocks are ahead; of `CALLS`,
            how many of a thousand calls on files of the store fail. Each is there if its fault happens.
        links: to the database and the broker, by their names, if a fault disturbs them.
    """

    system: System
    run_id: str
    engine: Engine
    server: PostgresServer | None
    artifacts: Path
    dials: Mapping[str, Path] = field(default_factory=dict)
    links: Mapping[str, Link] = field(default_factory=dict)
    #: Held by faults of the database's server and of the store's file system, which happen one at a time.
    alone: threading.Lock = field(default_factory=threading.Lock)

    @property
    def lease(self) -> float:
        return float(self.system.settings.lease_seconds)

    def processes(self, service: str, *, computing: bool = False) -> list[psutil.Process]:
        """Return `System.processes`, or those `System.computing`; wait for a service that is being restarted."""
        while True:
            with suppress(psutil.NoSuchProcess):
                return self.system.computing(service) if computing else self.system.processes(service)
            time.sleep(0.05)


Fault = Callable[[Target, Random], None]


def _kill_worker(target: Target, random: Random) -> None:
    kill(target.processes(random.choice(tuple(WORKERS))))


def _kill_child(target: Target, random: Random) -> None:
    kill(target.processes(random.choice(tuple(WORKERS)), computing=True))


def _kill_control(target: Target, random: Random) -> None:
    kill(target.processes("api"))


def _kill_broker(target: Target, random: Random) -> None:
    kill(target.processes("redis"))


def _kill_database(target: Target, random: Random) -> None:
    assert target.server is not None
    with target.alone:
        target.server.kill()
        time.sleep(random.uniform(0.0, 3.0))
        target.server.start()


def _freeze_worker(target: Target, random: Random) -> None:
    _freeze(target.processes(random.choice(tuple(WORKERS))), random.uniform(1.2, 2.0) * target.lease)


def _freeze_control(target: Target, random: Random) -> None:
    _freeze(target.processes("api"), random.uniform(1.2, 2.0) * target.lease)


def _freeze_child(target: Target, random: Random) -> None:
    _freeze(target.processes(random.choice(tuple(WORKERS)), computing=True), random.uniform(1.2, 2.0) * target.lease)


def _freeze_database(target: Target, random: Random) -> None:
    assert target.server is not None
    with target.alone:
        _freeze(target.server.processes(), random.uniform(1.0, 8.0))


def _hang_broker(target: Target, random: Random) -> None:
    _freeze(target.processes("redis"), random.uniform(1.0, 8.0))


def _freeze(processes: list[psutil.Process], seconds: float) -> None:
    with suppress(psutil.NoSuchProcess):
        for process in processes:
            process.suspend()
    time.sleep(seconds)
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            process.resume()


def _restart_broker(target: Target, random: Random) -> None:
    with suppress(psutil.NoSuchProcess):
        target.processes("redis")[-1].send_signal(signal.SIGTERM)


def _empty_broker(target: Target, random: Random) -> None:
    path = redis_server.socket_path(target.system.settings.data_dir)
    with suppress(redis.RedisError), redis.Redis(unix_socket_path=str(path)) as client:
        client.flushall()


def _restart_database(target: Target, random: Random) -> None:
    assert target.server is not None
    with target.alone:
        target.server.stop()
        time.sleep(random.uniform(0.0, 3.0))
        target.server.start()


def _lock_database(target: Target, random: Random) -> None:
    with suppress(DBAPIError), target.engine.begin() as connection:  # on SQLite, this alone locks all writers out
        if target.server is not None:
            connection.exec_driver_sql("LOCK TABLE products IN ACCESS EXCLUSIVE MODE")
        time.sleep(random.uniform(2.0, 6.0))


def _end_sessions(target: Target, random: Random) -> None:
    assert target.server is not None
    with (
        suppress(psycopg.OperationalError),
        psycopg.connect(target.server.url("postgres"), autocommit=True) as connection,
    ):
        connection.execute("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()")


def _fill_store(target: Target, random: Random) -> None:
    _fill(target, target.artifacts, random)


def _fill_data(target: Target, random: Random) -> None:
    _fill(target, target.system.settings.data_dir, random)


def _fill(target: Target, folder: Path, random: Random) -> None:
    ballast = folder / "ballast"
    with target.alone:
        with suppress(OSError), ballast.open("wb", buffering=0) as file:  # until there is no space left
            while file.write(bytes(4096)):
                continue
        time.sleep(random.uniform(2.0, 6.0))
        ballast.unlink()


def _read_only_store(target: Target, random: Random) -> None:
    with target.alone:
        while not _remount(target.artifacts, "ro"):  # busy while an object is written
            time.sleep(0.01)
        time.sleep(random.uniform(2.0, 6.0))
        _remount(target.artifacts, "rw")


def _remount(folder: Path, mode: str) -> bool:
    command = ["mount", "-o", f"remount,{mode}", str(folder)]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def _tear_object(target: Target, random: Random) -> None:
    with suppress(OSError):  # the store may be read-only or full
        path = _object(target, random)
        path.write_bytes(path.read_bytes()[:-7])


def _lose_object(target: Target, random: Random) -> None:
    with suppress(OSError):
        _object(target, random).unlink()


def _object(target: Target, random: Random) -> Path:
    keys = sorted(info.key for info in open_store(str(target.artifacts)).list(PRODUCTS.rstrip("/")))
    return target.artifacts / random.choice(keys)


def _step_clocks(target: Target, random: Random) -> None:
    _turn(target.dials[CLOCKS], random.choice((-_STEP_SECONDS, _STEP_SECONDS)))


def _failing_calls(target: Target, random: Random) -> None:
    per_thousand = random.choice((10, 50, 200))
    _turn(target.dials[CALLS], per_thousand)
    time.sleep(random.uniform(2.0, 6.0))
    _turn(target.dials[CALLS], -per_thousand)


def _turn(dial: Path, by: int) -> None:
    with dial.open("r+b") as file:  # in place, since processes have mapped it
        (number,) = struct.unpack("q", file.read())
        file.seek(0)
        file.write(struct.pack("q", number + by))


def _second_control(target: Target, random: Random) -> None:
    """A second control loop takes the role of the frozen first one, and is killed when that is back."""
    settings = target.system.supervisor.settings
    with (target.system.supervisor.logs / "control-2.log").open("ab") as log:
        command = python_command("services.api", "--control-only")
        environment = {**service_environment("api", settings), **dial_environment(target.dials, target.artifacts)}
        second = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
    try:
        time.sleep(random.uniform(3.0, 5.0))
        _freeze(target.processes("api"), random.uniform(1.2, 2.0) * target.lease)
        time.sleep(random.uniform(0.0, 2.0))
    finally:
        second.kill()
        second.wait()


def _storm(target: Target, random: Random) -> None:
    until = time.monotonic() + random.uniform(2.0, 5.0)
    with httpx.Client(base_url=target.system.supervisor.url, timeout=5.0) as client:
        while time.monotonic() < until:
            with suppress(httpx.TransportError):
                client.post(f"/v1/runs/{target.run_id}/{random.choice(('cancel', 'resume', 'retry'))}")
            time.sleep(random.uniform(0.0, 0.3))


def _cut_link(name: str, target: Target, random: Random) -> None:
    target.links[name].cut(random.uniform(1.0, 8.0))


def _slow_link(name: str, target: Target, random: Random) -> None:
    target.links[name].slow(random.uniform(0.02, 0.2), random.uniform(3.0, 8.0))


def _hang_link(name: str, target: Target, random: Random) -> None:
    target.links[name].hang(random.uniform(1.0, 8.0))


def new_dial(name: str, folder: Path) -> Path:
    """Write the file of a fault of `DIALS`, and the library beside it with which processes read it; return its path."""
    source, dial = _SOURCES / DIALS[name], folder / Path(DIALS[name]).stem
    dial.write_bytes(struct.pack("q", 0))
    subprocess.run(["cc", "-shared", "-fPIC", "-O2", "-o", f"{dial}.so", str(source), "-ldl"], check=True)
    return dial


def dial_environment(dials: Mapping[str, Path], artifacts: Path) -> dict[str, str]:
    """Return the variables of processes that read the files; none without files."""
    if not dials:
        return {}
    paths = {f"CHAOS_{dial.name.upper()}": str(dial) for dial in dials.values()}
    return {"LD_PRELOAD": ":".join(f"{dial}.so" for dial in dials.values()), "CHAOS_FOLDER": str(artifacts), **paths}


CLOCKS, CALLS = "step all clocks", "failing calls of store"
#: Fault to the source of the library that it needs.
DIALS = {CLOCKS: "clock.c", CALLS: "calls.c"}
STORM = "storm of cancel, resume, retry"
FULL_DATA = "fill data folder"
MOUNTED: dict[str, Fault] = {"fill store": _fill_store, "read-only store": _read_only_store, FULL_DATA: _fill_data}
POSTGRES: dict[str, Fault] = {
    "kill database": _kill_database,
    "freeze database": _freeze_database,
    "restart database": _restart_database,
    "end sessions of database": _end_sessions,
    "cut link to database": partial(_cut_link, "database"),
    "slow link to database": partial(_slow_link, "database"),
    "hang link to database": partial(_hang_link, "database"),
}
FAULTS: dict[str, Fault] = {
    "kill worker": _kill_worker,
    "kill child of worker": _kill_child,
    "kill API with control": _kill_control,
    "freeze worker": _freeze_worker,
    "freeze child of worker": _freeze_child,
    "freeze API with control": _freeze_control,
    "second control": _second_control,
    "kill broker": _kill_broker,
    "restart broker": _restart_broker,
    "hang broker": _hang_broker,
    "empty broker": _empty_broker,
    "cut link to broker": partial(_cut_link, "broker"),
    "slow link to broker": partial(_slow_link, "broker"),
    "lock database": _lock_database,
    **POSTGRES,
    **MOUNTED,
    "tear object": _tear_object,
    "lose object": _lose_object,
    CLOCKS: _step_clocks,
    CALLS: _failing_calls,
    STORM: _storm,
}
