"""Column types: frozen documents as JSON, enums as their values, moments in UTC."""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime
from enum import StrEnum
from functools import cached_property
from typing import Any, Generic, TypeVar

import orjson
from pydantic import TypeAdapter
from sqlalchemy import ARRAY, JSON, DateTime, Dialect, Enum, String, TypeDecorator
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.types import TypeEngine

from valerie.runs.moments import in_utc

D = TypeVar("D")


class JsonDocument(TypeDecorator[D], Generic[D]):
    """A document in a JSON column (JSONB on Postgres); the column's reader gets the document, or None for NULL.

    `valerie.db.engine` passes JSON text through unparsed, so that pydantic reads and writes it in one step.

    Args:
        form: a pydantic model, or any other type that pydantic knows, e.g. ``dict[str, float]``.
    """

    impl = JSON
    cache_ok = True

    def __init__(self, form: Any) -> None:
        super().__init__(none_as_null=True)
        self.form = form

    @cached_property
    def _adapter(self) -> TypeAdapter[D]:
        return TypeAdapter(self.form)

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        """Return the column's type in a database."""
        return JSONB(none_as_null=True) if dialect.name == "postgresql" else JSON(none_as_null=True)

    def process_bind_param(self, value: D | None, dialect: Dialect) -> Any:  # noqa: ARG002
        """Return the document as JSON text."""
        return None if value is None else self._adapter.dump_json(value).decode()

    def process_result_value(self, value: Any, dialect: Dialect) -> D | None:  # noqa: ARG002
        """Return the document in a JSON text."""
        return None if value is None else self._adapter.validate_json(value)


class TextArray(TypeDecorator[Collection[str]]):
    """The type of a bound value of several texts: an array, or on SQLite JSON for ``json_each``."""

    impl = String
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        """Return the value's type in a database."""
        return ARRAY(String) if dialect.name == "postgresql" else String()

    def process_bind_param(self, value: Collection[str] | None, dialect: Dialect) -> Any:
        """Return the value as the driver takes it."""
        texts = list(value or ())
        return texts if dialect.name == "postgresql" else orjson.dumps(texts).decode()


class UtcMoment(TypeDecorator[datetime]):
    """A moment in UTC; SQLite stores no time zone."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:  # noqa: ARG002
        """Return the moment in UTC."""
        return None if value is None else in_utc(value)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:  # noqa: ARG002
        """Return the moment in UTC, with its time zone."""
        return None if value is None else in_utc(value)


def words(enum: type[StrEnum], length: int) -> Enum:
    """Return the type of a column that holds the values of an enum, as text of at most ``length`` characters."""
    return Enum(
        enum,
        values_callable=lambda members: [member.value for member in members],
        native_enum=False,
        create_constraint=False,
        length=length,
    )
