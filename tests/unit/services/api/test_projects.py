"""Projects: for a token of one, nothing of another exists."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from services.api.app import create_app
from services.api.roles import needed
from tests.world.drawn import ASSET, FUNCTIONS, DrawnWorld, layer_of_variant_4, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.access import Role
from valerie.db import runs
from valerie.db.engine import reading
from valerie.errors import InvalidInput, RenderingError
from valerie.pipeline.control.studies import commands
from valerie.pipeline.control.studies.advancing import StudyKeeper
from valerie.runs.products.states import Stage
from valerie.runs.study.study_document import parse_study

TOKEN = "correct-horse-battery"
#: Names that only radar's members know.
SECRETS = ("radar's run", "radar's child", "radar's study", "radar selection", "radar-tag", "radar's note")
STUDY = f"""name: radar's study
asset: {ASSET}
vary: [[person-1.pos.y, UNIFORM, 5, 35]]
functions: [{FUNCTIONS[0]}]
measure: min(pacc) >= 0.5
goal: estimate
budget: {{variants: 256}}
"""
#: Parameters of a run that four projects submit.
SHARED = spec("of all", constants={"sun-1.elevation": 33})


@dataclass
class Deployment:
    """A server over runs of the project ``radar``, with members of others.

    Attributes:
        api: a client with the operator's token.
        run, study, frame, product: ids of radar's.
        secrets: of a runner's token of each project; ``""``: of none.
    """

    api: httpx.Client
    run: str
    study: str
    frame: str
    product: str
    secrets: dict[str, str]

    def send(self, project: str, method: str, path: str, **request: Any) -> httpx.Response:
        headers = {"Authorization": f"Bearer {self.secrets[project]}", **request.pop("headers", {})}
        return self.api.request(method, path, headers=headers, **request)


@pytest.fixture(scope="module")
def deployment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Deployment]:
    settings = settings_of(
        tmp_path_factory.mktemp("projects"),
        api_token=TOKEN,
        tenants="radar=adas,lidar=adas",
        max_project_runs=3,
    )
    world = DrawnWorld(settings)
    run = world.submit(spec("radar's run"), project="radar")

    def fail(job: Any) -> None:
        if layer_of_variant_4(job):
            raise RenderingError(f"radar's note: {job.digest}")

    world.makers[Stage.RENDER].before = fail
    world.run(run)
    world.makers[Stage.RENDER].before = lambda _: None
    world.run(world.submit(SHARED, project="radar"))
    world.context.engine.dispose()
    with served(create_app(settings, control=False), token=TOKEN) as api:
        secrets = {}
        for project in ("radar", "lidar", "camera", ""):
            asked = {"name": f"{project or 'all'}-1", "owner": f"member of {project}", "role": "runner"}
            secrets[project] = api.post("/v1/tokens", json={**asked, "project": project}).json()["secret"]
        found = Deployment(api, run, "", "", "", secrets)
        frame = found.send("radar", "GET", f"/v1/runs/{run}/frames").raise_for_status().json()["items"][0]
        found.frame, found.product = frame["id"], frame["truth"]
        found.study = found.send("radar", "POST", "/v1/studies", content=STUDY).raise_for_status().json()["id"]
        mark = {"kind": "run", "name": "", "tags": ["radar-tag"], "note": "radar's note"}
        found.send("radar", "PUT", f"/v1/runs/{run}/marks", json=mark).raise_for_status()
        selection = {"name": "radar selection", "runs": [run], "expression": "pacc < 0.5", "view": ""}
        found.send("radar", "POST", "/v1/selections", json=selection).raise_for_status()
        child = {**spec("radar's child", constants={"sun-1.elevation": 20}), "parent_run": run, "iteration": 1}
        found.send("radar", "POST", "/v1/runs", json=child).raise_for_status()
        yield found


def requests_of(deployment: Deployment) -> Iterator[tuple[str, str, dict[str, Any], bool]]:
    """Yield method, path and arguments of one request per endpoint, about what is radar's where it is about something.

    The last value is False where the endpoint is about nothing that a project has.
    """
    names = {
        "run_id": deployment.run,
        "study_id": deployment.study,
        "frame_id": deployment.frame,
        "digest": deployment.product,
        "reference": "none",
        "name": "none",
    }
    queries = {
        "run": deployment.run,
        "column": ["distance_m", "pacc"],
        "function": FUNCTIONS[0],
        "before": f"{deployment.run}:{FUNCTIONS[0]}",
        "after": f"{deployment.run}:{FUNCTIONS[1]}",
        "tile": f"{deployment.frame}:24001:{FUNCTIONS[0]}:default",
        "kind": "picture",
        "x": 1,
        "y": 1,
        "by_hand": True,
        "variant": 0,
    }
    child = {**spec("stranger"), "parent_run": deployment.run}
    bodies: dict[str, dict[str, Any]] = {
        "POST /v1/runs": {"json": child},
        "POST /v1/plan": {"json": spec("stranger")},
        "POST /v1/preview": {"json": spec("stranger")},
        "POST /v1/draft": {"json": {"text": "name: stranger\n"}},
        "POST /v1/studies": {"content": STUDY.replace("radar's", "stranger's")},
        "POST /v1/studies/plan": {"content": STUDY.replace("radar's", "stranger's")},
        "POST /v1/selections": {"json": {"name": "mine", "runs": [deployment.run], "expression": "", "view": ""}},
        "PUT /v1/runs/{run_id}/marks": {"json": {"kind": "run", "name": "", "tags": [], "note": ""}},
    }
    about = {"run_id", "study_id", "frame_id", "digest", "run", "tile"}
    for path, operations in deployment.api.get("/openapi.json").json()["paths"].items():
        for method, operation in operations.items():
            used = {one["name"] for one in operation.get("parameters", [])}
            required = {one["name"] for one in operation.get("parameters", []) if one.get("required")}
            endpoint = f"{method.upper()} {path}"
            place = path.replace("/annotations/{kind}", "/annotations/normals").replace("{kind}", "truth")
            query = {name: queries[name] for name in required & queries.keys() if f"{{{name}}}" not in path}
            mine = bool(used & about) or endpoint in ("POST /v1/runs", "POST /v1/selections")
            mine &= needed(method.upper(), path) is not Role.ADMIN  # admins belong to no project
            yield method.upper(), place.format(**names), {"params": query, **bodies.get(endpoint, {})}, mine


def test_no_endpoint_tells_a_stranger_of_what_another_project_has(deployment: Deployment) -> None:
    """Also not of its existence: the answer is the one for an id that does not exist."""
    known = (*SECRETS, deployment.run, deployment.study, deployment.product)
    asked = 0
    for method, path, request, about in requests_of(deployment):
        answer = deployment.send("camera", method, path, **request)
        if about:
            assert answer.status_code == 404, f"{method} {path}: {answer.status_code} {answer.text[:200]}"
            asked += 1
        # A refusal repeats what was asked for; nothing else may name it.
        told = answer.text if answer.status_code != 404 else answer.json()["title"]
        assert not [text for text in known if text in told], f"{method} {path}"
    assert asked > 40


def test_what_cannot_be_an_id_does_not_exist(deployment: Deployment) -> None:
    """Also where Postgres would refuse it: a NUL."""
    for path in ("runs/%00", "studies/%00", "frames/%00.0.0.0", "explore/rows?run=%00", "artifacts/truth/%00"):
        assert deployment.send("camera", "GET", f"/v1/{path}").status_code == 404, path


def test_its_own_project_reads_all_of_it(deployment: Deployment) -> None:
    for method, path, request, about in requests_of(deployment):
        if method == "GET" and about and "/annotations/" not in path:
            answer = deployment.send("radar", method, path, **request)
            assert answer.status_code in (200, 409), f"{path}: {answer.text[:200]}"


def test_lists_have_what_is_the_projects_and_a_token_of_none_sees_all_runs(deployment: Deployment) -> None:
    def listed(project: str, path: str) -> list[str]:
        answer = deployment.send(project, "GET", path).json()
        return [one["name"] for one in (answer["items"] if isinstance(answer, dict) else answer)]

    assert {"radar's run", "radar's child"} <= set(listed("radar", "/v1/runs")) == set(listed("", "/v1/runs"))
    assert listed("camera", "/v1/runs") == []
    assert listed("radar", "/v1/studies") == ["radar's study"]
    assert "radar's study" in listed("", "/v1/studies")
    assert "radar's study" not in listed("camera", "/v1/studies")
    assert listed("radar", "/v1/selections") == ["radar selection"]
    assert deployment.send("camera", "GET", "/v1/tags").json() == {}
    assert deployment.send("radar", "GET", "/v1/tags").json() == {"radar-tag": 1}
    failures = deployment.send("", "GET", "/v1/work").json()["failures"]
    assert "radar's note" in failures[0]["message"], "whoever sees all runs also sees why their products failed"
    assert deployment.send("radar", "GET", f"/v1/runs/{deployment.run}").json()["project"] == "radar"


def test_a_name_and_a_key_that_another_project_uses_are_free(deployment: Deployment) -> None:
    key = {"Idempotency-Key": "nightly"}
    own = deployment.send("", "POST", "/v1/runs", json=spec("mine"), headers=key).raise_for_status().json()
    other = deployment.send("camera", "POST", "/v1/runs", json=spec("other"), headers=key).raise_for_status().json()
    again = deployment.send("camera", "POST", "/v1/runs", json=spec("other"), headers=key).raise_for_status().json()
    assert own["id"] != other["id"] == again["id"]
    selection = {"name": "radar selection", "runs": [other["id"]], "expression": "", "view": ""}
    assert deployment.send("camera", "POST", "/v1/selections", json=selection).status_code == 201
    assert deployment.send("camera", "DELETE", "/v1/selections/radar selection").status_code == 204
    assert [one["name"] for one in deployment.send("radar", "GET", "/v1/selections").json()] == ["radar selection"]


def test_products_count_as_stored_only_for_those_who_share_them(deployment: Deployment) -> None:
    def present(project: str) -> int:
        plan = deployment.send(project, "POST", "/v1/plan", json=SHARED).raise_for_status().json()
        return sum(one["present"] for one in plan["products"])

    assert present("radar") == present("lidar") > 100
    assert present("camera") == present("") == 0


def test_all_members_of_a_project_share_its_quota(deployment: Deployment) -> None:
    asked = {"name": "lidar-2", "owner": "another member", "role": "runner", "project": "lidar"}
    deployment.secrets["lidar, too"] = deployment.api.post("/v1/tokens", json=asked).json()["secret"]
    for number in range(3):
        member = "lidar, too" if number == 1 else "lidar"
        deployment.send(member, "POST", "/v1/runs", json=spec(f"night {number}")).raise_for_status()
    refused = deployment.send("lidar, too", "POST", "/v1/runs", json=spec("night 3"))
    assert (refused.status_code, refused.json()["detail"]) == (
        409,
        "project lidar would have 4 unfinished runs; limit: 3",
    )
    large = STUDY.replace("{variants: 256}", "{variants: 256}\nbatch: 128")
    assert deployment.send("lidar", "POST", "/v1/studies", content=large).status_code == 202


def test_an_admin_is_of_no_project(deployment: Deployment) -> None:
    asked = {"name": "chief", "owner": "Ada", "role": "admin", "project": "radar"}
    refused = deployment.api.post("/v1/tokens", json=asked)
    assert refused.status_code == 422
    assert "all projects" in refused.json()["detail"]


@pytest.mark.parametrize("tenants", ["radar", "radar=", "=adas", "Radar=adas"])
def test_a_tenant_that_is_not_one_is_refused_at_the_start(tmp_path: Path, tenants: str) -> None:
    with pytest.raises(InvalidInput, match="VALERIE_TENANTS"):
        settings_of(tmp_path, tenants=tenants)


def test_the_runs_of_a_study_are_of_its_project_and_share_with_its_tenant(tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path, tenants="radar=adas"))
    commands.begin(world.context, parse_study(STUDY.encode()), owner="Ada", project="radar")
    keeper = StudyKeeper(world.context)
    for _ in range(2):  # proposes a batch, submits it
        keeper.advance()
    with reading(world.context.engine) as connection:
        rows = runs.page(connection, limit=10)
    assert [(row.project, row.tenant, row.owner) for row in rows] == [("radar", "adas", "Ada")]
