"""Transactions of a process that forks."""

import subprocess
import sys
from pathlib import Path

import pytest

# A thread writes for a second; meanwhile the process forks, and the child writes with little patience.
PROGRAM = """
import contextlib, os, sys, threading, time
from sqlalchemy import text
from valerie.db import engine as db

db._BUSY_TIMEOUT_MS = 2_000
url, guard = sys.argv[1], db.unforked if sys.argv[2] == "guarded" else contextlib.nullcontext
engine = db.open_database(url)
with db.writing(engine) as connection:
    connection.execute(text("create table seen (at integer)"))
inside = threading.Event()

def write():
    with guard(), db.writing(engine) as connection:
        connection.execute(text("insert into seen values (1)"))
        inside.set()
        time.sleep(1.0)

thread = threading.Thread(target=write)
thread.start()
inside.wait()
child = os.fork()
if child == 0:
    try:
        with db.writing(db.open_database(url)) as connection:
            connection.execute(text("insert into seen values (2)"))
    except db.TransientError:
        os._exit(1)
    os._exit(0)
thread.join()
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.parametrize(("how", "code"), [("guarded", "0"), ("unguarded", "1")])
def test_a_child_forked_beside_a_transaction_can_write(tmp_path: Path, how: str, code: str) -> None:
    # Without the guard the child finds the database locked for good: that is what it is for.
    url = f"sqlite:///{tmp_path / 'valerie.sqlite3'}"
    command = [sys.executable, "-c", PROGRAM, url, how]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == code, done.stderr
