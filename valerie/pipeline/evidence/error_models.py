"""The perception-error models of a run: fitted to its long table, stored beside its results."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from hashlib import sha256
from typing import Final

import orjson
import pyarrow as pa

from valerie.analysis.error_model.files import CARD, error_model_files
from valerie.analysis.error_model.model import GIVEN, fit_error_models
from valerie.analysis.rows.table import EvaluationTable
from valerie.db import runs
from valerie.db.engine import reading
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.run_artifacts import TABLE_PARQUET, read_artifact
from valerie.runs.resolving.spec import RunSpec
from valerie.storage.keys import run_key, run_prefix

#: Prefix of the file names.
_NAMES: Final = "error-model"


def make_error_models(
    context: Context,
    run_id: str,
    *,
    threshold: float | None = None,
    given: Sequence[str] = GIVEN,
    progress: Callable[[str], None] = lambda _: None,
) -> dict[str, bytes]:
    """Fit the error models of an ended run and store their files in place of earlier ones.

    Args:
        context: database and artifact store.
        run_id: id of the run.
        threshold: a person with pACC below it is a miss; None: the detection threshold of the spec.
        given: columns of the queries.
        progress: receives a message before each fit.

    Returns:
        File name to content.

    Raises:
        NotFound: no such run.
        Conflict: the run has not ended.
        InvalidInput, MissingDependency: as for `valerie.analysis.error_model.model.fit_error_models`.
    """
    table = EvaluationTable.from_parquet(pa.BufferReader(read_artifact(context, run_id, TABLE_PARQUET)))
    with reading(context.engine) as connection:
        spec = runs.get(connection, run_id).spec
    threshold = spec.detection_threshold if threshold is None else threshold
    models = fit_error_models(table, threshold=threshold, given=given, seed=spec.seed, progress=progress)
    files = error_model_files(
        models, run=run_id, table=table_digest(table), threshold=threshold, conditions=_conditions(spec)
    )
    context.store.delete(run_key(run_id, name) for name in _stored_names(context, run_id))
    for name, data in files.items():
        context.store.put(run_key(run_id, name), data, replace=True)
    return files


def stored_error_models(context: Context, run_id: str, table: str) -> dict[str, bytes]:
    """Return file name to content of the error models fitted to the table with this digest; empty if there are none."""
    files = {name: context.store.get(run_key(run_id, name)) for name in _stored_names(context, run_id)}
    if CARD not in files or orjson.loads(files[CARD])["table"] != table:
        return {}
    return files


def table_digest(table: EvaluationTable) -> str:
    """Return the SHA-256, hex, of the table as CSV without the ids of run and frames."""
    anonymous = io.BytesIO()
    table.to_csv(anonymous, without=("run_id", "frame_id"))
    return sha256(anonymous.getvalue()).hexdigest()


def _stored_names(context: Context, run_id: str) -> list[str]:
    prefix = run_prefix(run_id)
    keys = (info.key.removeprefix(prefix) for info in context.store.list(prefix.rstrip("/")))
    return sorted(name for name in keys if name.startswith((f"{_NAMES}.", f"{_NAMES}-")))


def _conditions(spec: RunSpec) -> dict[str, str]:
    size = spec.resolution
    places: dict[str, set[str]] = {}
    for constants in (spec.constants, *(block.constants for block in spec.blocks)):
        for name, value in constants.items():
            places.setdefault(name, set()).add(str(value))
    return {
        "asset": str(spec.asset),
        "resolution": f"{size.width} × {size.height}",
        "cameras": ", ".join(spec.cameras or ("all of the asset",)),
        **{name: " or ".join(sorted(values)) for name, values in sorted(places.items())},
    }
