"""Tokens and the audit log on Postgres."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest
from sqlalchemy import Engine, text
from sqlalchemy.exc import DatabaseError

from valerie.access import Role
from valerie.db import audit, tokens
from valerie.db.engine import reading, writing
from valerie.errors import Conflict

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]

NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)
TOKEN = tokens.TokenRow("nightly", "Ada", Role.RUNNER, NOW, NOW + timedelta(days=1), scopes=("metrics", "runs"))


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


@pytest.mark.parametrize("statement", ["UPDATE audit SET caller = 'x'", "DELETE FROM audit", "TRUNCATE audit"])
def test_rows_of_the_audit_log_can_only_be_added(engine: Engine, statement: str) -> None:
    entry = audit.Entry("ab", NOW, "nightly", "Ada", Role.RUNNER, "127.0.0.1", "DELETE", "/v1/runs/r0", None)
    with writing(engine) as connection:
        audit.append(connection, entry)
    with pytest.raises(DatabaseError, match="append-only"), engine.begin() as connection:
        connection.execute(text(statement))
    with reading(engine) as connection:
        assert list(audit.entries(connection)) == [(1, entry)]
