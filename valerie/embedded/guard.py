"""Run one command so that it never outlives the supervisor that started it, however the supervisor ends.

`valerie.embedded.guarded_process` starts this file by path, as ``python -I -S guard.py GRACE_SECONDS STATUS_FD LOCK_FD
COMMAND…``. It uses the standard library only, so that it is small and starts fast. Standard input is a *lifeline*: a
pipe whose other end only the supervisor holds. When the supervisor ends, even by kill -9, the kernel closes the pipe,
and the guard ends the command: SIGTERM to the command and, after the grace period, SIGKILL to its process group and to
every descendant that left the group. On Linux, the kernel kills the command if the guard itself is killed.

The command has its own session: Ctrl-C at the terminal reaches only the supervisor, which ends its services in order.
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
    """Call ``prctl(2)`` on Linux; do nothing on other systems."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0)


def main(arguments: list[str]) -> int:
    """Run the command, and return its exit status as a shell would (128 + n after signal n)."""
    grace, status_fd, lock_fd = float(arguments[0]), int(arguments[1]), int(arguments[2])
    os.set_inheritable(status_fd, False)
    os.set_inheritable(lock_fd, False)  # held until the command has ended, so that no other uses its data folder
    prctl(_PR_SET_CHILD_SUBREAPER, 1)  # adopts descendants that lose their parent, so that they can be ended
    wake_reading, wake_writing = os.pipe()
    os.set_blocking(wake_writing, False)
    signal.set_wakeup_fd(wake_writing, warn_on_full_buffer=False)
    requests: list[int] = []
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGTERM, lambda *_: requests.append(1))
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    child = _start(arguments[3:])
    os.write(status_fd, f"{child}\n".encode())
    os.close(status_fd)

    status: int | None = None
    deadline: float | None = None
    while status is None:
        timeout = None if deadline is None else max(deadline - time.monotonic(), 0.0)
        inputs = [wake_reading] if deadline is not None else [wake_reading, 0]
        ready, _, _ = select.select(inputs, [], [], timeout)
        if wake_reading in ready:
            os.read(wake_reading, 512)
        status = _reap(child)
        if status is None and deadline is None and (requests or 0 in ready):
            deadline = time.monotonic() + grace
            _kill(os.kill, child, signal.SIGTERM)
        elif status is None and deadline is not None and time.monotonic() >= deadline:
            _kill(os.killpg, child, signal.SIGKILL)
            deadline = time.monotonic() + 1.0
    _end_the_rest(child)
    return status


def _start(command: list[str]) -> int:
    parent = os.getpid()
    # Until the child has given up this process's handlers, they would swallow a signal that is meant for the command.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    child = os.fork()
    if child:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
        return child
    try:
        os.setsid()
        prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)
        for signum in (signal.SIGINT, signal.SIGTERM, signal.SIGCHLD):
            signal.signal(signum, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
        null = os.open(os.devnull, os.O_RDONLY)
        os.dup2(null, 0)
        os.execvp(command[0], command)  # noqa: S606  # the list comes from the supervisor
    except OSError as error:
        sys.stderr.write(f"{command[0]}: {error.strerror}\n")
        sys.stderr.flush()
    os._exit(127)


def _reap(child: int) -> int | None:
    """Reap all processes that have ended, and return the exit status of ``child`` if it is among them."""
    exit_status: int | None = None
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return exit_status
        if pid == 0:
            return exit_status
        if pid == child:
            code = os.waitstatus_to_exitcode(status)
            exit_status = code if code >= 0 else 128 - code


def _end_the_rest(child: int) -> None:
    """Kill the remaining processes of the command's group and the adopted descendants."""
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
