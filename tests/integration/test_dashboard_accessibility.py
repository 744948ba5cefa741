"""axe-core finds nothing serious in any state of any page, light, dark or on a phone, and no page is wider than a phone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Literal

import pytest
import structlog
import yaml
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import TimeoutError as WaitEnded

from services.api.app import create_app
from tests.world.drawn import ASSET, DrawnWorld, layer_of_variant_4, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.db import marks
from valerie.db.engine import database_moment, writing
from valerie.pipeline.control.studies import commands
from valerie.runs.marks import Mark, Subject
from valerie.runs.study.study_document import parse_study

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = [pytest.mark.browser, pytest.mark.processes, pytest.mark.timeout(600)]

#: Colour scheme, width and height.
LOOKS: dict[str, tuple[Literal["light", "dark"], int, int]] = {
    "light": ("light", 1280, 900),
    "dark": ("dark", 1280, 900),
    "phone": ("light", 390, 800),
}
STUDY = {
    **spec("how often", functions=["deeplabv3plus-small"], cameras=["camera-1"]),
    "vary": [["person-1.pos.x", "UNIFORM", -3, 3], ["person-1.pos.y", "UNIFORM", 5, 30]],
    "measure": "min(pacc) >= 0.5",
    "goal": {"name": "estimate", "first": 20},
    "budget": {"variants": 20},
    "batch": 10,
    "mode": "by hand",
}
NO_PICTURES = {"variants": [], "engine": "raster", "draft": {}, "problem": "there is no Blender environment"}
#: Time for plots to follow the size of the screen on a busy machine, milliseconds.
SETTLED_MS = 5_000
#: The width of a page that is too wide, and what reaches beyond the screen.
WIDER = """() => document.scrollingElement.scrollWidth <= innerWidth ? [] : [document.scrollingElement.scrollWidth,
    ...[...document.querySelectorAll("body *")].filter((one) => one.getBoundingClientRect().right > innerWidth)
        .map((one) => one.outerHTML.slice(0, 80))]"""
Go = Callable[["Page"], None]


def _tab(name: str) -> Go:
    def go(page: Page) -> None:
        page.wait_for_selector(".thumbnail:not(.waiting)")
        page.click(f"[data-tab={name}]")
        page.wait_for_function("() => !document.querySelector('main .loading')")

    return go


def _problem(page: Page) -> None:
    page.wait_for_selector(".facts.plan")
    page.fill("#spec", f"name: one\nasset: {ASSET}\nconstants:\n  sun-1.elevation: 2000 deg\nrenderer: rastr\n")
    page.wait_for_selector(".problems li")
    page.focus("#spec")
    page.keyboard.press("Control+End")
    page.keyboard.type("cam")
    page.wait_for_selector("#proposals:visible")


def _demands(page: Page) -> None:
    page.wait_for_selector(".facts.plan")
    sensors = "sensors: [{name: one, gain_db: 60, noise: {shot: true}}]\n"
    requirements = "requirements: [{id: A, statistic: share(pacc >= 0.5) >= 95 %}, {id: B, statistic: median(pacc)}]\n"
    page.fill("#spec", f"name: one\nasset: {ASSET}\n{sensors}{requirements}")
    page.wait_for_selector("[id='f-sensors.0.gain_db-problem']")


def _plan(page: Page) -> None:
    page.fill("#spec", yaml.safe_dump(STUDY))
    page.click("button:text-is('Plan')")
    page.wait_for_selector(".facts.plan")


def _refuse(page: Page) -> None:
    page.fill("#spec", yaml.safe_dump({**STUDY, "budget": {"variants": 3}}))
    page.click("button:text-is('Plan')")
    page.wait_for_selector(".problems li")


def _click(*selectors: str, shown: str = "dialog[open]") -> Go:
    def go(page: Page) -> None:
        for selector in selectors:
            page.click(selector)
        page.wait_for_selector(shown)

    return go


def _brush(page: Page) -> None:
    page.focus(".histogram-canvas >> nth=0")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    page.wait_for_selector("tr.rest")


def _choose_a_point(page: Page) -> None:
    page.focus(".plot canvas >> nth=0")
    page.keyboard.press("ArrowRight")
    page.wait_for_selector(".tip:visible")


def _zoom(page: Page) -> None:
    page.click("[aria-label='Zoom in']")
    page.hover(".window >> nth=0")
    page.wait_for_selector(".reading:has-text('truth')")


def _toast(page: Page) -> None:
    page.click(".mark button >> nth=0")
    page.fill("#mark-tags", "x" * 41)
    page.click("dialog >> text=Save")
    page.wait_for_selector(".toast")


#: Address, what shows that the page is drawn, and what is done there.
PAGES: dict[str, tuple[str, str, Go | None]] = {
    "runs": ("/", "tbody tr", None),
    "runs of a tag": ("/?tag=night", "tbody tr", None),
    "no run of a tag": ("/?tag=nothing", "text=No run carries this tag", None),
    "finished": ("/runs/{finished}", ".plot canvas", None),
    "point": ("/runs/{finished}", ".plot canvas", _choose_a_point),
    "spec": ("/runs/{finished}", ".plot canvas", _click(".spec summary", shown=".spec pre")),
    "failed": ("/runs/{failed}", "text=failed for good", None),
    "running": ("/runs/{running}", ".stages .stage", None),
    "cancel": ("/runs/{running}", ".stages .stage", _click("button:text-is('Cancel')")),
    "delete": ("/runs/{finished}", ".plot canvas", _click("button:text-is('Delete')")),
    "child": ("/runs/{child}", ".lineage", None),
    "mark": ("/runs/{finished}", ".mark button", _click(".mark button >> nth=0")),
    "toast": ("/runs/{finished}", ".mark button", _toast),
    "frame": ("/frames/{finished}.0.0.0", ".viewer img[src]", None),
    "zoomed": ("/frames/{finished}.0.0.0", ".viewer img[src]", _zoom),
    "layers": ("/frames/{finished}.0.0.0?view=all", ".viewer img[src]", None),
    "depth": ("/frames/{finished}.0.0.0?view=depth", ".viewer img[src]", None),
    "failed frame": ("/frames/{failed}.4.0.0", "text=products of this frame are failed", None),
    "choice": ("/explore", "tbody tr", None),
    "explore": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", None),
    "two runs": ("/explore?runs={finished},{child}", ".thumbnail:not(.waiting)", None),
    "selection": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _brush),
    "nobody": ("/explore?runs={finished}&where=distance_m+>+900", "text=No row is selected", None),
    "wrong selection": ("/explore?runs={finished}&where=nope+>+1", ".select .note.bad", None),
    "save": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _click("text=Save selection")),
    "saved": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _click("button:text-is('Saved')")),
    "train": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _click("text=Train on this")),
    "export": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _click("button:text-is('Export')")),
    "table": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _tab("table")),
    "compare": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _tab("compare")),
    "swings": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _tab("swings")),
    "confusion": ("/explore?runs={finished}&tab=confusion&cell=person~building", ".thumbnail:not(.waiting)", None),
    "studies": ("/studies", "article", None),
    "study": ("/studies/{study}", ".proposal", None),
    "new study": ("/studies/new", "#spec", _plan),
    "refused study": ("/studies/new", "#spec", _refuse),
    "stop": ("/studies/{study}", ".proposal", _click("button:text-is('Stop')")),
    "functions": ("/functions", ".function", None),
    "card": ("/functions", ".function", _click("summary >> nth=0", shown=".function details[open]")),
    "workers": ("/workers", ".costs figure", None),
    "new": ("/new", ".facts.plan", None),
    "start over": ("/new", ".facts.plan", _click("text=Start over")),
    "problem": ("/new", ".facts.plan", _problem),
    "demands": ("/new", ".facts.plan", _demands),
    "cloned": ("/new?run={finished}", ".parameter", None),
    "refined": ("/new?form=range&run={finished}", ".facts.plan", None),
    "similar": ("/new?form=nearby&run={finished}", ".facts.plan", None),
    "no such run": ("/runs/0nothing", "h1:text-is('Not found')", None),
    "nothing": ("/nothing", "text=Page not found", None),
}
#: Pages of a server without runs.
EMPTY = {
    "/": "text=No run yet",
    "/explore": "text=There is no run with results yet",
    "/studies": "text=No study yet",
    "/studies/new": "#spec",
    "/functions": "h1",
    "/workers": "text=No living worker",
    "/new": ".facts.plan",
}


@pytest.fixture(scope="module")
def addresses(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """The dashboard's address, and the ids of runs in every state and of a study."""
    settings = settings_of(tmp_path_factory.mktemp("accessible"), log_level="error")
    world = DrawnWorld(settings)
    finished = world.work(spec("finished"))
    ids = {
        "finished": finished,
        "failed": world.work(spec("failed", constants={"sun-1.elevation": 12}), broken=layer_of_variant_4),
        "child": world.work(spec("child", parent_run=finished, iteration=1, constants={"sun-1.elevation": 13})),
        "study": commands.begin(world.context, parse_study(STUDY)),
    }
    world.step()
    ids["running"] = world.work(spec("running", constants={"sun-1.elevation": 25}), products=100)
    with writing(world.context.engine) as connection:
        mark = Mark(tags=("night",), note="Look at the houses.")
        marks.put(connection, finished, Subject(), mark, database_moment(connection))
    with served(create_app(settings, control=False)) as client:
        yield {**ids, "url": f"{str(client.base_url).rstrip('/')}/dashboard/"}
    structlog.reset_defaults()


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The dashboard of a server without runs."""
    with served(create_app(settings_of(tmp_path_factory.mktemp("empty"), log_level="error"), control=False)) as client:
        yield f"{str(client.base_url).rstrip('/')}/dashboard/"


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    opened = context.new_page()
    # Pictures of drafts have their own tests.
    opened.route("**/v1/preview?**", lambda route: route.fulfill(json=NO_PICTURES))
    yield opened
    context.close()


def require_accessible(page: Page) -> None:
    """Assert in every look that axe-core finds nothing serious and that nothing is wider than the screen."""
    for look, (scheme, width, height) in LOOKS.items():
        page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
        page.set_viewport_size({"width": width, "height": height})
        answer = Axe().run(page)
        serious = [
            violation["id"]
            for violation in answer.response["violations"]
            if violation["impact"] in ("serious", "critical")
        ]
        assert serious == [], f"{look}: {answer.generate_report()}"
        with suppress(WaitEnded):  # plots follow the size of the screen a moment later
            page.wait_for_function(f"() => !({WIDER})().length", timeout=SETTLED_MS)
        assert page.evaluate(WIDER) == [], look


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_accessible_and_fits(page: Page, addresses: dict[str, str], name: str) -> None:
    path, drawn, go = PAGES[name]
    page.goto(f"{addresses['url']}#{path.format(**addresses)}")
    page.wait_for_selector(drawn)
    if go is not None:
        go(page)
    require_accessible(page)


@pytest.mark.parametrize("path", EMPTY)
def test_a_page_without_content_is_accessible_and_fits(page: Page, empty: str, path: str) -> None:
    page.goto(f"{empty}#{path}")
    page.wait_for_selector(EMPTY[path])
    require_accessible(page)


def test_a_lost_connection_a_broken_server_and_the_question_for_a_token_are_accessible(
    page: Page, addresses: dict[str, str]
) -> None:
    page.goto(addresses["url"])
    page.wait_for_selector("tbody tr")
    page.route("**/healthz", lambda route: route.abort())
    page.wait_for_selector("#lost", state="visible")
    require_accessible(page)
    page.route("**/v1/studies**", lambda route: route.fulfill(status=500, json={"title": "Broken", "detail": "x"}))
    page.goto(f"{addresses['url']}#/studies")
    page.wait_for_selector("h1:text-is('Something went wrong')")
    require_accessible(page)
    page.route("**/v1/access", lambda route: route.fulfill(status=401, json={"title": "Unauthorized"}))
    page.reload()
    page.wait_for_selector("dialog[open] #token")
    require_accessible(page)
