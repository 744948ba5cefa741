"""The one-machine mode with its real processes: they live, come back, and end together. The engine is the blank one."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest

from tests.world.boxes import spec, write_box_street
from valerie.embedded import running

ROOT = Path(__file__).parents[2]
SERVICES = {"redis", "api", "render", "infer", "eval"}
#: Patience on a machine that does other things too.
SECONDS = 300.0

pytestmark = [pytest.mark.processes, pytest.mark.timeout(900)]

#: 50 variants × 2 cameras: small frames, enough of them to be interrupted before a worker has started.
SPEC = json.dumps(spec(xs=10, ys=5, name="embedded"))


class Command:
    """A ``valerie`` command as a process, and everything that descends from it."""

    def __init__(self, folder: Path, *arguments: str, **environment: str) -> None:
        self.folder = folder
        self.data_dir = folder / "data"
        (folder / "spec.yaml").write_text(SPEC)
        if not (folder / "assets").exists():
            write_box_street(folder / "assets" / "box-street")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "valerie", *arguments, "--data-dir", str(self.data_dir)],
            cwd=folder,
            env={
                **os.environ,
                "PYTHONPATH": str(ROOT),
                "VALERIE_TESTING_ENGINES": "true",
                "VALERIE_RENDER_ENGINES": "blank",
                "VALERIE_INFER_FUNCTIONS": "blank",
                "VALERIE_INFER_ENGINES": "none",
                "VALERIE_API_PORT": "0",
                "VALERIE_ASSET_DIR": str(folder / "assets"),
                **environment,
            },
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def running(self) -> running.Running:
        """The note of the running system, once it is there."""
        assert _until(lambda: self.process.poll() is not None or running.find(self.data_dir) is not None)
        state = running.find(self.data_dir)
        assert state is not None, self.output()
        return state

    def workers(self) -> list[dict[str, Any]]:
        """The workers that the API knows, once there is one per stage."""
        url = self.running().url
        assert _until(lambda: len({worker["stage"] for worker in _get(url, "/v1/workers")}) == 3), _logs(self.data_dir)
        return _get(url, "/v1/workers")

    def descendants(self) -> list[psutil.Process]:
        return psutil.Process(self.process.pid).children(recursive=True)

    def output(self) -> str:
        return self.process.communicate(timeout=SECONDS)[0]

    def events(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.output().splitlines() if line.startswith("{")]

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        self.process.communicate(timeout=SECONDS)


def _until(condition: Callable[[], bool], seconds: float = SECONDS) -> bool:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.2)
    return True


def _get(url: str, path: str) -> Any:
    try:
        return httpx.get(url + path, timeout=10, trust_env=False, verify=False).json()
    except httpx.HTTPError:
        return []


def _logs(data_dir: Path) -> str:
    return "\n".join(
        f"== {path.name}\n{path.read_text()[-2000:]}" for path in sorted((data_dir / "logs").glob("*.log"))
    )


def _all_gone(processes: Sequence[psutil.Process]) -> bool:
    return not [process for process in processes if process.is_running() and process.status() != psutil.STATUS_ZOMBIE]


def _nothing_stays(command: Command, signum: signal.Signals) -> None:
    """End a command whose workers work; check its exit code, and that it leaves no process."""
    command.workers()
    # Guards, services and the workers' children, which a busy machine forks late.
    assert _until(lambda: len(command.descendants()) >= 2 * len(SERVICES) + 2)
    everything = command.descendants()
    command.process.send_signal(signum)
    command.process.wait(SECONDS)
    assert command.process.returncode == 128 + signum
    assert _until(lambda: _all_gone(everything), 30)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Command]]:
    started: list[Command] = []

    def begin(*arguments: str, **environment: str) -> Command:
        started.append(Command(tmp_path, *arguments, **environment))
        return started[-1]

    yield begin
    for command in started:
        command.end()


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Command]:
    """One system for the tests that leave it running."""
    command = Command(tmp_path_factory.mktemp("system"), "up")
    command.workers()
    yield command
    command.end()


def test_every_service_is_a_process_of_its_own(system: Command) -> None:
    pids = system.running().services
    assert pids.keys() == SERVICES
    assert len(set(pids.values())) == len(SERVICES)
    assert all(psutil.pid_exists(pid) for pid in pids.values())


def test_redis_listens_on_no_port(system: Command) -> None:
    redis = psutil.Process(system.running().services["redis"])
    assert redis.net_connections(kind="inet") == []


def test_only_the_api_listens_and_on_loopback_only(system: Command) -> None:
    listening = {
        connection.laddr.ip
        for process in system.descendants()
        for connection in process.net_connections(kind="inet")
        if connection.status == psutil.CONN_LISTEN
    }
    assert listening == {"127.0.0.1"}


def test_a_second_command_uses_the_first_ones_server(system: Command) -> None:
    second = Command(system.folder, "up")
    output = second.output()
    assert second.process.returncode == 0, output
    assert f"using the server at {system.running().url}" in output


def test_a_run_of_another_command_uses_the_server_and_completes(system: Command) -> None:
    second = Command(system.folder, "run", "spec.yaml", "--json")
    events = second.events()
    assert second.process.returncode == 0, events
    assert events[0]["url"] == system.running().url
    assert (events[-1]["event"], events[-1]["state"]) == ("finished", "completed")
    assert Path(system.folder, events[-1]["report"]).read_text().lstrip().lower().startswith("<!doctype html>")


def test_a_worker_may_be_added_by_hand(system: Command) -> None:
    known = {worker["pid"] for worker in system.workers()}
    extra = Command(system.folder, "worker", "eval")
    try:
        assert _until(lambda: extra.process.pid in {worker["pid"] for worker in system.workers()})
    finally:
        extra.end()
    assert extra.process.pid not in known
    assert _until(lambda: {worker["pid"] for worker in system.workers()} == known)


def test_nothing_stays_when_the_command_is_ended(system: Command) -> None:
    _nothing_stays(system, signal.SIGTERM)


def test_nothing_stays_when_the_command_is_killed_while_it_starts(start: Callable[..., Command]) -> None:
    command = start("up")
    assert _until(lambda: len(command.descendants()) >= 6)
    everything = command.descendants()
    command.process.kill()
    assert _until(lambda: _all_gone(everything), 30)


def test_an_interrupted_run_is_cancelled_and_the_next_makes_the_rest(start: Callable[..., Command]) -> None:
    first = start("run", "spec.yaml", "--json")
    url = first.running().url
    assert _until(lambda: bool(_get(url, "/v1/runs").get("items")))
    run_id = _get(url, "/v1/runs")["items"][0]["id"]
    # The list shows a run before the command has the answer to its submission; a run that is running was answered.
    assert _until(lambda: _get(url, f"/v1/runs/{run_id}")["state"] == "running")
    first.process.send_signal(signal.SIGINT)
    output = first.output()
    assert first.process.returncode == 130
    assert f"run {run_id} is cancelled" in output
    second = start("run", "spec.yaml", "--json")
    assert second.events()[-1]["state"] == "completed"
    # The cancelled run goes on without a server of its own: this command is one.
    third = start("resume", run_id)
    assert "mean pACC" in third.output()
    assert third.process.returncode == 0
    again = start("resume", run_id)
    assert f"run {run_id} is completed; it has nothing left to do" in again.output()
    assert again.process.returncode == 5


def test_a_run_whose_command_was_killed_leaves_no_process_and_goes_on_with_the_next_start(
    start: Callable[..., Command],
) -> None:
    first = start("run", "spec.yaml", "--json")
    url = first.running().url
    assert _until(lambda: bool(_get(url, "/v1/runs").get("items")))
    run_id = _get(url, "/v1/runs")["items"][0]["id"]
    assert _until(lambda: _get(url, f"/v1/runs/{run_id}/progress")["stages"].get("render", {}).get("done", 0) > 0)
    everything = first.descendants()
    first.process.kill()
    assert first.process.wait(SECONDS) == -signal.SIGKILL
    assert _until(lambda: _all_gone(everything), 30)
    second = start("up")
    url = second.running().url
    assert _until(lambda: _get(url, f"/v1/runs/{run_id}/progress")["state"] == "completed"), _logs(second.data_dir)
    _nothing_stays(second, signal.SIGINT)


def test_the_command_ends_with_its_parent_where_it_shall(tmp_path: Path) -> None:
    """As under ``make run``: the parent is killed, and cannot tell its child."""
    program = (
        "import os, subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-m', 'valerie', *sys.argv[1:]])\n"
        "print(child.pid, flush=True)\n"
        "time.sleep(600)\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", program, "up", "--data-dir", str(tmp_path / "data"), "--end-with-parent"],
        env={**os.environ, "PYTHONPATH": str(ROOT), "VALERIE_API_PORT": "0"},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert parent.stdout is not None
    child = psutil.Process(int(parent.stdout.readline()))
    assert _until(lambda: len(child.children(recursive=True)) >= 4)
    everything = [child, *child.children(recursive=True)]
    parent.kill()
    parent.communicate()
    assert _until(lambda: _all_gone(everything), 30)


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ({"VALERIE_ARTIFACTS_URL": "/dev/null/artifacts"}, "artifact folder /dev/null/artifacts cannot be used"),
        ({"VALERIE_REDIS_SERVER": "/nowhere/redis-server"}, "VALERIE_REDIS_SERVER"),
        ({"VALERIE_API_HOST": "0.0.0.0", "VALERIE_API_PORT": "0"}, "VALERIE_API_TOKEN"),
        ({"VALERIE_DATABASE_URL": "mysql://x/y"}, "database"),
    ],
)
def test_what_makes_a_start_impossible_is_one_clear_message(
    start: Callable[..., Command], environment: dict[str, str], message: str
) -> None:
    command = start("up", **environment)
    output = command.output()
    assert command.process.returncode in (2, 5)
    assert message in output
    assert "Traceback" not in output
    assert not (command.data_dir / "running.json").exists()


def test_a_service_that_cannot_live_ends_the_command_with_the_reason(start: Callable[..., Command]) -> None:
    command = start("up", VALERIE_RENDER_ENGINES="no-such-engine")
    output = command.output()
    assert command.process.returncode == 5, output
    assert "the render process ended 5 times" in output
    assert "no-such-engine" in output
