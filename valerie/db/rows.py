"""Rows as frozen dataclasses, whose fields name the columns that a query reads."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

from sqlalchemy import Connection, Executable

from valerie.errors import NotFound

R = TypeVar("R")


def columns_of(form: type[Any], *models: type[Any], **others: Any) -> list[Any]:
    """Return the columns for a dataclass's fields, in their order.

    Args:
        form: the dataclass.
        models: tables; a field reads the column of its name in the first table that has one.
        others: columns of other names or tables, by field.
    """
    return [
        others[field.name]
        if field.name in others
        else next(getattr(model, field.name) for model in models if field.name in model.__table__.columns)
        for field in fields(form)
    ]


def read_all(connection: Connection, statement: Executable, form: type[R], **bound: object) -> list[R]:
    """Return the rows of a query over `columns_of` a form; ``bound`` are the values of its parameters."""
    return [form(*row) for row in connection.execute(statement, bound)]


def read_first(connection: Connection, statement: Executable, form: type[R], **bound: object) -> R | None:
    """Return the first row of a query over `columns_of` a form, if any."""
    row = connection.execute(statement, bound).first()
    return None if row is None else form(*row)


def required(row: R | None, kind: str, name: object) -> R:
    """Return the row of something that must exist.

    Raises:
        NotFound: it does not; with its kind and name.
    """
    if row is None:
        raise NotFound(kind, name)
    return row
