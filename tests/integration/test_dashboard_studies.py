"""The dashboard's pages of studies in a real browser, over a control loop that the tests advance."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx
import pytest
import structlog

from services.api.app import create_app
from tests.world.drawn import ASSET, CHARACTERS, DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.pipeline.work import finish
from valerie.runs.study.study_document import parse_study

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = [pytest.mark.browser, pytest.mark.processes, pytest.mark.timeout(300)]


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[DrawnWorld]:
    monkeypatch.setattr(finish, "write_results", lambda *_: None)  # a study reads rows alone
    yield DrawnWorld(settings_of(tmp_path, log_level="error"))
    structlog.reset_defaults()


@pytest.fixture
def api(world: DrawnWorld) -> Iterator[httpx.Client]:
    with served(create_app(world.settings, control=False)) as client:
        yield client


@pytest.fixture
def page(browser: Browser, api: httpx.Client) -> Iterator[Page]:
    """The list of studies; errors on its console fail the test."""
    opened = browser.new_page()
    complaints: list[str] = []
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    opened.goto(f"{str(api.base_url).rstrip('/')}/dashboard/#/studies")
    yield opened
    opened.close()
    assert [text for text in complaints if "status of 422" not in text] == []


def begin(api: httpx.Client, name: str, **more: Any) -> str:
    """Begin a study whose every point is drawn from the operational density."""
    vary = [["person-1.pos.x", "UNIFORM", -3, 3], ["person-1.pos.y", "UNIFORM", 5, 30]]
    study: dict[str, Any] = {
        "measure": "min(pacc) >= 0.5",
        "goal": {"name": "estimate", "first": 20},
        "budget": {"variants": 20},
        "cameras": ["camera-1"],
    }
    document = spec(name, vary=vary, functions=["deeplabv3plus-small"], **study) | {"batch": 10} | more
    return str(api.post("/v1/studies", json=document).raise_for_status().json()["id"])


def test_a_batch_is_accepted_with_another_size_and_its_outcomes_are_counted(
    world: DrawnWorld, api: httpx.Client, page: Page
) -> None:
    begin(api, "how <b>often</b>", mode="by hand")
    world.step()
    page.reload()
    page.wait_for_selector("article:has-text('How often does a variant fail?')")
    assert page.locator(".chip").inner_text() == "waits"
    page.click("text=how <b>often</b>")
    page.wait_for_selector(".proposal:has-text('as they occur in operation')")
    assert page.locator(".proposal dd").first.inner_text() == "10"
    assert "10 of 20 proposed, 10 left" in page.locator(".budget").inner_text()
    page.fill("#count", "21")
    page.click("text=Accept")
    page.wait_for_selector("#count:invalid")
    page.fill("#count", "7")
    page.click("text=Accept")
    page.wait_for_selector(".proposal", state="detached")
    world.step()
    run = api.get("/v1/runs").json()["items"][0]["id"]
    world.run(run)
    world.step()
    page.wait_for_selector(f".batches tr:has-text('{run}') td:nth-child(4):not(:text-is('–'))")
    shown = page.locator(".batches tbody tr").first.locator("td.right").all_inner_texts()
    lowest: dict[int, float] = {}
    for row in api.get(f"/v1/runs/{run}/evaluations?limit=1000").json()["items"]:
        if row["pacc"] is not None:
            lowest[row["variant_index"]] = min(row["pacc"], lowest.get(row["variant_index"], 1.0))
    failed = sum(pacc < 0.5 for pacc in lowest.values())
    assert shown[:4] == [str(n) for n in (failed, len(lowest) - failed, 7 - len(lowest), 0)]
    assert 0 < failed < 7
    page.click("button:text-is('Automatic')")
    page.wait_for_selector("button[aria-pressed=true]:text-is('Automatic')")
    page.wait_for_selector(".proposal", state="detached")
    page.click("button:text-is('Stop')")
    page.click("text=Stop the study")
    page.wait_for_selector(".note:has-text('stopped by hand')")
    assert page.locator("button:text-is('Stop'), .segments").count() == 0
    assert page.locator(f"a[href='#/runs/{run}']").is_visible()


def test_a_phone_names_every_total_of_the_batches(world: DrawnWorld, api: httpx.Client, page: Page) -> None:
    page.set_viewport_size({"width": 400, "height": 800})
    begin(api, "totals")
    world.step()
    world.step()
    page.reload()
    page.click("text=totals")
    page.wait_for_selector(".batches tr.all")
    labels = page.locator(".batches tr.all td").evaluate_all("cells => cells.map((cell) => cell.dataset.label)")
    assert labels == ["Fail", "Pass", "Undefined", "Rejected", "CPU"]


def test_a_paused_study_says_why_and_goes_on(world: DrawnWorld, api: httpx.Client, page: Page) -> None:
    study = begin(api, "interrupted")
    world.loop.tick(everything=True)
    run = api.get(f"/v1/studies/{study}").json()["batches"][0]["run_id"]
    api.post(f"/v1/runs/{run}/cancel").raise_for_status()
    world.loop.tick(everything=True)
    page.reload()
    page.click("text=interrupted")
    page.wait_for_selector(f".note:has-text('Paused: run {run} of batch 1 is cancelled')")
    page.click("button:text-is('Resume')")
    page.wait_for_selector(".chip:text-is('running')")
    page.wait_for_selector("main .note", state="detached")
    assert api.get(f"/v1/runs/{run}").json()["state"] != "cancelled"


def test_a_study_is_written_planned_refused_in_place_and_started(
    world: DrawnWorld, api: httpx.Client, page: Page
) -> None:
    page.click("a:has-text('New study')")
    page.wait_for_selector("#spec")
    template = page.input_value("#spec")
    assert template == api.get("/v1/studies/template").json()["text"]
    assert parse_study(template).name == "my-first-study"
    assert page.locator("button:text-is('Start')").is_disabled()
    heights = [page.locator(part).bounding_box() for part in ("#spec", ".numbers")]
    assert len({box["height"] for box in heights if box}) == 1, "every line that is shown has its number"
    text = template.replace("asset: urban-street", f"asset: {ASSET}").replace(
        "black-outfit, yellow-shirt", ", ".join(CHARACTERS)
    )
    page.fill("#spec", text.replace("deeplabv3plus-small", "nobody").replace("variants: 256", "variants: 3"))
    page.click("button:text-is('Plan')")
    page.wait_for_selector(".problems li:has-text('budget.variants')")
    line = 1 + text.splitlines().index(next(one for one in text.splitlines() if one.startswith("budget:")))
    page.click(f".problems button:text-is('Line {line}')")
    assert page.locator("button:text-is('Start')").is_disabled()
    page.fill("#spec", text)
    page.wait_for_selector(".problems", state="detached")
    page.click("button:text-is('Plan')")
    page.wait_for_selector(".facts.plan dd:text-is('32')")
    planned = api.post("/v1/studies/plan", content=text, headers={"Content-Type": "application/yaml"}).json()
    assert page.locator(f"text={planned['reason']}").is_visible()
    assert "The budget of 256 variants takes about" in page.locator("[aria-label=Plan]").inner_text()
    page.goto(page.url.replace("/new", ""))
    page.click("a:has-text('New study')")  # what was written is still there
    page.wait_for_selector("#spec")
    assert page.input_value("#spec") == text
    page.click("button:text-is('Plan')")
    page.click("button:text-is('Start'):not([disabled])")
    page.wait_for_selector("h1:text-is('my-first-study')")
    (study,) = api.get("/v1/studies").json()["items"]
    assert page.url.endswith(f"#/studies/{study['id']}")
    page.click("text=Studies >> nth=0")
    page.click("a:has-text('New study')")
    page.wait_for_selector("#spec")
    assert page.input_value("#spec") == template
