"""Measure CPU time and memory of the end of a large run: reading its rows, analysis, tables and report.

``python -m benchmarks.bench_finish [--rows 300000]``: a real run of 1,000 variants with two cameras, two persons and the blank
engines; then its variants, frames and evaluations are repeated in the database. The repeated evaluations share the stored
scores, so the table has many equal rows; every row is read and decoded on its own.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, insert, literal, select, update

from benchmarks import results
from benchmarks.bench_control_plane import document
from tests.acceptance.system import System
from tests.world.boxes import write_box_street
from valerie.db import runs
from valerie.db.engine import reading, writing
from valerie.db.models import Base, Evaluation, Frame, Run, Variant
from valerie.pipeline.base.context import open_context
from valerie.pipeline.work.finish import write_results
from valerie.runs.document.run_spec import RunSpec
from valerie.storage.keys import run_key

#: Variants that are really made, and rows of each: two cameras, two persons.
MADE = 1_000
ROWS_EACH = 4


def two_cameras(variants: int) -> dict[str, Any]:
    """Return the spec of a run of ``variants`` variants before two cameras."""
    return document(variants) | {"cameras": ["camera-1", "camera-2"]}


def repeat(connection: Connection, run_id: str, times: int) -> None:
    """Repeat a run's variants, frames and evaluations until it has ``times`` as many."""
    numbers = select(literal(1).label("n")).cte("numbers", recursive=True)
    numbers = numbers.union_all(select(numbers.c.n + 1).where(numbers.c.n < times - 1))
    tables: tuple[tuple[type[Base], str], ...] = (
        (Variant, "index"),
        (Frame, "variant_index"),
        (Evaluation, "variant_index"),
    )
    for model, numbered in tables:
        table = model.__table__
        values = [c + numbers.c.n * MADE if c.name == numbered else c for c in table.columns]
        chosen = select(*values).select_from(table).join(numbers, literal(True)).where(table.c.run_id == run_id)
        connection.execute(insert(model).from_select([c.name for c in table.columns], chosen))
    spec = RunSpec.model_validate(two_cameras(MADE * times))
    connection.execute(update(Run).where(Run.id == run_id).values(spec=spec, variant_count=MADE * times))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=300_000)
    times = max(parser.parse_args().rows // (MADE * ROWS_EACH), 2)
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as folder:
        assets = Path(folder) / "assets"
        write_box_street(assets / "box-street")
        with System(Path(folder) / "data", assets) as system:
            run_id = system.submit(two_cameras(MADE))
            assert system.wait(run_id) == "completed"
            settings = system.settings
        context = open_context(settings)
        with writing(context.engine) as connection:
            repeat(connection, run_id, times)
        with reading(context.engine) as connection:
            run = runs.get(connection, run_id)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        started = time.process_time()
        write_results(context, run, [], lambda name, data: context.store.put(run_key(run_id, name), data, replace=True))
        figures = {
            "evaluations": 2 * MADE * times,
            "rows": ROWS_EACH * MADE * times,
            "CPU s": round(time.process_time() - started, 1),
            "memory beside that of the process, MB": round(
                (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
            ),
        }
    for name, value in figures.items():
        print(f"{name}: {value:,}")
    results.write("finish", figures)


if __name__ == "__main__":
    main()
