"""The report prints completely: provenance and spec too, folded or open, and nothing is cut off at the edge of the page."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from io import BytesIO
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from tests.planted_tables import planted_finding, planted_table
from valerie.analysis.analyze import analyze
from valerie.analysis.findings.findings import Findings, ScoredPerson
from valerie.analysis.report.model import Provenance, ReportInput
from valerie.analysis.report.odd import Covered, CoveredPair, Held, OddCoverage
from valerie.analysis.report.report import build_report
from valerie.cli.printing import pdf_of
from valerie.parameters.odd import OddAttribute
from valerie.perception.base import FunctionCard

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = [pytest.mark.browser, pytest.mark.processes]

#: Digests and paths have no place to break.
DIGEST = "0123456789abcdef" * 16
#: Width of A4 less the page's margins of 14 mm, in CSS pixels.
WIDTH = round((210 - 28) / 25.4 * 96)
LAST = ("the-last-fact", "line-199-of-the-spec")


LIT, DARK = (
    ScoredPerson("lit-frame", "default", "net", 24001, 0.9),
    ScoredPerson("dark-frame", "default", "net", 24001, 0.1),
)
FINDINGS = Findings((planted_finding(LIT, DARK),), (), 9, level=0.95, places_searched=20, places_confirming=20)
LEVELS = tuple(f"level-{k}" for k in range(4))
ONE, OTHER = (Covered(OddAttribute.RAINFALL, name, "", LEVELS, (3,) * 4) for name in ("one", "other"))
#: Twelve of the sixteen pairs of levels never occur.
PAIR = CoveredPair(ONE, OTHER, tuple(tuple(3 * (row == column) for column in range(4)) for row in range(4)))
DOMAIN = OddCoverage((ONE, OTHER), (PAIR,), (Held(OddAttribute.WIND, "the-held-one", "3 m/s"),), ())


def report(**fields: Any) -> str:
    """Return a report with pictures of frames, each of another colour."""
    colours = count(0x808080, 16)

    def picture(*_: object, **__: object) -> bytes:
        sink = BytesIO()
        Image.new("RGB", (64, 36), f"#{next(colours):06x}").save(sink, "PNG")
        return sink.getvalue()

    along = np.linspace(10, 40, 60)
    table = planted_table(1 - along / 50, range(60), distance_m=along, pixel_area_percent=10 / along)
    analysis = analyze(table)
    now = datetime(2026, 11, 25, tzinfo=UTC)
    card = FunctionCard("net", DIGEST, "a", "fp32", "e", {"weights": DIGEST})
    more = {"Duration": "3 min 20 s", "Report written on": "the-last-fact"}
    provenance = Provenance(
        "run",
        DIGEST,
        7,
        "street",
        DIGEST,
        "raster",
        (960, 540),
        {"image": "llvmpipe"},
        (card,),
        "valerie 0",
        now,
        now,
        more,
    )
    document = {"name": "printed", "notes": [f"line-{k}-of-the-spec {DIGEST if k == 199 else ''}" for k in range(200)]}
    source = ReportInput(
        document, provenance, table, analysis.summary, analysis.trends, analysis.findings, 60, 60, picture=picture
    )
    return build_report(replace(source, **fields))


@pytest.mark.parametrize("state", ["folded", "open"])
def test_provenance_and_spec_are_whole_in_print(state: str, browser: Browser) -> None:
    page = browser.new_page(viewport={"width": WIDTH, "height": 1000})
    page.set_content(report())
    if state == "open":
        page.eval_on_selector_all("#provenance details", "all => all.forEach((one) => { one.open = true; })")
    page.emulate_media(media="print")
    for word in LAST:
        box = page.get_by_text(word).last.bounding_box()
        assert box is not None
        assert box["height"] > 0
    # What is wider than its box is cut off on paper, where nothing scrolls.
    wide = page.eval_on_selector_all(
        "#provenance *", "all => all.filter((one) => one.scrollWidth > one.clientWidth + 1 && one.clientWidth).length"
    )
    assert wide == 0
    assert page.evaluate("document.documentElement.scrollWidth") <= WIDTH
    page.close()


def test_evidence_of_the_register_and_every_hole_of_the_domain_are_printed(browser: Browser) -> None:
    page = browser.new_page(viewport={"width": WIDTH, "height": 1000})
    page.set_content(report(findings=FINDINGS, odd=DOMAIN))
    page.emulate_media(media="print")
    for section, word in (
        ("register", DARK.frame_id),
        ("domain", "level-3 with level-2"),
        ("domain", "the-held-one"),
    ):
        box = page.locator(f"#{section}").get_by_text(word).last.bounding_box()
        assert box is not None
        assert box["height"] > 0
    # The spec of the re-test is folded in the finding, and does not print.
    assert page.locator("#register").get_by_text("the spec is with the finding").is_hidden()
    page.close()


def test_open_provenance_takes_pages_of_the_pdf() -> None:
    html = report()
    short = html.replace(html[html.index('<section id="provenance">') : html.index("</main>")], "")
    assert pdf_of(html.encode()).count(b"/Type /Page\n") > pdf_of(short.encode()).count(b"/Type /Page\n") + 2


def test_all_pictures_are_printed_from_a_window_and_as_pdf(browser: Browser) -> None:
    html = report()
    page = browser.new_page(viewport={"width": 1000, "height": 400})
    page.set_content(html)
    for _ in range(200):
        if page.eval_on_selector_all("img", "all => all.every((one) => one.complete)"):
            break
        page.wait_for_timeout(50)
    printed = page.pdf().count(b"/Subtype /Image\n")
    page.close()
    assert 'loading="lazy"' in html, "pictures far from the screen do not delay the opening"
    assert html.count("<img ") == printed == pdf_of(html.encode()).count(b"/Subtype /Image\n")


def test_figures_are_drawn_when_they_come_near_the_screen(browser: Browser) -> None:
    page = browser.new_page(viewport={"width": 1000, "height": 400})
    page.set_content(report())
    plots = page.locator(".plot")
    assert plots.count() > 0
    assert page.locator(".plot.drawn").count() < plots.count()
    assert not page.evaluate("'Plotly' in window")
    plots.last.scroll_into_view_if_needed()
    page.wait_for_selector(".plot.drawn .live .main-svg")
    page.close()
