"""Restarting what dies, and giving up what cannot live."""

import base64
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from valerie.embedded.guarded_process import Command
from valerie.embedded.supervisor import WORKERS, Service, free_port, service_environment
from valerie.errors import Conflict, InvalidInput
from valerie.settings import load_settings

pytestmark = pytest.mark.processes


class _Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> _Clock:
    return _Clock()


@pytest.fixture
def make(tmp_path: Path, clock: _Clock) -> Iterator[Callable[[str], Service]]:
    lock_fd = os.open(tmp_path / "lock", os.O_RDWR | os.O_CREAT)
    services: list[Service] = []

    def build(program: str) -> Service:
        command = Command("worker", (sys.executable, "-c", program), dict(os.environ), tmp_path / "worker.log", 5.0)
        services.append(Service(command, lock_fd=lock_fd, clock=clock))
        services[-1].start()
        return services[-1]

    yield build
    for service in services:
        service.end()
    os.close(lock_fd)


def _look_until_it_changes(service: Service) -> None:
    for _ in range(1000):
        if service.look():
            return
        time.sleep(0.01)
    raise AssertionError("nothing changed")


def test_a_process_that_runs_is_left_alone(make: Callable[[str], Service]) -> None:
    service = make("import time; time.sleep(600)")
    pid = service.pid
    assert not service.look()
    assert service.pid == pid > 0


def test_a_process_that_ended_is_started_again_after_a_pause(make: Callable[[str], Service], clock: _Clock) -> None:
    service = make("import time; time.sleep(600)")
    first = service.pid
    os.kill(first, 9)
    _look_until_it_changes(service)
    assert service.pid == 0
    assert not service.look()
    clock.now += 0.5
    assert service.look()
    assert service.pid not in (0, first)


def test_the_pause_doubles_with_every_death(make: Callable[[str], Service], clock: _Clock) -> None:
    service = make("")
    for pause in (0.5, 1.0, 2.0, 4.0):
        _look_until_it_changes(service)
        clock.now += pause - 0.01
        assert not service.look()
        clock.now += 0.02
        assert service.look()


def test_a_process_that_always_ends_at_once_is_given_up_with_the_end_of_its_log(
    make: Callable[[str], Service], clock: _Clock
) -> None:
    service = make("print('the reason'); raise SystemExit(3)")
    for _ in range(20):
        _look_until_it_changes(service)
        clock.now += 5
        if service.failure:
            break
    assert service.failure is not None
    assert service.deaths == 5
    assert "the worker process ended 5 times" in service.failure
    assert "exit status 3" in service.failure
    assert "worker.log" in service.failure
    assert service.failure.endswith("the reason")
    assert not service.look()


def test_rare_deaths_are_never_too_many(make: Callable[[str], Service], clock: _Clock) -> None:
    service = make("")
    for _ in range(8):
        _look_until_it_changes(service)  # the end
        clock.now += 100
        assert service.look()  # the new start
    assert service.failure is None


def test_the_configured_port_is_taken_when_it_is_free() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert free_port(load_settings(api_port=port)) == port


def test_a_port_in_use_that_was_asked_for_is_refused_by_number() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(Conflict, match=f"port {port} .*VALERIE_API_PORT"):
            free_port(load_settings(api_port=port))


def test_a_port_at_which_a_server_still_answers_says_so() -> None:
    class Healthy(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Write no log."""

    with HTTPServer(("127.0.0.1", 0), Healthy) as server:
        thread = threading.Thread(target=server.handle_request)
        thread.start()
        with pytest.raises(Conflict, match=f"port {server.server_port} .*a server still answers there"):
            free_port(load_settings(api_port=server.server_port))
        thread.join()


def test_a_default_port_in_use_gives_way_to_a_free_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VALERIE_API_PORT", raising=False)
    with socket.socket() as taken:
        try:
            taken.bind(("127.0.0.1", 8700))
        except OSError:
            pass  # somebody else's has it: as good
        else:
            taken.listen()
        port = free_port(load_settings())
    assert port not in (0, 8700)


def test_port_0_is_any_free_one() -> None:
    assert free_port(load_settings(api_port=0)) > 0


def test_a_name_that_is_no_address_is_refused() -> None:
    with pytest.raises(InvalidInput, match="VALERIE_API_HOST"):
        free_port(load_settings(api_host="no.such.host.invalid"))


def test_a_service_gets_the_settings_and_as_many_threads_as_its_work_can_use(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OMP_NUM_THREADS", "OMP_WAIT_POLICY", "LP_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    settings = load_settings(infer_threads=3, api_port=1234)
    render, infer = service_environment("render", settings), service_environment("infer", settings)
    assert (render["OMP_NUM_THREADS"], render["LP_NUM_THREADS"]) == ("1", str(os.cpu_count()))
    assert infer["LP_NUM_THREADS"] == "0"
    assert infer["OMP_NUM_THREADS"] == "3"
    assert infer["OMP_WAIT_POLICY"] == "PASSIVE"
    assert infer["VALERIE_API_PORT"] == "1234"


def test_a_worker_gets_no_secret_of_the_api(monkeypatch: pytest.MonkeyPatch) -> None:
    hook, key = "https://hooks.example/team-secret", base64.b64encode(b"a secret key of 32 bytes, at any rate").decode()
    secrets = {
        "api_token": "operators-secret-token",
        "oidc_secret": "clients-secret",
        "webhooks": hook,
        "webhook_secret": key,
    }
    for name, value in secrets.items():
        monkeypatch.setenv(f"VALERIE_{name.upper()}", value)
    settings = load_settings()
    for stage in WORKERS:
        assert not {*service_environment(stage, settings).values()} & {*secrets.values()}
    assert {*service_environment("api", settings).values()} >= {*secrets.values()}


def test_what_a_user_set_for_a_library_wins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LP_NUM_THREADS", "4")
    assert service_environment("render", load_settings())["LP_NUM_THREADS"] == "4"


def test_settings_of_the_parent_that_were_overridden_do_not_reach_a_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VALERIE_DATA_DIR", "/elsewhere")
    assert service_environment("api", load_settings(data_dir=tmp_path))["VALERIE_DATA_DIR"] == str(tmp_path)
