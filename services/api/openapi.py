"""The OpenAPI document, with the problems of every endpoint, the bearer token and an example of every answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any, Final, TypedDict, cast

from fastapi import APIRouter, FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute
from pydantic import TypeAdapter

from services.api.problems import INVALID_INPUT, MEDIA_TYPE, Problem
from valerie.plain import Json, JsonObject, JsonSchema

#: Status to description, title and example of a detail.
_MEANINGS: Final[dict[int, tuple[str, str, str]]] = {
    401: (
        "The bearer token is missing, wrong, expired or revoked",
        "Unauthorized",
        "a valid bearer token is needed (Authorization header)",
    ),
    403: (
        "The token's role is too low, or it lacks the scope; without a token: another site's page asks, or for another host",
        "Forbidden",
        "this needs the role runner; the token's role: viewer",
    ),
    404: ("Not found, or deleted", "Not found", "there is no run r1ng219w3v1ks"),
    408: ("The body did not arrive in time", "Request timeout", "the request body did not arrive in time; limit: 60 s"),
    409: (
        "The present state does not allow this",
        "Conflict",
        "run r1ng219w3v1ks is completed; this is possible when it is running",
    ),
    413: ("The body is too long", INVALID_INPUT, "the request body is too large: 10000000 bytes; limit: 2000000"),
    416: (
        "The range begins beyond the end",
        INVALID_INPUT,
        "range: begins beyond the end; limit: 2190 bytes",
    ),
    422: ("The request is invalid; errors name field, value and limit", INVALID_INPUT, "step: must be above 0; got 0"),
    501: (
        "The server lacks a library that this needs",
        "Missing library",
        "converting a checkpoint needs torch, which is not installed here",
    ),
    503: (
        "Database, broker or artifact store does not answer; try again",
        "Temporarily unavailable",
        "the broker does not answer",
    ),
    507: (
        "No space left for artifacts or database",
        "No space left",
        "no space left for artifact runs/r1/report.html",
    ),
}
_ALWAYS: Final = (401, 403, 503)


class _Content(TypedDict, total=False):
    example: Json


class _Link(TypedDict, total=False):
    operationRef: str
    operationId: str
    parameters: dict[str, str]


class _Response(TypedDict, total=False):
    content: dict[str, _Content]
    links: dict[str, _Link]


class _Parameter(TypedDict):
    name: str


class _Operation(TypedDict, total=False):
    operationId: str
    parameters: list[_Parameter]
    responses: dict[str, _Response]


#: Path and method to operation; only the members that examples and links are made of.
_Paths = Mapping[str, Mapping[str, _Operation]]


#: Content that is no text.
BINARY: Final[JsonObject] = {"schema": {"type": "string", "format": "binary"}}


def problems(*statuses: int) -> dict[int | str, JsonObject]:
    """Return ``responses=`` with the problems of every endpoint and those of ``statuses``."""
    late = (408,) if 413 in statuses else ()  # a body that may be too long may also be too slow
    return {status: _response(status) for status in sorted({*_ALWAYS, *statuses, *late})}


def example(value: Any, *, media_type: str = "application/json", status: int = 200) -> dict[int | str, JsonObject]:
    """Return ``responses=`` with an example of the answer."""
    return {status: {"content": {media_type: {"example": value}}}}


def gives(status: int, *ids: tuple[str, str, str]) -> dict[int | str, JsonObject]:
    """Return ``responses=`` that links the answer to the operations that take an id which it gives.

    Args:
        status: of the answer.
        ids: parameter, start of the path of operations that take it, JSON pointer into the answer's body.
    """
    links: JsonObject = {
        f"{parameter} {below}": {"operationRef": below, "parameters": {parameter: f"$response.body#{pointer}"}}
        for parameter, below, pointer in ids
    }
    return {status: {"links": links}}


def request_body(description: str, content: Mapping[str, JsonObject]) -> JsonObject:
    """Return ``openapi_extra=`` of a body that the endpoint reads itself.

    Args:
        description: of the body.
        content: media type to schema and example.
    """
    return {"requestBody": {"required": True, "description": description, "content": dict(content)}}


def document_body(description: str, *, example: Mapping[str, Json], yaml: str) -> JsonObject:
    """Return ``openapi_extra=`` of a document as JSON or YAML, with an example of each."""
    return request_body(
        description,
        {
            "application/json": {"schema": {"type": "object"}, "example": example},
            "application/yaml": {"schema": {"type": "string"}, "example": yaml},
        },
    )


def binary(media_type: str, description: str) -> dict[int | str, JsonObject]:
    """Return ``responses=`` of bytes that support ranges and entity tags."""
    content: JsonObject = {media_type: BINARY}
    return {
        200: {"description": description, "content": content},
        206: {"description": "The requested range", "content": content},
        304: {"description": "The version in If-None-Match is current"},
        416: _response(416),
    }


def install(app: FastAPI, routers: Sequence[APIRouter]) -> None:
    """Complete the generated document, once, at the first request."""

    def build() -> JsonObject:
        if app.openapi_schema is None:
            app.openapi_schema = _document(app, routers)
        return app.openapi_schema

    app.openapi = build  # type: ignore[method-assign]


def _document(app: FastAPI, routers: Sequence[APIRouter]) -> JsonObject:
    document = get_openapi(
        title=app.title, version=app.version, summary=app.summary, description=app.description, routes=app.routes
    )
    components = document.setdefault("components", {})
    models = components.setdefault("schemas", {})
    models["Problem"] = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    models.update(models["Problem"].pop("$defs", {}))
    for unused in ("HTTPValidationError", "ValidationError"):
        models.pop(unused, None)
    components["securitySchemes"] = {
        "token": {
            "type": "http",
            "scheme": "bearer",
            "description": "The value of VALERIE_API_TOKEN, or a token of /v1/tokens. A token with scopes needs the one "
            "that the operation's security names. A server that listens only on its own machine may have none.",
        }
    }
    open_paths = ("/healthz", "/readyz")
    for path, item in document["paths"].items():
        for operation in item.values():
            operation["security"] = [] if path in open_paths else [{"token": operation["tags"]}, {}]
    _add_examples(document["paths"], routers)
    _complete_links(document["paths"])
    return document


def _complete_links(paths: _Paths) -> None:
    """Replace each link of `gives` by one link for each operation that it means."""
    operations = [(path, operation) for path, item in paths.items() for operation in item.values()]
    for response in (response for _, operation in operations for response in operation["responses"].values()):
        if "links" in response:
            response["links"] = {
                target["operationId"]: {"operationId": target["operationId"], "parameters": link["parameters"]}
                for link in response["links"].values()
                for path, target in operations
                if path.startswith(link["operationRef"])
                and link["parameters"].keys() <= {parameter["name"] for parameter in target.get("parameters", ())}
            }


def _add_examples(paths: _Paths, routers: Sequence[APIRouter]) -> None:
    """Give every JSON answer an example: the endpoint's own, or one built from the examples of the model's fields.

    Examples that the generator copied are replaced too: it drops every null, which the schemas require.
    """
    for route in (route for router in routers for route in router.routes if isinstance(route, APIRoute)):
        models = {str(route.status_code or 200): route.response_model}
        models |= {str(status): answer["model"] for status, answer in route.responses.items() if "model" in answer}
        for method in route.methods or ():
            for status, response in paths[route.path][method.lower()]["responses"].items():
                own = route.responses.get(int(status), {}).get("content", {})
                for media_type, content in response.get("content", {}).items():
                    if "example" in own.get(media_type, {}):
                        content["example"] = own[media_type]["example"]
                    elif media_type == "application/json":
                        content["example"] = _example_of_type(models[status])


def _example_of_type(form: Any) -> Json:
    return example_of(cast("JsonSchema", TypeAdapter(form).json_schema(mode="serialization")))


def example_of(schema: JsonSchema, models: Mapping[str, JsonSchema] | None = None) -> Json:
    """Build an example of a JSON schema from the examples of its fields; an optional field without one is null.

    Args:
        schema: the schema.
        models: definitions that it refers to; None: its own.

    Raises:
        KeyError: a field has neither example nor default.
    """
    models = schema.get("$defs", {}) if models is None else models
    if "examples" in schema:
        return schema["examples"][0]
    if "$ref" in schema:
        return example_of(_referred(schema, models), models)
    if "anyOf" in schema:
        references = [option for option in schema["anyOf"] if "$ref" in option]
        return example_of(references[0], models) if references else schema.get("default")
    if "properties" in schema:
        return {name: example_of(member, models) for name, member in schema["properties"].items()}
    if "propertyNames" in schema:
        values = schema["additionalProperties"]
        assert not isinstance(values, bool), "a mapping says what its values are"
        value = example_of(values, models)
        return {str(name): value for name in _referred(schema["propertyNames"], models)["enum"]}
    return [example_of(schema["items"], models)] if "items" in schema else schema["default"]


def _referred(schema: JsonSchema, models: Mapping[str, JsonSchema]) -> JsonSchema:
    """Return the definition that a schema refers to, or the schema itself."""
    return models[schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema


def _response(status: int) -> JsonObject:
    meaning, title, detail = _MEANINGS[status]
    problem: JsonObject = {"type": "about:blank", "title": title, "status": status, "detail": detail}
    if status == HTTPStatus.UNPROCESSABLE_ENTITY:
        problem["errors"] = [{"field": "step", "message": "must be above 0", "value": 0, "limit": "> 0"}]
    return {
        "description": meaning,
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}, "example": problem}},
    }
