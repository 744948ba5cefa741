"""Runs through REST: submit, list, follow, cancel, resume, retry, delete."""

from __future__ import annotations

from typing import Any

import httpx
import pytest

from tests.world.drawn import DrawnRuns, spec
from tests.world.serving import every_item


def post(client: httpx.Client, document: dict[str, Any], **headers: str) -> httpx.Response:
    return client.post("/v1/runs", json=document, headers=headers)


def test_a_submitted_run_is_accepted_and_located(fresh: httpx.Client) -> None:
    answer = post(fresh, spec("new"))
    assert answer.status_code == 202
    run = fresh.get(answer.headers["Location"]).json()
    assert (run["name"], run["state"], run["variant_count"]) == ("new", "submitted", 24)
    assert run["spec"]["blocks"][0]["vary"][0]["parameter"] == "person-1.pos.x"


def test_a_yaml_spec_gives_the_same_digest_as_its_json(fresh: httpx.Client) -> None:
    text = "name: n\nasset: drawn-street\nvary:\n  - [person-1.pos.x, HOMOGENEOUS, 1.5, 5.5, 1.0]\n"
    document = {"name": "n", "asset": "drawn-street", "vary": [["person-1.pos.x", "HOMOGENEOUS", 1.5, 5.5, 1.0]]}
    yaml = fresh.post("/v1/runs", content=text, headers={"Content-Type": "application/yaml"}).json()
    assert yaml["spec_digest"] == post(fresh, document).json()["spec_digest"]


def test_a_repeated_post_with_the_same_key_makes_no_second_run(fresh: httpx.Client) -> None:
    first = post(fresh, spec("once"), **{"Idempotency-Key": "k-1"}).json()
    second = post(fresh, spec("once"), **{"Idempotency-Key": "k-1"}).json()
    assert first["id"] == second["id"]
    assert [run["name"] for run in fresh.get("/v1/runs").json()["items"]].count("once") == 1


def test_a_key_that_was_used_for_another_spec_is_refused(fresh: httpx.Client) -> None:
    first = post(fresh, spec("once"), **{"Idempotency-Key": "k-1"}).json()
    answer = post(fresh, spec("other"), **{"Idempotency-Key": "k-1"})
    assert answer.status_code == 409
    assert first["id"] in answer.json()["detail"]


def test_equal_specs_without_a_key_are_two_runs(fresh: httpx.Client) -> None:
    assert post(fresh, spec("twice")).json()["id"] != post(fresh, spec("twice")).json()["id"]


def test_runs_are_listed_newest_first_with_their_progress(api: httpx.Client, drawn: DrawnRuns) -> None:
    items = api.get("/v1/runs").json()["items"]
    assert [run["id"] for run in items] == [drawn.waiting, drawn.running, drawn.failed, drawn.finished]
    assert items[3]["stages"]["eval"]["done"] == items[3]["stages"]["eval"]["total"] > 0
    assert items[0]["stages"] == {}
    assert "pyrender" in items[0]["reason"]


def test_times_are_in_utc(api: httpx.Client, drawn: DrawnRuns) -> None:
    run = api.get(f"/v1/runs/{drawn.finished}").json()
    assert run["created_at"].endswith("Z")
    assert run["created_at"] <= run["started_at"] <= run["finished_at"]


def test_pages_of_runs_join_without_gap_or_repetition(api: httpx.Client) -> None:
    assert every_item(api, "/v1/runs", limit=1) == api.get("/v1/runs").json()["items"]


def test_a_run_that_arrives_between_pages_does_not_shift_them(fresh: httpx.Client) -> None:
    whole = [run["id"] for run in fresh.get("/v1/runs").json()["items"]]
    first = fresh.get("/v1/runs", params={"limit": 2}).json()
    post(fresh, spec("late"))
    second = fresh.get("/v1/runs", params={"limit": 2, "cursor": first["next"]}).json()
    assert [run["id"] for run in (*first["items"], *second["items"])] == whole


def test_runs_are_filtered_by_state(api: httpx.Client, drawn: DrawnRuns) -> None:
    items = api.get("/v1/runs", params={"state": "completed-with-failures"}).json()["items"]
    assert [run["id"] for run in items] == [drawn.failed]


def test_progress_counts_every_stage(api: httpx.Client, drawn: DrawnRuns) -> None:
    progress = api.get(f"/v1/runs/{drawn.failed}/progress").json()
    stages = progress["stages"]
    assert progress["variants"] == {"total": 24, "fed": 24, "rejected": stages_rejected(api, drawn.failed)}
    frames = (24 - progress["variants"]["rejected"]) * 2
    assert (stages["render"]["total"], stages["render"]["failed"]) == (frames, 2)
    assert (stages["eval"]["total"], stages["eval"]["failed"]) == (frames * 2, 4)
    assert stages["eval"]["done"] == frames * 2 - 4


def stages_rejected(client: httpx.Client, run: str) -> int:
    return sum(client.get(f"/v1/runs/{run}/rejections").json().values())


def test_failures_have_stage_error_attempts_and_cause(api: httpx.Client, drawn: DrawnRuns) -> None:
    failures = api.get(f"/v1/runs/{drawn.failed}/failures").json()
    roots = [failure for failure in failures if "cause" not in failure["error"]]
    assert {(root["kind"], root["variant_index"]) for root in roots} == {("layer", 4)}
    assert all(root["error"]["type"] == "RenderingError" and root["error"]["attempts"] == 1 for root in roots)
    digests = {failure["digest"] for failure in failures}
    assert all(failure["error"]["cause"] in digests for failure in failures if "cause" in failure["error"])


def test_a_cancelled_run_is_resumed_and_parked_products_are_wanted_again(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    path = f"/v1/runs/{drawn.running}"
    assert fresh.post(f"{path}/cancel").json()["state"] == "cancelled"
    assert fresh.post(f"{path}/resume").json()["state"] == "running"
    assert fresh.get(path).json()["finished_at"] is None


def test_retry_makes_failed_products_ready_again(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    path = f"/v1/runs/{drawn.failed}"
    assert fresh.get(f"{path}/failures").json() != []
    assert fresh.post(f"{path}/retry").json()["state"] == "running"
    assert fresh.get(f"{path}/failures").json() == []


@pytest.mark.parametrize(("verb", "state"), [("cancel", "completed"), ("resume", "completed"), ("retry", "completed")])
def test_a_change_that_the_state_does_not_allow_is_a_conflict(
    fresh: httpx.Client, drawn: DrawnRuns, verb: str, state: str
) -> None:
    answer = fresh.post(f"/v1/runs/{drawn.finished}/{verb}")
    assert answer.status_code == 409
    assert answer.json()["title"] == "Conflict"
    assert f"is {state}" in answer.json()["detail"]


def test_an_active_run_is_not_deleted(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    assert fresh.delete(f"/v1/runs/{drawn.running}").status_code == 409
    assert fresh.get(f"/v1/runs/{drawn.running}").status_code == 200


def test_a_deleted_run_is_gone_with_its_results_and_nothing_else(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    answer = fresh.delete(f"/v1/runs/{drawn.finished}")
    assert (answer.status_code, answer.content) == (204, b"")
    for path in (
        "",
        "/progress",
        "/frames",
        "/variants",
        "/evaluations",
        "/points",
        "/summary",
        "/report",
        "/failures",
    ):
        assert fresh.get(f"/v1/runs/{drawn.finished}{path}").status_code == 404, path
    assert fresh.get(f"/v1/runs/{drawn.failed}/report").status_code == 200


def test_a_plan_stores_nothing_and_counts_stored_products(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    before = fresh.get("/v1/runs").json()
    plan = fresh.post("/v1/plan", json=spec("finished")).json()
    assert fresh.get("/v1/runs").json() == before
    rejected = stages_rejected(fresh, drawn.finished)
    assert (plan["variants"], plan["accepted"], plan["frames"]) == (24, 24 - rejected, 2 * (24 - rejected))
    assert (plan["renders"], plan["inferences"]) == (0, 0)


def test_a_run_without_summary_says_so(api: httpx.Client, drawn: DrawnRuns) -> None:
    for path in ("summary", "report"):
        answer = api.get(f"/v1/runs/{drawn.running}/{path}")
        assert answer.status_code == 409
        assert "is running" in answer.json()["detail"]


def test_the_list_of_runs_is_sent_again_only_where_it_changed(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    first = fresh.get("/v1/runs")
    known = {"If-None-Match": first.headers["ETag"]}
    again = fresh.get("/v1/runs", headers=known)
    assert (again.status_code, again.content) == (304, b"")
    assert fresh.get("/v1/runs?limit=1", headers=known).status_code == 200
    fresh.post(f"/v1/runs/{drawn.running}/cancel")
    assert fresh.get("/v1/runs", headers=known).status_code == 200


def test_the_list_of_runs_is_compressed_for_those_who_accept_it(api: httpx.Client) -> None:
    packed = api.get("/v1/runs", headers={"Accept-Encoding": "br, gzip"})
    plain = api.get("/v1/runs", headers={"Accept-Encoding": "gzip;q=0"})
    assert packed.headers["Content-Encoding"] == "gzip"
    assert "Content-Encoding" not in plain.headers
    assert packed.json() == plain.json()
    assert int(packed.headers["Content-Length"]) < len(plain.content) / 2


def test_a_run_has_the_deadline_that_it_was_submitted_with_and_says_what_becomes_of_it(fresh: httpx.Client) -> None:
    run = fresh.post("/v1/runs?deadline=2999-12-01T06:00%2B01:00", json=spec("by then")).json()
    assert run["deadline"] == "2999-12-01T05:00:00Z"
    assert fresh.get(f"/v1/runs/{run['id']}/progress").json()["outlook"].startswith("deadline in ")
    assert fresh.get("/v1/runs").json()["items"][0]["deadline"] == "2999-12-01T05:00:00Z"
    free = post(fresh, spec("whenever")).json()
    assert free["deadline"] is None
    assert fresh.get(f"/v1/runs/{free['id']}/progress").json()["outlook"] is None


@pytest.mark.parametrize("deadline", ["2020-01-01T00:00Z", "soon", "9999-12-31T23:00-05:00"])
def test_a_deadline_that_is_no_moment_ahead_is_refused(deadline: str, fresh: httpx.Client) -> None:
    answer = fresh.post("/v1/runs", params={"deadline": deadline}, json=spec("never"))
    assert answer.status_code == 422
    assert "deadline" in answer.json()["errors"][0]["field"]
    assert "never" not in [run["name"] for run in fresh.get("/v1/runs").json()["items"]]
