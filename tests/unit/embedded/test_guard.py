"""The guard: nothing outlives the supervisor, however it ends. Real processes throughout."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from valerie.embedded.guarded_process import LOG_BYTES, Command, GuardedProcess

pytestmark = pytest.mark.processes

_SECONDS = 15.0

#: Starts a child, writes both process ids, then sleeps; what it does with SIGTERM is the first argument.
_FAMILY = """
import os, signal, subprocess, sys, time
if sys.argv[1] == "stubborn":
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
elif sys.argv[1] == "orderly":
    signal.signal(signal.SIGTERM, lambda *_: (print("in order", flush=True), sys.exit(7)))
child = subprocess.Popen(
    [sys.executable, "-c", "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"],
    start_new_session=sys.argv[1] == "escaped",
)
path = sys.argv[2]
open(path + ".tmp", "w").write(f"{os.getpid()} {child.pid}")
os.rename(path + ".tmp", path)
time.sleep(600)
"""


def _until(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + _SECONDS
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def _gone(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def _pids(path: Path) -> list[int]:
    assert _until(path.exists)
    return [int(pid) for pid in path.read_text().split()]


@pytest.fixture
def lock_fd(tmp_path: Path) -> Iterator[int]:
    fd = os.open(tmp_path / "lock", os.O_RDWR | os.O_CREAT)
    yield fd
    os.close(fd)


def _command(tmp_path: Path, *arguments: str, grace_seconds: float = 5.0) -> Command:
    return Command("family", (sys.executable, *arguments), dict(os.environ), tmp_path / "family.log", grace_seconds)


def _family(tmp_path: Path, manner: str, **options: float) -> Command:
    return _command(tmp_path, "-c", _FAMILY, manner, str(tmp_path / "pids"), **options)


def test_a_command_that_has_hardly_begun_ends_by_the_first_signal(tmp_path: Path, lock_fd: int) -> None:
    for _ in range(10):
        process = GuardedProcess(_command(tmp_path, "-c", "import time; time.sleep(600)"), lock_fd=lock_fd)
        process.end()
        assert process.poll() == 128 + signal.SIGTERM  # SIGKILL follows after the grace period only


def test_the_exit_status_of_the_command_is_the_exit_status_of_its_guard(tmp_path: Path, lock_fd: int) -> None:
    process = GuardedProcess(_command(tmp_path, "-c", "raise SystemExit(42)"), lock_fd=lock_fd)
    assert _until(lambda: process.poll() is not None)
    assert process.poll() == 42
    process.end()


def test_a_command_that_was_killed_by_a_signal_is_reported_as_a_shell_would(tmp_path: Path, lock_fd: int) -> None:
    process = GuardedProcess(_command(tmp_path, "-c", "import time; time.sleep(600)"), lock_fd=lock_fd)
    os.kill(process.pid, signal.SIGKILL)
    assert _until(lambda: process.poll() is not None)
    assert process.poll() == 128 + signal.SIGKILL
    process.end()


def test_a_program_that_does_not_exist_ends_with_127_and_its_name_in_the_log(tmp_path: Path, lock_fd: int) -> None:
    command = Command("absent", ("/nowhere/absent",), dict(os.environ), tmp_path / "absent.log", 1.0)
    process = GuardedProcess(command, lock_fd=lock_fd)
    assert _until(lambda: process.poll() is not None)
    assert process.poll() == 127
    assert process.last_lines() == "/nowhere/absent: No such file or directory"
    process.end()


def test_output_and_errors_are_appended_to_the_log(tmp_path: Path, lock_fd: int) -> None:
    for number in range(2):
        process = GuardedProcess(
            _command(tmp_path, "-c", f"import sys; print('out', {number}); print('error', file=sys.stderr)"),
            lock_fd=lock_fd,
        )
        assert _until(lambda p=process: p.poll() is not None)
        process.end()
    assert sorted((tmp_path / "family.log").read_text().split("\n")) == ["", "error", "error", "out 0", "out 1"]


def test_a_command_may_end_in_order(tmp_path: Path, lock_fd: int) -> None:
    process = GuardedProcess(_family(tmp_path, "orderly"), lock_fd=lock_fd)
    pids = _pids(tmp_path / "pids")
    process.end()
    assert process.poll() == 7
    assert "in order" in process.last_lines()
    assert all(_gone(pid) for pid in pids)


def test_a_command_that_ignores_sigterm_is_killed_after_the_grace_period(tmp_path: Path, lock_fd: int) -> None:
    process = GuardedProcess(_family(tmp_path, "stubborn", grace_seconds=0.2), lock_fd=lock_fd)
    pids = _pids(tmp_path / "pids")
    process.end()
    assert process.poll() == 128 + signal.SIGKILL
    assert all(_gone(pid) for pid in pids)


@pytest.mark.skipif(sys.platform != "linux", reason="subreapers are Linux's")
def test_a_descendant_that_left_the_group_is_ended_too(tmp_path: Path, lock_fd: int) -> None:
    process = GuardedProcess(_family(tmp_path, "escaped"), lock_fd=lock_fd)
    pids = _pids(tmp_path / "pids")
    process.end()
    assert all(_gone(pid) for pid in pids)


def test_descendants_of_a_command_that_was_killed_do_not_stay(tmp_path: Path, lock_fd: int) -> None:
    process = GuardedProcess(_family(tmp_path, "escaped"), lock_fd=lock_fd)
    command, child = _pids(tmp_path / "pids")
    os.kill(command, signal.SIGKILL)
    assert _until(lambda: process.poll() is not None)
    assert _gone(child)
    process.end()


def test_nothing_stays_when_the_guard_itself_is_killed(tmp_path: Path, lock_fd: int) -> None:
    process = GuardedProcess(_family(tmp_path, "stubborn"), lock_fd=lock_fd)
    pids = _pids(tmp_path / "pids")
    psutil.Process(pids[0]).parent().kill()  # type: ignore[union-attr]
    assert _until(lambda: process.poll() is not None)
    assert _until(lambda: all(_gone(pid) for pid in pids))
    process.end()


@pytest.mark.parametrize("signum", [signal.SIGKILL, signal.SIGTERM])
def test_nothing_stays_when_the_supervisor_is_killed(tmp_path: Path, signum: signal.Signals) -> None:
    program = (
        "import os, sys, time\n"
        "from pathlib import Path\n"
        "from valerie.embedded.guarded_process import Command, GuardedProcess\n"
        "folder = Path(sys.argv[1])\n"
        "command = Command('family', tuple(sys.argv[2:]), dict(os.environ), folder / 'log', 0.5)\n"
        "process = GuardedProcess(command, lock_fd=os.open(folder / 'lock', os.O_RDWR | os.O_CREAT))\n"
        "time.sleep(600)\n"
    )
    family = [sys.executable, "-c", _FAMILY, "stubborn", str(tmp_path / "pids")]
    supervisor = subprocess.Popen([sys.executable, "-c", program, str(tmp_path), *family])
    pids = _pids(tmp_path / "pids")
    guard = psutil.Process(pids[0]).ppid()
    supervisor.send_signal(signum)
    supervisor.wait()
    assert _until(lambda: all(_gone(pid) for pid in [guard, *pids]))


def test_a_long_log_is_put_aside(tmp_path: Path, lock_fd: int) -> None:
    log = tmp_path / "family.log"
    log.write_text("old")
    os.truncate(log, LOG_BYTES + 1)  # a hole, which takes no space
    GuardedProcess(_command(tmp_path, "-c", "print('new')"), lock_fd=lock_fd).end()
    with (tmp_path / "family.1.log").open() as aside:
        assert aside.read(3) == "old"
    assert "old" not in log.read_text()
