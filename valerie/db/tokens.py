"""Queries about the API's tokens."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Row, insert, select, update
from sqlalchemy.exc import IntegrityError

from valerie.access import Role
from valerie.db.models import Token
from valerie.db.rows import columns_of, required
from valerie.errors import Conflict


@dataclass(frozen=True, slots=True)
class TokenRow:
    """A token without its secret; all times are in UTC.

    Attributes:
        name: identifies the token; never used again.
        owner: person or service that holds it.
        role: its rights.
        created_at: when it was issued.
        expires_at: from when it is refused.
        revoked_at: when it was revoked; None: it was not.
        used_at: last request, to the minute; None: never used.
        project: the only one that exists for it; empty: all do.
        scopes: names of the areas (`valerie.access.Area`) that it reaches; empty: all.
    """

    name: str
    owner: str
    role: Role
    created_at: datetime
    expires_at: datetime
    revoked_at: datetime | None = None
    used_at: datetime | None = None
    project: str = ""
    scopes: tuple[str, ...] = ()


_TOKEN = select(*columns_of(TokenRow, Token))


def create(connection: Connection, token: TokenRow, digest: str) -> None:
    """Insert a token with the digest of its secret.

    Raises:
        Conflict: a token has or had this name.
    """
    try:
        values = {**asdict(token), "scopes": " ".join(token.scopes)}
        connection.execute(insert(Token).values(digest=digest, **values))
    except IntegrityError as error:
        raise Conflict(f"a token has or had the name {token.name}; choose another") from error


def listed(connection: Connection) -> list[TokenRow]:
    """Return all tokens by name, with those that expired or were revoked."""
    return [_token(row) for row in connection.execute(_TOKEN.order_by(Token.name))]


def revoke(connection: Connection, name: str, now: datetime) -> None:
    """Revoke a token; one that was revoked before keeps its time.

    Raises:
        NotFound: no such token.
    """
    required(connection.scalar(select(Token.name).where(Token.name == name)), "token", name)
    connection.execute(update(Token).where(Token.name == name, Token.revoked_at.is_(None)).values(revoked_at=now))


def valid(connection: Connection, digest: str, now: datetime) -> TokenRow | None:
    """Return the token whose secret has this digest, unless it expired or was revoked."""
    row = connection.execute(_TOKEN.where(Token.digest == digest)).one_or_none()
    token = None if row is None else _token(row)
    return None if token is None or token.revoked_at is not None or token.expires_at <= now else token


def lock(connection: Connection, *, owner: str | None, project: str) -> None:
    """Let other transactions that lock a token of this owner or project wait until this one ends, as SQLite does with all."""
    held = Token.owner == owner
    if project:
        held |= Token.project == project
    connection.execute(select(Token.name).where(held).order_by(Token.name).with_for_update()).all()


def touch(connection: Connection, name: str, now: datetime) -> None:
    """Record a use."""
    connection.execute(update(Token).where(Token.name == name).values(used_at=now))


def _token(row: Row[Any]) -> TokenRow:
    return TokenRow(**{**row._asdict(), "scopes": tuple(row.scopes.split())})
