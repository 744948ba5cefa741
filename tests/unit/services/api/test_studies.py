"""Studies over REST and through the command's client."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.world.world import settings_of
from valerie.client import Client
from valerie.local.folder import Folder
from valerie.pipeline.base.context import open_context
from valerie.pipeline.control.studies.advancing import StudyKeeper


def document(**more: Any) -> dict[str, Any]:
    return {
        "name": "how often",
        "asset": "drawn-street",
        "vary": [["person-1.pos.x", "UNIFORM", -3, 3], ["person-1.pos.y", "UNIFORM", 5, 20]],
        "functions": ["deeplabv3plus-small"],
        "measure": "min(pacc) >= 0.5",
        "goal": {"name": "estimate", "first": 20},
        "budget": {"variants": 40},
        "batch": 10,
        "mode": "by hand",
        **more,
    }


def begun_study(api: httpx.Client, folder: Path) -> str:
    """Return the id of a study whose first batch waits for a person; the control loop runs in no process."""
    answer = api.post("/v1/studies", json=document())
    assert answer.status_code == 202, answer.text
    assert answer.headers["Location"] == f"/v1/studies/{answer.json()['id']}"
    advance(folder)
    return str(answer.json()["id"])


def advance(folder: Path) -> None:
    context = open_context(settings_of(folder))
    StudyKeeper(context).advance()
    context.engine.dispose()


def test_a_batch_is_proposed_with_its_reason_and_price_and_accepted(fresh: httpx.Client, tmp_path: Path) -> None:
    study = begun_study(fresh, tmp_path / "data")
    proposed = fresh.get(f"/v1/studies/{study}/next").json()
    assert (proposed["number"], proposed["legal"], proposed["accepted"]) == (0, 10, False)
    assert "as they occur in operation" in proposed["reason"]
    assert proposed["plan"]["variants"] == 10
    assert fresh.post("/v1/plan", content=proposed["spec"]).json()["variants"] == 10
    fresh.post(f"/v1/studies/{study}/accept", params={"count": 7}).raise_for_status()
    assert fresh.post(f"/v1/studies/{study}/accept").status_code == 409
    advance(tmp_path / "data")
    detail = fresh.get(f"/v1/studies/{study}").json()
    first, second = detail["batches"]
    assert (first["legal"], second["legal"], second["run_id"]) == (7, 10, None)
    run = fresh.get(f"/v1/runs/{first['run_id']}").json()
    assert (run["name"], run["variant_count"]) == ("how often, batch 1", 7)
    assert detail["reason"] == "batch 2 is proposed: accept it"


def test_a_study_is_planned_listed_reported_and_stopped(fresh: httpx.Client, tmp_path: Path) -> None:
    assert fresh.post("/v1/studies/plan", json=document()).json()["legal"] == 10
    study = begun_study(fresh, tmp_path / "data")
    assert [item["id"] for item in fresh.get("/v1/studies").json()["items"]] == [study]
    page = fresh.get(f"/v1/studies/{study}/report")
    assert "<h1>how often</h1>" in page.text
    assert "http://" not in page.text.replace("http://www.w3.org", "")
    assert fresh.post(f"/v1/studies/{study}/mode", params={"by_hand": False}).json()["by_hand"] is False
    assert fresh.post(f"/v1/studies/{study}/stop").json()["state"] == "stopped"
    assert fresh.post(f"/v1/studies/{study}/resume").status_code == 409
    assert fresh.post("/v1/studies/s0/stop").status_code == 404


def test_the_data_folder_answers_as_its_server_does(fresh: httpx.Client, tmp_path: Path) -> None:
    study = begun_study(fresh, tmp_path / "data")
    context = open_context(settings_of(tmp_path / "data"))
    folder = Folder(context, up="valerie up")
    with Client(str(fresh.base_url)) as client:
        assert folder.study(study) == client.study(study)
        assert folder.studies() == list(client.studies())
        assert folder.study_report(study) == client.study_report(study)
        assert folder.runs() == list(client.runs())
    context.engine.dispose()


def test_studies_answer_304_while_nothing_changes(fresh: httpx.Client, tmp_path: Path) -> None:
    study = begun_study(fresh, tmp_path / "data")
    for path in ("/v1/studies", f"/v1/studies/{study}"):
        known = {"If-None-Match": fresh.get(path).headers["ETag"]}
        assert fresh.get(path, headers=known).status_code == 304
    fresh.post(f"/v1/studies/{study}/stop").raise_for_status()
    assert fresh.get(f"/v1/studies/{study}", headers=known).status_code == 200


@pytest.mark.parametrize(
    ("change", "field"), [({"budget": {"variants": 3}}, "budget.variants"), ({"where": "pac < 1"}, "where")]
)
def test_a_wrong_study_is_refused_naming_the_field(fresh: httpx.Client, change: dict[str, Any], field: str) -> None:
    answer = fresh.post("/v1/studies", json=document(**change))
    assert answer.status_code == 422
    assert [error["field"] for error in answer.json()["errors"]] == [field]
