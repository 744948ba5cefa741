"""The dashboard's files and their content security policy."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import pytest

FOLDER = Path(__file__).parents[4] / "services/api/dashboard"
FILES = sorted(path.name for path in FOLDER.iterdir())


def test_the_address_of_the_server_leads_to_the_dashboard(api: httpx.Client) -> None:
    answer = api.get("/", follow_redirects=True)
    assert answer.url.path == "/dashboard/"
    assert "<title>VALERIE</title>" in answer.text


@pytest.mark.parametrize("name", ["", *FILES])
def test_every_file_has_the_policy_and_is_revalidated(api: httpx.Client, name: str) -> None:
    answer = api.get(f"/dashboard/{name}")
    assert answer.status_code == 200
    policy = dict(part.strip().split(" ", 1) for part in answer.headers["Content-Security-Policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == "'self'"
    assert policy["style-src"] == "'self'"
    assert policy["frame-ancestors"] == "'none'"
    assert answer.headers["Cache-Control"] == ("max-age=3600" if name == "icon.svg" else "no-cache")
    again = api.get(f"/dashboard/{name}", headers={"If-None-Match": answer.headers["ETag"]})
    assert again.status_code == 304
    assert again.headers["Content-Security-Policy"] == answer.headers["Content-Security-Policy"]


def test_scripts_are_served_as_scripts(api: httpx.Client) -> None:
    for name in FILES:
        if name.endswith(".js"):
            assert "javascript" in api.get(f"/dashboard/{name}").headers["Content-Type"]


def test_a_missing_file_is_a_problem_document(api: httpx.Client) -> None:
    answer = api.get("/dashboard/nope.js")
    assert (answer.status_code, answer.headers["Content-Type"]) == (404, "application/problem+json")


def test_the_page_holds_no_script_and_no_style_of_its_own() -> None:
    text = (FOLDER / "index.html").read_text()
    assert not re.search(r"<script(?![^>]*\bsrc=)", text)
    assert not re.search(r"<style|\sstyle=|\son\w+=", text)


def test_no_file_names_another_host_or_builds_markup_from_text() -> None:
    for name in FILES:
        text = (FOLDER / name).read_text().replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"https?://", text), name
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", text), (
            name
        )


def test_every_import_names_a_file_and_something_that_it_exports() -> None:
    for name in FILES:
        if not name.endswith(".js"):
            continue
        for names, target in re.findall(r'import \{([^}]*)\} from "\./([\w.]+)"', (FOLDER / name).read_text()):
            exported = set(
                re.findall(r"export (?:async )?(?:const|function|class) (\w+)", (FOLDER / target).read_text())
            )
            assert {one.strip() for one in names.split(",")} <= exported, (name, target)


def test_every_address_that_the_scripts_ask_for_exists(api: httpx.Client) -> None:
    known = [re.sub(r"\{\w+\}", "x", path) for path in api.get("/openapi.json").json()["paths"]]
    text = "".join((FOLDER / name).read_text() for name in FILES if name.endswith(".js"))
    requests = {re.sub(r"\$\{[^}]*\}", "x", one).split("?")[0] for one in re.findall(r"[\"`](/v1/[^\"`]*?)[\"`]", text)}
    assert len(requests) >= 6
    assert requests <= set(known)
