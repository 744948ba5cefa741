"""Start Redis, the API and the workers as processes, restart those that end, and end all together."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, Self

from valerie.embedded import redis_server, running
from valerie.embedded.guarded_process import Command, GuardedProcess, python_command
from valerie.errors import Conflict, InvalidInput, TransientError, ValerieError
from valerie.settings import NO_BROKER, Settings

#: A service that ends this often within this time is given up.
_DEATHS: Final = 5
_WINDOW_SECONDS: Final = 180.0
_FIRST_PAUSE_SECONDS: Final = 0.5
_LAST_PAUSE_SECONDS: Final = 10.0
_LOOK_SECONDS: Final = 0.2
_API_READY_SECONDS: Final = 90.0

#: Name of a worker to its module; each serves its own queues.
WORKERS: Final = {
    "render": "services.render_worker",
    "infer": "services.infer_worker",
    "eval": "services.eval_worker",
}


class ServiceFailedError(ValerieError):
    """A process of the one-machine mode keeps ending; the message contains the end of its log."""


class Service:
    """One process that is restarted when it ends, after a growing pause, until it has ended too often."""

    def __init__(self, command: Command, *, lock_fd: int, clock: Callable[[], float] = time.monotonic) -> None:
        self.command = command
        self._lock_fd = lock_fd
        self._clock = clock
        self._deaths: deque[float] = deque(maxlen=_DEATHS)
        self._start_at: float | None = None
        self._process: GuardedProcess | None = None
        #: Message for the user once the service is given up; None until then.
        self.failure: str | None = None

    def start(self) -> None:
        """Start the process."""
        self._process = GuardedProcess(self.command, lock_fd=self._lock_fd)
        self._start_at = None

    @property
    def pid(self) -> int:
        """Process id of the command; 0 while it does not run."""
        return self._process.pid if self._process is not None and self._start_at is None else 0

    @property
    def deaths(self) -> int:
        """Number of recent ends of the process."""
        return len(self._deaths)

    def look(self) -> bool:
        """Restart the process if it has ended and its pause is over. Return True if anything changed."""
        now = self._clock()
        if self.failure is not None or self._process is None:
            return False
        if self._start_at is not None:
            if now < self._start_at:
                return False
            try:
                self.start()
            except OSError:  # no process or no log can be created now: the machine lacks memory or disk space
                self._start_at = now + _LAST_PAUSE_SECONDS
                return False
            return True
        status = self._process.poll()
        if status is None:
            return False
        self._process.end()
        self._deaths.append(now)
        if len(self._deaths) == _DEATHS and now - self._deaths[0] < _WINDOW_SECONDS:
            self.failure = (
                f"the {self.command.name} process ended {_DEATHS} times within {now - self._deaths[0]:.0f} s (last exit"
                f" status {_words(status)}); its log {self.command.log} ends with:\n{self._process.last_lines()}"
            )
            return True
        recent = sum(1 for death in self._deaths if now - death < _WINDOW_SECONDS)
        self._start_at = now + min(_FIRST_PAUSE_SECONDS * 2 ** (recent - 1), _LAST_PAUSE_SECONDS)
        return True

    def ask_to_end(self) -> None:
        """Ask the process to end."""
        if self._process is not None:
            self._process.ask_to_end()

    def end(self) -> None:
        """End the process, and wait until it is gone."""
        if self._process is not None:
            self._process.end()


class Supervisor:
    """A complete system on one machine; a context manager that starts and ends it.

    ``with Supervisor(settings, lock) as system: system.url``. Entering it prepares the database and the artifact store,
    so that a wrong version or a read-only folder is one clear error before any process starts.
    """

    def __init__(self, settings: Settings, lock: running.Lock) -> None:
        """Prepare; nothing is started yet.

        Args:
            settings: of the deployment; an explicit ``broker_url`` replaces the system's own Redis. No worker starts without
                a broker: workers join that ask the database.
            lock: the held lock of the data folder; released at the end.
        """
        self._initial_settings = settings
        self._lock = lock
        self._worker_names = tuple(WORKERS) if settings.broker_url != NO_BROKER else ()
        self._services: dict[str, Service] = {}
        self._guarding = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="supervisor", daemon=True)
        self.settings = settings

    def __enter__(self) -> Self:
        """Start everything.

        Raises:
            MissingDependency: there is no Redis server.
            StorageUnavailable, StorageFull, Conflict: data folder, artifacts or database cannot be used.
            ServiceFailedError: a process keeps ending.
        """
        try:
            self._start()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    @property
    def url(self) -> str:
        """Address of the API."""
        return _url(self.settings.api_host, self.settings.api_port)

    @property
    def logs(self) -> Path:
        """Folder of the processes' logs."""
        return self.settings.data_dir / "logs"

    def pids(self) -> dict[str, int]:
        """Return service name to process id; 0 while a service waits for its restart."""
        return {name: service.pid for name, service in list(self._services.items())}

    def check(self) -> None:
        """Check that no service has been given up.

        Raises:
            ServiceFailedError: a service has.
        """
        for service in list(self._services.values()):
            if service.failure is not None:
                raise ServiceFailedError(service.failure)

    def _start(self) -> None:
        settings = self._initial_settings
        data_dir = settings.data_dir
        self._prepare_stores()
        settings = settings.model_copy(update={"api_port": free_port(settings)})
        settings.require_token()
        if "broker_url" not in settings.model_fields_set:
            program = redis_server.find_server(settings)
            path = redis_server.socket_path(data_dir)
            redis_server.clear(data_dir / "redis", path)
            settings = settings.model_copy(update={"broker_url": redis_server.server_url(path)})
            self._add("redis", redis_server.server_command(program, path, data_dir / "redis"), settings)
            self._await("redis", lambda: redis_server.answers(path), 15.0)
        self.settings = settings
        self._add("api", python_command("services.api"), settings)
        for name in self._worker_names:
            self._add(name, python_command(WORKERS[name]), settings)
        self._thread.start()
        self._await("api", lambda: running.healthy(self.url), _API_READY_SECONDS)
        self._note()

    def _prepare_stores(self) -> None:
        from valerie.db.migrate import migrate_url
        from valerie.storage import open_store

        settings = self._initial_settings
        open_store(settings.artifacts_url, s3_endpoint=settings.s3_endpoint).check()
        migrate_url(settings.database_url)

    def _add(self, name: str, arguments: Sequence[str], settings: Settings) -> None:
        command = Command(
            name=name,
            arguments=tuple(arguments),
            environment=service_environment(name, settings),
            log=self.logs / f"{name}.log",
            grace_seconds=settings.shutdown_seconds + 3,
        )
        service = Service(command, lock_fd=self._lock.fd)
        with self._guarding:
            self._services[name] = service
            service.start()

    def _await(self, name: str, ready: Callable[[], bool], seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while not ready():
            if not self._thread.is_alive():
                self._look()
            self.check()
            if time.monotonic() > deadline:
                raise TransientError(f"{name} was not ready within {seconds:g} s; see {self.logs / f'{name}.log'}")
            time.sleep(0.05)

    def _watch(self) -> None:
        while not self._stop.wait(_LOOK_SECONDS):
            if self._look():
                self._note()

    def _look(self) -> bool:
        with self._guarding:
            changed = [service.look() for service in self._services.values()]  # a list, so that all are checked
        return any(changed)

    def _note(self) -> None:
        note = running.Running(os.getpid(), self.url, self.settings.broker_url, self.pids())
        with suppress(OSError):  # on a full disk, only other commands that look for this system suffer
            running.write(self.settings.data_dir, note)

    def _end(self) -> None:
        """End the API and the workers together, and then the broker, which they use until they end."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        with self._guarding:
            services = dict(self._services)
            broker = services.pop("redis", None)
            for service in services.values():
                service.ask_to_end()
            for service in services.values():
                service.end()
            if broker is not None:
                broker.end()
        running.remove(self.settings.data_dir)
        self._lock.close()


#: Settings that are secrets or contain some, and that only the API uses, with its control loop.
_OF_API: Final = ("api_token", "oidc_secret", "webhooks", "webhook_secret")
_LIBRARIES: Final = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    # Waiting threads sleep instead of spinning: where rendering and inference shared the cores, spinning was measured
    # to triple the CPU time and the wall time of an inference.
    "OMP_WAIT_POLICY": "PASSIVE",
    # llvmpipe: 0 renders in the calling thread.
    "LP_NUM_THREADS": "0",
}


def service_environment(name: str, settings: Settings) -> dict[str, str]:
    """Return the environment of a service: that of this process, ``settings``, and numbers of threads for its work.

    Workers, which may run on other machines, get no secret of the API.
    """
    own = settings if name not in WORKERS else settings.model_copy(update=dict.fromkeys(_OF_API))
    libraries = dict(_LIBRARIES)
    if name == "infer":
        threads = str(settings.inference_threads)
        libraries |= {"OMP_NUM_THREADS": threads, "MKL_NUM_THREADS": threads}
    if name == "render":
        # Backgrounds use all cores while inference waits for pictures. More threads than cores only slow llvmpipe down.
        libraries |= {"LP_NUM_THREADS": str(os.cpu_count() or 1)}
    return {
        **{key: value for key, value in os.environ.items() if not key.startswith("VALERIE_")},
        # Variables that the user has set override these defaults.
        **{key: value for key, value in libraries.items() if key not in os.environ},
        **own.environment(),
        "PYTHONPATH": os.pathsep.join(filter(None, [str(_source_root()), os.environ.get("PYTHONPATH")])),
        "PYTHONUNBUFFERED": "1",
    }


def free_port(settings: Settings) -> int:
    """Return the configured port if it is free; otherwise any free one, unless the user has set the port.

    Raises:
        Conflict: the port that the user has set is in use.
        InvalidInput: this machine has no such address.
    """
    family = socket.AF_INET6 if ":" in settings.api_host else socket.AF_INET
    configured = settings.api_port
    for port in dict.fromkeys([configured, 0]):
        with socket.socket(family) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((settings.api_host, port))
            except PermissionError:
                raise Conflict(f"port {port} needs rights that this user does not have; set VALERIE_API_PORT") from None
            except socket.gaierror as error:
                raise InvalidInput(
                    "not an address of this machine", field="VALERIE_API_HOST", value=settings.api_host
                ) from error
            except OSError as error:
                if port == configured and port != 0 and "api_port" in settings.model_fields_set:
                    answers = running.healthy(_url(settings.api_host, port))
                    reason = "a server still answers there" if answers else error.strerror
                    raise Conflict(
                        f"port {port} of {settings.api_host} cannot be used ({reason}); end what uses it, or set "
                        "VALERIE_API_PORT to another one, or to 0 for any"
                    ) from error
                continue
            return int(probe.getsockname()[1])
    raise Conflict(f"no port of {settings.api_host} can be used")


def _url(host: str, port: int) -> str:
    """Return the address at which this machine reaches a server that listens on ``host``."""
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)  # noqa: S104  # names of "all addresses"
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"


def _source_root() -> Path:
    """Return the folder of the packages ``valerie`` and ``services``, so that children import the same code."""
    return Path(__file__).parents[2]


def _words(status: int) -> str:
    return f"{status}, signal {status - 128}" if status > 128 else str(status)
