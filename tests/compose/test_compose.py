"""The containers for real: build, start, scale, a run through the REST API, one worker killed, everything taken down.

`make test-compose`; needs a Docker engine with compose v2. About ten minutes the first time (images are built).
"""

import contextlib
import json
import os
import random
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from valerie.client import Client

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "examples" / "first-run.yaml"
SERVICES = ["postgres", "redis", "api", "render_worker", "infer_worker", "eval_worker"]

pytestmark = [pytest.mark.processes, pytest.mark.timeout(3600)]


class Stack:
    """One compose project with a name, a port and a token of its own."""

    def __init__(self) -> None:
        self.port = _free_port()
        self.token = "token-of-the-container-test"
        self._project = f"valerie-test-{os.getpid()}"
        self._environment = {
            **os.environ,
            "COMPOSE_PROJECT_NAME": self._project,
            "IMAGE_TAG": self._project,
            "VALERIE_API_TOKEN": self.token,
            "VALERIE_API_PORT": str(self.port),
            "BUILDX_NO_DEFAULT_ATTESTATIONS": "1",
        }

    def compose(self, *arguments: str, check: bool = True, capture: bool = True) -> str:
        """``docker compose arguments``; its output."""
        done = subprocess.run(
            ["docker", "compose", *arguments],
            cwd=ROOT,
            env=self._environment,
            stdout=subprocess.PIPE if capture else None,
            stderr=subprocess.STDOUT if capture else None,
            text=True,
            check=False,
        )
        assert not check or done.returncode == 0, f"docker compose {' '.join(arguments)}:\n{done.stdout}"
        return done.stdout or ""

    def containers(self) -> list[dict[str, Any]]:
        """Return the running containers by ``docker compose ps``."""
        lines = self.compose("ps", "--format", "json").splitlines()
        events = [json.loads(line) for line in lines if line.strip()]
        return [one for entry in events for one in (entry if isinstance(entry, list) else [entry])]

    def take_down(self) -> None:
        """No container, volume or image of this project is left: each build is gigabytes that nothing else would free."""
        self.compose("down", "--volumes", "--timeout", "20", check=False, capture=False)
        mine = f"label=com.docker.compose.project={self._project}"
        subprocess.run(
            ["docker", "image", "prune", "--all", "--force", "--filter", mine], check=False, capture_output=True
        )

    def client(self) -> Client:
        return Client(f"http://127.0.0.1:{self.port}", token=self.token)


def _free_port() -> int:
    """Return a free port below those that the kernel gives to outgoing connections, which minutes of downloads would use."""
    for port in random.Random(os.getpid()).sample(range(20_000, 30_000), 100):
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
    raise RuntimeError("no free port between 20000 and 30000")


def _offer_torch() -> None:
    """Let the image install the build of torch that is tested here, if that is the CPU's: the other brings gigabytes."""
    installed = version("torch")
    if installed.endswith("+cpu") and not list((ROOT / "wheels").glob("torch-*.whl")):
        plain = installed.removesuffix("+cpu")
        download = ["-m", "pip", "download", "--quiet", "--no-deps", "--dest", "wheels", f"torch=={plain}"]
        subprocess.run([sys.executable, *download], cwd=ROOT, check=True)


@pytest.fixture(scope="module")
def stack() -> Iterator[Stack]:
    _offer_torch()
    stack = Stack()
    stack.compose("build", capture=False)
    try:
        try:
            stack.compose("up", "--detach", "--wait", "--wait-timeout", "300")
        except AssertionError as error:
            containers = stack.compose("ps", "--all", check=False)
            logs = stack.compose("logs", "--no-color", "--tail", "20", check=False)
            pytest.exit(f"{error}\n{containers}\n{logs}", returncode=1)
        yield stack
    finally:
        stack.take_down()


@pytest.fixture(scope="module")
def finished(stack: Stack) -> Iterator[str]:
    """A run on three render workers, one of which is killed in the middle; its id."""
    stack.compose("up", "--detach", "--wait", "--no-recreate", "--scale", "render_worker=3", capture=False)
    with stack.client() as client:
        run = client.submit(SPEC.read_bytes(), idempotency_key="first")
        assert client.submit(SPEC.read_bytes(), idempotency_key="first").id == run.id
        _wait(
            client,
            run.id,
            until=lambda progress: progress.stages.get("render") is not None and progress.stages["render"].done > 5,
        )
        victim = next(container["Name"] for container in stack.containers() if container["Service"] == "render_worker")
        subprocess.run(["docker", "kill", "--signal", "KILL", victim], check=True, capture_output=True)
        _wait(client, run.id, until=lambda progress: progress.state not in ("submitted", "running", "finishing"))
        yield run.id


def _wait(client: Client, run_id: str, *, until: Any, seconds: float = 1800) -> None:
    deadline = time.monotonic() + seconds
    while not until(progress := client.progress(run_id)):
        assert time.monotonic() < deadline, progress
        time.sleep(1)


def test_every_service_is_healthy(stack: Stack) -> None:
    health = {container["Service"]: container["Health"] for container in stack.containers()}
    assert {name: health.get(name) for name in SERVICES} == dict.fromkeys(SERVICES, "healthy")


def test_the_api_listens_on_loopback_only_and_wants_its_token(stack: Stack) -> None:
    published = [
        port
        for container in stack.containers()
        for port in (container["Publishers"] or [])
        if port.get("PublishedPort")
    ]
    assert {port["URL"] for port in published} == {"127.0.0.1"}
    assert {port["PublishedPort"] for port in published} == {stack.port}
    from valerie.client import ServerProblemError

    stranger = Client(f"http://127.0.0.1:{stack.port}", token="another")
    with stranger, pytest.raises(ServerProblemError) as refused:
        stranger.run("x")
    assert refused.value.status == 401


@pytest.mark.parametrize(
    ("service", "absent"),
    [
        ("api", ["torch", "moderngl", "OpenGL", "pyrender"]),
        ("eval_worker", ["torch", "moderngl", "OpenGL", "pyrender"]),
        ("render_worker", ["torch"]),
        ("infer_worker", ["moderngl", "OpenGL", "pyrender"]),
    ],
)
def test_an_image_holds_only_its_own_libraries(stack: Stack, service: str, absent: list[str]) -> None:
    program = f"import importlib.util as u; print([n for n in {absent!r} if u.find_spec(n)])"
    assert stack.compose("exec", "-T", service, "python", "-c", program).strip() == "[]"


@pytest.mark.parametrize("service", ["api", "render_worker", "infer_worker", "eval_worker"])
def test_no_service_runs_as_root(stack: Stack, service: str) -> None:
    assert stack.compose("exec", "-T", service, "id", "-u").strip() == "10001"


@pytest.mark.parametrize("service", SERVICES)
def test_even_root_cannot_write_to_a_container_outside_its_volumes(stack: Stack, service: str) -> None:
    touch = stack.compose("exec", "-T", "--user", "0", service, "touch", "/etc/planted", check=False)
    assert "Read-only file system" in touch


@pytest.mark.parametrize("service", SERVICES)
def test_a_container_has_limits_and_gains_no_privileges(stack: Stack, service: str) -> None:
    name = next(container["Name"] for container in stack.containers() if container["Service"] == service)
    shown = subprocess.run(["docker", "inspect", name], check=True, capture_output=True, text=True).stdout
    limits = json.loads(shown)[0]["HostConfig"]
    assert limits["Memory"] > 0
    assert limits["PidsLimit"] > 0
    assert "no-new-privileges:true" in limits["SecurityOpt"]


def test_a_run_completes_although_a_render_worker_was_killed(stack: Stack, finished: str) -> None:
    with stack.client() as client:
        run = client.run(finished)
        progress = client.progress(finished)
        assert run.state == "completed", (run.reason, client.failures(finished))
    frames = progress.stages["render"]
    assert frames.done == frames.total >= 120
    assert progress.stages["eval"].done == progress.stages["eval"].total == 2 * frames.total


def test_the_results_are_whole(stack: Stack, finished: str) -> None:
    with stack.client() as client:
        summary = client.summary(finished).summary
        report = client.report(finished).decode()
        evaluated = client.progress(finished).stages["render"].total
    assert summary["frames"] == evaluated
    assert len({row["function"] for row in summary["rows"]}) == 2
    defined = sum(row["defined"] for row in summary["rows"])
    undefined = sum(sum(row["undefined"].values()) for row in summary["rows"])
    persons = sum(row["persons"] for row in summary["rows"])
    assert defined + undefined == persons > 0
    assert undefined > 0
    assert report.lstrip().lower().startswith("<!doctype html>")


def test_the_same_spec_again_makes_nothing(stack: Stack, finished: str) -> None:
    with stack.client() as client:
        plan = client.plan(SPEC.read_bytes())
        assert plan.renders == 0
        assert plan.cpu_seconds == 0
        again = client.submit(SPEC.read_bytes())
        _wait(client, again.id, until=lambda progress: progress.state == "completed", seconds=120)
        first, second = client.summary(finished), client.summary(again.id)
    # Frames and proposed runs are named by the run's id.
    assert second.model_dump_json().replace(again.id, finished) == first.model_dump_json()
