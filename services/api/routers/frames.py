"""Variants and frames of a run, the pictures of a frame, and the stored objects behind them."""

from __future__ import annotations

from typing import Annotated, Literal
from urllib.parse import urlencode

from fastapi import APIRouter, Path, Query, Request, Response

from services.api.dependencies import (
    ContextDependency,
    Cursor,
    FrameDependency,
    Limit,
    RunId,
    decode_cursor,
    encode_cursor,
    index,
)
from services.api.openapi import binary, gives, problems
from services.api.schemas.base import DIGEST
from services.api.schemas.frames import FrameDetail, FramePage, FrameRead, PixelRead, VariantPage, VariantRead
from services.api.transfer import ConditionsDependency, send, send_parts
from valerie.db import runs, variants
from valerie.db.archives import reading_run
from valerie.perception.running.label_png import encode_png
from valerie.pipeline.reading.annotation_files import FILES_REVISION, annotation_arrays, find_annotations, npz
from valerie.pipeline.reading.frame_details import frame_details
from valerie.pipeline.reading.frame_details import list_frames as frames_after
from valerie.pipeline.reading.frame_pictures import find_picture, label_map, paint_picture
from valerie.pipeline.reading.painting import png
from valerie.pipeline.reading.pixels import Pixels
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pictures import PictureKind
from valerie.storage.keys import product_key

router = APIRouter(prefix="/v1", tags=["frames"])

SensorName = Annotated[str | None, Query(max_length=200, description="default: the run's first", examples=["default"])]


@router.get(
    "/runs/{run_id}/variants",
    responses=problems(404, 422),
    summary="Variants with their assignments, rejected ones with the reason",
)
def list_variants(
    run_id: RunId,
    context: ContextDependency,
    limit: Limit = 100,
    cursor: Cursor = None,
    rejected: Annotated[bool | None, Query(description="only rejected, or only accepted ones", examples=[True])] = None,
) -> VariantPage:
    after = decode_cursor(cursor, index)
    with reading_run(context.engine, run_id) as connection:
        runs.get(connection, run_id)
        rows = variants.page(
            connection, run_id, after=-1 if after is None else after[0], limit=limit + 1, rejected=rejected
        )
    items = [VariantRead.model_validate(row) for row in rows[:limit]]
    return VariantPage(items=items, next=encode_cursor(items[-1].index) if len(rows) > limit else None)


@router.get(
    "/runs/{run_id}/frames",
    responses={
        **problems(404, 409, 422),
        **gives(200, ("frame_id", "/v1/frames", "/items/0/id"), ("digest", "/v1/artifacts", "/items/0/truth")),
    },
    summary="Frames and the products they link to",
)
def list_frames(run_id: RunId, context: ContextDependency, limit: Limit = 100, cursor: Cursor = None) -> FramePage:
    place = decode_cursor(cursor, index, index, index)
    frames = frames_after(context, run_id, after=None if place is None else FrameKey(run_id, *place), limit=limit + 1)
    items = [FrameRead.model_validate(frame) for frame in frames[:limit]]
    last = FrameKey.parse(items[-1].id) if len(frames) > limit else None
    following = None if last is None else encode_cursor(last.variant, last.camera, last.time)
    return FramePage(items=items, next=following)


@router.get(
    "/frames/{frame_id}",
    responses=problems(404, 409, 422),
    summary="One frame: visibility of its persons, scores, addresses of its pictures",
)
def read_frame(key: FrameDependency, context: ContextDependency) -> FrameDetail:
    return FrameDetail.model_validate(frame_details(context, key, _address))


@router.get(
    "/frames/{frame_id}/image",
    response_class=Response,
    responses={**problems(404, 409, 422), **binary("image/png", "The picture")},
    summary="A picture of a frame as PNG",
)
def image(
    key: FrameDependency,
    context: ContextDependency,
    conditions: ConditionsDependency,
    kind: Annotated[
        str, Query(max_length=40, description=f"one of {', '.join(PictureKind)}", examples=["picture"])
    ] = "picture",
    function: Annotated[
        str | None, Query(max_length=200, description="default: the run's first", examples=["deeplabv3plus-small"])
    ] = None,
    sensor: SensorName = None,
) -> Response:
    source = find_picture(context, key, kind=kind, function=function, sensor=sensor)
    return send(
        conditions,
        tag=source.tag,
        media_type="image/png",
        content=lambda: png(paint_picture(context, source)),
    )


@router.get(
    "/frames/{frame_id}/pixel",
    responses=problems(404, 409, 422),
    summary="What a pixel of a frame shows to each sensor: class, instance, depth, and the class of each function",
)
def pixel(
    key: FrameDependency,
    request: Request,
    x: Annotated[int, Query(ge=0, le=100_000, description="column from the left, from 0", examples=[48])],
    y: Annotated[int, Query(ge=0, le=100_000, description="row from the top, from 0", examples=[27])],
) -> list[PixelRead]:
    pixels: Pixels = request.app.state.pixels
    return [PixelRead.model_validate(seen) for seen in pixels.at(key, x, y)]


@router.get(
    "/frames/{frame_id}/labels",
    response_class=Response,
    responses={**problems(404, 409, 422), **binary("image/png", "8 bits per pixel")},
    summary="The label ids of a frame as PNG: its truth, or the prediction of a function",
)
def labels(
    key: FrameDependency,
    context: ContextDependency,
    conditions: ConditionsDependency,
    function: Annotated[
        str | None, Query(max_length=200, description="default: the truth", examples=["deeplabv3plus-small"])
    ] = None,
    sensor: SensorName = None,
) -> Response:
    kind = "truth" if function is None else "prediction"
    source = find_picture(context, key, kind=kind, function=function, sensor=sensor)
    return send(
        conditions,
        tag=f"{source.tag}-labels",
        media_type="image/png",
        content=lambda: encode_png(label_map(context, source)),
    )


@router.get(
    "/frames/{frame_id}/annotations/{kind}",
    response_class=Response,
    responses={**problems(404, 409, 422), **binary("application/zip", "Arrays as numpy.load reads them (.npz)")},
    summary="An annotation of a frame as a file of numpy",
)
def annotation(
    key: FrameDependency,
    context: ContextDependency,
    conditions: ConditionsDependency,
    kind: Annotated[str, Path(max_length=40, description=f"one of {', '.join(AnnotationKind)}", examples=["normals"])],
) -> Response:
    ((annotation_kind, product),) = find_annotations(context, key, [kind]).items()
    reader = ProductReader(context.store)
    return send(
        conditions,
        tag=f"{product}-npz-{FILES_REVISION}",
        media_type="application/zip",
        content=lambda: npz(annotation_arrays(context, reader, key.run_id, annotation_kind, product)),
    )


@router.get(
    "/artifacts/{kind}/{digest}",
    response_class=Response,
    responses={**problems(404, 422), **binary("application/zstd", "safetensors in one zstd frame")},
    summary="The stored object of a product",
)
def artifact(
    kind: Literal[
        "background",
        "layer",
        "statics",
        "truth",
        "normals",
        "boxes",
        "joints",
        "flow",
        "velocity",
        "scan",
        "prediction",
    ],
    digest: Annotated[
        str,
        Path(pattern=r"^[0-9a-f]{32}$", description="of the product; frames name theirs", examples=[DIGEST]),
    ],
    context: ContextDependency,
    conditions: ConditionsDependency,
) -> Response:
    key = product_key(kind, digest)
    info = context.store.head(key)

    def read(start: int, length: int) -> bytes:
        return context.store.get(key) if length == info.size else context.store.get_range(key, start, length)

    # The digest determines the content; the size distinguishes a broken object from its replacement.
    return send_parts(
        conditions, tag=f"{digest}-{info.size:x}", media_type="application/zstd", size=lambda: info.size, read=read
    )


def _address(key: FrameKey, **parameters: str) -> str:
    return f"/v1/frames/{key}/image?{urlencode(parameters)}"
