"""The owner of a data folder: a lock that lasts as long as the owner's processes, and a note with its API's address."""

from __future__ import annotations

import fcntl
import json
import os
import time
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from http import HTTPStatus
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from urllib.parse import urlsplit

from valerie.errors import Conflict, StorageUnavailable


@dataclass(frozen=True, slots=True)
class Running:
    """A running one-machine system.

    Attributes:
        pid: process id of the command that supervises it.
        url: address of its API.
        broker_url: its broker.
        services: name to process id.
    """

    pid: int
    url: str
    broker_url: str
    services: dict[str, int]


class Lock:
    """Exclusive use of a data folder. Guards inherit `fd`, and the lock lasts until the last of them has ended."""

    def __init__(self, data_dir: Path) -> None:
        """Open the lock file without taking the lock.

        Raises:
            StorageUnavailable: the data folder cannot be written.
        """
        self._path = data_dir / "supervisor.lock"
        try:
            data_dir.mkdir(parents=True, exist_ok=True)
            self.fd = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise StorageUnavailable(f"the data folder {data_dir} cannot be written: {error.strerror}") from error

    def take(self) -> bool:
        """Try to take the lock; return False if another command, or a process that it left, holds it."""
        try:
            fcntl.flock(self.fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def close(self) -> None:
        """Release the lock in this process."""
        os.close(self.fd)


def acquire(data_dir: Path, *, seconds: float = 30.0) -> Lock | Running:
    """Take the lock of a data folder, or find the system that holds it.

    Waits while another command starts, or while the processes of a killed one end.

    Raises:
        Conflict: another command holds the lock, but its API does not answer.
        StorageUnavailable: the data folder cannot be written.
    """
    lock = Lock(data_dir)
    deadline = time.monotonic() + seconds
    while not lock.take():
        running = read(data_dir)
        if running is not None and _alive(running.pid) and healthy(running.url):
            lock.close()
            return running
        if time.monotonic() > deadline:
            lock.close()
            holder = f"process {running.pid}" if running else "another command"
            raise Conflict(f"{holder} uses the data folder {data_dir}, but its API does not answer")
        time.sleep(0.1)
    return lock


def write(data_dir: Path, running: Running) -> None:
    """Write the note atomically."""
    path = _note(data_dir)
    temporary = path.with_suffix(".tmp")
    temporary.write_text(json.dumps(asdict(running), indent=1))
    temporary.replace(path)


def read(data_dir: Path) -> Running | None:
    """Return the note in a data folder, or None if there is no readable one; its writer may have ended."""
    try:
        note = json.loads(_note(data_dir).read_text())
        return Running(int(note["pid"]), str(note["url"]), str(note["broker_url"]), dict(note["services"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def find(data_dir: Path) -> Running | None:
    """Return the system that runs on a data folder, or None."""
    running = read(data_dir)
    return running if running is not None and _alive(running.pid) and healthy(running.url) else None


def remove(data_dir: Path) -> None:
    """Delete the note."""
    with suppress(OSError):
        _note(data_dir).unlink()


def healthy(url: str) -> bool:
    """Return True if an API answers at this address."""
    address = urlsplit(url)
    # A start asks often; httpx would load the certificates of all authorities each time, 35 ms for an address that is plain HTTP.
    with closing(HTTPConnection(address.hostname or "", address.port, timeout=3.0)) as connection:
        try:
            connection.request("GET", "/healthz")
            return connection.getresponse().status == HTTPStatus.OK
        except (OSError, HTTPException):
            return False


def _note(data_dir: Path) -> Path:
    return data_dir / "running.json"


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
