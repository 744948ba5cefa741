"""Other releases of VALERIE in folders, whose workers run beside those of this one."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

import psutil
from sqlalchemy import func, select

from tests.world.processes import kill
from valerie.db.engine import open_database, reading
from valerie.db.models import REVISION, Worker
from valerie.embedded.guarded_process import python_command
from valerie.embedded.supervisor import WORKERS, service_environment
from valerie.settings import Settings

ROOT: Final = Path(__file__).parents[2]
NEXT: Final = "next_release"
_PACKAGES: Final = ("valerie", "services", "migrations", "urban_street")
_MIGRATION: Final = f'''"""a column and a table of the next release"""

import sqlalchemy as sa
from alembic import op

revision, down_revision, branch_labels, depends_on = "{NEXT}", "{REVISION}", None, None


def upgrade() -> None:
    for table in ("runs", "products", "workers", "scores"):
        op.add_column(table, sa.Column("later", sa.Integer(), nullable=True))
    op.create_table("later", sa.Column("id", sa.Integer(), primary_key=True))
'''
_SECONDS: Final = 120.0


def next_release(folder: Path) -> Path:
    """Make a release from this one: with a migration that adds columns to its tables, and a table. Return its folder."""
    for package in _PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "migrations" / "versions" / f"{NEXT}.py").write_text(_MIGRATION)
    models = folder / "valerie" / "db" / "models.py"
    text = models.read_text()
    present = f'REVISION: Final = "{REVISION}"'
    assert text.count(present) == 1
    models.write_text(text.replace(present, f'REVISION: Final = "{NEXT}"'))
    return folder


def past_release(reference: str, folder: Path) -> Path:
    """Write the files of a commit or tag of this repository to a folder, and return it."""
    archive = subprocess.run(["git", "archive", reference, *_PACKAGES], cwd=ROOT, check=True, capture_output=True)
    folder.mkdir()
    subprocess.run(["tar", "-x", "-C", folder], input=archive.stdout, check=True)
    return folder


def called(release: Path, settings: Settings, module: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a module of a release until it ends."""
    return subprocess.run(
        python_command(module, *arguments),
        env=_environment(release, "api", settings),
        cwd=release,
        capture_output=True,
        text=True,
        timeout=_SECONDS,
    )


@contextmanager
def running(release: Path, settings: Settings, modules: Mapping[str, str]) -> Iterator[list[psutil.Process]]:
    """Start services of a release, name to module; yield their processes, and kill them at the end."""
    with _log(settings).open("ab") as log, ExitStack() as stack:
        started = []
        for name, module in modules.items():
            environment = _environment(release, name, settings)
            command = python_command(module)
            process = subprocess.Popen(command, env=environment, cwd=release, stdout=log, stderr=log)
            stack.callback(process.wait)
            started.append(psutil.Process(process.pid))
            stack.callback(kill_all, started[-1:])
        yield started


@contextmanager
def workers_of(release: Path, settings: Settings) -> Iterator[list[psutil.Process]]:
    """Start a worker of a release for each stage; yield their processes once all have joined."""
    before = _joined(settings)
    with running(release, settings, WORKERS) as started:
        deadline = time.monotonic() + _SECONDS
        while _joined(settings) < before + len(WORKERS):
            assert time.monotonic() < deadline, _log(settings).read_text()[-2000:]
            time.sleep(0.1)
        yield started


def kill_all(parents: Sequence[psutil.Process]) -> None:
    """Kill -9 of processes that may have ended, with all below them."""
    for parent in parents:
        with suppress(psutil.NoSuchProcess):
            kill([*parent.children(recursive=True), parent])


def _log(settings: Settings) -> Path:
    settings.data_dir.mkdir(exist_ok=True)
    return settings.data_dir / "services.log"


def _environment(release: Path, name: str, settings: Settings) -> dict[str, str]:
    return service_environment(name, settings) | {"PYTHONPATH": str(release)}


def _joined(settings: Settings) -> int:
    engine = open_database(settings.database_url)
    try:
        with reading(engine) as connection:
            return connection.scalar(select(func.count()).select_from(Worker)) or 0
    finally:
        engine.dispose()
