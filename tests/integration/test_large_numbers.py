"""Numbers beyond the bounds of the databases, in every place of a request: refused or answered, never a defect."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import httpx
import pytest
import structlog

from services.api.app import create_app
from tests.world.drawn import DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.logs import configure_logging

pytestmark = [pytest.mark.processes, pytest.mark.timeout(600)]

#: Beyond the databases' integers of 32 and 64 bits, exact doubles, all doubles.
_NUMBERS = (2**31, 2**53 + 1, 2**63, 10**30, 10**400)


class Deployment(NamedTuple):
    """A served database with a finished run."""

    client: httpx.Client
    finished: str


@pytest.fixture(scope="module", params=["sqlite", "postgres"])
def deployment(
    request: pytest.FixtureRequest, new_database: Callable[[], str], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Deployment]:
    url = {"database_url": new_database()} if request.param == "postgres" else {}
    settings = settings_of(tmp_path_factory.mktemp(request.param), log_level="error", **url)
    configure_logging(settings)
    world = DrawnWorld(settings)
    run = world.work(spec("finished", vary=[["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 15.0]]))
    world.context.engine.dispose()
    with served(create_app(settings, control=False)) as client:
        yield Deployment(client, run)
    structlog.reset_defaults()


@pytest.mark.parametrize("column", ["variant_index", "instance_id", "pixel_area", "pacc", "distance_m"])
def test_no_number_in_a_filter_is_too_large_for_the_database(deployment: Deployment, column: str) -> None:
    path = f"/v1/runs/{deployment.finished}/evaluations"
    rows = deployment.client.get(path).json()["items"]
    defined = sum(row[column] is not None for row in rows)
    assert defined > 0
    for number in _NUMBERS:
        for text, count in ((f"{column}:lt:{number}", defined), (f"{column}:lt:-{number}", 0)):
            answer = deployment.client.get(path, params={"filter": text})
            assert answer.status_code in (200, 422), (text, answer.text)
            assert answer.status_code == 422 or answer.json()["total"] == count, text


@pytest.mark.parametrize("sort", ["variant_index", "pacc"])
def test_no_number_in_a_cursor_is_too_large_for_the_database(deployment: Deployment, sort: str) -> None:
    path = f"/v1/runs/{deployment.finished}/evaluations"
    for place in range(7):
        for number in (*_NUMBERS, *(-number for number in _NUMBERS)):
            position = [0.5, 0, 0, 0, 0, 0, 0]
            position[place] = number
            answer = deployment.client.get(path, params={"sort": sort, "cursor": _cursor(position)})
            assert answer.status_code in (200, 422), (position, answer.text)


@pytest.mark.parametrize(("list_", "length"), [("frames", 3), ("variants", 1)])
def test_no_number_in_the_cursor_of_a_list_is_too_large(deployment: Deployment, list_: str, length: int) -> None:
    for place in range(length):
        for number in (*_NUMBERS, -1):
            position = [0] * length
            position[place] = number
            path = f"/v1/runs/{deployment.finished}/{list_}"
            answer = deployment.client.get(path, params={"cursor": _cursor(position)})
            assert answer.status_code in (200, 422), (position, answer.text)


def test_no_parameter_takes_a_number_that_is_too_large(deployment: Deployment) -> None:
    document = deployment.client.get("/openapi.json").json()
    tried = 0
    for path, operations in document["paths"].items():
        for parameter in operations.get("get", {}).get("parameters", ()):
            forms = [form.get("items", form) for form in parameter["schema"].get("anyOf", [parameter["schema"]])]
            if parameter["in"] == "query" and any(form.get("type") in ("integer", "number") for form in forms):
                for number in _NUMBERS:
                    answer = deployment.client.get(
                        path.format(run_id=deployment.finished, frame_id=f"{deployment.finished}.0.0.0"),
                        params={parameter["name"]: number, "run": deployment.finished},
                    )
                    assert answer.status_code < 500, (path, parameter["name"], number, answer.text)
                    tried += 1
    assert tried >= 20 * len(_NUMBERS)


@pytest.mark.parametrize(
    "frame", ["999999999999999999.9999.999999", f"{2**63 - 1}.0.0", f"0.{2**31}.0", f"0.0.{2**31}"]
)
def test_no_frame_id_is_too_large(deployment: Deployment, frame: str) -> None:
    for part in ("", "/image", "/mask", "/annotations"):
        answer = deployment.client.get(f"/v1/frames/{deployment.finished}.{frame}{part}")
        assert answer.status_code in (404, 422), answer.text


def _cursor(values: list[Any]) -> str:
    return base64.urlsafe_b64encode(json.dumps(values).encode()).decode().rstrip("=")
