"""The OpenAPI document is complete, and its examples are valid."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import jsonschema
import pytest

from tests.unit.services.api.test_studies import begun_study
from tests.world.drawn import DrawnRuns

Operation = dict[str, Any]


@pytest.fixture(scope="module")
def document(api: httpx.Client) -> dict[str, Any]:
    answer: dict[str, Any] = api.get("/openapi.json").json()
    return answer


def operations(document: dict[str, Any]) -> Iterator[tuple[str, Operation]]:
    for path, item in document["paths"].items():
        for method, operation in item.items():
            yield f"{method} {path}", operation


def schema_of(document: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema with the definitions that it refers to."""
    return {**schema, "components": document["components"]}


def example_of(document: dict[str, Any], content: dict[str, Any]) -> Any:
    """Return the example of one kind of content: its own, or that of its model."""
    if "example" in content:
        return content["example"]
    name = content.get("schema", {}).get("$ref", "").rpartition("/")[2]
    return document["components"]["schemas"].get(name, {}).get("example")


def test_every_endpoint_has_a_summary(document: dict[str, Any]) -> None:
    assert [name for name, one in operations(document) if not one.get("summary")] == []


def test_every_endpoint_documents_its_problems_with_an_example(document: dict[str, Any]) -> None:
    for name, one in operations(document):
        if name in ("get /healthz", "get /readyz"):
            continue
        expected = {"401", "403", "503"} | ({"404"} if "{" in name else set()) | ({"422"} if "/v1/" in name else set())
        assert expected <= one["responses"].keys(), name
        for status, response in one["responses"].items():
            if status >= "400":
                content = response["content"]["application/problem+json"]
                assert content["schema"] == {"$ref": "#/components/schemas/Problem"}
                assert content["example"]["status"] == int(status)


def test_every_json_answer_has_an_example_that_fits_its_schema(document: dict[str, Any]) -> None:
    for name, one in operations(document):
        for status, response in one["responses"].items():
            for media, content in response.get("content", {}).items():
                if not media.endswith("json"):
                    continue
                example = example_of(document, content)
                assert example is not None, (name, status)
                jsonschema.validate(example, schema_of(document, content["schema"]))


def test_every_parameter_and_every_text_body_has_an_example(document: dict[str, Any]) -> None:
    for name, one in operations(document):
        for parameter in one.get("parameters", []):
            schema = parameter["schema"]
            known = schema.keys() & {"examples", "enum"} or schema.get("default") is not None
            assert known, (name, parameter["name"])
        answers = [response.get("content", {}) for status, response in one["responses"].items() if status < "400"]
        for content in (one.get("requestBody", {}).get("content", {}), *answers):
            for media, shown in content.items():
                if shown.get("schema", {}).get("format") != "binary" and media != "application/json":
                    assert "example" in shown, (name, media)


def test_the_example_of_a_request_is_accepted(api: httpx.Client, document: dict[str, Any]) -> None:
    contents = document["paths"]["/v1/plan"]["post"]["requestBody"]["content"]
    plan = api.post("/v1/plan", json=contents["application/json"]["example"]).json()
    assert (plan["variants"], plan["frames"]) == (10, 30), "the paper's two lists"
    assert api.post("/v1/plan", content=contents["application/yaml"]["example"]).json()["variants"] == 5


def test_answers_fit_their_schemas(
    fresh: httpx.Client, tmp_path: Path, drawn: DrawnRuns, document: dict[str, Any]
) -> None:
    api, study = fresh, begun_study(fresh, tmp_path / "data")
    run, frame = drawn.finished, api.get(f"/v1/runs/{drawn.finished}/frames").json()["items"][0]["id"]
    count = 0
    for path, item in document["paths"].items():
        content = item.get("get", {}).get("responses", {}).get("200", {}).get("content", {}).get("application/json")
        if content is None or path == "/readyz":
            continue
        address = path.format(
            run_id=run, frame_id=frame, study_id=study, name="drawn-street", reference="deeplabv3plus-small"
        )
        sides = {"before": f"{run}:deeplabv3plus-small", "after": f"{run}:semantic-fpn-small"}
        values = {"run": run, "column": "pacc", "function": "deeplabv3plus-small", "x": 0, "y": 0, **sides}
        needed = [one["name"] for one in item["get"].get("parameters", []) if one["in"] == "query" and one["required"]]
        answer = api.get(address, params={name: values[name] for name in needed})
        assert answer.status_code == 200, (address, answer.text)
        jsonschema.validate(answer.json(), schema_of(document, content["schema"]))
        count += 1
    assert count >= 18


def test_links_lead_with_ids_from_answers_to_every_operation_that_takes_one(document: dict[str, Any]) -> None:
    by_id = {one["operationId"]: (name, one) for name, one in operations(document)}
    reached: set[tuple[str, str]] = set()
    for name, one in by_id.values():
        for response in one["responses"].values():
            for link in response.get("links", {}).values():
                target, _ = by_id[link["operationId"]]
                ((parameter, expression),) = link["parameters"].items()
                reached.add((target, parameter))
                value = example_of(document, response["content"]["application/json"])
                for part in expression.removeprefix("$response.body#/").split("/"):
                    value = value[int(part)] if isinstance(value, list) else value[part]
                assert isinstance(value, str), (name, expression)
    needed = {
        (name, parameter["name"])
        for name, one in operations(document)
        for parameter in one.get("parameters", [])
        if parameter["in"] == "path" or parameter["name"] == "run"
    }
    assert needed - reached == {
        ("get /v1/frames/{frame_id}/annotations/{kind}", "kind"),
        ("get /v1/artifacts/{kind}/{digest}", "kind"),
    }


def test_the_token_is_part_of_the_document(document: dict[str, Any]) -> None:
    assert document["components"]["securitySchemes"]["token"]["scheme"] == "bearer"
    assert document["paths"]["/healthz"]["get"]["security"] == []
    assert {"token": ["runs"]} in document["paths"]["/v1/runs"]["get"]["security"]
