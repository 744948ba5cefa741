"""Signs of life of a worker."""

from __future__ import annotations

import os
import sqlite3
import time
from pathlib import Path

from tests.world.world import settings_of
from valerie.db.engine import open_database
from valerie.db.migrate import migrate
from valerie.pipeline.work.workers import Presence
from valerie.runs.products.pins import Probed
from valerie.runs.products.states import Stage


def test_a_worker_touches_its_file_while_the_database_is_away_and_removes_it_at_its_end(tmp_path: Path) -> None:
    settings = settings_of(tmp_path)
    migrate(open_database(settings.database_url))
    presence = Presence(settings, Stage.EVAL, Probed(offers=()))
    presence.join()
    (file,) = (tmp_path / "health").iterdir()
    locked = sqlite3.connect(tmp_path / "valerie.sqlite3", isolation_level=None)
    locked.execute("BEGIN EXCLUSIVE")
    os.utime(file, (0, 0))
    deadline = time.monotonic() + 30.0
    while file.stat().st_mtime == 0:
        assert time.monotonic() < deadline, "no sign of life"
        time.sleep(0.05)
    locked.execute("ROLLBACK")
    locked.close()
    presence.leave()
    assert not file.exists()
