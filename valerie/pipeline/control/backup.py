"""Back up a deployment into a folder, and restore it: the database first, then the objects.

Products never change, and one that is missing is computed again, so objects may be newer than the database.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path
from typing import Final

from sqlalchemy.engine import make_url

from valerie.document import Document
from valerie.errors import Conflict, InvalidInput, MissingDependency, NotFound, TransientError
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.environment import software
from valerie.settings import Settings
from valerie.storage.keys import PRODUCTS
from valerie.storage.store import copy_objects, open_store

_CONTENTS: Final = "backup.json"
_SQLITE: Final = "database.sqlite3"
_POSTGRES: Final = "database.dump"
_OBJECTS: Final = "objects"


class Contents(Document):
    """The content of a backup; its file is written last.

    Attributes:
        software: name and version of the program that wrote it.
        database: file of the database.
        objects, bytes: number and total size of the objects.
        products: False if products were left out, because they can be computed again.
    """

    software: str
    database: str
    objects: int
    bytes: int
    products: bool


def back_up(context: Context, folder: Path, *, products: bool = False) -> Contents:
    """Write a backup beside running work.

    Args:
        context: of the deployment.
        folder: new or empty.
        products: also copy the products; otherwise those that are read are computed again.

    Raises:
        Conflict: the folder is not empty.
        MissingDependency: Postgres's programs are not installed.
        TransientError: the database refuses.
    """
    if folder.exists() and any(folder.iterdir()):
        raise Conflict(f"{folder} is not empty: a backup needs a folder of its own")
    folder.mkdir(parents=True, exist_ok=True)
    database = _dump(context.settings.database_url, folder)
    keys = [info.key for info in context.store.list() if products or not info.key.startswith(PRODUCTS)]
    bytes_copied = sum(copy_objects(context.store, open_store(str(folder / _OBJECTS)), keys, replace=True))
    contents = Contents(
        software=software(), database=database, objects=len(keys), bytes=bytes_copied, products=products
    )
    (folder / _CONTENTS).write_text(contents.model_dump_json(indent=2), "utf-8")
    return contents


def restore(settings: Settings, folder: Path) -> Contents:
    """Restore a backup into an empty deployment; migrate afterwards if the backup is of an older version.

    Raises:
        NotFound: the folder is not a complete backup.
        Conflict: the deployment has a database already.
        InvalidInput: the backup is of the other kind of database.
    """
    try:
        contents = Contents.model_validate_json((folder / _CONTENTS).read_bytes())
    except FileNotFoundError:
        raise NotFound(
            "backup", f"{folder / _CONTENTS}: the folder is not a backup, or the backup is unfinished"
        ) from None
    _load(settings.database_url, folder / contents.database)
    source, target = (
        open_store(str(folder / _OBJECTS)),
        open_store(settings.artifacts_url, s3_endpoint=settings.s3_endpoint),
    )
    sum(copy_objects(source, target, [info.key for info in source.list()], replace=True))
    return contents


def _dump(url: str, folder: Path) -> str:
    if make_url(url).get_backend_name() == "sqlite":
        with (
            closing(sqlite3.connect(_path(url))) as source,
            closing(sqlite3.connect(folder / _SQLITE)) as target,
        ):
            source.backup(target)
        return _SQLITE
    _postgres("pg_dump", "--format=custom", "--no-owner", f"--file={folder / _POSTGRES}", url=url)
    return _POSTGRES


def _load(url: str, file: Path) -> None:
    is_sqlite = make_url(url).get_backend_name() == "sqlite"
    if is_sqlite != (file.name == _SQLITE):
        raise InvalidInput(
            "a backup is restored into the kind of database that it was made of",
            field="VALERIE_DATABASE_URL",
            limit="sqlite" if file.name == _SQLITE else "postgresql",
        )
    if is_sqlite:
        target = _path(url)
        if target.exists():
            raise Conflict(f"{target} exists: a backup is restored into an empty deployment")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
        return
    tables = _postgres("psql", "--no-psqlrc", "--tuples-only", "--command=\\dt", url=url)
    if tables.strip():
        raise Conflict("the database has tables: a backup is restored into an empty one")
    # The accounts of stages may not exist there yet: deploy/postgres/roles.sql makes them.
    _postgres("pg_restore", "--no-owner", "--no-privileges", "--exit-on-error", str(file), url=url)


def _path(url: str) -> Path:
    return Path(make_url(url).database or "")


def _postgres(program: str, *arguments: str, url: str) -> str:
    """Run one of Postgres's programs; other users of the machine do not see the password."""
    whole = make_url(url).set(drivername="postgresql")
    environment = {**os.environ, "PGPASSWORD": whole.password or ""}
    address = whole.set(password=None).render_as_string()
    command = [program, f"--dbname={address}", *arguments]
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise MissingDependency(f"{program} is not installed: apt-get install postgresql-client") from None
    if done.returncode:
        raise TransientError(f"{program}: {done.stderr.strip()}")
    return done.stdout
