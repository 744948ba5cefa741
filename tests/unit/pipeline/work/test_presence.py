"""Signs of life of a worker."""

from __future__ import annotations

import os
import sqlite3
import time
from pathlib import Path

import pytest

from tests.world.world import settings_of
from valerie.db import processes
from valerie.db.engine import open_database, reading
from valerie.db.migrate import migrate
from valerie.errors import Conflict
from valerie.pipeline.work.workers import Presence, render_offers
from valerie.runs.products.pins import Probed
from valerie.runs.products.specimens import specimen_key
from valerie.runs.products.states import Stage


def test_a_worker_touches_its_file_while_the_database_is_away_and_removes_it_at_its_end(tmp_path: Path) -> None:
    settings = settings_of(tmp_path)
    migrate(open_database(settings.database_url))
    presence = Presence(settings, Stage.EVAL)
    presence.join(Probed(offers=()))
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


def test_a_worker_reports_its_clock_beside_the_databases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = settings_of(tmp_path)
    engine = open_database(settings.database_url)
    migrate(engine)
    seen, own = [], time.time  # which stays the database's clock
    for ahead in (0.0, -7200.0, 7200.0):
        monkeypatch.setattr(time, "time", lambda ahead=ahead: own() + ahead)
        presence = Presence(settings, Stage.EVAL)
        presence.join(Probed(offers=()))
        with reading(engine) as connection:
            (worker,) = processes.workers(connection, now=own())
        seen.append(worker.clock_ahead)
        presence.leave()
    assert seen == pytest.approx([0.0, -7200.0, 7200.0], abs=1.0)
    engine.dispose()


def test_a_clock_that_is_set_while_a_worker_lives_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = settings_of(tmp_path)
    engine = open_database(settings.database_url)
    migrate(engine)
    presence = Presence(settings, Stage.EVAL)
    presence.join(Probed(offers=()))
    own = time.time
    monkeypatch.setattr(time, "time", lambda: own() + 7200.0)
    deadline = time.monotonic() + 30.0
    ahead = 0.0
    while ahead < 7000.0:
        assert time.monotonic() < deadline, "no heartbeat with the new clock"
        time.sleep(0.1)
        with reading(engine) as connection:
            ahead = processes.workers(connection, now=own())[0].clock_ahead or 0.0
    presence.leave()
    engine.dispose()


def test_a_worker_makes_only_the_specimens_that_its_database_lacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VALERIE_TESTING_ENGINES", "true")
    settings = settings_of(tmp_path)
    presence = Presence(settings, Stage.RENDER)
    with pytest.raises(Conflict, match="valerie migrate"):
        presence.specimen_keys()
    engine = open_database(settings.database_url)
    migrate(engine)
    assert not presence.specimen_keys()
    first = render_offers(["blank"], presence.specimen_keys())
    keys = {specimen_key(offer) for offer in first.offers}
    assert set(first.specimens) == keys
    presence.join(first)
    presence.leave()
    presence = Presence(settings, Stage.RENDER)
    assert presence.specimen_keys() == keys
    again = render_offers(["blank"], presence.specimen_keys())
    assert (again.offers, again.specimens) == (first.offers, {})
    missing = specimen_key(first.offers[0])
    assert set(render_offers(["blank"], keys - {missing}).specimens) == {missing}
    presence.join(again)
    presence.leave()
    with reading(engine) as connection:
        assert processes.stored_specimens(connection, keys) == first.specimens
    engine.dispose()
