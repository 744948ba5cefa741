"""Results of a run: the long table, points to plot, summary, report."""

from __future__ import annotations

import io
import math
from typing import Annotated, Literal, cast

from fastapi import APIRouter, Query, Response

from services.api.dependencies import (
    ContextDependency,
    Cursor,
    Limit,
    PatientDependency,
    RunId,
    decode_cursor,
    encode_cursor,
    index,
)
from services.api.dependencies import value_of_column as value
from services.api.openapi import BINARY, binary, example_of, problems
from services.api.schemas.results import EvaluationPage, EvaluationRow, PointColumns, SummaryRead
from services.api.transfer import TABLES, ConditionsDependency, send, send_table
from valerie.analysis.rows.table import encoded
from valerie.analysis.verdicts.verdicts import RequirementVerdict, verdict_table
from valerie.db import long_table
from valerie.db.archives import reading_run
from valerie.errors import InvalidInput, UnknownName
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun, read_run
from valerie.pipeline.base.run_artifacts import REPORT, SUMMARY, artifact_key, read_artifact, read_summary
from valerie.pipeline.reading.points import read_points
from valerie.pipeline.reading.tables import read_table, table_row, varied_types
from valerie.plain import JsonObject, JsonSchema, typed
from valerie.runs.resolving.spec import ResolvedRun

router = APIRouter(prefix="/v1/runs/{run_id}", tags=["results"])

_FILTER = r"^[a-z_]+:(eq|ne|lt|le|gt|ge|null):[^\x00]{1,200}$"
#: Column of names to the database column with the name's position in the spec.
_NAMED = {"camera": "camera_index", "sensor": "sensor_index", "function": "function_index"}
_ROW = cast("JsonObject", example_of(cast("JsonSchema", EvaluationRow.model_json_schema())))
_CSV = "".join(",".join(map(str, cells)) + "\n" for cells in (_ROW, _ROW.values()))


@router.get(
    "/evaluations",
    summary="The long table: one row per person in an evaluation; filter, sort, page; JSON, CSV or Parquet",
    responses={
        **problems(404, 409, 422),
        200: {
            "content": {
                "text/csv": {"schema": {"type": "string"}, "example": _CSV},
                TABLES["parquet"]: BINARY,
            }
        },
    },
    response_model=EvaluationPage,
)
def list_evaluations(
    run_id: RunId,
    context: ContextDependency,
    patient: PatientDependency,
    filter_: Annotated[
        list[Annotated[str, Query(pattern=_FILTER)]] | None,
        Query(
            alias="filter",
            max_length=20,
            description="column:comparison:value with eq, ne, lt, le, gt, ge or null; all must hold",
            examples=[["distance_m:gt:25", "function:eq:deeplabv3plus-small"]],
        ),
    ] = None,
    sort: Annotated[
        str, Query(max_length=60, description="a column; a leading - sorts in descending order", examples=["-pacc"])
    ] = "variant_index",
    limit: Limit = 100,
    cursor: Cursor = None,
    format_: Annotated[
        Literal["json", "csv", "parquet"], Query(alias="format", description="csv and parquet give the whole table")
    ] = "json",
) -> EvaluationPage | Response:
    run = read_run(context, run_id)
    if format_ != "json":
        if filter_ or cursor:
            raise InvalidInput("downloads give the whole table", field="filter", limit="format=json")
        return _download(patient, run, format_)
    column, descending = sort.removeprefix("-"), sort.startswith("-")
    column = _NAMED.get(column, column)
    filters = [_filter(text, run.resolved) for text in filter_ or ()]
    after = decode_cursor(cursor, value, *[index] * len(long_table.KEY))
    if after is not None and isinstance(after[0], str) is not (column == "undefined_reason") and after[0] is not None:
        raise InvalidInput(
            "the cursor belongs to another sort order", field="cursor", value=cursor, limit="sort unchanged"
        )
    with reading_run(context.engine, run_id) as connection:
        rows = long_table.page(
            connection, run_id, filters=filters, sort=column, descending=descending, limit=limit + 1, after=after
        )
        total = long_table.count(connection, run_id, filters=filters)
    varied = varied_types(run.resolved)
    following = encode_cursor(*rows[limit - 1].position(column)) if len(rows) > limit else None
    items = [table_row(row, run, varied) for row in rows[:limit]]
    return EvaluationPage.model_validate({"items": items, "total": total, "next": following})


@router.get(
    "/points", responses=problems(404, 409, 422), summary="pACC over a column, for plots; large runs as an even sample"
)
def points(
    run_id: RunId,
    context: PatientDependency,
    column: Annotated[
        str, Query(max_length=200, description="one of the run's `axes` in the answer", examples=["distance_m"])
    ] = "distance_m",
    limit: Annotated[
        int, Query(ge=100, le=100_000, description="approximate upper limit of the number of points")
    ] = 20_000,
) -> PointColumns:
    return PointColumns.model_validate(read_points(context, run_id, column, limit=limit))


@router.get(
    "/summary",
    responses=problems(404, 409, 422),
    summary="The verdicts, the table of the paper's section 6.2, and the findings",
)
def summary(run_id: RunId, context: ContextDependency) -> SummaryRead:
    return SummaryRead.model_validate_json(read_artifact(context, run_id, SUMMARY))


@router.get(
    "/verdicts",
    summary="The verdicts on the run's requirements, as CSV or Parquet; as JSON they are in the summary",
    response_class=Response,
    responses={
        **problems(404, 409, 422),
        200: {
            "content": {
                "text/csv": {"schema": {"type": "string"}, "example": "id,function,outcome\nSYS-214,one,met\n"},
                TABLES["parquet"]: BINARY,
            }
        },
    },
)
def verdicts(
    run_id: RunId,
    context: ContextDependency,
    format_: Annotated[Literal["csv", "parquet"], Query(alias="format", description="csv or parquet")] = "csv",
) -> Response:
    stored = typed(tuple[RequirementVerdict, ...], read_summary(context, run_id)["verdicts"])
    return send_table(encoded(verdict_table(stored), format_), f"{run_id}-verdicts", format_)


@router.get(
    "/report",
    response_class=Response,
    responses={**problems(404, 409, 422), **binary("text/html", "One self-contained file")},
    summary="The self-contained HTML report",
)
def report(run_id: RunId, context: ContextDependency, conditions: ConditionsDependency) -> Response:
    key = artifact_key(context, run_id, REPORT)
    info = context.store.head(key)
    return send(
        conditions,
        # A retry rewrites the report.
        tag=f"{run_id}-{info.size:x}-{round(info.modified.timestamp() * 1e6):x}",
        media_type="text/html; charset=utf-8",
        content=lambda: context.store.get(key),
        # Sandboxed, so that no text in it can act as a page of this server.
        headers={"Content-Security-Policy": "sandbox allow-scripts allow-popups allow-downloads"},
    )


def _download(context: Context, run: StoredRun, format_: str) -> Response:
    table = read_table(context.engine, run)
    buffer = io.BytesIO()
    (table.to_csv if format_ == "csv" else table.to_parquet)(buffer)
    return send_table(buffer.getvalue(), f"{run.id}-evaluations", format_)


def _filter(text: str, resolved: ResolvedRun) -> long_table.Filter:
    column, comparison, value_text = text.split(":", 2)
    if comparison == "null":
        if value_text not in ("true", "false"):
            raise InvalidInput("null is compared with true or false", field=f"filter.{column}", value=value_text)
        return long_table.Filter(column, comparison, value_text == "true")
    if column in _NAMED:
        return _named(column, comparison, value_text, resolved)
    if column == "undefined_reason":
        return long_table.Filter(column, comparison, value_text)
    try:
        number = float(value_text)
    except ValueError:
        raise InvalidInput("not a number", field=f"filter.{column}", value=value_text) from None
    if not math.isfinite(number):
        raise InvalidInput("not a finite number", field=f"filter.{column}", value=value_text)
    return long_table.Filter(column, comparison, number)


def _named(column: str, comparison: str, name: str, resolved: ResolvedRun) -> long_table.Filter:
    """Return the comparison with a name's position in the spec that replaces one with the name."""
    spec = resolved.spec
    names = {
        "camera": resolved.cameras,
        "sensor": tuple(setting.name for setting in spec.sensors),
        "function": spec.functions,
    }[column]
    if comparison not in ("eq", "ne"):
        raise InvalidInput("names have no order", field=f"filter.{column}", value=comparison, limit="eq or ne")
    if name not in names:
        raise UnknownName(column, name, names, field=f"filter.{column}")
    return long_table.Filter(_NAMED[column], comparison, names.index(name))
