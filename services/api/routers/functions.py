"""Functions under test: register, list, read, remove."""

from __future__ import annotations

import threading
from typing import Annotated, Final

from fastapi import APIRouter, Path, Request, Response, status

from services.api.dependencies import ContextDependency, wake_control
from services.api.openapi import binary, gives, problems, request_body
from services.api.problems import named_by_address
from services.api.schemas.functions import FunctionDetail, FunctionRead
from services.api.transfer import ConditionsDependency, as_file, send
from services.api.upload import FormDependency
from valerie.db.engine import reading
from valerie.errors import NotFound
from valerie.pipeline.functions import catalog, registry
from valerie.pipeline.functions.guarded_import import ImportRequest, import_function

router = APIRouter(prefix="/v1", tags=["functions"])

Reference = Annotated[
    str,
    Path(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}(@[0-9a-f]{6,32})?$",
        description="name, or name@digest of a registered version; the first characters of the digest are enough",
        examples=["deeplabv3plus-small"],
    ),
]
_REFERENCE: Final = ("reference", "/v1/functions", "/reference")
#: One import at a time in this process, since it takes memory and time.
_IMPORTS: Final = threading.Lock()
_FORM: Final = request_body(
    "The document (YAML or JSON, see docs/functions.md), the file, or both. Name, engine and precision override the "
    "document.",
    {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "properties": {
                    "document": {"type": "string"},
                    "payload": {"type": "string", "format": "binary"},
                    "name": {"type": "string"},
                    "engine": {"type": "string"},
                    "precision": {"type": "string"},
                },
            },
            "example": {
                "document": "name: my-net\nclasses: [road, person]\n",
                "payload": "(the file)",
                "engine": "openvino",
            },
        }
    },
)


@router.post(
    "/functions",
    status_code=status.HTTP_201_CREATED,
    openapi_extra=_FORM,
    responses={
        **problems(409, 413, 422, 501, 507),
        **gives(201, _REFERENCE),
        200: {
            "model": FunctionDetail,
            "description": "this version is registered already",
            **gives(200, _REFERENCE)[200],
        },
    },
    summary="Register a function under test; an equal document under the same name changes nothing",
    response_description="registered; Location names this version",
)
def register(form: FormDependency, request: Request, response: Response, context: ContextDependency) -> FunctionDetail:
    import_request = ImportRequest(
        path=form.payload,
        filename="" if form.payload is None else form.payload.name,
        document=form.texts.get("document", ""),
        name=form.texts.get("name"),
        engine=form.texts.get("engine"),
        precision=form.texts.get("precision"),
    )
    with _IMPORTS:
        imported = import_function(import_request, form.folder, context.settings)
    registered, new = registry.register(context, imported.document, imported.payload)
    wake_control(request)
    response.headers["Location"] = f"/v1/functions/{registered.reference}"
    if not new:
        response.status_code = status.HTTP_200_OK
    return FunctionDetail.model_validate(catalog.registered_function(context, registered, imported.trial))


@router.get(
    "/functions",
    responses={**problems(422), **gives(200, ("reference", "/v1/functions", "/0/name"))},
    summary="Functions under test with their cards: installed ones, then every version of registered ones, newest first",
)
def list_functions(context: ContextDependency) -> list[FunctionRead]:
    return [FunctionRead.model_validate(entry) for entry in catalog.functions(context)]


@router.get("/functions/{reference}", responses=problems(404, 422), summary="One function with its card and document")
def read(reference: Reference, context: ContextDependency) -> FunctionDetail:
    with named_by_address():
        return FunctionDetail.model_validate(catalog.function(context, reference))


@router.get(
    "/functions/{reference}/payload",
    response_class=Response,
    responses={**problems(404, 422), **binary("application/octet-stream", "The file")},
    summary="The file of a registered function",
)
def payload(reference: Reference, context: ContextDependency, conditions: ConditionsDependency) -> Response:
    with named_by_address(), reading(context.engine) as connection:
        document = registry.find(connection, reference).document
    if document.payload is None:
        raise NotFound("payload of the function", reference)
    return send(
        conditions,
        tag=document.payload.sha256,
        media_type="application/octet-stream",
        content=lambda: registry.read_payload(context, document),
        headers=as_file(f"{document.name}.{document.payload.format}"),
    )


@router.delete(
    "/functions/{reference}",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=problems(404, 409, 422),
    summary="Remove one version (name@digest) that no unfinished run needs",
)
def remove(reference: Reference, context: ContextDependency) -> None:
    with named_by_address():
        registry.remove(context, reference)
