"""Upload predictions that were made elsewhere."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import APIRouter, Query, Request, Response, status

from services.api.dependencies import Body, ContextDependency, FrameDependency, wake_control
from services.api.openapi import BINARY, problems, request_body
from services.api.schemas.functions import PredictionRead
from valerie.pipeline.work.uploaded_predictions import put_prediction

router = APIRouter(prefix="/v1", tags=["predictions"])

_PNG: Final = request_body(
    "PNG of 8 bits per pixel, of the frame's size; values are ids of the function's classes, 255 is void",
    {"image/png": BINARY},
)


@router.put(
    "/frames/{frame_id}/prediction",
    status_code=status.HTTP_201_CREATED,
    openapi_extra=_PNG,
    responses={
        **problems(404, 409, 413, 422, 507),
        200: {"model": PredictionRead, "description": "the same label map is stored already"},
    },
    summary="Upload the prediction of a frame, for functions of kind predictions",
)
def upload(
    key: FrameDependency,
    request: Request,
    response: Response,
    context: ContextDependency,
    body: Body,
    function: Annotated[
        str | None, Query(max_length=200, description="default: the only one of this kind", examples=["my-predictions"])
    ] = None,
    sensor: Annotated[
        str | None, Query(max_length=200, description="default: the only one", examples=["default"])
    ] = None,
) -> PredictionRead:
    new = put_prediction(context, key, body, function=function, sensor=sensor)
    wake_control(request)
    if not new:
        response.status_code = status.HTTP_200_OK
    return PredictionRead(frame_id=str(key), new=new)
