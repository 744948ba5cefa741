"""Queries about registered functions under test: their versions, and the runs that may need them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from datetime import datetime
from typing import Final

from sqlalchemy import Connection, delete, func, select

from valerie.db.models import Function, Run
from valerie.db.rows import columns_of, read_all, read_first
from valerie.db.runs import ACTIVE
from valerie.db.statements import insert_ignoring
from valerie.errors import Conflict
from valerie.perception.documents.function import FunctionDocument
from valerie.runs.products.pins import AnyPins
from valerie.runs.resolving.spec import RunSpec

#: Number of displayed characters of a digest, which identify a version.
SHORT: Final = 12


@dataclass(frozen=True, slots=True)
class FunctionRow:
    """A version of a registered function; see `valerie.db.models.Function`."""

    name: str
    digest: str
    version: int
    document: FunctionDocument
    created_at: datetime

    @property
    def reference(self) -> str:
        """``name@digest``, the reference of exactly this version in specs."""
        return f"{self.name}@{self.digest[:SHORT]}"


@dataclass(frozen=True, slots=True)
class UnfinishedRun:
    """A run that has not ended: its spec names functions; its pins fix their versions once it has started."""

    id: str
    spec: RunSpec
    pins: AnyPins | None


_FUNCTION = select(*columns_of(FunctionRow, Function))


def register(connection: Connection, document: FunctionDocument, now: datetime) -> bool:
    """Write the next version of a name; return False if one of its versions has this document already.

    Raises:
        Conflict: in five attempts, other processes registered versions of this name at the same time.
    """
    for _ in range(5):
        if get(connection, document.name, document.digest) is not None:
            return False
        newest = connection.scalar(select(func.max(Function.version)).where(Function.name == document.name)) or 0
        row = {
            "name": document.name,
            "digest": document.digest,
            "version": newest + 1,
            "document": document,
            "payload": None if document.payload is None else document.payload.sha256,
            "created_at": now,
        }
        if insert_ignoring(connection, Function, [row]):
            return True
        # On Postgres, another process took the number or wrote this same version between the SELECT and the INSERT.
    raise Conflict(
        f"the function {document.name} could not be registered: other processes registered it at the same time"
    )


def get(connection: Connection, name: str, digest: str) -> FunctionRow | None:
    """Return the version of a name that has this full digest."""
    return read_first(connection, _FUNCTION.where(Function.name == name, Function.digest == digest), FunctionRow)


def of_digest(connection: Connection, digest: str) -> FunctionRow | None:
    """Return a version with this digest, under any name."""
    return read_first(connection, _FUNCTION.where(Function.digest == digest).limit(1), FunctionRow)


def versions(connection: Connection, name: str) -> list[FunctionRow]:
    """Return all versions of a name, newest first."""
    return read_all(connection, _FUNCTION.where(Function.name == name).order_by(Function.version.desc()), FunctionRow)


def every(connection: Connection) -> list[FunctionRow]:
    """Return all versions of all names, sorted by name, newest first."""
    return read_all(connection, _FUNCTION.order_by(Function.name, Function.version.desc()), FunctionRow)


def remove(connection: Connection, name: str, digest: str) -> None:
    """Delete a version."""
    connection.execute(delete(Function).where(Function.name == name, Function.digest == digest))


def known_payloads(connection: Connection, digests: Collection[str]) -> set[str]:
    """Return the given SHA-256 digests that are payloads of versions."""
    payloads = connection.scalars(select(Function.payload).where(Function.payload.in_(digests)))
    return {payload for payload in payloads if payload is not None}


def unfinished_runs(connection: Connection) -> list[UnfinishedRun]:
    """Return every run that has not ended."""
    query = select(*columns_of(UnfinishedRun, Run)).where(Run.state.in_(ACTIVE)).order_by(Run.id)
    return read_all(connection, query, UnfinishedRun)
