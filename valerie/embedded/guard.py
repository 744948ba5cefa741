"""Runs one command so that it never outlives whoever asked for it, however that one ends.

Started by path as ``python -I -S guard.py GRACE_SECONDS STATUS_FD LOCK_FD COMMAND…`` by `valerie.embedded.process`;
standard library only, so that it is small and starts fast. Standard input is a *lifeline*: a pipe whose other end only
the supervisor holds. When the supervisor ends, also by kill -9, the kernel closes it, and the guard ends the command:
SIGTERM to the command, after the grace period SIGKILL to its process group and to every descendant that left the group.
On Linux the kernel kills the command should the guard itself be killed.

The command is a session of its own: Ctrl-C at the terminal reaches the supervisor alone, which ends things in order.
"""

from __future__ import annotations

import ctypes
import os
import select
import signal
import sys
import time
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36


def prctl(option: int, value: int) -> None:
    """``prctl(2)`` where there is one; without effect elsewhere."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0)


def end_with_parent(signum: int = signal.SIGTERM) -> None:
    """Ask the kernel for ``signum`` when the parent of this process ends (Linux)."""
    parent = os.getppid()
    prctl(_PR_SET_PDEATHSIG, signum)
    if os.getppid() != parent:  # it ended before we asked
        os.kill(os.getpid(), signum)


def main(arguments: list[str]) -> int:
    """Run the command; returns its exit status as a shell would give it (128 + n after signal n)."""
    grace, status_fd, lock_fd = float(arguments[0]), int(arguments[1]), int(arguments[2])
    os.set_inheritable(status_fd, False)
    os.set_inheritable(lock_fd, False)  # held while the command lives: nobody else may use its data folder
    prctl(_PR_SET_CHILD_SUBREAPER, 1)  # descendants that lose their parent become ours, and we can end them
    wake_reading, wake_writing = os.pipe()
    os.set_blocking(wake_writing, False)
    signal.set_wakeup_fd(wake_writing, warn_on_full_buffer=False)
    asked: list[int] = []
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGTERM, lambda *_: asked.append(1))
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    child = _start(arguments[3:])
    os.write(status_fd, f"{child}\n".encode())
    os.close(status_fd)

    status: int | None = None
    deadline: float | None = None
    while status is None:
        left = None if deadline is None else max(deadline - time.monotonic(), 0.0)
        watched = [wake_reading] if deadline is not None else [wake_reading, 0]
        ready, _, _ = select.select(watched, [], [], left)
        if wake_reading in ready:
            os.read(wake_reading, 512)
        status = _reap(child)
        if status is None and deadline is None and (asked or 0 in ready):
            deadline = time.monotonic() + grace
            _kill(os.kill, child, signal.SIGTERM)
        elif status is None and deadline is not None and time.monotonic() >= deadline:
            _kill(os.killpg, child, signal.SIGKILL)
            deadline = time.monotonic() + 1.0
    _end_the_rest(child)
    return status


def _start(command: list[str]) -> int:
    parent = os.getpid()
    child = os.fork()
    if child:
        return child
    try:
        os.setsid()
        prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)
        for signum in (signal.SIGINT, signal.SIGTERM, signal.SIGCHLD):
            signal.signal(signum, signal.SIG_DFL)
        null = os.open(os.devnull, os.O_RDONLY)
        os.dup2(null, 0)
        os.execvp(command[0], command)  # noqa: S606  # the list comes from our own supervisor
    except OSError as error:
        sys.stderr.write(f"{command[0]}: {error.strerror}\n")
        sys.stderr.flush()
    os._exit(127)


def _reap(child: int) -> int | None:
    """Collect all that ended; the status of ``child`` if it was among them."""
    found: int | None = None
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return found
        if pid == 0:
            return found
        if pid == child:
            code = os.waitstatus_to_exitcode(status)
            found = code if code >= 0 else 128 - code


def _end_the_rest(child: int) -> None:
    """Kill what is left of the command's group and of the descendants that were handed to us."""
    _kill(os.killpg, child, signal.SIGKILL)
    for _ in range(200):
        for pid in _children():
            _kill(os.kill, pid, signal.SIGKILL)
        _reap(child)
        if not _children():
            return
        time.sleep(0.01)


def _children() -> list[int]:
    try:
        return [int(pid) for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()]
    except OSError:
        return []


def _kill(send: object, target: int, signum: int) -> None:
    try:
        send(target, signum)  # type: ignore[operator]  # os.kill or os.killpg
    except (ProcessLookupError, PermissionError):
        return


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
