"""Ownership of a data folder."""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from valerie.embedded import running
from valerie.embedded.running import Lock, Running, acquire
from valerie.errors import Conflict, StorageUnavailable


@pytest.fixture
def api() -> Iterator[str]:
    """An address that answers as the API's health endpoint does."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200 if self.path == "/healthz" else 404)
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def _note(url: str, pid: int | None = None) -> Running:
    return Running(pid or os.getpid(), url, "redis://", {"api": 1})


def test_a_free_folder_is_owned(tmp_path: Path) -> None:
    lock = acquire(tmp_path / "data")
    assert isinstance(lock, Lock)
    lock.close()


def test_a_second_command_finds_the_first(tmp_path: Path, api: str) -> None:
    lock = acquire(tmp_path)
    assert isinstance(lock, Lock)
    running.write(tmp_path, _note(api))
    assert acquire(tmp_path) == _note(api)
    assert running.find(tmp_path) == _note(api)
    lock.close()


def test_an_owner_that_does_not_answer_is_named(tmp_path: Path) -> None:
    lock = acquire(tmp_path)
    assert isinstance(lock, Lock)
    running.write(tmp_path, _note("http://127.0.0.1:9"))
    with pytest.raises(Conflict, match=f"process {os.getpid()} uses the data folder"):
        acquire(tmp_path, seconds=0.2)
    lock.close()


def test_the_folder_stays_owned_while_a_process_that_inherited_the_lock_lives(tmp_path: Path) -> None:
    lock = acquire(tmp_path)
    assert isinstance(lock, Lock)
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE, pass_fds=(lock.fd,))
    lock.close()
    with pytest.raises(Conflict):
        acquire(tmp_path, seconds=0.2)
    child.communicate(b"\n")
    second = acquire(tmp_path, seconds=5)
    assert isinstance(second, Lock)
    second.close()


def test_the_note_of_a_dead_command_is_not_believed(tmp_path: Path, api: str) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    running.write(tmp_path, _note(api, pid=ended.pid))
    assert running.find(tmp_path) is None


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", json.dumps({"pid": "x", "url": "", "broker_url": "", "services": {}})]
)
def test_an_unreadable_note_is_no_note(tmp_path: Path, text: str) -> None:
    (tmp_path / "running.json").write_text(text)
    assert running.read(tmp_path) is None


def test_removing_a_note_twice_is_no_error(tmp_path: Path) -> None:
    running.write(tmp_path, _note("http://x"))
    running.remove(tmp_path)
    running.remove(tmp_path)
    assert running.read(tmp_path) is None


def test_a_data_folder_below_a_file_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageUnavailable, match="file/data"):
        acquire(tmp_path / "file" / "data")
