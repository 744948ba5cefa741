"""Open the deployment of the data folder, for commands that work without a server."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from valerie.errors import NotFound
from valerie.local.terminal import command_name

if TYPE_CHECKING:
    from valerie.pipeline.base.context import Context
    from valerie.settings import Settings

_SQLITE: Final = "sqlite:///"


def settings_of(data_dir: Path | None = None) -> Settings:
    """Return the settings of this process; options override the environment.

    Raises:
        InvalidInput: an environment variable is invalid.
    """
    # Commands that need no settings start without pydantic.
    from valerie.settings import load_settings

    return load_settings(data_dir=data_dir)


def has_database(settings: Settings) -> bool:
    """Return True if the database file exists; a database on a server counts as existing."""
    url = settings.database_url
    return not url.startswith(_SQLITE) or Path(url.removeprefix(_SQLITE)).exists()


@contextmanager
def context_of(data_dir: Path | None) -> Iterator[Context]:
    """Open the deployment's database and artifact store.

    Raises:
        NotFound: there is no database; none is created.
        ValerieError: the database is of another version.
    """
    settings = settings_of(data_dir)
    if not has_database(settings):
        hint = f"`{command_name()} run` and `{command_name()} up` create one"
        raise NotFound("database", f"{settings.database_url.removeprefix(_SQLITE)}: {hint}")
    with _opened(settings) as context:
        yield context


@contextmanager
def folder_context(folder: Path, *, create: bool) -> Iterator[Context]:
    """Open the database and the artifacts of a data folder, whatever deployment the environment describes.

    Args:
        folder: the data folder.
        create: True to create or migrate the database.

    Raises:
        NotFound: there is no database, and none is to be created.
        ValerieError: the database is of another version.
    """
    from valerie.settings import load_settings

    settings = load_settings(data_dir=folder, database_url="", artifacts_url="")
    if create:
        create_or_migrate(settings)
    elif not has_database(settings):
        raise NotFound("database", f"{folder}: not a data folder of VALERIE")
    with _opened(settings) as context:
        yield context


@contextmanager
def deployment_or_empty(settings: Settings) -> Iterator[Context]:
    """Open the deployment; if there is none, open an empty one that leaves no files.

    Raises:
        ValerieError: the database is of another version.
    """
    if has_database(settings):
        with _opened(settings) as context:
            yield context
        return
    with TemporaryDirectory(prefix="valerie-empty-") as folder:
        update = {"database_url": f"sqlite:///{folder}/empty.sqlite3", "artifacts_url": folder}
        empty = settings.model_copy(update=update)
        migrate_database(empty)
        with _opened(empty) as context:
            yield context


def create_or_migrate(settings: Settings) -> None:
    """Create the data folder and the database, or migrate it to this version."""
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    migrate_database(settings)


def migrate_database(settings: Settings) -> None:
    """Create the tables, or migrate them to this version."""
    from valerie.db.migrate import migrate_url

    migrate_url(settings.database_url)


def open_current(settings: Settings) -> Context:
    """Open a deployment with a database; the caller disposes of the engine.

    Raises:
        ValerieError: the database is of another version.
    """
    from valerie.db.migrate import require_current
    from valerie.pipeline.base.context import open_context

    context = open_context(settings)
    try:
        require_current(context.engine)
    except BaseException:
        context.engine.dispose()
        raise
    return context


@contextmanager
def _opened(settings: Settings) -> Iterator[Context]:
    context = open_current(settings)
    try:
        yield context
    finally:
        context.engine.dispose()
