"""Schemathesis follows the links of the OpenAPI document: whatever is asked in whatever order, no answer is a defect."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest
import schemathesis
import structlog
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis.errors import FlakyStrategyDefinition

from services.api.app import create_app
from tests.integration.test_api_fuzz import CHECKS
from tests.world.drawn import ASSET, FUNCTIONS, DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.logs import configure_logging

pytestmark = [pytest.mark.processes, pytest.mark.timeout(7200)]

#: Scenarios of each database, and requests of a scenario. `make test-stateful` sets more.
_SCENARIOS = int(os.environ.get("VALERIE_TEST_SCENARIOS", "2"))
_STEPS = 30
#: The links must lead to so many operations; where few scenarios did not, more are played, up to so many times as many.
_OPERATIONS, _PATIENCE = 20, 10
#: What nobody may learn from an answer.
_INTERNAL = ("Traceback", '.py", line', "sqlalchemy", "psycopg")
_STUDY = {
    "name": "small",
    "asset": ASSET,
    "vary": [["person-1.pos.x", "UNIFORM", -3, 4], ["person-1.pos.y", "UNIFORM", 5, 35]],
    "resolution": {"width": 96, "height": 54},
    "functions": [FUNCTIONS[0]],
    "measure": "min(pacc) >= 0.5",
    "goal": {"name": "estimate", "first": 20},
    "budget": {"variants": 24},
    "batch": 12,
}
#: Values of query parameters that random text never meets; None: left out, so that lists are not empty.
_QUERY: dict[str, Any] = {
    "column": ["pacc", "distance_m"],
    "function": FUNCTIONS[0],
    "where": "distance_m > 10",
    "color": "",
    "sort": "pacc",
    "kind": "picture",
    "sensor": None,
    "state": None,
    "tag": None,
    "cursor": None,
}
_PREDICTIONS = "name: mine-{}\nkind: predictions\noutput: {{kind: labels, classes: cityscapes-label-ids}}\n"


class Deployment:
    """A server and its workers, which work when told to, in the thread of the test; with a run and a study."""

    def __init__(self, world: DrawnWorld) -> None:
        self.world = world
        self.run = world.work(self.document("/v1/runs", 0))
        self.answers: Counter[tuple[str, int]] = Counter()
        self.scenarios = 0
        self.defects: list[BaseException] = []

    @property
    def succeeded(self) -> set[str]:
        """Operations that answered with success."""
        return {operation for operation, status in self.answers if status < 300}

    def document(self, path: str, drawn: int) -> Any:
        """Return a valid body, one of a few by a drawn number; None where the generated one does."""
        match path:
            case "/v1/runs" | "/v1/plan":
                places = ["person-1.pos.y", "HOMOGENEOUS", 5.0, 5.0 + 10.0 * (drawn % 2), 10.0]
                sun = {"sun-1.elevation": 20 + drawn % 3}
                return spec(f"run {drawn % 5}", vary=[places], constants=sun, functions=[FUNCTIONS[drawn % 2]])
            case "/v1/studies" | "/v1/studies/plan":
                return {**_STUDY, "mode": "by hand" if drawn % 4 else "automatic"}
            case "/v1/functions":
                return {"document": _PREDICTIONS.format(drawn % 3)}
            case "/v1/selections":
                return {"name": f"selection {drawn % 3}", "runs": [self.run], "expression": "pacc < 0.5"}
        return None


def machine_of(schema: Any, deployment: Deployment) -> type[Any]:
    """Return the state machine of a document: three of four bodies are valid, and workers work between requests."""

    class Scenario(schema.as_state_machine()):  # type: ignore[misc]
        rule_order_seed = 1  # which operation begins; the first one otherwise begins most scenarios

        def setup(self) -> None:
            super().setup()
            deployment.scenarios += 1

        def before_call(self, case: Any) -> None:
            drawn = crc32(b"%d" % deployment.answers.total())
            body = deployment.document(case.operation.path, drawn // 4)
            # The examples of the document name a street that nobody draws here.
            if body is not None and case.method == "POST" and (drawn % 4 or "urban-street" in str(case.body)):
                case.body = body
            case.query = {**case.query, **{name: _QUERY[name] for name in case.query if name in _QUERY and drawn % 4}}
            case.query = {name: value for name, value in case.query.items() if value is not None}
            super().before_call(case)

        def after_call(self, response: Any, case: Any) -> None:
            super().after_call(response, case)
            deployment.answers[f"{case.method} {case.operation.path}", response.status_code] += 1
            if deployment.answers.total() % 3 == 0:
                deployment.world.step()

        def validate_response(self, response: Any, case: Any, **_: Any) -> None:
            try:
                case.validate_response(response, checks=CHECKS)
                if "json" in response.headers.get("content-type", [""])[0]:
                    told = [word for word in _INTERNAL if word in response.text]
                    assert not told, (case.as_curl_command(), told, response.text)
            except BaseException as defect:
                deployment.defects.append(defect)
                raise

    return Scenario


@pytest.fixture(params=["sqlite", "postgres"])
def deployment(
    request: pytest.FixtureRequest, new_database: Callable[[], str], redis_url: str, tmp_path: Path
) -> Iterator[tuple[Any, Deployment]]:
    database = {"database_url": new_database()} if request.param == "postgres" else {}
    settings_ = settings_of(tmp_path, broker_url=redis_url, log_level="error", **database)
    configure_logging(settings_)
    world = DrawnWorld(settings_)
    with served(create_app(settings_, control=False)) as client:
        schema = schemathesis.openapi.from_url(f"{client.base_url}/openapi.json")
        schema.config.phases.stateful.inference.algorithms = []  # only our own links
        yield schema, Deployment(world)
    world.context.engine.dispose()
    structlog.reset_defaults()
    shutil.rmtree(tmp_path, ignore_errors=True)


def test_no_order_of_requests_breaks_the_server(deployment: tuple[Any, Deployment]) -> None:
    schema, state = deployment
    machine = machine_of(schema, state)
    number = 0
    # Hypothesis gives up when draws that it made before meet another state of the server; the next seed goes on.
    while not state.defects and (
        state.scenarios < _SCENARIOS
        or (len(state.succeeded) <= _OPERATIONS and state.scenarios < _PATIENCE * _SCENARIOS)
    ):
        with suppress(FlakyStrategyDefinition):
            seed(number)(machine).run(
                settings=settings(
                    max_examples=max(_SCENARIOS - state.scenarios, 1),
                    stateful_step_count=_STEPS,
                    deadline=None,
                    database=None,
                    phases=[Phase.generate],  # the server remembers, so that a shorter scenario is another one
                    suppress_health_check=list(HealthCheck),
                )
            )
        number += 1
    if state.defects:
        raise state.defects[0]
    assert len(state.succeeded) > _OPERATIONS, "the links lead to what exists"
