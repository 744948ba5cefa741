"""Tokens on Postgres."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta

import pytest
from sqlalchemy import Engine

from valerie.access import Role
from valerie.db import tokens
from valerie.db.engine import open_engine, reading, writing
from valerie.db.migrate import migrate
from valerie.errors import Conflict

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]

NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)
TOKEN = tokens.TokenRow("nightly", "Ada", Role.RUNNER, NOW, NOW + timedelta(days=1))


@pytest.fixture
def engine(new_database: Callable[[], str]) -> Iterator[Engine]:
    engine = open_engine(new_database())
    migrate(engine)
    yield engine
    engine.dispose()


def test_a_token_is_valid_until_it_expires_or_is_revoked(engine: Engine) -> None:
    with writing(engine) as connection:
        tokens.create(connection, TOKEN, "d" * 64)
    with reading(engine) as connection:
        assert tokens.valid(connection, "d" * 64, NOW) == TOKEN
        assert tokens.valid(connection, "e" * 64, NOW) is None
        assert tokens.valid(connection, "d" * 64, TOKEN.expires_at) is None
    with writing(engine) as connection:
        tokens.revoke(connection, "nightly", NOW)
    with reading(engine) as connection:
        assert tokens.valid(connection, "d" * 64, NOW) is None


def test_a_name_is_never_used_again(engine: Engine) -> None:
    with writing(engine) as connection:
        tokens.create(connection, TOKEN, "d" * 64)
    with pytest.raises(Conflict, match="nightly"), writing(engine) as connection:
        tokens.create(connection, TOKEN, "e" * 64)
