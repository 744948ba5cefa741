"""The dashboard in a real browser, over runs of the real control loop."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING
from urllib.parse import unquote
from zipfile import is_zipfile

import httpx
import pytest
import structlog

from services.api.app import create_app
from tests.world.drawn import FUNCTIONS, DrawnWorld, layer_of_variant_4, spec
from tests.world.openid import CLIENT, SECRET, openid_provider
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.measures import Source, measures_from
from valerie.perception.documents.cards import card_rows
from valerie.perception.running.small_network import small_onnx
from valerie.pipeline.functions import registry

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

TOKEN = "correct-horse-battery"
#: Provenance of the newest version of a registered function.
SECOND = {"source": "<b>second</b>.onnx", "checked": "opened and run"}
#: Met and not met by both functions.
REQUIREMENTS = [{"id": "A", "statistic": "mean(pacc) >= 0.01"}, {"id": "B", "statistic": "mean(pacc) >= 0.99"}]

pytestmark = [pytest.mark.browser, pytest.mark.processes, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A server with a finished, a failed and a running run, and two versions of a function."""
    folder = tmp_path_factory.mktemp("dashboard")
    world = DrawnWorld(settings_of(folder, log_level="error"))
    for light, elevation in (("at noon", 35.0), ("at dusk", -3.0)):
        held = [["sun-1.elevation", "CHOICE", elevation], ["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 10.0]]
        world.work(spec(light, vary=held, cameras=["camera-1"]))
    world.work(spec("finished", requirements=REQUIREMENTS))
    failing = spec("lost a layer", constants={"sun-1.elevation": 12})
    world.work(failing, broken=layer_of_variant_4)
    walk = {"vary": [["person-1.trajectory.start", "HOMOGENEOUS", 0, 1, 1]], "cameras": ["camera-1"]}
    way = {"person-1": [[0, -1, 8], [2, 2, 8]]}
    world.work(spec("walking", sequence={"frames": 3, "step": "500 ms"}, trajectories=way) | walk)
    lights = [["sun-1.elevation", "CHOICE", -3.0, 35.0], ["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 5.0]]
    world.work(spec("day and dusk", vary=lights, cameras=["camera-1"]))
    world.work(spec("running", constants={"sun-1.elevation": 25}), products=100)
    for provenance in ({**SECOND, "source": "first.onnx"}, SECOND):
        registry.register(world.context, *small_onnx(folder, provenance=provenance))
    with served(create_app(settings_of(folder, api_token=TOKEN), control=False), token=TOKEN) as client:
        yield str(client.base_url).rstrip("/")
    structlog.reset_defaults()


@pytest.fixture
def page(browser: Browser, url: str) -> Iterator[Page]:
    """A page with the token; errors on its console fail the test."""
    context = browser.new_context(viewport={"width": 1280, "height": 860}, accept_downloads=True)
    opened = context.new_page()
    complaints: list[str] = []
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    opened.goto(f"{url}/dashboard/")
    opened.fill("#token", TOKEN)
    opened.keyboard.press("Enter")
    opened.wait_for_selector("tbody tr")
    # The browser logs the request that was refused before the token was entered.
    complaints[:] = [text for text in complaints if "401" not in text]
    yield opened
    context.close()
    assert complaints == []


def compare_runs(page: Page, *names: str) -> list[str]:
    """Open runs side by side, and return their ids."""
    links = [page.locator(".runs tr", has_text=name).locator("a").first.get_attribute("href") for name in names]
    runs = [link.rsplit("/", 1)[1] for link in links]
    page.goto(f"{page.url.split('#')[0]}#/explore?runs={','.join(runs)}&tab=compare")
    return runs


def open_run(page: Page, name: str) -> None:
    page.locator(".runs tr", has_text=name).locator("a").first.click()
    page.wait_for_selector("h1")


def test_a_wrong_token_is_rejected_and_asked_for_again(browser: Browser, url: str) -> None:
    page = browser.new_page()
    page.goto(f"{url}/dashboard/")
    page.fill("#token", "wrong")
    page.keyboard.press("Enter")
    page.wait_for_selector("dialog[open] >> text=was not accepted")
    page.close()


def test_a_user_of_the_operators_provider_signs_in_and_comes_back_to_the_view(browser: Browser, tmp_path: Path) -> None:
    with openid_provider() as provider:
        allowed = {"oidc_client": CLIENT, "oidc_secret": SECRET, "oidc_roles": "validators=runner"}
        settings = settings_of(tmp_path, api_token=TOKEN, oidc_issuer=provider.issuer, **allowed)
        with served(create_app(settings, control=False)) as client:
            page, address = browser.new_page(), f"{str(client.base_url).rstrip('/')}/dashboard"
            page.goto(f"{address}/#/functions")
            page.click("dialog[open] button:text-is('Sign in')")
            page.wait_for_selector("button:text-is('Forget token (runner)')")
            page.wait_for_selector("h1:text-is('Functions under test')")
            assert page.url == f"{address}/#/functions"
            provider.claims["groups"] = []
            page.click("button:text-is('Forget token (runner)')")
            page.click("dialog[open] button:text-is('Sign in')")
            page.wait_for_selector("#toasts >> text=none of your groups has a role here")
            page.close()


def test_a_viewer_is_offered_only_what_its_role_may_do(browser: Browser, url: str) -> None:
    answer = httpx.post(
        f"{url}/v1/tokens",
        json={"name": "reader", "owner": "Ada", "role": "viewer"},
        headers={"Authorization": f"Bearer {TOKEN}"},
    )
    page = browser.new_page()
    refused: list[str] = []
    page.on("response", lambda response: refused.append(response.url) if response.status == 403 else None)
    page.goto(f"{url}/dashboard/")
    page.fill("#token", answer.json()["secret"])
    page.keyboard.press("Enter")
    page.wait_for_selector("button:text-is('Forget token (viewer)')")
    for name in ("finished", "lost a layer", "running"):
        page.goto(f"{url}/dashboard/#/")
        open_run(page, name)
        page.wait_for_selector("main a:text-is('Explore')")
        for text in ("Clone", "Edit and rerun", "Cancel", "Retry failures", "Delete", "Add tag or note"):
            assert page.get_by_text(text, exact=True).count() == 0, text
    page.click("main a:text-is('Explore')")
    page.wait_for_selector("button:text-is('Saved')")
    assert page.locator("button:text-is('Save selection')").count() == 0
    page.goto(f"{url}/dashboard/#/")
    page.click("text=Plan a run")
    page.wait_for_selector(".facts.plan")
    assert page.locator("button:has-text('Submit')").count() == 0
    assert page.get_by_role("region", name="Preview").count() == 0
    page.close()
    assert refused == []


def test_a_token_with_scopes_shows_them(browser: Browser, url: str) -> None:
    answer = httpx.post(
        f"{url}/v1/tokens",
        json={"name": "lister", "owner": "Ada", "scopes": ["access", "marks", "runs"]},
        headers={"Authorization": f"Bearer {TOKEN}"},
    )
    page = browser.new_page()
    page.goto(f"{url}/dashboard/")
    page.fill("#token", answer.json()["secret"])
    page.keyboard.press("Enter")
    page.wait_for_selector("button:text-is('Forget token (viewer, only access, marks, runs)')")
    page.wait_for_selector(".runs tr >> text=finished")
    page.close()


def test_a_frame_whose_pictures_are_removed_shows_its_thumbnails(browser: Browser, tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path, log_level="error"))
    places = ["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 10.0]
    run = world.work(spec("numbers", retention="numbers", vary=[places], cameras=["camera-1"]))
    with served(create_app(world.settings, control=False)) as client:
        page = browser.new_page()
        complaints: list[str] = []
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        page.goto(f"{str(client.base_url).rstrip('/')}/dashboard/#/frames/{run}.0.0.0")
        page.wait_for_selector("text=The picture was removed (retention: numbers); the thumbnail remains.")
        page.wait_for_function("document.querySelectorAll('.thumbnail.waiting').length === 0")
        shown = page.locator(".thumbnail").evaluate_all("all => all.map((one) => one.style.backgroundImage)")
        assert [one.startswith('url("blob:') for one in shown] == [True] * 4, "picture and errors of two functions"
        assert page.locator(".viewer").count() == 0
        page.wait_for_selector("h1")
        page.close()
    assert complaints == []
    structlog.reset_defaults()


def test_a_lost_connection_is_told_and_taken_back(browser: Browser, url: str) -> None:
    page = browser.new_page()  # of its own, since the browser logs every request that fails
    page.goto(f"{url}/dashboard/")
    page.wait_for_selector("#lost", state="hidden")
    page.route("**/healthz", lambda route: route.abort())
    page.wait_for_selector("#lost", state="visible", timeout=5_000)
    page.unroute("**/healthz")
    page.wait_for_selector("#lost", state="hidden", timeout=5_000)
    page.close()


def test_the_view_in_an_address_is_shown_also_when_nothing_else_changes(page: Page) -> None:
    open_run(page, "finished")
    page.click("a:text-is('Frames')")
    page.locator(".thumbnails a").first.click()
    page.wait_for_selector(".viewer img[src]")
    address = page.url.split("?")[0]
    for view in ("truth", "picture"):
        page.goto(f"{address}?view={view}")
        page.wait_for_selector(f"[data-view={view}][aria-pressed=true]")


def test_the_list_shows_every_run_with_its_state(page: Page) -> None:
    rows = page.locator("tbody tr")
    assert rows.count() == 7
    states = {row.locator("a").inner_text(): row.locator(".chip").inner_text() for row in rows.all()}
    assert states["finished"] == "completed"
    assert "failures" in states["lost a layer"]
    assert states["running"] == "running"


def test_a_finished_run_shows_its_table_and_every_evaluated_person_as_a_point(page: Page, url: str) -> None:
    open_run(page, "finished")
    page.wait_for_selector(".plot canvas")
    assert page.locator("table", has_text="pACC").count() >= 1
    assert page.locator(".verdicts h2").inner_text() == "Requirements 2 met, 2 not met"
    plot = page.locator(".plot canvas").first
    plot.focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_selector(".tip")
    assert "pACC" in page.locator(".tip").first.inner_text()


def test_verdicts_come_first_on_the_page_and_in_the_report(page: Page, url: str) -> None:
    open_run(page, "finished")
    page.wait_for_selector(".verdicts h2")
    before = page.evaluate(
        "() => [...document.querySelectorAll('main .verdicts, main table, main .plot')].map((one) => one.className)[0]"
    )
    assert before == "verdicts"
    run = page.url.rsplit("/", 1)[1].split("?")[0]
    report = httpx.get(f"{url}/v1/runs/{run}/report", headers={"Authorization": f"Bearer {TOKEN}"}, timeout=60)
    sections = re.findall(r'<section id="([a-z]+)"', report.text)
    assert sections[:3] == ["short", "requirements", "findings"]


def test_another_axis_is_part_of_the_address(page: Page) -> None:
    open_run(page, "finished")
    page.wait_for_selector(".plot canvas")
    page.select_option("#axis", "occlusion_rate")
    page.wait_for_url("**occlusion_rate**")


def test_pacc_is_drawn_over_what_the_run_varied(page: Page) -> None:
    open_run(page, "finished")
    page.wait_for_selector(".plot canvas")
    offered = page.locator("#axis option").all_inner_texts()
    assert "Bearing (°)" in offered
    assert "Contrast to the surroundings (Michelson)" not in offered, "the run did not ask for light"
    page.select_option("#axis", "scene.person-1.pos.y")
    page.wait_for_url("**x=scene.person-1.pos.y")
    plot = page.locator(".plot canvas").first
    page.wait_for_function("() => document.querySelector('.plot canvas').ariaLabel.includes('person-1.pos.y')")
    plot.focus()
    page.keyboard.press("ArrowRight")
    assert "person-1.pos.y 5.00 m" in page.locator(".tip").first.inner_text()


def test_a_sequence_is_played_and_its_slider_leads_to_its_moments(page: Page) -> None:
    open_run(page, "walking")
    page.click("a:text-is('Frames')")
    page.locator(".thumbnails a").first.click()
    page.wait_for_selector(".player")
    assert page.locator("h1").inner_text().endswith(", 0.00 s")
    page.click(".player button")
    page.wait_for_function("() => document.querySelector('.player span').textContent.includes('frame 3 of 3')")
    page.click(".player button")
    page.wait_for_function("() => document.querySelector('.player button').textContent.includes('Play')")
    page.locator(".player input").focus()
    page.keyboard.press("End")  # where it stopped, unless the machine was slow
    page.wait_for_url("**.0.0.2?*")
    page.locator(".player input").focus()
    page.keyboard.press("Home")
    page.wait_for_url("**.0.0.0?*")
    page.locator(".player input").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_url("**.0.0.1?*")
    page.wait_for_function("() => document.querySelector('h1').textContent.endsWith('0.50 s')")
    page.wait_for_function("() => document.activeElement.type === 'range'")


def test_results_can_be_downloaded(page: Page) -> None:
    open_run(page, "finished")
    page.wait_for_selector(".plot canvas")
    with page.expect_download() as csv:
        page.click("text=↓ CSV")
    assert Path(csv.value.path()).read_text().startswith('"run_id",')
    with page.expect_download() as report:
        page.click("button:has-text('Report')")
    assert "<html" in Path(report.value.path()).read_text()[:200].lower()


def explore(page: Page, name: str) -> None:
    """Open the page Explore of a run."""
    open_run(page, name)
    page.click("main a:has-text('Explore')")
    page.wait_for_selector(".thumbnail:not(.waiting)")
    page.wait_for_selector("tr.selection")


def test_a_brush_selects_in_every_view_and_is_part_of_the_address(page: Page) -> None:
    explore(page, "finished")
    rows = int(page.locator(".select strong").inner_text().removesuffix(" rows"))
    bars = page.locator(".histogram", has_text="Function").locator("canvas")
    bars.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    page.wait_for_selector(".brush:has-text('deeplabv3plus-small')")
    page.wait_for_selector("tr.rest")
    assert page.locator(".select strong").inner_text() == f"{rows // 2} of {rows} rows"
    assert "b=function~names~deeplabv3plus-small" in page.url.replace("%7E", "~")
    page.fill("#where", "camera == 'camera-1'")
    page.keyboard.press("Enter")
    page.wait_for_selector(f".select strong:text-is('{rows // 4} of {rows} rows')")
    page.reload()
    page.wait_for_selector(f".select strong:text-is('{rows // 4} of {rows} rows')")


def test_a_selection_is_saved_exported_refined_and_compared(page: Page) -> None:
    explore(page, "finished")
    page.fill("#where", "distance_m > 25")
    page.keyboard.press("Enter")
    page.wait_for_selector("tr.rest")
    page.click("text=Save selection")
    page.keyboard.type("far")
    page.keyboard.press("Enter")
    page.wait_for_selector("#toasts >> text=saved")
    page.click("button:text-is('Saved')")
    page.wait_for_selector("dialog tr:has-text('finished') >> text=distance_m > 25")
    page.keyboard.press("Escape")
    page.click("button:text-is('Export')")
    with page.expect_download() as csv:
        page.click("text=↓ CSV")
    assert Path(csv.value.path()).read_text().startswith('"run_id",')
    with page.expect_download() as frames:
        page.click("text=↓ COCO")
    assert is_zipfile(frames.value.path())
    page.keyboard.press("Escape")
    page.wait_for_selector("#beside option:text-is('far')", state="attached")
    page.fill("#where", "distance_m < 20")
    page.keyboard.press("Enter")
    page.select_option("#beside", label="far")
    page.wait_for_selector("tr.rest:has-text('far')")
    page.wait_for_function("() => location.hash.includes('beside=distance_m+%3E+25')")
    page.fill("#where", "distance_m > 25")
    page.keyboard.press("Enter")
    page.wait_for_selector(".select strong:has-text(' of ')")
    for button in ("Refine here", "More like these"):
        page.click(f"button:text-is('{button}')")
        page.wait_for_selector(f"h1:text-is('{button}')")
        page.wait_for_selector(".facts.plan dd:text-is('64')")
        assert "parent_run" in page.input_value("#spec")
        assert ("finished similar" in page.input_value("#spec")) == (button == "More like these")
        assert page.locator("button:has-text('Submit run')").is_enabled()
        page.go_back()
        page.wait_for_selector("tr.selection")
    page.click("text=Train on this")
    page.wait_for_selector("dialog code:has-text(\"--where 'distance_m > 25' --data-dir /\")")
    page.keyboard.press("Escape")
    page.click("[data-tab=compare]")
    page.wait_for_selector("text=persons matched")
    page.click("[data-tab=swings]")
    page.wait_for_selector(".pair:has-text('camera-2') .thumbnail:not(.waiting)")
    page.click("[data-tab=table]")
    page.click("tbody td a.mono")
    page.wait_for_selector(".viewer img[src]")


def test_which_of_two_networks_is_worse_at_dusk_is_answered_with_pictures_four_clicks_after_the_list_of_runs(
    page: Page, url: str
) -> None:
    clicks = 0

    def click(selector: str) -> None:
        nonlocal clicks
        clicks += 1
        page.locator(selector).first.click()

    click("tr:has-text('day and dusk') a")
    page.wait_for_selector("a:text-is('Compare functions')")
    run = page.url.rsplit("/", 1)[1]
    click("a:text-is('Compare functions')")
    page.wait_for_selector(".pair .thumbnail:not(.waiting)")
    page.wait_for_selector("[data-tab=compare]:focus")
    assert page.locator("[data-tab=compare]").bounding_box()["y"] < 200, "the head of the comparison is at the top"
    page.wait_for_selector("text=/pooled precision [^,]* points.*, pooled IoU .* points.*; no interval/")
    matched = page.locator("text=/persons matched/").first.inner_text()
    click("button:text-is('Dusk')")
    page.wait_for_selector(".brush:has-text('Sun elevation')")
    page.wait_for_function(
        "(all) => !document.body.innerText.includes(all)", arg=matched
    )  # the verdict is that of dusk
    worse = page.locator("[aria-label=Rows] p strong").first.inner_text().split()[0]
    page.wait_for_selector(f"[aria-label=Outcome] [aria-pressed=true]:has-text('Only {worse} misses')")
    click(".pair a")
    page.wait_for_selector(".viewer img[src]")
    assert clicks == 4
    page.go_back()
    page.wait_for_selector(".pair")
    page.wait_for_function("() => scrollY > 300")  # where the page was left
    rows = httpx.get(
        f"{url}/v1/explore/rows",
        params={"run": run, "where": "sun_elevation_deg < 3", "limit": 1000},
        headers={"Authorization": f"Bearer {TOKEN}"},
    ).json()["items"]
    means = {
        name: fmean(row["pacc"] for row in rows if row["function"] == name and row["pacc"] is not None)
        for name in ("deeplabv3plus-small", "semantic-fpn-small")
    }
    assert worse == min(means, key=means.__getitem__)


def test_two_runs_are_coloured_by_run_and_their_sides_say_what_differs(page: Page) -> None:
    runs = compare_runs(page, "finished", "lost a layer")
    page.wait_for_selector(".pair .thumbnail:not(.waiting)")
    assert page.input_value("#c") == "run_id"
    assert [page.input_value(f"#side-{side}") for side in ("before", "after")] == [
        f"{one}:{FUNCTIONS[0]}" for one in runs
    ]
    page.wait_for_selector("text=To refine or train, explore one run alone")
    page.wait_for_selector("[aria-label=Rows] .legend:has(.patch.miss)")
    names = page.locator(".pair >> nth=0 >> .clipped")
    assert names.all_inner_texts() == ["finished", "lost a layer"]
    page.select_option("#side-after", label=f"{FUNCTIONS[1]} · lost a layer")
    page.wait_for_selector(f".pair .clipped:text-is('{FUNCTIONS[1]} · lost a layer')")
    assert names.first.inner_text() == f"{FUNCTIONS[0]} · finished"
    page.select_option("#side-after", label=f"{FUNCTIONS[1]} · finished")
    page.wait_for_selector(f".pair .clipped:text-is('{FUNCTIONS[1]}')")
    assert names.first.inner_text() == FUNCTIONS[0]


def test_the_light_of_points_is_shown_and_cannot_be_set_beside_them(page: Page) -> None:
    link = page.locator(".runs tr", has_text="day and dusk").locator("a").first.get_attribute("href")
    page.goto(f"{page.url.split('#')[0]}#/new?form=nearby&run={link.rsplit('/', 1)[1]}&where=sun_elevation_deg+%3C+3")
    light = page.get_by_role("group", name="Light")
    light.locator("[aria-pressed=true]:text-is('Dusk')").wait_for()
    assert light.locator("[aria-pressed=true]").count() == 1
    assert light.locator("button[disabled][title*='points of this document set sun-1.elevation']").count() == 3


def test_two_runs_match_across_a_parameter_that_each_holds(page: Page) -> None:
    compare_runs(page, "at noon", "at dusk")
    page.wait_for_selector("text=0 persons matched")
    page.get_by_role("group", name="Match across").get_by_role("button", name="sun-1.elevation").click()
    page.wait_for_selector(".pair .thumbnail:not(.waiting)")
    assert "across=scene.sun-1.elevation" in page.url
    page.reload()
    page.wait_for_selector(".pair .thumbnail:not(.waiting)")
    page.select_option("#side-after", label=f"{FUNCTIONS[1]} · at noon")  # another pair of sides
    page.wait_for_selector(f".pair .clipped:text-is('{FUNCTIONS[1]}')")
    assert "across=" not in page.url


def test_cards_wait_for_their_rows_and_a_brush_beyond_the_plot_ends_at_the_column_s_values(page: Page) -> None:
    held: list[Route] = []
    page.route("**/v1/explore/rates*", lambda route: held.append(route))
    open_run(page, "finished")
    page.click("main a:text-is('Explore')")
    page.wait_for_selector("[aria-label=Rates] [aria-busy=true]")
    page.wait_for_selector(".thumbnail:not(.waiting)")
    assert page.locator("[aria-busy=true]").count() == 1, "only the rates are missing"
    for route in held:
        route.continue_()
    page.unroute("**/v1/explore/rates*")
    page.wait_for_selector("tr.selection")
    assert page.locator("[aria-busy=true]").count() == 0
    box = page.locator(".scatter-canvas").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] + 40, box["y"] - 40, steps=4)
    page.mouse.up()
    page.wait_for_selector(".brush:has-text('pACC')")
    rows = page.evaluate("() => unescape(location.hash).match(/pacc~range~[^|]*[|]([^|]*)[|]/)[1]")
    assert float(rows) == 1.0


def test_a_cell_of_the_confusion_matrix_opens_the_frames_with_its_pixels(page: Page) -> None:
    explore(page, "finished")
    page.click("[data-tab=confusion]")
    cell = page.locator(".confusion button[aria-label^='person predicted as building']")
    cell.click()
    page.wait_for_selector(".thumbnails .thumbnail:not(.waiting)")
    assert cell.get_attribute("aria-pressed") == "true"
    assert "cell=person%7Ebuilding" in page.url.replace("~", "%7E")
    shown = page.locator(".thumbnails strong")
    pixels = [int(text.replace(",", "")) for text in shown.all_inner_texts()]
    assert pixels == sorted(pixels, reverse=True)
    assert pixels[-1] > 0
    page.reload()
    page.wait_for_selector(".confusion [aria-pressed='true']")


def test_zoom_is_the_same_in_every_pane_and_the_pixel_under_the_pointer_is_read(page: Page) -> None:
    open_run(page, "finished")
    page.click("a:text-is('Frames')")
    page.locator(".thumbnails a").first.click()
    page.wait_for_function(
        "() => [...document.querySelectorAll('.viewer img')].filter(i => i.naturalWidth > 1).length >= 4"
    )
    page.locator(".window").first.hover()
    page.wait_for_selector(".reading:has-text('RGB')")
    page.wait_for_selector(".reading:has-text('deeplabv3plus-small')")  # the server's answer comes after the colour
    page.mouse.wheel(0, -400)
    page.wait_for_selector(".world.near")
    transforms = page.evaluate("() => [...document.querySelectorAll('.world')].map(one => one.style.transform)")
    assert len(transforms) == 2
    assert len(set(transforms)) == 1
    page.click("[data-view=all]")
    page.wait_for_function("() => document.querySelectorAll('.world.near').length === 8")
    transforms = page.evaluate("() => [...document.querySelectorAll('.world')].map(one => one.style.transform)")
    assert len(set(transforms)) == 1, "every layer of every function follows"
    page.keyboard.press("0")
    page.wait_for_selector(".world.near", state="detached")
    page.click("[aria-label='Variant'] a[aria-label*='pos.y']")
    page.wait_for_function("() => document.querySelector('[aria-label=Variant]').innerText.includes('← 5')")


def test_the_chip_and_the_address_name_the_whole_brush_after_a_quick_drag(page: Page) -> None:
    open_run(page, "day and dusk")
    page.click("main a:text-is('Explore')")
    bars = page.locator(".histogram-canvas[aria-label*='person-1.pos.y']")
    bars.scroll_into_view_if_needed()
    box = bars.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 4, box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 40, steps=12)  # more moves than the page has time to show
    page.mouse.up()
    page.wait_for_selector(".chips .brush:has-text('5 m to 25 m')")
    assert "person-1.pos.y~range~5|25|1" in unquote(page.url)


def test_two_fingers_zoom_every_pane_around_their_middle(page: Page) -> None:
    open_run(page, "finished")
    page.click("a:text-is('Frames')")
    page.locator(".thumbnails a").first.click()
    page.wait_for_selector(".window")
    page.locator(".window").first.scroll_into_view_if_needed()
    box = page.locator(".window").first.bounding_box()
    assert box is not None
    middle = (box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"])
    screen = page.context.new_cdp_session(page)

    def fingers(kind: str, *apart: float) -> None:
        touching = [
            {"x": middle[0] + sign * half, "y": middle[1], "id": k} for half in apart for k, sign in enumerate((-1, 1))
        ]
        screen.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touching})

    fingers("touchStart", 20)
    for half in (30, 45, 60):
        fingers("touchMove", half)
    fingers("touchEnd")
    scale, x, y = page.evaluate(
        "() => { const w = document.querySelector('.world'); const [a, b] = w.style.transform.match(/-?[\\d.]+%/g);"
        " return [parseFloat(w.style.getPropertyValue('--scale')), -parseFloat(a) / 100, -parseFloat(b) / 100]; }"
    )
    assert scale == pytest.approx(3.0, rel=0.1)
    assert x + 0.25 / scale == pytest.approx(0.25, abs=0.02), "the middle stays where it was"
    assert y + 0.5 / scale == pytest.approx(0.5, abs=0.02)
    assert (
        len(set(page.evaluate("() => [...document.querySelectorAll('.world')].map(one => one.style.transform)"))) == 1
    )


def test_a_point_opens_its_frame_with_truth_and_prediction_over_the_picture(page: Page) -> None:
    open_run(page, "finished")
    page.wait_for_selector(".plot canvas")
    page.locator(".plot canvas").first.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    page.wait_for_selector(".viewer img[src]")
    first = page.url
    assert "/frames/" in first
    drawn = "() => [...document.querySelectorAll('.viewer img')].filter(i => i.src && i.naturalWidth > 1).length >= 2"
    page.wait_for_function(drawn)
    titles = page.locator(".columns th[scope=row]").all_inner_texts()
    for measure in measures_from(Source.PLACE, Source.PIXELS, Source.FRAME_SCORE):
        shown = measure.title in [title[0].lower() + title[1:] for title in titles] + titles
        assert shown == (measure.name != "undefined_reason"), "pACC is defined"
    assert len(set(titles)) == len(titles)
    assert "Light on the body" not in titles, "the run did not ask for light"
    assert "Missed, called instead" in titles
    for view, title in (("errors", "Errors · {}"), ("all", "Errors · {}"), ("all", "Prediction · {}")):
        page.click(f"[data-view={view}]")
        for name in FUNCTIONS:
            page.wait_for_selector(f"figcaption h3:text-is('{title.format(name)}')")
    page.wait_for_selector(".legend .patch.miss")
    page.keyboard.press("ArrowRight")
    page.wait_for_function("before => location.href !== before", arg=first)


def test_failures_are_shown_with_their_error(page: Page) -> None:
    open_run(page, "lost a layer")
    page.wait_for_selector("text=failed for good")
    assert page.locator("button:has-text('Retry failures')").is_visible()


def test_functions_show_their_cards_and_every_version(page: Page, tmp_path: Path) -> None:
    page.click("nav >> text=Functions")
    page.wait_for_selector("h1:has-text('Functions under test')")
    cards = {card.locator("h2").inner_text(): card for card in page.locator(".function").all()}
    assert list(cards) == ["deeplabv3plus-small", "semantic-fpn-small", "small"]
    assert cards["semantic-fpn-small"].locator(".chip").inner_text() == "offered"
    own = cards["small"]
    assert own.locator(".chip").inner_text() == "no living worker"
    assert "version 2" in own.inner_text()
    assert "<b>second</b>.onnx" in own.locator(".facts").first.inner_text(), "text stays text"
    assert "opened and run when it was imported" in own.inner_text()
    own.locator("summary", has_text="The whole card").click()
    facts = [
        (row.locator("dt").inner_text(), row.locator("dd").inner_text())
        for row in own.locator("details .facts > div").all()
    ]
    document, _ = small_onnx(tmp_path, provenance=SECOND)
    assert facts == card_rows(document.card(), document)
    own.locator("summary", has_text="2 versions").click()
    rows = own.locator("tbody tr")
    assert [row.locator("th").inner_text() for row in rows.all()] == ["2", "1"]
    assert "first.onnx" in rows.nth(1).inner_text()


def test_a_link_of_the_list_survives_the_polls_while_the_mouse_is_down(page: Page) -> None:
    page.locator("a", has_text="running").hover()
    page.mouse.down()
    for _ in range(2):
        page.wait_for_event("response", lambda response: "/v1/tags" in response.url)
    page.wait_for_timeout(200)
    page.mouse.up()
    page.wait_for_selector("main a:text-is('Explore')")


def test_a_run_is_cancelled_and_deleted_only_after_confirmation(page: Page) -> None:
    open_run(page, "running")
    page.click("button:has-text('Cancel')")
    page.click("text=Cancel the run")
    page.wait_for_selector(".chip:has-text('cancelled')")
    page.click("button:has-text('Delete')")
    page.click("text=Delete for good")
    page.wait_for_url("**#/")
    page.wait_for_selector("tr:has-text('running')", state="detached")
    page.wait_for_selector("tr:has-text('day and dusk')")
