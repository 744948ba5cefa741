"""Rows of one or several runs, filtered and counted on the server for linked views; saved selections."""

from __future__ import annotations

import io
from typing import Annotated, Literal

import orjson
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from fastapi import APIRouter, Depends, Path, Query, Request, Response, status
from fastapi.responses import StreamingResponse

from services.api.dependencies import ContextDependency, PatientDependency, ProjectDependency
from services.api.openapi import BINARY, gives, problems
from services.api.schemas.base import FRAME_ID, FUNCTION, RUN_ID
from services.api.schemas.explore import (
    SELECTION_NAME,
    ColumnsRead,
    ComparisonRead,
    ConfusionRead,
    HistogramsRead,
    LinksRead,
    NewSelection,
    RatesRead,
    RowsRead,
    SelectionRead,
    SpecRead,
    SwingsRead,
)
from services.api.transfer import TABLES, as_file, send_table
from valerie.analysis.comparison.wording import difference_of_specs
from valerie.analysis.findings.child_specs import drawn_spec, similar_spec
from valerie.analysis.rows.table import EvaluationTable
from valerie.db import runs, selections
from valerie.db.engine import database_moment, reading, writing
from valerie.db.selections import SelectionRow
from valerie.errors import InvalidInput, UnknownName
from valerie.measures import Cell
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.exploring import linked_views
from valerie.pipeline.exploring.class_confusion import ConfusionCell, Confusions
from valerie.pipeline.exploring.exploration import Exploration, Selection
from valerie.pipeline.exploring.exploration_cache import MAX_RUNS, Explorations
from valerie.pipeline.exploring.pairs import PairOutcome, Side, compare_sides, largest_swings
from valerie.pipeline.exploring.thumbnails import MAX_TILES, TILE_KINDS, Tile, Tiles
from valerie.pipeline.export.archive import export_archive
from valerie.pipeline.export.export_plan import ExportSettings, Format
from valerie.runs.document.differing import differing
from valerie.runs.document.draft import draft_of
from valerie.runs.products.frame_keys import ID

router = APIRouter(prefix="/v1", tags=["explore"])

_ARROW = TABLES["arrow"]
_JPEG = "image/jpeg"
_ZIP = "application/zip"
#: Largest number of columns in one request.
_MAX_COLUMNS = 40

Runs = Annotated[
    list[Annotated[str, Query(pattern=ID)]],
    Query(alias="run", min_length=1, max_length=MAX_RUNS, description="ids of runs", examples=[[RUN_ID]]),
]
WhereText = Annotated[
    str,
    Query(
        alias="where",
        max_length=2000,
        description="selects rows; empty: all",
        examples=["distance_m > 25 and pacc < 0.5"],
    ),
]
ColumnNames = Annotated[
    list[Annotated[str, Query(max_length=200)]],
    Query(alias="column", min_length=1, max_length=_MAX_COLUMNS, examples=[["distance_m", "pacc"]]),
]
ColumnName = Annotated[str, Query(max_length=200, examples=["distance_m"])]
Threshold = Annotated[
    float | None, Query(gt=0, le=1, description="of the detection rate; default: the run's", examples=[0.5])
]


def _opened(request: Request, run: Runs) -> Exploration:
    explorations: Explorations = request.app.state.explorations
    return explorations.open(run)


Opened = Annotated[Exploration, Depends(_opened)]


def _selected(exploration: Opened, where: WhereText = "") -> Selection:
    return exploration.select(where)


Selected = Annotated[Selection, Depends(_selected)]


def _detected(run: Runs, context: ContextDependency, threshold: Threshold = None) -> float:
    return threshold or read_run(context, run[0]).resolved.spec.detection_threshold


Detected = Annotated[float, Depends(_detected)]


@router.get("/explore/columns", responses=problems(404, 409, 422), summary="Columns of the rows of some runs")
def columns(exploration: Opened, run: Runs, context: ContextDependency) -> ColumnsRead:
    specs = {run_id: read_run(context, run_id).resolved.spec for run_id in run}
    return ColumnsRead(
        rows=len(exploration),
        threshold=specs[run[0]].detection_threshold,
        read_at=exploration.read_at,
        functions={run_id: list(spec.functions) for run_id, spec in specs.items()},
        columns=list(exploration.columns),
    )


@router.get(
    "/explore/histograms",
    responses=problems(404, 409, 422),
    summary="Numbers of rows by bins of columns, all and selected",
)
def histograms(exploration: Opened, selection: Selected, column: ColumnNames) -> HistogramsRead:
    return HistogramsRead(
        selected=selection.count, histograms=[linked_views.histogram(exploration, name, selection) for name in column]
    )


@router.get(
    "/explore/links",
    responses=problems(404, 409, 422),
    summary="Selected rows that go from a bin of one column to a bin of the next, for parallel coordinates",
)
def links(exploration: Opened, selection: Selected, column: ColumnNames) -> LinksRead:
    return LinksRead(selected=selection.count, links=linked_views.links(exploration, column, selection))


@router.get(
    "/explore/scatter",
    response_class=Response,
    responses={
        **problems(404, 409, 422),
        200: {"description": "Arrow stream", "content": {_ARROW: BINARY}},
    },
    summary="Selected rows over two columns: points if there are few, else a density, as an Arrow stream",
)
def scatter(
    exploration: Opened,
    selection: Selected,
    x: ColumnName = "distance_m",
    y: ColumnName = "pacc",
    color: ColumnName = "",
    form: Annotated[Literal["auto", "cells"], Query(description="cells: a density of any number of rows")] = "auto",
) -> Response:
    return _arrow(linked_views.scatter(exploration, x, y, color, selection, form=form))


@router.get(
    "/explore/rows",
    responses={
        **problems(404, 409, 422),
        200: {
            "content": {
                "text/csv": {"schema": {"type": "string"}, "example": "frame_id,pacc\n"},
                TABLES["parquet"]: BINARY,
                _ARROW: BINARY,
            }
        },
    },
    response_model=RowsRead,
    summary="Selected rows in the order of a column; csv, parquet and arrow give all of them",
)
def rows(
    exploration: Opened,
    selection: Selected,
    sort: Annotated[
        str, Query(max_length=201, description="a column; a leading - sorts in descending order", examples=["pacc"])
    ] = "",
    limit: Annotated[int, Query(ge=1, le=1000)] = 60,
    offset: Annotated[int, Query(ge=0, le=100_000_000)] = 0,
    number: Annotated[int | None, Query(ge=0, description="only the row of this number", examples=[5])] = None,
    format_: Annotated[Literal["json", "csv", "parquet", "arrow"], Query(alias="format")] = "json",
) -> Response:
    if format_ != "json":
        return _file(exploration.rows(selection), format_)
    if number is None:
        items = exploration.page(selection, sort=sort, limit=limit, offset=offset).to_pylist()
    else:
        items = list(_numbered(exploration, [number]).values())
    page = orjson.dumps({"selected": selection.count, "items": items})
    return Response(page, media_type="application/json")


@router.get(
    "/explore/rates",
    responses=problems(404, 409, 422),
    summary="Mean pACC and detection rate of the selected rows beside the rest or another selection, with intervals",
)
def rates(
    exploration: Opened,
    selection: Selected,
    threshold: Detected,
    beside: Annotated[
        str | None,
        Query(max_length=2000, description="selects the other rows; by default the rest", examples=["distance_m < 10"]),
    ] = None,
) -> RatesRead:
    other = ~selection.rows if beside is None else exploration.select(beside, field="beside").rows
    groups = linked_views.rates(exploration, selection.rows, other, threshold)
    return RatesRead(selected=selection.count, scored=selection.scored, threshold=threshold, groups=groups)


def _side(text: str, field: str) -> Side:
    run, colon, function = text.partition(":")
    if not colon:
        raise InvalidInput("not a side", field=field, value=text, limit="run:function")
    return Side(run, function)


_SideText = Annotated[str, Query(max_length=240, description="run:function", examples=[f"{RUN_ID}:{FUNCTION}"])]


def _sides(before: _SideText, after: _SideText) -> tuple[Side, Side]:
    return _side(before, "before"), _side(after, "after")


Sides = Annotated[tuple[Side, Side], Depends(_sides)]


@router.get(
    "/explore/comparison",
    responses=problems(404, 409, 422),
    summary="Two functions or two runs matched by variant: persons fixed, broken, missed by both",
)
def comparison(
    exploration: Opened,
    selection: Selected,
    context: ContextDependency,
    threshold: Detected,
    sides: Sides,
    outcome: Annotated[PairOutcome, Query(description="of the pairs to return")] = PairOutcome.BROKEN,
    limit: Annotated[int, Query(ge=1, le=200)] = 24,
    across: Annotated[
        list[Annotated[str, Query(max_length=200)]] | None,
        Query(
            max_length=_MAX_COLUMNS,
            description="varied parameters that each run holds at a value of its own; rows match across them",
            examples=[["sun-1.elevation"]],
        ),
    ] = None,
) -> ComparisonRead:
    compared = compare_sides(
        exploration,
        selection,
        *sides,
        threshold=threshold,
        outcome=outcome,
        limit=limit,
        across=across or (),
    )
    numbers = [number for pair in compared.pairs for number in (pair.before, pair.after)]
    with reading(context.engine) as connection:
        here, there = (runs.get(connection, side.run).spec for side in sides)
    differs = [difference_of_specs(*one, own="before", other="after") for one in differing(here, there)]
    return ComparisonRead(comparison=compared, differs=differs, rows=_numbered(exploration, numbers))


@router.get(
    "/explore/swings",
    responses=problems(404, 409, 422),
    summary="Pairs of selected rows that differ in only one varied parameter and most in pACC",
)
def swings(
    exploration: Opened,
    selection: Selected,
    limit: Annotated[int, Query(ge=1, le=50, description="of each parameter")] = 6,
) -> SwingsRead:
    listed = largest_swings(exploration, selection, limit=limit)
    numbers = [number for swing in listed for number in (swing.pair.before, swing.pair.after)]
    return SwingsRead(swings=listed, rows=_numbered(exploration, numbers))


@router.get(
    "/explore/confusion",
    responses=problems(404, 409, 422),
    summary="Pixels of each class by predicted class in the selected evaluations of a function, and those in one cell",
)
def confusion(
    request: Request,
    exploration: Opened,
    selection: Selected,
    run: Runs,
    function: Annotated[str, Query(max_length=200, examples=[FUNCTION])],
    truth: Annotated[
        str | None, Query(max_length=40, description="class of the cell's row", examples=["person"])
    ] = None,
    predicted: Annotated[
        str | None, Query(max_length=40, description="class of the cell's column, or void", examples=["rider"])
    ] = None,
    limit: Annotated[int, Query(ge=1, le=200, description="of the frames in the cell")] = 48,
) -> ConfusionRead:
    if (truth is None) != (predicted is None):
        raise InvalidInput("a cell has a true and a predicted class", field="truth" if truth is None else "predicted")
    cell = None if truth is None or predicted is None else ConfusionCell(truth, predicted)
    confusions: Confusions = request.app.state.confusions
    matrix = confusions.confusion(run, exploration, selection, function, cell=cell, limit=limit)
    return ConfusionRead(confusion=matrix, rows=_numbered(exploration, [frame.row for frame in matrix.frames]))


@router.get(
    "/explore/sheet",
    response_class=Response,
    responses={
        **problems(404, 422),
        200: {"description": "JPEG", "content": {_JPEG: BINARY}},
    },
    summary="Thumbnails of frames in one picture, eight in a row",
)
def sheet(
    request: Request,
    tile: Annotated[
        list[Annotated[str, Query(max_length=300)]],
        Query(
            min_length=1,
            max_length=MAX_TILES,
            description="frame:instance:function:sensor",
            examples=[[f"{FRAME_ID}:24001:{FUNCTION}:default"]],
        ),
    ],
    kind: Annotated[
        str, Query(max_length=40, description=f"one of {', '.join(TILE_KINDS)}", examples=["picture"])
    ] = "picture",
    crop: Annotated[bool, Query(description="to the person; else the whole frame")] = False,
    width: Annotated[int, Query(ge=32, le=320, description="of a thumbnail, pixels")] = 160,
) -> Response:
    if kind not in TILE_KINDS:
        raise UnknownName("kind of thumbnail", kind, TILE_KINDS, field="kind")
    tiles: Tiles = request.app.state.tiles
    content = tiles.sheet([Tile.parse(text) for text in tile], kind=kind, crop=crop, width=width)
    return Response(content, media_type=_JPEG, headers={"Cache-Control": "private, max-age=600"})


@router.get(
    "/explore/spec",
    responses=problems(404, 409, 422),
    summary="The spec of a run that refines the region of the selected rows of one run, or repeats them nearby",
)
def refine(
    exploration: Opened,
    selection: Selected,
    run: Runs,
    context: ContextDependency,
    count: Annotated[int, Query(ge=1, le=1000, description="variants of the new run", examples=[64])] = 64,
    form: Annotated[
        Literal["range", "nearby"], Query(description="range: from the ranges of the rows; nearby: around single rows")
    ] = "range",
) -> SpecRead:
    _require_one(run)
    resolved = read_run(context, run[0]).resolved
    table = EvaluationTable(exploration.rows(selection), exploration.table.parameters)
    if form == "nearby":
        child = similar_spec(table, exploration.table, resolved.spec, resolved.space.names, count)
    else:
        child = drawn_spec(table, resolved.spec, resolved.definitions, count)
    return SpecRead(yaml=draft_of(child))


@router.get(
    "/explore/frames",
    response_class=Response,
    responses={
        **problems(404, 409, 422, 507),
        200: {"description": "zip", "content": {_ZIP: BINARY}},
    },
    summary="The frames of the selected rows of one run as a data set: a zip archive of pictures and labels",
)
def frames(
    run: Runs,
    context: PatientDependency,
    where: WhereText = "",
    format_: Annotated[Format, Query(alias="format", description="of the labels")] = "cityscapes",
) -> Response:
    _require_one(run)
    parts = export_archive(context, run[0], ExportSettings(formats=(format_,), where=where))
    return StreamingResponse(parts, media_type=_ZIP, headers=as_file(f"{run[0]}-{format_}.zip"))


def _require_one(run: list[str]) -> None:
    if len(run) > 1:
        raise InvalidInput("this needs the rows of one run", field="run", value=run, limit="one run")


@router.get(
    "/selections",
    responses={**problems(422), **gives(200, ("name", "/v1/selections", "/0/name"))},
    summary="Saved selections, newest first",
)
def list_selections(context: ContextDependency, project: ProjectDependency) -> list[SelectionRead]:
    with reading(context.engine) as connection:
        rows = selections.listed(connection, project=project)
    return [SelectionRead.model_validate(row, from_attributes=True) for row in rows]


@router.post(
    "/selections",
    status_code=status.HTTP_201_CREATED,
    responses={**problems(404, 409, 422), **gives(201, ("name", "/v1/selections", "/name"))},
    summary="Save a selection under a name",
)
def save_selection(new: NewSelection, context: ContextDependency, project: ProjectDependency) -> SelectionRead:
    with writing(context.engine) as connection:
        row = SelectionRow(**new.model_dump(), project=project, created_at=database_moment(connection))
        for run_id in new.runs:
            runs.require(connection, run_id, project=project)
        selections.save(connection, row)
    return SelectionRead.model_validate(row, from_attributes=True)


@router.delete(
    "/selections/{name}",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=problems(404, 422),
    summary="Delete a saved selection",
)
def delete_selection(
    name: Annotated[str, Path(max_length=120, pattern=SELECTION_NAME, examples=["dark and far"])],
    context: ContextDependency,
    project: ProjectDependency,
) -> None:
    with writing(context.engine) as connection:
        selections.remove(connection, name, project=project)


def _numbered(exploration: Exploration, numbers: list[int]) -> dict[int, dict[str, Cell]]:
    known = sorted({number for number in numbers if number < len(exploration)})
    return dict(zip(known, exploration.at(known), strict=True))


def _arrow(table: pa.Table) -> Response:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        # One batch, so that readers need not join several.
        writer.write_table(table.combine_chunks())
    return Response(sink.getvalue().to_pybytes(), media_type=_ARROW)


def _file(table: pa.Table, form: str) -> Response:
    if form == "arrow":
        return _arrow(table)
    sink = io.BytesIO()
    if form == "parquet":
        pa.parquet.write_table(table, sink, compression="zstd")
    else:
        pa.csv.write_csv(table, sink)
    return send_table(sink.getvalue(), "selection", form)
