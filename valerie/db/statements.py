"""Parts of statements that this package's queries share."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from functools import cache
from typing import Any, Final, NamedTuple, TypeVar

from sqlalchemy import (
    BindParameter,
    ColumnElement,
    Connection,
    Executable,
    Select,
    TextClause,
    and_,
    any_,
    bindparam,
    func,
    literal,
    literal_column,
    select,
    true,
    tuple_,
)
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import InstrumentedAttribute

from valerie.db.column_types import TextArray
from valerie.db.models import Base, DeletedRun, Product, Run, Study
from valerie.runs.products.states import ProductState

#: A row of a table; its fields name columns.
Columns = TypeVar("Columns", bound=NamedTuple)
#: Values of a row of any table, by column.
Values = Mapping[str, object]


#: Digests that are bound when a statement is executed.
DIGESTS: Final = bindparam("digests", type_=TextArray())


def _spelled(state: ProductState) -> ColumnElement[ProductState]:
    return literal_column(f"'{state.value}'")


# Literals instead of bound values: SQLite uses a partial index only if the statement's text contains its condition. A query
# for unfinished, waiting or ended products that names no digests needs one of these, or it reads the whole table. Besides, it
# plans a statement again each time a state is bound, which takes longer than executing it on a few products.
UNFINISHED: Final = Product.state.in_(
    [_spelled(state) for state in (ProductState.WAITING, ProductState.READY, ProductState.RUNNING)]
)
WAITING: Final = Product.state == _spelled(ProductState.WAITING)
READY: Final = Product.state == _spelled(ProductState.READY)
RUNNING: Final = Product.state == _spelled(ProductState.RUNNING)
ENDED: Final = Product.state.in_([_spelled(state) for state in (ProductState.DONE, ProductState.FAILED)])
#: The columns of a product that no worker holds.
UNLEASED: Final = {"lease_owner": None, "lease_until": None}


def among(
    dialect: str,
    column: InstrumentedAttribute[Any],
    digests: Collection[str] | BindParameter[Collection[str]] = DIGESTS,
) -> ColumnElement[bool]:
    """Return the condition that a column is one of ``digests``.

    All digests are one bound value, so that the statement is compiled once.
    """
    values = digests if isinstance(digests, BindParameter) else literal(digests, DIGESTS.type)
    if dialect == "postgresql":
        return column == any_(values)
    each = func.json_each(values).table_valued("value")
    return column.in_(select(each.c.value))


def lock(connection: Connection, digests: Collection[str]) -> None:
    """Lock products until the commit, in the order in which every transaction locks them: that of their digests.

    Two transactions that lock the same rows in different orders may wait for each other. SQLite has one writer at a time.
    """
    if connection.dialect.name == "postgresql":
        query = select(Product.digest).where(among(connection.dialect.name, Product.digest, digests))
        connection.execute(query.order_by(Product.digest).with_for_update())


def in_order(dialect: str, *conditions: ColumnElement[bool] | TextClause) -> ColumnElement[bool]:
    """Return the condition that a product meets all ``conditions``; an UPDATE with it locks its rows as `lock` does."""
    if dialect != "postgresql":
        return and_(*conditions)
    rows = select(Product.digest).where(*conditions).order_by(Product.digest).with_for_update().cte("locked")
    return Product.digest.in_(select(rows.c.digest))


def within(table: type[Run | DeletedRun | Study], project: str) -> ColumnElement[bool]:
    """Return the condition that a row is of a project; true of all rows if it is empty."""
    return table.project == project if project else true()


class Seen(NamedTuple):
    """The row of a list that a reader has seen last."""

    created_at: datetime
    id: str


def newest_first(
    query: Select[Any], table: type[Run | Study], *, limit: int, before: Seen | None = None
) -> Select[Any]:
    """Return a page of a query over one table, newest first.

    Args:
        query: the rows.
        table: that has them.
        limit: most rows.
        before: the last row of the page before.
    """
    page = query.order_by(table.created_at.desc(), table.id.desc()).limit(limit)
    return page if before is None else page.where(tuple_(table.created_at, table.id) < before)


def insertion_into(dialect: str, model: type[Base]) -> postgresql.Insert | sqlite.Insert:
    """Return an INSERT of a kind of database, which may have a clause for conflicts."""
    return postgresql.insert(model) if dialect == "postgresql" else sqlite.insert(model)


def insert_ignoring(connection: Connection, model: type[Base], rows: Sequence[Values]) -> int:
    """Insert the rows of any table whose primary keys do not exist yet; return their number."""
    if not rows:
        return 0
    options = {"preserve_rowcount": True}
    return connection.execute(_ignoring(connection.dialect.name, model), list(rows), execution_options=options).rowcount


@cache
def _ignoring(dialect: str, model: type[Base]) -> Executable:
    return insertion_into(dialect, model).on_conflict_do_nothing()


def insert_rows(
    connection: Connection,
    model: type[Base],
    form: type[Columns],
    rows: Sequence[Columns],
    *,
    on_conflict: str = "",
) -> None:
    """Insert named tuples by one prepared statement.

    SQLAlchemy's executemany builds a dictionary and calls a type's processor for every value, which takes a third of the time
    of feeding a large run. Values must already have the driver's types: JSON as text, enums as their values.

    Args:
        connection: SQLite or Postgres.
        model: the table.
        form: the named tuple, whose fields are columns of the table.
        rows: may be empty.
        on_conflict: SQL after ``ON CONFLICT``; empty: a conflict is an error.
    """
    if not rows:
        return
    mark = "%s" if connection.dialect.name == "postgresql" else "?"
    names = ", ".join(f'"{name}"' for name in form._fields)
    marks = ", ".join([mark] * len(form._fields))
    conflict = f" ON CONFLICT {on_conflict}" if on_conflict else ""
    statement = f'INSERT INTO "{model.__tablename__}" ({names}) VALUES ({marks}){conflict}'  # noqa: S608  our own names
    connection.exec_driver_sql(statement, list(rows))
