"""Artifacts that a finished run leaves in the store."""

from __future__ import annotations

from typing import Any, Final

import orjson

from valerie.db import runs
from valerie.db.engine import reading
from valerie.errors import Conflict
from valerie.pipeline.base.context import Context
from valerie.storage.keys import run_key

#: The table of the paper's section 6.2 and the findings, as JSON.
SUMMARY: Final = "summary.json"
#: One HTML file.
REPORT: Final = "report.html"
#: The long table.
TABLE_PARQUET: Final = "evaluations.parquet"
TABLE_CSV: Final = "evaluations.csv"
#: Software of the process that wrote the results, as JSON.
ENVIRONMENT: Final = "environment.json"


def artifact_key(context: Context, run_id: str, name: str) -> str:
    """Return the key of an artifact that the end of a run wrote.

    Raises:
        NotFound: no such run.
        Conflict: the run has not completed, or the artifact is gone.
    """
    key = run_key(run_id, name)
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
    if not context.store.exists(key):
        artifact = name.partition(".")[0]
        raise Conflict(f"run {run_id} is {run.state} and has no {artifact}; a run gets one when it completes")
    return key


def read_artifact(context: Context, run_id: str, name: str) -> bytes:
    """Read an artifact that the end of a run wrote; errors as in `artifact_key`."""
    return context.store.get(artifact_key(context, run_id, name))


def read_summary(context: Context, run_id: str) -> Any:
    """Return the document of a run's summary, findings and verdicts; errors as in `artifact_key`."""
    return orjson.loads(read_artifact(context, run_id, SUMMARY))
