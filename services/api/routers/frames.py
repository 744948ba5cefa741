"""Variants and frames of a run, the pictures of a frame, and the stored objects behind them."""

from __future__ import annotations

from typing import Annotated, Any, Literal
from urllib.parse import urlencode

from fastapi import APIRouter, Path, Query, Response

from services.api import examples
from services.api.dependencies import (
    ContextDependency,
    Cursor,
    FrameId,
    Limit,
    RunId,
    decode_cursor,
    encode_cursor,
    index,
    split_frame_id,
)
from services.api.openapi import binary, problems
from services.api.schemas import FrameDetail, FramePage, FrameRead, VariantPage, VariantRead
from services.api.transfer import ConditionsDependency, send
from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.errors import UnknownName
from valerie.pipeline.base.pins import pinned_card
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.pipeline.reading import frames
from valerie.pipeline.reading.annotation_files import FILES_REVISION, annotation_arrays, find_annotations, npz
from valerie.pipeline.reading.pictures import ANNOTATION_KINDS, FRAME_KINDS, FUNCTION_KINDS, KINDS, png
from valerie.pipeline.reading.products import ProductReader
from valerie.pipeline.reading.tables import character_of, frame_id
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.pins import Pins
from valerie.runs.spec import ResolvedRun
from valerie.storage.keys import product_key

router = APIRouter(prefix="/v1", tags=["frames"])


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
    with reading(context.engine) as connection:
        runs.get(connection, run_id)
        rows = runs.variants_page(
            connection, run_id, after=-1 if after is None else after[0], limit=limit + 1, rejected=rejected
        )
    items = [VariantRead.model_validate(row) for row in rows[:limit]]
    return VariantPage(items=items, next=encode_cursor(items[-1].index) if len(rows) > limit else None)


@router.get("/runs/{run_id}/frames", responses=problems(404, 409, 422), summary="Frames and the products they link to")
def list_frames(run_id: RunId, context: ContextDependency, limit: Limit = 100, cursor: Cursor = None) -> FramePage:
    after = decode_cursor(cursor, index, index, index)
    with reading(context.engine) as connection:
        resolved = resolve_stored(runs.get(connection, run_id), context.settings)
        rows = results.frames_page(connection, run_id, after=after or (-1, -1, -1), limit=limit + 1)
    items = [
        FrameRead(
            id=frame_id(run_id, row.variant_index, row.camera_index, row.time_index),
            variant_index=row.variant_index,
            camera=resolved.cameras[row.camera_index],
            time_index=row.time_index,
            time_s=resolved.seconds(row.assignment, row.time_index),
            background=row.background,
            layer=row.layer,
            truth=row.truth,
            state=_state([row.background_state, row.layer_state, row.truth_state]),
        )
        for row in rows[:limit]
    ]
    last = rows[limit - 1] if len(rows) > limit else None
    following = encode_cursor(last.variant_index, last.camera_index, last.time_index) if last is not None else None
    return FramePage(items=items, next=following)


@router.get(
    "/frames/{frame_id}",
    responses=problems(404, 409, 422),
    summary="One frame: visibility of its persons, scores, addresses of its pictures",
)
def read_frame(frame_id: FrameId, context: ContextDependency) -> FrameDetail:
    place = split_frame_id(frame_id)
    run_id, variant, camera, time = place
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
        resolved = resolve_stored(run, context.settings)
        row = results.frame(connection, *place)
        states = [results.product(connection, digest).state for digest in (row.background, row.layer, row.truth)]
        annotations = results.frame_annotations(connection, *place)
        persons = results.person_views(connection, row.truth)
        light = annotations.get("light")
        lit = {one.instance_id: one for one in results.person_lights(connection, light.product)} if light else {}
        evaluations = results.frame_evaluations(connection, *place)
        scores = results.person_scores(connection, [one.scores for one in evaluations])
        before, after = results.neighbours(connection, *place)
    resolution = resolved.spec.resolution
    return FrameDetail.model_validate(
        {
            "id": frame_id,
            "run_id": run_id,
            "variant_index": variant,
            "camera": resolved.cameras[camera],
            "time_index": time,
            "time_s": resolved.seconds(row.assignment, time),
            "width": resolution.width,
            "height": resolution.height,
            "sequence": None
            if resolved.times.step is None
            else {"frames": len(resolved.times.elapsed), "step_s": resolved.times.step},
            "background": row.background,
            "layer": row.layer,
            "truth": row.truth,
            "state": _state(states),
            "assignment": {**row.assignment, **resolved.at(row.assignment, time)},
            "persons": [
                {
                    **_light(lit.get(one.instance_id)),
                    **one._mapping,  # noqa: SLF001  # public in SQLAlchemy
                    "character": character_of(one.instance_id, row.assignment, resolved),
                }
                for one in persons
            ],
            "evaluations": [
                _evaluation(frame_id, one, resolved, run.pinned(), scores[one.scores]) for one in evaluations
            ],
            "annotations": {kind: one.product for kind, one in annotations.items()},
            "images": {
                kind: _address(frame_id, kind=kind)
                for kind in (*FRAME_KINDS, *(one for one in annotations if one in ANNOTATION_KINDS))
            },
            "previous": None if before is None else _id(run_id, before),
            "next": None if after is None else _id(run_id, after),
        }
    )


@router.get(
    "/frames/{frame_id}/image",
    response_class=Response,
    responses={**problems(404, 409, 422), **binary("image/png", "The picture")},
    summary="A picture of a frame as PNG",
)
def image(
    frame_id: FrameId,
    context: ContextDependency,
    conditions: ConditionsDependency,
    kind: Annotated[
        str, Query(max_length=40, description=f"one of {', '.join(KINDS)}", examples=["picture"])
    ] = "picture",
    function: Annotated[
        str | None, Query(max_length=200, description="default: the run's first", examples=["deeplabv3plus-small"])
    ] = None,
    sensor: Annotated[
        str | None, Query(max_length=200, description="default: the run's first", examples=["default"])
    ] = None,
) -> Response:
    if kind not in KINDS:
        raise UnknownName("kind of picture", kind, KINDS, field="kind")
    source = frames.find(context, *split_frame_id(frame_id), kind=kind, function=function, sensor=sensor)
    painted: list[bytes] = []

    def size() -> int:
        painted.append(png(frames.draw(context, source)))
        return len(painted[0])

    return send(
        conditions,
        tag=source.tag,
        media_type="image/png",
        size=size,
        read=lambda start, length: painted[0][start : start + length],
    )


@router.get(
    "/frames/{frame_id}/annotations/{kind}",
    response_class=Response,
    responses={**problems(404, 409, 422), **binary("application/zip", "Arrays as numpy.load reads them (.npz)")},
    summary="An annotation of a frame as a file of numpy",
)
def annotation(
    frame_id: FrameId,
    context: ContextDependency,
    conditions: ConditionsDependency,
    kind: Annotated[str, Path(max_length=40, description=f"one of {', '.join(AnnotationKind)}", examples=["normals"])],
) -> Response:
    run_id, *key = split_frame_id(frame_id)
    ((found, product),) = find_annotations(context, run_id, (key[0], key[1], key[2]), [kind]).items()
    written: list[bytes] = []

    def size() -> int:
        written.append(npz(annotation_arrays(context, ProductReader(context.store), found, product)))
        return len(written[0])

    return send(
        conditions,
        tag=f"{product}-npz-{FILES_REVISION}",
        media_type="application/zip",
        size=size,
        read=lambda start, length: written[0][start : start + length],
    )


@router.get(
    "/artifacts/{kind}/{digest}",
    response_class=Response,
    responses={**problems(404, 422), **binary("application/zstd", "safetensors in one zstd frame")},
    summary="The stored object of a product",
)
def artifact(
    kind: Literal[
        "background", "layer", "statics", "truth", "normals", "boxes", "joints", "flow", "velocity", "prediction"
    ],
    digest: Annotated[
        str,
        Path(pattern=r"^[0-9a-f]{32}$", description="of the product; frames name theirs", examples=[examples.DIGEST]),
    ],
    context: ContextDependency,
    conditions: ConditionsDependency,
) -> Response:
    key = product_key(kind, digest)
    info = context.store.head(key)

    def read(start: int, length: int) -> bytes:
        return context.store.get(key) if length == info.size else context.store.get_range(key, start, length)

    # The content follows from the digest; the size tells a broken object from the one that replaced it.
    return send(
        conditions, tag=f"{digest}-{info.size:x}", media_type="application/zstd", size=lambda: info.size, read=read
    )


def _light(row: Any) -> dict[str, float | None]:
    """The columns of `PersonRead` that only runs with the annotation ``light`` have."""
    return {name: getattr(row, name, None) for name in ("irradiance", "shadow_share", "contrast")}


def _evaluation(frame: str, row: Any, resolved: ResolvedRun, pins: Pins, persons: list[Any]) -> dict[str, Any]:
    sensor = resolved.spec.sensors[row.sensor_index].name
    function = resolved.spec.functions[row.function_index]
    return {
        **row._mapping,  # noqa: SLF001  # public in SQLAlchemy
        "sensor": sensor,
        "function": function,
        "judged_by": pinned_card(pins, function).judged_by,
        "state": _state([row.prediction_state, row.scores_state]),
        "persons": persons,
        "images": {
            kind: _address(frame, kind=kind, function=function, sensor=sensor) for kind in ("picture", *FUNCTION_KINDS)
        },
    }


def _address(frame: str, **parameters: str) -> str:
    return f"/v1/frames/{frame}/image?{urlencode(parameters)}"


def _id(run_id: str, place: tuple[int, int, int]) -> str:
    return frame_id(run_id, *place)


def _state(states: list[str]) -> str:
    """Of several products: failed if one failed, done if all are, else that of the slowest."""
    for state in ("failed", "parked", "waiting", "ready", "running"):
        if state in states:
            return state
    return "done"
