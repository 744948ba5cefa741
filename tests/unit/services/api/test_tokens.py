"""Tokens with roles: what each may do, and how one ends."""

from __future__ import annotations

import re
import shutil
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from fastapi.routing import APIRoute
from starlette.routing import BaseRoute
from typer.testing import CliRunner

import services.api
from services.api.app import create_app
from services.api.roles import ROLES, needed
from services.api.scopes import area_of
from tests.world.drawn import DrawnRuns
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.access import Area
from valerie.cli.main import app

TOKEN = "correct-horse-battery"


@dataclass(frozen=True)
class Guarded:
    """A server with VALERIE_API_TOKEN, the client of its operator, and its database."""

    operator: httpx.Client
    database: Path
    run: str

    def issue(self, name: str, role: str, *scopes: str) -> dict[str, str]:
        """Issue a token and return the headers that carry it."""
        wish = {"name": name, "owner": "Ada", "role": role, "scopes": scopes}
        answer = self.operator.post("/v1/tokens", json=wish)
        assert answer.status_code == 201, answer.text
        return {"Authorization": f"Bearer {answer.json()['secret']}"}

    def change(self, statement: str) -> None:
        with sqlite3.connect(self.database) as connection:
            connection.execute(statement)
        connection.close()


@contextmanager
def guarding(drawn: DrawnRuns, folder: Path) -> Iterator[Guarded]:
    """Serve a copy of the drawn runs."""
    shutil.copytree(drawn.folder, folder)
    with served(create_app(settings_of(folder, api_token=TOKEN), control=False), token=TOKEN) as client:
        run = client.get("/v1/runs").json()["items"][0]["id"]
        yield Guarded(client, folder / "valerie.sqlite3", run)


@pytest.fixture(scope="module")
def guarded(drawn: DrawnRuns, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarding(drawn, tmp_path_factory.mktemp("guarded") / "data") as server:
        yield server


@pytest.fixture
def calm(drawn: DrawnRuns, tmp_path: Path) -> Iterator[Guarded]:
    """Serve without the refusals of other tests: the audit log keeps only so many of a minute."""
    with guarding(drawn, tmp_path / "data") as server:
        yield server


def walked(routes: Iterable[BaseRoute]) -> Iterator[BaseRoute]:
    """Yield the routes of an application, with those of the routers that it includes."""
    for route in routes:
        included = getattr(route, "original_router", None)
        if included is None:
            yield route
        else:
            yield from walked(included.routes)


def test_every_route_has_a_role(tmp_path: Path) -> None:
    routes = list(walked(create_app(settings_of(tmp_path), control=False).routes))
    endpoints = {
        f"{method} {route.path}" for route in routes if isinstance(route, APIRoute) for method in route.methods
    }
    assert endpoints >= ROLES.keys()
    assert {endpoint for endpoint in endpoints if not endpoint.startswith("GET ")} <= ROLES.keys()
    others = {getattr(route, "path", "") for route in routes if not isinstance(route, APIRoute)}
    assert others == {"/dashboard"}


def test_a_role_may_do_what_its_endpoints_need_and_no_more(guarded: Guarded) -> None:
    """Ask every endpoint of the table as every role, for things that do not exist and with bodies that say nothing."""
    ranks = {"viewer": 0, "runner": 1, "admin": 2}
    for role, rank in ranks.items():
        headers = guarded.issue(f"{role}-of-all", role)
        for endpoint in (*ROLES, "GET /v1/runs", "GET /v1/workers"):
            method, path = endpoint.split()
            address = path.replace("{", "").replace("}", "")
            answer = guarded.operator.request(method, address, headers=headers, content=b"{}")
            allowed = rank >= ranks[needed(method, path)]
            assert (answer.status_code != 403) is allowed, (role, endpoint, answer.text)


#: Endpoints that look at no token, since they need none.
OPEN = {"GET /healthz", "GET /readyz", "GET /v1/sign-in", "POST /v1/sign-in"}


def areas(guarded: Guarded) -> dict[str, str]:
    """Read the area of each endpoint from the OpenAPI document."""
    paths = guarded.operator.get("/openapi.json").json()["paths"]
    operations = ((f"{method.upper()} {path}", one) for path, item in paths.items() for method, one in item.items())
    return {endpoint: " ".join(one["tags"]) for endpoint, one in operations}


def test_every_route_belongs_to_one_area_which_the_openapi_document_states(guarded: Guarded, tmp_path: Path) -> None:
    routes = [
        one for one in walked(create_app(settings_of(tmp_path), control=False).routes) if isinstance(one, APIRoute)
    ]
    own = {f"{method} {one.path}": area_of(one.tags) for one in routes for method in one.methods}
    stated = areas(guarded)
    assert {endpoint: area for endpoint, area in own.items() if area is not None} == stated
    assert {endpoint for endpoint, area in own.items() if area is None} == {
        "GET /",
        "GET /explore",
        "GET /openapi.json",
    }
    assert set(stated.values()) == set(Area), "no scope is without an endpoint"
    for path, item in guarded.operator.get("/openapi.json").json()["paths"].items():
        for method, operation in item.items():
            expected = [] if path in ("/healthz", "/readyz") else [{"token": operation["tags"]}, {}]
            assert operation["security"] == expected, (method, path)


def test_the_documentation_lists_the_areas() -> None:
    text = Path(services.api.__file__).parents[2].joinpath("docs", "operations.md").read_text("utf-8")
    listed = text.partition("An area is the tag of its endpoints in\n`/openapi.json`: ")[2].partition(".")[0]
    assert re.findall("`([a-z]+)`", listed) == list(Area)


def test_a_scope_gives_its_area_and_no_other(guarded: Guarded) -> None:
    """Ask every endpoint with each scope as an admin, for things that do not exist and with bodies that say nothing."""
    stated = areas(guarded)
    for scope in Area:
        headers = guarded.issue(f"only-{scope}", "admin", scope)
        for endpoint, area in stated.items():
            method, path = endpoint.split()
            address = path.replace("{", "").replace("}", "")
            answer = guarded.operator.request(method, address, headers=headers, content=b"{}")
            allowed = area == scope or endpoint in OPEN
            assert (answer.status_code != 403) is allowed, (scope, endpoint, answer.text)


def test_an_endpoint_without_an_area_is_refused_to_tokens_with_scopes(guarded: Guarded) -> None:
    headers, free = guarded.issue("all-areas", "admin", *Area), guarded.issue("no-scopes", "admin")
    for path in ("/openapi.json", "/explore"):
        answer = guarded.operator.get(path, headers=headers)
        assert answer.status_code == 403
        assert answer.json()["detail"].startswith(
            "this needs a token without scopes; the token's scopes: access, audit,"
        )
        assert guarded.operator.get(path, headers=free).status_code < 400
    assert [area_of(tags) for tags in ([], ["runs", "metrics"], ["nothing"])] == [None, None, None]


def test_a_scraper_reads_metrics_and_a_pipeline_uploads_predictions_and_nothing_else(calm: Guarded) -> None:
    scraper, pipeline = calm.issue("scraper", "viewer", "metrics"), calm.issue("ci", "runner", "predictions")
    assert calm.operator.get("/metrics", headers=scraper).text.startswith("# HELP")
    upload = calm.operator.put(f"/v1/frames/{calm.run}.0.0.0/prediction", headers=pipeline, content=b"")
    assert upload.status_code in (404, 409, 422), "the token may, and the run asks for no predictions"
    refused = calm.operator.get("/v1/runs", headers=scraper)
    assert (refused.status_code, refused.json()["detail"]) == (
        403,
        "this needs the scope runs; the token's scopes: metrics",
    )
    refused = calm.operator.delete(f"/v1/runs/{calm.run}", headers=pipeline)
    assert refused.json()["detail"] == "this needs the scope runs; the token's scopes: predictions"
    last = calm.operator.get("/v1/audit", params={"limit": 1000}).json()[-1]
    assert (last["caller"], last["method"], last["status"]) == ("ci", "DELETE", 403)


@pytest.mark.parametrize(
    ("scope", "reason"), [("predictions", "has not started yet"), ("results", "this needs the scope predictions")]
)
def test_the_command_that_uploads_needs_no_other_scope(
    guarded: Guarded, tmp_path: Path, scope: str, reason: str
) -> None:
    secret = guarded.issue(f"uploads-{scope}", "runner", scope)["Authorization"].removeprefix("Bearer ")
    (tmp_path / f"{guarded.run}.99999.0.0.png").write_bytes(b"")
    put = ["predictions", "put", guarded.run, str(tmp_path), "--url", str(guarded.operator.base_url)]
    shown = CliRunner().invoke(app, put, env={"VALERIE_API_TOKEN": secret})
    assert (shown.exit_code, reason in shown.output) == (3, True), shown.output


def test_a_scope_adds_nothing_to_a_role(guarded: Guarded) -> None:
    headers = guarded.issue("reading-runs", "viewer", "runs", "tokens")
    assert guarded.operator.get("/v1/runs", headers=headers).status_code == 200
    assert "the role runner" in guarded.operator.post("/v1/runs", headers=headers, content=b"{}").json()["detail"]
    assert "the role admin" in guarded.operator.get("/v1/tokens", headers=headers).json()["detail"]


def test_a_token_with_scopes_issues_none_that_reaches_more(guarded: Guarded) -> None:
    headers = guarded.issue("issuer", "admin", "tokens", "metrics")
    wish = {"name": "issued", "owner": "Ada", "role": "viewer"}
    for scopes in ([], ["runs"], ["metrics", "runs"]):
        answer = guarded.operator.post("/v1/tokens", json={**wish, "scopes": scopes}, headers=headers)
        assert (answer.status_code, "limit: metrics, tokens" in answer.text) == (403, True), scopes
    answer = guarded.operator.post("/v1/tokens", json={**wish, "scopes": ["metrics"]}, headers=headers)
    assert (answer.status_code, answer.json()["scopes"]) == (201, ["metrics"])


def test_scopes_are_known_to_the_caller_and_in_the_list(guarded: Guarded) -> None:
    headers = guarded.issue("told", "viewer", "runs", "access")
    assert guarded.operator.get("/v1/access", headers=headers).json()["scopes"] == ["access", "runs"]
    listed = {token["name"]: token["scopes"] for token in guarded.operator.get("/v1/tokens").json()}
    assert listed["told"] == ["access", "runs"]
    place = ["--data-dir", str(guarded.database.parent)]
    made = ["token", "create", "by-command", "--owner", "Ada", "--scope", "results", "--scope", "metrics", *place]
    secret = CliRunner().invoke(app, made).stdout.strip()
    assert guarded.operator.get("/metrics", headers={"Authorization": f"Bearer {secret}"}).status_code == 200
    shown = CliRunner().invoke(app, ["token", "list", *place]).stdout.splitlines()
    assert [line.endswith(": Ada, only metrics, results") for line in shown if line.startswith("by-command ")] == [True]
    wrong = CliRunner().invoke(app, [*made[:2], "wrong", *made[3:6], "nothing", *place])
    assert wrong.exit_code != 0


def test_a_caller_learns_what_its_role_may_not_do(guarded: Guarded) -> None:
    answers = {
        role: guarded.operator.get("/v1/access", headers=guarded.issue(f"{role}-asks", role)).json()
        for role in ("viewer", "runner", "admin")
    }
    assert {role: answer["role"] for role, answer in answers.items()} == {role: role for role in answers}
    assert {one.split("/")[2] for one in answers["runner"]["refused"]} == {"audit", "runs", "tokens"}
    assert {"POST /v1/runs", "POST /v1/preview", "PUT /v1/runs/{run_id}/marks"} < set(answers["viewer"]["refused"])
    assert answers["admin"]["refused"] == []


def test_only_an_operator_on_the_machine_of_the_server_learns_its_data_folder(guarded: Guarded) -> None:
    def folder(**headers: str) -> str:
        return str(guarded.operator.get("/v1/access", headers=headers).json()["data_dir"])

    assert Path(folder()).is_absolute()
    assert folder(**guarded.issue("admin-asks-where", "admin")) == ""
    for header in ("X-Forwarded-For", "X-Real-IP", "Via", "Forwarded"):
        assert folder(**{header: "203.0.113.7"}) == ""


def test_the_dashboard_asks_for_the_role_of_endpoints_that_exist() -> None:
    scripts = (Path(services.api.__file__).parent / "dashboard").glob("*.js")
    rights = {name for script in scripts for name in re.findall(r'may\("([^"]+)"\)', script.read_text())}
    assert rights
    assert rights <= ROLES.keys()


def test_a_viewer_reads_a_run_and_cannot_delete_it(guarded: Guarded) -> None:
    headers = guarded.issue("reader", "viewer")
    assert guarded.operator.get(f"/v1/runs/{guarded.run}", headers=headers).status_code == 200
    refusal = guarded.operator.delete(f"/v1/runs/{guarded.run}", headers=headers)
    assert (refusal.status_code, refusal.json()["detail"]) == (
        403,
        "this needs the role runner; the token's role: viewer",
    )
    assert guarded.operator.get(f"/v1/runs/{guarded.run}").status_code == 200


def test_a_runner_cannot_issue_itself_an_admins_token(guarded: Guarded) -> None:
    headers = guarded.issue("climber", "runner")
    wish = {"name": "climbed", "owner": "Eve", "role": "admin"}
    assert guarded.operator.post("/v1/tokens", json=wish, headers=headers).status_code == 403
    assert "climbed" not in {token["name"] for token in guarded.operator.get("/v1/tokens").json()}


def test_a_revoked_token_is_refused_at_once(guarded: Guarded) -> None:
    headers = guarded.issue("lost", "admin")
    assert guarded.operator.get("/v1/runs", headers=headers).status_code == 200
    assert guarded.operator.delete("/v1/tokens/lost").status_code == 204
    assert guarded.operator.get("/v1/runs", headers=headers).status_code == 401


def test_an_expired_token_is_refused(guarded: Guarded) -> None:
    headers = guarded.issue("old", "admin")
    guarded.change("UPDATE tokens SET expires_at = '2020-01-01 00:00:00' WHERE name = 'old'")
    assert guarded.operator.get("/v1/runs", headers=headers).status_code == 401


def test_neither_the_database_nor_a_list_contains_a_secret(guarded: Guarded) -> None:
    secret = guarded.issue("hidden", "viewer")["Authorization"].removeprefix("Bearer ")
    files = guarded.database.parent.glob(f"{guarded.database.name}*")
    assert not [file for file in files if secret.encode() in file.read_bytes()]
    assert secret not in guarded.operator.get("/v1/tokens").text


def test_the_digest_from_the_database_is_no_token(guarded: Guarded) -> None:
    guarded.issue("copied", "admin")
    with sqlite3.connect(guarded.database) as connection:
        (digest,) = connection.execute("SELECT digest FROM tokens WHERE name = 'copied'").fetchone()
    connection.close()
    for secret in (digest, f"valerie_{digest}"):
        headers = {"Authorization": f"Bearer {secret}"}
        assert guarded.operator.get("/v1/runs", headers=headers).status_code == 401


def test_a_name_is_never_used_again(guarded: Guarded) -> None:
    guarded.issue("once", "viewer")
    guarded.operator.delete("/v1/tokens/once")
    again = guarded.operator.post("/v1/tokens", json={"name": "once", "owner": "Ada"})
    assert (again.status_code, "once" in again.json()["detail"]) == (409, True)


def test_the_last_use_is_shown(guarded: Guarded) -> None:
    headers = guarded.issue("used", "viewer")
    guarded.issue("idle", "viewer")
    guarded.operator.get("/v1/runs", headers=headers)
    shown = {token["name"]: token["used_at"] for token in guarded.operator.get("/v1/tokens").json()}
    assert (shown["used"] is not None, shown["idle"]) == (True, None)


def test_a_use_that_cannot_be_recorded_locks_nobody_out(guarded: Guarded) -> None:
    headers = guarded.issue("unrecorded", "viewer")
    guarded.change("CREATE TRIGGER unwritable BEFORE UPDATE ON tokens BEGIN INSERT INTO nowhere VALUES (1); END")
    try:
        assert guarded.operator.get("/v1/runs", headers=headers).status_code == 200
    finally:
        guarded.change("DROP TRIGGER unwritable")


@pytest.mark.parametrize(
    ("field", "value"), [("name", "No Name"), ("owner", ""), ("role", "owner"), ("days", 0), ("days", 3651)]
)
def test_a_bad_request_names_its_field(guarded: Guarded, field: str, value: object) -> None:
    answer = guarded.operator.post("/v1/tokens", json={"name": "new", "owner": "Ada", field: value})
    assert (answer.status_code, [error["field"] for error in answer.json()["errors"]]) == (422, [field])


def test_an_unknown_token_cannot_be_revoked(guarded: Guarded) -> None:
    assert guarded.operator.delete("/v1/tokens/nobody").status_code == 404
