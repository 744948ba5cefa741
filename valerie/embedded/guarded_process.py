"""One guarded process; `valerie.embedded.guard` explains how it is kept from becoming an orphan."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from valerie.embedded import guard

#: Size above which a log is put aside when its process starts.
LOG_BYTES: Final = 20_000_000


@dataclass(frozen=True, slots=True)
class Command:
    """A command to run.

    Attributes:
        name: short name, also that of the log file.
        arguments: program and arguments.
        environment: complete environment.
        log: standard output and error are appended here.
        grace_seconds: time between SIGTERM and SIGKILL.
    """

    name: str
    arguments: tuple[str, ...]
    environment: Mapping[str, str]
    log: Path
    grace_seconds: float


class GuardedProcess:
    """A running command with its guard; it ends when this process ends."""

    def __init__(self, command: Command, *, lock_fd: int) -> None:
        """Start the command.

        Args:
            command: the command.
            lock_fd: descriptor of a held lock; the guard keeps it until the command has ended.

        Raises:
            OSError: the log cannot be written, or no process can be started.
        """
        self.command = command
        self.started_at = time.monotonic()
        lifeline_reading, self._lifeline = os.pipe()
        status_reading, status_writing = os.pipe()
        try:
            _rotate(command.log)
            with command.log.open("ab") as log:
                self._guard = subprocess.Popen(
                    [
                        *(sys.executable, "-I", "-S", guard.__file__),
                        *(str(command.grace_seconds), str(status_writing), str(lock_fd)),
                        *command.arguments,
                    ],
                    stdin=lifeline_reading,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=dict(command.environment),
                    pass_fds=(status_writing, lock_fd),
                    start_new_session=True,
                )
        except BaseException:
            os.close(self._lifeline)
            os.close(status_reading)
            raise
        finally:
            os.close(lifeline_reading)
            os.close(status_writing)
        with os.fdopen(status_reading, "rb") as status:
            line = status.readline()
        #: Process id of the command itself, not of its guard; 0 if it could not be started.
        self.pid = int(line) if line else 0

    def poll(self) -> int | None:
        """Return the exit status of the command, None while it runs; kill its processes if its guard was killed."""
        status = self._guard.poll()
        if status is not None and status < 0:
            self._kill_group()
        return status

    def ask_to_end(self) -> None:
        """Close the lifeline: SIGTERM now, SIGKILL after the grace period. May be called again."""
        if self._lifeline >= 0:
            os.close(self._lifeline)
            self._lifeline = -1

    def end(self) -> None:
        """End the command, and wait until it and all its descendants are gone."""
        self.ask_to_end()
        try:
            self._guard.wait(self.command.grace_seconds + 5.0)
        except subprocess.TimeoutExpired:
            self._guard.kill()
            self._guard.wait()
        if self._guard.returncode < 0:
            self._kill_group()

    def last_lines(self) -> str:
        """Return the last 15 lines of the log."""
        try:
            with self.command.log.open("rb") as log:
                log.seek(max(self.command.log.stat().st_size - 20_000, 0))
                lines = log.read().decode(errors="replace").rstrip().splitlines()
        except OSError:
            return ""
        return "\n".join(lines[-15:])

    def _kill_group(self) -> None:
        if self.pid:
            try:
                os.killpg(self.pid, signal.SIGKILL)
            except (ProcessLookupError, PermissionError):
                return


def python_command(module: str, *arguments: str) -> Sequence[str]:
    """Return ``python -m module`` with the interpreter of this process, without imports from the current folder."""
    return [sys.executable, "-P", "-m", module, *arguments]


def _rotate(log: Path) -> None:
    log.parent.mkdir(parents=True, exist_ok=True)
    if log.exists() and log.stat().st_size > LOG_BYTES:
        log.replace(log.with_suffix(".1.log"))
