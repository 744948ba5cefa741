"""axe-core finds nothing serious on any page, light, dark or on a phone, and no page is wider than a phone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import pytest
import structlog
from axe_playwright_python.sync_playwright import Axe

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

LOOKS: dict[str, dict[str, Any]] = {
    "light": {"color_scheme": "light", "viewport": {"width": 1280, "height": 900}},
    "dark": {"color_scheme": "dark", "viewport": {"width": 1280, "height": 900}},
    "phone": {"color_scheme": "light", "viewport": {"width": 390, "height": 800}},
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


def _dialog(page: Page) -> None:
    page.click(".mark button >> nth=0")
    page.wait_for_selector("dialog[open]")


#: Address, what shows that the page is drawn, and what is done there.
PAGES: dict[str, tuple[str, str, Go | None]] = {
    "runs": ("/", "tbody tr", None),
    "runs of a tag": ("/?tag=night", "tbody tr", None),
    "finished": ("/runs/{finished}", ".plot canvas", None),
    "failed": ("/runs/{failed}", "text=failed for good", None),
    "running": ("/runs/{running}", ".stages .stage", None),
    "child": ("/runs/{child}", ".lineage", None),
    "mark": ("/runs/{finished}", ".mark button", _dialog),
    "frame": ("/frames/{finished}.0.0.0", ".viewer img[src]", None),
    "depth": ("/frames/{finished}.0.0.0?view=depth", ".viewer img[src]", None),
    "explore": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", None),
    "table": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _tab("table")),
    "compare": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _tab("compare")),
    "swings": ("/explore?runs={finished}", ".thumbnail:not(.waiting)", _tab("swings")),
    "studies": ("/studies", "article", None),
    "study": ("/studies/{study}", ".proposal", None),
    "functions": ("/functions", ".function", None),
    "workers": ("/workers", ".costs figure", None),
    "new": ("/new", ".facts.plan", None),
    "problem": ("/new", ".facts.plan", _problem),
    "demands": ("/new", ".facts.plan", _demands),
    "cloned": ("/new?run={finished}", ".parameter", None),
    "nothing": ("/nothing", "text=Page not found", None),
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


@pytest.mark.parametrize("name", PAGES)
@pytest.mark.parametrize("look", LOOKS)
def test_a_page_is_accessible_and_fits(browser: Browser, addresses: dict[str, str], look: str, name: str) -> None:
    path, drawn, go = PAGES[name]
    context = browser.new_context(**LOOKS[look], reduced_motion="reduce")
    page = context.new_page()
    # Pictures of drafts have their own tests.
    page.route("**/v1/preview?**", lambda route: route.fulfill(json=NO_PICTURES))
    page.goto(f"{addresses['url']}#{path.format(**addresses)}")
    page.wait_for_selector(drawn)
    if go is not None:
        go(page)
    result = Axe().run(page)
    width = page.evaluate("() => document.scrollingElement.scrollWidth - innerWidth")
    context.close()
    serious = [one["id"] for one in result.response["violations"] if one["impact"] in ("serious", "critical")]
    assert serious == [], result.generate_report()
    assert width <= 0
