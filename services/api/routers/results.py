"""Results of a run: variants, frames, evaluations, pictures, report."""

from __future__ import annotations

import hashlib
import io
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Header, Query, Response, status

from services.api.dependencies import (
    ContextDependency,
    Cursor,
    FrameId,
    Limit,
    RunId,
    decode_cursor,
    encode_cursor,
    split_frame_id,
)
from services.api.schemas import (
    EvaluationPage,
    FrameDetail,
    FrameEvaluation,
    FramePage,
    FrameRead,
    PersonRead,
    VariantPage,
    VariantRead,
)
from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.errors import Conflict, InvalidInput
from valerie.pipeline import frames
from valerie.pipeline.pictures import FRAME_KINDS, FUNCTION_KINDS, KINDS, png
from valerie.pipeline.resolution import resolve_stored
from valerie.pipeline.tables import frame_id, read_table, table_row, varied_types
from valerie.storage.keys import product_key, run_key

router = APIRouter(prefix="/v1", tags=["results"])

_FILTER = r"^[a-z_]+:(eq|ne|lt|le|gt|ge|null):.{1,80}$"


@router.get("/runs/{run_id}/variants", summary="Variants with their assignments, rejected ones with the reason")
def list_variants(
    run_id: RunId,
    context: ContextDependency,
    limit: Limit = 100,
    cursor: Cursor = None,
    rejected: Annotated[bool | None, Query(description="only rejected, or only accepted ones")] = None,
) -> VariantPage:
    after = decode_cursor(cursor, int)
    with reading(context.engine) as connection:
        runs.get(connection, run_id)
        rows = runs.variants_page(
            connection, run_id, after=-1 if after is None else after[0], limit=limit + 1, rejected=rejected
        )
    items = [VariantRead.model_validate(row) for row in rows[:limit]]
    return VariantPage(items=items, next=encode_cursor(items[-1].index) if len(rows) > limit else None)


@router.get("/runs/{run_id}/frames", summary="Frames and the products they link to")
def list_frames(run_id: RunId, context: ContextDependency, limit: Limit = 100, cursor: Cursor = None) -> FramePage:
    after = decode_cursor(cursor, int, int, int)
    with reading(context.engine) as connection:
        cameras = resolve_stored(runs.get(connection, run_id), context.settings).cameras
        rows = results.frames_page(connection, run_id, after=after or (-1, -1, -1), limit=limit + 1)
    items = [_frame(run_id, row, cameras) for row in rows[:limit]]
    last = rows[limit - 1] if len(rows) > limit else None
    following = encode_cursor(last.variant_index, last.camera_index, last.time_index) if last is not None else None
    return FramePage(items=items, next=following)


@router.get("/frames/{frame_id}", summary="One frame: visibility of its persons, scores, addresses of its pictures")
def read_frame(frame_id: FrameId, context: ContextDependency) -> FrameDetail:
    run_id, variant, camera, time = split_frame_id(frame_id)
    with reading(context.engine) as connection:
        resolved = resolve_stored(runs.get(connection, run_id), context.settings)
        row = results.frame(connection, run_id, variant, camera, time)
        states = [results.product(connection, digest).state for digest in (row.background, row.layer, row.truth)]
        persons = results.person_views(connection, row.truth)
        evaluations = results.frame_evaluations(connection, run_id, variant, camera, time)
    spec = resolved.spec
    read = [
        FrameEvaluation.model_validate(
            {
                **one._mapping,
                "sensor": spec.sensors[one.sensor_index].name,
                "function": spec.functions[one.function_index],
                "state": _state([one.prediction_state, one.scores_state]),
            }
        )
        for one in evaluations
    ]
    base = f"/v1/frames/{frame_id}/image"
    images = {kind: f"{base}?kind={kind}" for kind in FRAME_KINDS}
    for one in read:
        for kind in FUNCTION_KINDS:
            images[f"{kind}:{one.function}"] = f"{base}?kind={kind}&function={one.function}&sensor={one.sensor}"
    return FrameDetail(
        id=frame_id,
        variant_index=variant,
        camera=resolved.cameras[camera],
        time_index=time,
        background=row.background,
        layer=row.layer,
        truth=row.truth,
        state=_state(states),
        assignment=row.assignment,
        persons=[PersonRead.model_validate(one) for one in persons],
        evaluations=read,
        images=images,
    )


@router.get(
    "/frames/{frame_id}/image",
    response_class=Response,
    responses={200: {"content": {"image/png": {}}}, 206: {"content": {"image/png": {}}}, 304: {"model": None}},
    summary="A picture of a frame as PNG",
)
def image(
    frame_id: FrameId,
    context: ContextDependency,
    kind: Annotated[str, Query(description=f"one of {', '.join(KINDS)}")] = "picture",
    function: Annotated[str | None, Query(max_length=100, description="default: the run's first")] = None,
    sensor: Annotated[str | None, Query(max_length=100, description="default: the run's first")] = None,
    range_: Annotated[str | None, Header(alias="range", max_length=100)] = None,
    if_none_match: Annotated[str | None, Header(max_length=200)] = None,
) -> Response:
    picture = frames.paint(context, *split_frame_id(frame_id), kind=kind, function=function, sensor=sensor)
    return _bytes(png(picture), "image/png", range_, if_none_match)


@router.get(
    "/runs/{run_id}/evaluations",
    summary="The long table: one row per person in an evaluation; filter, sort, page; JSON, CSV or Parquet",
    responses={200: {"content": {"text/csv": {}, "application/vnd.apache.parquet": {}}}},
    response_model=EvaluationPage,
)
def list_evaluations(
    run_id: RunId,
    context: ContextDependency,
    filter_: Annotated[
        list[Annotated[str, Query(pattern=_FILTER)]] | None,
        Query(alias="filter", max_length=20, description="column:comparison:value, e.g. distance_m:gt:25"),
    ] = None,
    sort: Annotated[str, Query(max_length=60, description="a column; a leading - sorts downwards")] = "variant_index",
    limit: Limit = 100,
    offset: Annotated[int, Query(ge=0, le=10**9)] = 0,
    format_: Annotated[
        Literal["json", "csv", "parquet"], Query(alias="format", description="csv and parquet hold the whole table")
    ] = "json",
) -> Any:
    with reading(context.engine) as connection:
        resolved = resolve_stored(runs.get(connection, run_id), context.settings)
    if format_ != "json":
        if filter_:
            raise InvalidInput("the downloads hold the whole table", field="filter", limit="format=json")
        table = read_table(context.engine, run_id, resolved)
        buffer = io.BytesIO()
        (table.to_csv if format_ == "csv" else table.to_parquet)(buffer)
        media = "text/csv; charset=utf-8" if format_ == "csv" else "application/vnd.apache.parquet"
        name = f'attachment; filename="{run_id}-evaluations.{format_}"'
        return Response(buffer.getvalue(), media_type=media, headers={"Content-Disposition": name})
    varied = varied_types(resolved)
    with reading(context.engine) as connection:
        rows, total = results.page(
            connection,
            run_id,
            filters=[_filter(one) for one in filter_ or ()],
            sort=sort.removeprefix("-"),
            descending=sort.startswith("-"),
            limit=limit,
            offset=offset,
        )
    items = [table_row(row, run_id, resolved, varied) for row in rows]
    return EvaluationPage(items=items, total=total, offset=offset, limit=limit)


@router.get("/runs/{run_id}/summary", summary="The table of the paper's section 6.2, with findings")
def summary(run_id: RunId, context: ContextDependency) -> dict[str, Any]:
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
    if run.summary is None:
        raise Conflict(f"run {run_id} is {run.state}; it has a summary when it has ended")
    return dict(run.summary)


@router.get("/runs/{run_id}/report", response_class=Response, summary="The self-contained HTML report")
def report(run_id: RunId, context: ContextDependency) -> Response:
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
    if run.summary is None:
        raise Conflict(f"run {run_id} is {run.state}; it has a report when it has ended")
    return Response(context.store.get(run_key(run_id, "report.html")), media_type="text/html; charset=utf-8")


@router.get(
    "/artifacts/{kind}/{digest}",
    response_class=Response,
    responses={206: {"content": {"application/zstd": {}}}},
    summary="The stored object of a product: safetensors in one zstd frame",
)
def artifact(
    kind: Literal["background", "layer", "truth", "prediction"],
    digest: str,
    context: ContextDependency,
    range_: Annotated[str | None, Header(alias="range", max_length=100)] = None,
    if_none_match: Annotated[str | None, Header(max_length=200)] = None,
) -> Response:

    return _bytes(context.store.get(product_key(kind, digest)), "application/zstd", range_, if_none_match)


def _frame(run_id: str, row: Any, cameras: Any) -> FrameRead:
    return FrameRead(
        id=frame_id(run_id, row.variant_index, row.camera_index, row.time_index),
        variant_index=row.variant_index,
        camera=cameras[row.camera_index],
        time_index=row.time_index,
        background=row.background,
        layer=row.layer,
        truth=row.truth,
        state=_state([row.background_state, row.layer_state, row.truth_state]),
    )


def _state(states: list[str]) -> str:
    """Of several products: failed if one failed, done if all are, else that of the slowest."""
    for state in ("failed", "parked", "waiting", "ready", "running"):
        if state in states:
            return state
    return "done"


def _filter(text: str) -> results.Filter:
    column, comparison, value = text.split(":", 2)
    if comparison == "null":
        if value not in ("true", "false"):
            raise InvalidInput("null is compared with true or false", field=f"filter.{column}", value=value)
        return results.Filter(column, comparison, value == "true")
    if column == "undefined_reason":
        return results.Filter(column, comparison, value)
    try:
        number = float(value)
    except ValueError:
        raise InvalidInput("not a number", field=f"filter.{column}", value=value) from None
    if not np.isfinite(number):
        raise InvalidInput("not a finite number", field=f"filter.{column}", value=value)
    return results.Filter(column, comparison, number)


def _bytes(data: bytes, media_type: str, range_: str | None, if_none_match: str | None) -> Response:
    """Answer with an ETag, and with one range if one is asked for (RFC 9110, sections 13 and 14)."""
    etag = f'"{hashlib.sha256(data).hexdigest()[:32]}"'
    headers = {"ETag": etag, "Accept-Ranges": "bytes", "Cache-Control": "private, max-age=0, must-revalidate"}
    if if_none_match is not None and etag in {one.strip().removeprefix("W/") for one in if_none_match.split(",")}:
        return Response(status_code=status.HTTP_304_NOT_MODIFIED, headers=headers)
    if range_ is None or not range_.startswith("bytes=") or "," in range_:
        return Response(data, media_type=media_type, headers=headers)
    first, _, last = range_.removeprefix("bytes=").partition("-")
    size = len(data)
    if not (first + last).isdigit():
        return Response(data, media_type=media_type, headers=headers)
    start = int(first) if first else max(size - int(last), 0)
    end = min(int(last), size - 1) if first and last else size - 1
    if start > end:
        headers["Content-Range"] = f"bytes */{size}"
        return Response(status_code=status.HTTP_416_RANGE_NOT_SATISFIABLE, headers=headers)
    headers["Content-Range"] = f"bytes {start}-{end}/{size}"
    return Response(
        data[start : end + 1], status_code=status.HTTP_206_PARTIAL_CONTENT, media_type=media_type, headers=headers
    )
