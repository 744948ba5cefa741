"""Runs that are written, submitted, steered and marked in a real browser, while a thread works them off."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import pytest
import structlog
import yaml

from services.api.app import create_app
from tests.world.drawn import ASSET, CHARACTERS, DrawnWorld, layer_of_variant_4, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.runs.resolving.spec import parse

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

pytestmark = [pytest.mark.browser, pytest.mark.processes, pytest.mark.gl, pytest.mark.timeout(600)]
#: Time for the first preview of a street on a busy machine, milliseconds.
PREVIEW_MS = 120_000
#: The button of a document whose plan is known and has no problem.
SURE = "button.primary:enabled:not([aria-busy])"


@pytest.fixture(scope="module")
def api(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A server with a finished run and one with failures; what is submitted is worked off by a thread."""
    folder = tmp_path_factory.mktemp("steering")
    settings = settings_of(folder, log_level="error", cycles_python=folder / "no-blender")
    world = DrawnWorld(settings)
    world.work(spec("finished"))
    world.work(spec("lost a layer", constants={"sun-1.elevation": 12}), broken=layer_of_variant_4)
    stop = threading.Event()

    def work() -> None:
        while not stop.is_set():
            world.step()
            time.sleep(0.05)

    thread = threading.Thread(target=work, daemon=True)
    with served(create_app(settings, control=False)) as client:
        thread.start()
        yield client
        stop.set()
        thread.join()
    structlog.reset_defaults()


@pytest.fixture
def page(browser: Browser, api: httpx.Client) -> Iterator[Page]:
    """The list of runs; errors on the console fail the test, besides the browser's remarks on refused requests."""
    context = browser.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
    opened = context.new_page()
    complaints: list[str] = []
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    opened.goto(f"{address(api)}/#/")
    opened.wait_for_selector("tbody tr")
    yield opened
    context.close()
    assert [text for text in complaints if not any(f"status of {code}" in text for code in (422, 501, 503))] == []


def address(api: httpx.Client) -> str:
    return f"{str(api.base_url).rstrip('/')}/dashboard/"


def run_named(api: httpx.Client, name: str) -> str:
    return next(str(run["id"]) for run in api.get("/v1/runs").json()["items"] if run["name"] == name)


def begin(page: Page, text: str) -> None:
    """Open the page of a new run with a document."""
    page.click("a:has-text('New run')")
    page.wait_for_selector(".facts.plan")
    write(page, text)


def write(page: Page, text: str) -> None:
    page.fill("#spec", text)
    page.wait_for_selector(f"{SURE}, .problems")


def fill(page: Page, name: str, text: str) -> None:
    page.fill(f"[id='{name}']", text)
    page.keyboard.press("Tab")


def test_a_run_is_submitted_from_the_form_watched_zoomed_and_reported(page: Page, api: httpx.Client) -> None:
    page.click("a:has-text('New run')")
    page.wait_for_selector(".facts.plan")
    page.select_option("#f-asset", ASSET)
    page.wait_for_selector("#f-cameras-camera-3", state="detached")
    page.uncheck("#f-cameras-camera-2")
    for name, text in (("width", "96"), ("height", "54")):
        page.fill(f"[id='f-resolution.{name}']", text)
        page.keyboard.press("Tab")
    page.fill("#parameter-search", "person-1.pos.y")
    page.click(".found button >> nth=0")
    page.wait_for_selector("[id='p-person-1.pos.y-minimum']")
    for part, text in (("minimum", "5 m"), ("maximum", "35"), ("step", "10")):
        page.fill(f"[id='p-person-1.pos.y-{part}']", text)
        page.keyboard.press("Tab")  # at once: no change may be lost while another is on its way
    page.fill("#f-name", "from the form")
    page.keyboard.press("Tab")
    page.wait_for_selector(".facts.plan dd:text-is('8')", timeout=30_000)
    page.wait_for_selector(SURE)
    page.wait_for_selector(".previews img", timeout=PREVIEW_MS)
    page.select_option("#priority", "high")
    page.fill("#deadline", "2999-12-15T06:00")
    page.click("text=Submit run")
    page.wait_for_url("**#/runs/*")
    page.wait_for_selector(".chip:has-text('completed')", timeout=60_000)
    run = api.get(f"/v1/runs/{run_named(api, 'from the form')}").json()
    assert run["priority"] == "high"
    assert run["deadline"].startswith("2999-12-1")
    submitted = run["spec"]
    assert submitted["cameras"] == ["camera-1"]
    assert submitted["resolution"] == {"width": 96, "height": 54}
    (varied,) = submitted["blocks"][0]["vary"]
    assert varied["minimum"] == "5 m"
    page.wait_for_selector("a:text-is('Report')")
    with page.expect_download() as report:
        page.evaluate("document.querySelector('a[href$=\"/report\"]').setAttribute('download', 'report.html')")
        page.click("a:text-is('Report')")
    assert "from the form" in Path(report.value.path()).read_text()
    page.click("a:text-is('Frames')")
    page.locator(".thumbnails a").first.click()
    page.wait_for_function("() => [...document.querySelectorAll('.viewer img')].some(i => i.naturalWidth > 1)")
    page.locator(".window").first.hover()
    page.mouse.wheel(0, -400)
    page.wait_for_selector(".world.near")


def test_text_and_form_are_one_document_and_comments_stay(page: Page) -> None:
    text = f"name: one  # mine\nasset: {ASSET}\nvary:\n  person-1.pos.x: {{homogeneous: {{from: 0, to: 2, step: 1}}}}\n"
    begin(page, text)
    page.wait_for_selector("[id='p-person-1.pos.x-step']")
    assert page.input_value("[id='p-person-1.pos.x-maximum']") == "2"
    page.fill("[id='p-person-1.pos.x-step']", "0.5")
    page.keyboard.press("Tab")
    page.wait_for_function("() => document.querySelector('#spec').value.includes('step: 0.5')")
    assert page.input_value("#spec") == text.replace("step: 1", "step: 0.5")
    page.select_option("[id='p-person-1.pos.x-way']", "constant")
    page.wait_for_selector("[id='p-person-1.pos.x-value']")
    assert "constants:\n  person-1.pos.x:" in page.input_value("#spec")
    page.click("[aria-label='Leave person-1.pos.x at its default']")
    page.wait_for_selector("[id='p-person-1.pos.x-way']", state="detached")
    assert page.input_value("#spec") == f"name: one  # mine\nasset: {ASSET}\n"
    page.reload()
    page.wait_for_selector(".facts.plan")
    assert page.input_value("#spec").startswith("name: one  # mine"), "a reload loses nothing"


def test_an_answer_that_arrives_while_a_field_is_selected_leaves_it_selected(page: Page) -> None:
    begin(page, f"name: one\nasset: {ASSET}\nvary:\n  person-1.pos.x: {{homogeneous: {{from: 0, to: 2, step: 1}}}}\n")
    page.wait_for_selector("[id='p-person-1.pos.x-step']")
    held: list[Route] = []
    page.route("**/v1/draft", lambda route: held.append(route), times=1)
    fill(page, "p-person-1.pos.x-minimum", "1")  # Tab selects the next field
    page.wait_for_function("() => document.activeElement.id === 'p-person-1.pos.x-maximum'")
    old = page.query_selector("[id='p-person-1.pos.x-maximum']")
    held[0].continue_()
    page.wait_for_function("old => !old.isConnected", arg=old)
    page.keyboard.type("5")
    assert page.input_value("[id='p-person-1.pos.x-maximum']") == "5"
    page.keyboard.press("Tab")
    page.wait_for_function("() => document.querySelector('#spec').value.includes('to: 5')")


def test_sensors_and_requirements_are_written_by_the_form_and_read_from_the_text_and_posted_as_shown(
    page: Page, api: httpx.Client
) -> None:
    text = f"name: with demands  # mine\nasset: {ASSET}\nresolution: {{width: 64, height: 36}}\n"
    begin(page, text)
    page.select_option("#f-sensors", "own")
    page.wait_for_selector("[id='f-sensors.0.name']")
    fill(page, "f-sensors.0.exposure_ev", "-1.5")
    page.click("text=Add a sensor")
    page.wait_for_selector("[id='f-sensors.1.name']")
    fill(page, "f-sensors.1.name", "cheap")
    page.select_option("[id='f-sensors.1.auto_exposure']", "false")
    page.select_option("[id='f-sensors.1.noise']", "none")
    page.click("text=Add a requirement")
    page.wait_for_selector("[id='f-requirements.0.id']")
    fill(page, "f-requirements.0.id", "SYS-214")
    fill(page, "f-requirements.0.where", "distance_m <= 30")
    fill(page, "f-requirements.0.confidence", "0.9")
    page.select_option("[id='f-requirements.0.statistic.kind']", "quantile")
    page.wait_for_selector("[aria-label='Order of the quantile']")
    page.select_option("[id='f-requirements.0.statistic.score']", "iou")
    fill(page, "f-requirements.0.statistic.bound", "0.25")
    page.wait_for_function("() => document.querySelector('#spec').value.includes('0.25')")
    page.wait_for_selector(SURE)
    shown = page.input_value("#spec")
    assert shown.startswith("name: with demands  # mine\n")
    document = yaml.safe_load(shown)
    noise = {"shot": True, "read_electrons": 3, "full_well_electrons": 100_000}
    assert document["sensors"] == [
        {"name": "metering", "auto_exposure": True, "noise": noise, "exposure_ev": -1.5},
        {"name": "cheap", "auto_exposure": False},
    ]
    requirement = {"id": "SYS-214", "statistic": "quantile(iou, 0.05) >= 0.25", "where": "distance_m <= 30"}
    assert document["requirements"] == [{**requirement, "confidence": 0.9}]
    page.click("text=Submit run")
    page.wait_for_url("**#/runs/*")
    submitted = parse(api.get(f"/v1/runs/{run_named(api, 'with demands')}").json()["spec"])
    assert submitted == parse(document)


def test_what_the_text_says_of_sensors_and_requirements_is_in_the_form_and_a_problem_stands_at_its_field(
    page: Page,
) -> None:
    text = (
        f"name: one\nasset: {ASSET}\n"
        "sensors:\n- name: wide\n  lens: {vignetting: 1}\n  gain_db: 6\n"
        "requirements:\n- {id: R-1, statistic: share(pacc ≥ 0.4) >= 90 %}\n- {id: R-2, statistic: median(pacc)}\n"
    )
    begin(page, text)
    page.wait_for_selector("[id='f-requirements.1.statistic-problem']")
    assert page.input_value("#f-sensors") == "own"
    assert page.input_value("[id='f-sensors.0.gain_db']") == "6"
    assert page.input_value("[id='f-sensors.0.auto_exposure']") == "false"
    assert page.input_value("[id='f-requirements.0.statistic.of']") == "0.4"
    assert page.input_value("[id='f-requirements.0.statistic.bound']") == "90 %"
    assert page.input_value("[id='f-requirements.1.statistic']") == "median(pacc)"
    page.click("[aria-label='Remove the requirement R-2']")
    page.wait_for_selector(SURE)
    page.select_option("#f-sensors", "fixed")
    page.wait_for_selector("[id='f-sensors.0.gain_db']", state="detached")
    document = yaml.safe_load(page.input_value("#spec"))
    assert document["sensors"] == [{"auto_exposure": False}]
    assert [requirement["id"] for requirement in document["requirements"]] == ["R-1"]
    page.select_option("#f-sensors", "usual")
    page.wait_for_function("() => !document.querySelector('#spec').value.includes('sensors')")


def test_the_light_is_set_by_one_click_and_a_fixed_exposure_meters_without_the_day(page: Page) -> None:
    begin(page, f"name: one\nasset: {ASSET}\nsensors: [{{auto_exposure: false}}]\n")
    page.wait_for_selector("[aria-label=Light] [aria-pressed=true]:text-is('Day')")
    page.click("[aria-label=Light] button:text-is('Dusk')")
    page.wait_for_selector("[aria-label=Light] [aria-pressed=true]:text-is('Dusk')")
    document = yaml.safe_load(page.input_value("#spec"))
    assert document["constants"] == {"sun-1.elevation": -3}
    assert "sensors" not in document
    assert "The camera meters now" in page.inner_text("#toasts")
    page.click("[aria-label=Light] button:text-is('Day')")
    page.wait_for_selector("[aria-label=Light] [aria-pressed=true]:text-is('Day')")
    document = yaml.safe_load(page.input_value("#spec"))
    assert document["sensors"] == [{"auto_exposure": False}]
    assert "constants" not in document, "the elevation was the asset's"


def test_a_click_on_submit_that_ends_the_typing_in_a_field_submits_what_was_typed(
    page: Page, api: httpx.Client
) -> None:
    begin(page, f"name: one\nasset: {ASSET}\nresolution: {{width: 64, height: 36}}\n")
    page.wait_for_selector(SURE)
    page.fill("#f-name", "by one click")
    page.click("text=Submit run")
    page.wait_for_url("**#/runs/*")
    assert run_named(api, "by one click")
    page.go_back()
    write(page, f"name: wrong\nasset: {ASSET}\n")
    page.wait_for_selector(SURE)
    page.fill("[id='f-resolution.width']", "3")
    page.click("text=Submit run")
    page.wait_for_selector(".problems")
    assert page.locator("text=Submit run").is_disabled()
    assert "#/new" in page.url


def test_an_edited_document_of_a_run_waits_at_its_address_until_it_is_begun_again(page: Page) -> None:
    page.click("a:text-is('finished')")
    page.click("a:text-is('Clone')")
    page.wait_for_selector(SURE)
    fill(page, "f-name", "a thought")
    page.wait_for_selector(SURE)
    page.go_back()
    page.wait_for_selector("h1:text-is('finished')")
    page.click("a:text-is('Clone')")
    page.wait_for_selector(SURE)
    assert page.input_value("#f-name") == "a thought"
    page.click("text=Start over")
    page.click("dialog button.primary")
    page.wait_for_function("() => document.querySelector('#f-name').value === 'finished'")
    page.wait_for_selector(SURE)
    page.reload()
    page.wait_for_selector(SURE)
    assert page.input_value("#f-name") == "finished"


def test_constraints_are_written_one_to_a_line_and_a_wrong_one_is_named(page: Page) -> None:
    text = f"name: one\nasset: {ASSET}\nvary:\n  person-1.pos.x: {{homogeneous: {{from: 0, to: 3, step: 1}}}}\n"
    begin(page, text)
    page.fill("#f-constraints", "person-1.pos.x < 2\n\nperson-1.pos.x > 0")
    page.keyboard.press("Tab")
    page.wait_for_selector("details:has-text('3 variants rejected')")
    assert page.input_value("#f-constraints") == "person-1.pos.x < 2\nperson-1.pos.x > 0"
    page.fill("#f-constraints", "person-1.pos.q < 2")
    page.keyboard.press("Tab")
    page.wait_for_selector("#f-constraints-problem")
    page.fill("#f-constraints", "")
    page.keyboard.press("Tab")
    page.wait_for_selector("#f-constraints-problem", state="detached")
    page.wait_for_selector(".facts.plan dd:text-is('4')")
    assert page.input_value("#spec") == text


def test_a_problem_is_shown_at_its_line_and_at_its_field_and_nothing_can_be_submitted(page: Page) -> None:
    begin(page, f"name: one\nasset: {ASSET}\nconstants:\n  sun-1.elevation: 2000 deg\nrenderer: rastr\n")
    page.wait_for_selector(".problems li >> nth=1")
    assert sorted(page.locator(".problems button").all_inner_texts()) == ["Line 4", "Line 5"]
    assert "did you mean raster?" in page.locator(".field", has_text="Render engine").inner_text()
    assert page.locator("[id='p-sun-1.elevation-value']").get_attribute("aria-invalid") == "true"
    assert page.locator(".numbers .bad").all_inner_texts() == ["4\n", "5\n"]
    assert page.locator("button:has-text('Submit run')").is_disabled()
    page.click(".problems button:has-text('Line 4')")
    assert "2000" in page.evaluate("() => getSelection().toString()")


def test_keys_parameters_and_values_are_completed(page: Page) -> None:
    begin(page, f"name: one\nasset: {ASSET}\n")
    page.focus("#spec")
    page.keyboard.press("Control+End")
    page.keyboard.type("con")
    page.wait_for_selector("#proposals li:has-text('constants')")
    page.keyboard.press("Enter")
    page.keyboard.press("Enter")
    page.keyboard.type("pos.y")
    page.keyboard.press("Tab")
    assert page.input_value("#spec").endswith("constants: \n  person-1.pos.y: ")
    write(page, f"name: one\nasset: {ASSET}\nvary:\n  person-1.character: ")
    page.focus("#spec")
    page.keyboard.press("Control+End")
    page.keyboard.press("Control+Space")
    page.wait_for_selector("#proposals:visible")
    page.keyboard.press("Enter")
    assert page.input_value("#spec").endswith(f"person-1.character: {{choice: [{', '.join(CHARACTERS)}, absent]}}")
    page.keyboard.press("Control+z")
    assert page.input_value("#spec").endswith("person-1.character: "), "undo takes a completion back"


def test_a_server_that_cannot_render_says_so_and_the_rest_works(page: Page) -> None:
    problem = '{"title": "Missing library", "detail": "this server cannot render previews: no moderngl"}'
    page.route("**/v1/preview?**", lambda route: route.fulfill(status=501, body=problem))
    begin(page, f"name: one\nasset: {ASSET}\n")
    page.wait_for_selector("text=cannot render previews: no moderngl")
    assert page.locator("button:has-text('Submit run')").is_enabled()


def test_a_busy_server_is_asked_for_the_preview_again(page: Page) -> None:
    problem = '{"title": "Busy", "detail": "the previews are busy"}'
    busy = {"status": 503, "headers": {"Retry-After": "4"}, "body": problem}
    page.route("**/v1/preview?**", lambda route: route.fulfill(**busy), times=1)
    begin(page, f"name: one\nasset: {ASSET}\nrenderer: pyrender\nresolution: {{width: 64, height: 36}}\n")
    page.wait_for_selector("text=the previews are busy")
    page.wait_for_selector(".previews[aria-busy=false] img", timeout=PREVIEW_MS)


@pytest.mark.parametrize("engine", ["pyrender", "cycles"])
def test_the_spec_s_engine_renders_the_preview_or_the_page_names_the_one_that_does_and_why(
    page: Page, engine: str
) -> None:
    begin(page, f"name: one\nasset: {ASSET}\nrenderer: {engine}\nresolution: {{width: 64, height: 36}}\n")
    page.wait_for_selector(".previews[aria-busy=false] img", timeout=PREVIEW_MS)
    section = page.get_by_role("region", name="Preview").inner_text()
    if engine == "pyrender":
        assert "by the engine pyrender" in section
        assert "does not render here" not in section
    else:
        assert "The engine cycles does not render here: there is no Blender environment" in section
        assert "by the engine raster" in section


def test_an_edited_run_is_a_child_and_the_lineage_leads_from_one_to_the_other(page: Page, api: httpx.Client) -> None:
    parent = run_named(api, "finished")
    page.click("a:text-is('finished')")
    page.click("a:has-text('Edit and rerun')")
    page.wait_for_selector(SURE)
    assert f"parent_run: {parent}\niteration: 1" in page.input_value("#spec")
    assert page.input_value("#f-name") == "finished edited"
    page.click("text=Submit run")
    page.wait_for_selector(".lineage a[aria-current]:has-text('finished edited')")
    page.wait_for_selector("p:has-text('Descends from finished') a")
    page.focus(".lineage a:has-text('finished')")
    page.keyboard.press("Enter")
    page.wait_for_selector("h1:text-is('finished')")


def test_a_cloned_run_has_the_same_spec_and_no_parent(page: Page, api: httpx.Client) -> None:
    page.click("a:text-is('finished')")
    page.click("a:text-is('Clone')")
    page.wait_for_selector(SURE)
    page.wait_for_selector(f".note:has-text('run {run_named(api, 'finished')} has this spec already')")
    page.click("text=Submit run")
    page.wait_for_selector("h1:text-is('finished')")
    first, second, *_ = [run for run in api.get("/v1/runs").json()["items"] if run["name"] == "finished"]
    assert first["spec_digest"] == second["spec_digest"]
    assert first["parent_run"] is None


def test_a_cancelled_run_is_resumed_and_failures_are_retried(page: Page, api: httpx.Client) -> None:
    run = run_named(api, "lost a layer")
    page.click("a:text-is('lost a layer')")
    page.click("button:has-text('Retry failures')")
    page.wait_for_selector("#toasts >> text=tried again")
    page.wait_for_selector(".chip:has-text('completed')")
    waiting = api.post("/v1/runs", json=spec("waiting", renderer="pyrender")).json()["id"]
    page.goto(f"{address(api)}#/runs/{waiting}")
    page.click("button:has-text('Cancel')")
    page.click("text=Cancel the run")
    page.wait_for_selector(".chip:has-text('cancelled')")
    page.click("button:has-text('Resume')")
    page.wait_for_selector(".chip:has-text('submitted')")
    assert api.get(f"/v1/runs/{run}").json()["state"] != "cancelled"


def test_tags_and_notes_are_edited_and_runs_filtered_by_them(page: Page, api: httpx.Client) -> None:
    page.click("a:text-is('finished')")
    page.click("button:has-text('Add tag or note') >> nth=0")
    page.fill("#mark-tags", "night, for <b>")
    page.click("text=Save")
    page.wait_for_selector("#toasts >> text=tags")
    page.click("button:has-text('Add tag or note') >> nth=0")
    page.fill("#mark-tags", "night, for Anna")
    page.fill("#mark-note", "Look at <b>this</b>.")
    page.click("text=Save")
    page.wait_for_selector(".mark-note:has-text('Look at <b>this</b>.')")
    page.click(".findings button >> nth=0")
    page.fill("#mark-tags", "known")
    page.keyboard.press("Enter")
    page.wait_for_selector(".findings .tag:has-text('known')")
    page.click("a:text-is('Frames')")
    page.locator(".thumbnails a").first.click()
    page.click("[aria-label='Tags and note of this frame']")
    page.fill("#mark-note", "odd")
    page.click("text=Save")
    page.wait_for_selector(".mark-note:has-text('odd')")
    page.goto(f"{address(api)}#/")
    page.click(".runs .tag:has-text('for Anna')")
    page.wait_for_function("() => document.querySelectorAll('.runs tbody tr').length === 1")
    page.click("[aria-current]:has-text('for Anna')")
    page.wait_for_function("() => document.querySelectorAll('.runs tbody tr').length > 1")


def test_a_worker_whose_clock_is_off_says_so(page: Page) -> None:
    def ahead(route: Route) -> None:
        first, *others = route.fetch().json()
        route.fulfill(json=[first | {"clock": "7,200 s ahead of the database's: results are right"}, *others])

    page.route("**/v1/workers", ahead)
    page.click("nav >> text=Workers")
    note = page.locator(".worker .note")
    note.wait_for()
    assert "Its clock is 7,200 s ahead of the database's: results are right." in note.inner_text()


def test_workers_show_costs_failures_and_the_space_left(page: Page) -> None:
    page.click("nav >> text=Workers")
    page.wait_for_selector(".costs figure:has-text('layer')")
    assert "RenderingError" in page.locator("table", has_text="Message of the latest").inner_text()
    assert "free" in page.locator(".note", has_text="for artifacts").inner_text()
    page.click("[data-hours='1']")
    page.wait_for_url("**#/workers?hours=1")
    page.wait_for_selector("[data-hours='1'][aria-pressed=true]")
