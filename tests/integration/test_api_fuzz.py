"""Schemathesis over the OpenAPI document: whatever is sent, no answer is a defect, and every answer is as documented."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import schemathesis
import structlog
from hypothesis import HealthCheck, given, settings
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from services.api.app import create_app
from tests.world.drawn import DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.logs import configure_logging
from valerie.settings import load_settings

pytestmark = [pytest.mark.processes, pytest.mark.timeout(900)]

CHECKS = [
    not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance,
    response_headers_conformance,
]  # fmt: skip


@pytest.fixture(scope="module")
def schema(new_database: Callable[[], str], redis_url: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The document of a server over Postgres with a finished run; half of the addresses name what exists."""
    folder: Path = tmp_path_factory.mktemp("fuzz")
    settings_ = settings_of(folder, database_url=new_database(), broker_url=redis_url, log_level="error")
    configure_logging(settings_)
    world = DrawnWorld(settings_)
    run = world.work(spec("finished", vary=[["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 15.0]]))
    world.context.engine.dispose()
    with served(create_app(settings_, control=False)) as client:
        frame = client.get(f"/v1/runs/{run}/frames").json()["items"][0]
        real = {
            "run_id": run,
            "frame_id": frame["id"],
            "name": "drawn-street",
            "digest": frame["truth"],
            "kind": "truth",
        }
        loaded = schemathesis.openapi.from_url(f"{client.base_url}/openapi.json")

        @loaded.hook
        def map_path_parameters(context: Any, path_parameters: dict[str, Any] | None) -> dict[str, Any] | None:
            """Of the addresses that read, every second names something that exists."""
            if path_parameters is None or context.operation.method.upper() == "DELETE":
                return path_parameters
            generated = "".join(map(str, path_parameters.values()))
            if sum(generated.encode("utf-8", "replace")) % 2:
                return path_parameters
            return {name: real.get(name, value) for name, value in path_parameters.items()}

        @loaded.hook
        def map_query(context: Any, query: dict[str, Any] | None) -> dict[str, Any] | None:
            """Of the questions about several runs, every second names the run that exists."""
            if query is None or "run" not in query or sum(str(query).encode("utf-8", "replace")) % 2:
                return query
            return {**query, "run": [run]}

        yield loaded
    structlog.reset_defaults()
    shutil.rmtree(folder, ignore_errors=True)


def _operations() -> list[tuple[str, str]]:
    with tempfile.TemporaryDirectory() as folder:
        document = create_app(load_settings(data_dir=Path(folder)), control=False).openapi()
    return [(method.upper(), path) for path, item in document["paths"].items() for method in item]


@pytest.mark.parametrize("mode", list(GenerationMode), ids=lambda mode: mode.value)
@pytest.mark.parametrize(("method", "path"), _operations(), ids=lambda value: value)
def test_no_request_breaks_the_server_and_every_answer_is_as_documented(
    schema: Any, method: str, path: str, mode: GenerationMode
) -> None:
    operation = schema[path][method]
    if mode is GenerationMode.NEGATIVE and not (
        operation.path_parameters or operation.query or operation.headers or operation.body
    ):
        return  # nothing of it can be wrong

    @settings(max_examples=8, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
    @given(case=operation.as_strategy(generation_mode=mode))
    def holds(case: Any) -> None:
        # The first preview draws a street, on a machine that does other things too.
        case.validate_response(case.call(timeout=120.0), checks=CHECKS)

    holds()
