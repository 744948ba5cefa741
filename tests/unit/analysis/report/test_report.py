import base64
import dataclasses
import hashlib
import json
import re
from datetime import UTC, datetime
from html.parser import HTMLParser

import pytest
import yaml

from valerie.analysis.analyze import analyze
from valerie.analysis.findings.effects import level_means, strongest_pair
from valerie.analysis.findings.importance import BlockShares, Explanation
from valerie.analysis.report import model
from valerie.analysis.report.figures import figure_tables
from valerie.analysis.report.model import Failure, Provenance, ReportInput
from valerie.analysis.report.odd import odd_coverage
from valerie.analysis.report.register import register
from valerie.analysis.report.report import build_report, data_url
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.summary.all_classes import AllClasses, PooledClass
from valerie.analysis.wording import ALIKE_PLACES
from valerie.measures import measure_of
from valerie.parameters.definitions import ParameterDefinition
from valerie.perception.base import FunctionCard
from valerie.runs.products.pictures import PictureKind
from valerie.runs.resolving.spec import parse
from valerie.statistics.curves import Shape
from valerie.statistics.importance import Importance, Share

DOCUMENT = {"name": "First run", "asset": "urban-street", "seed": 7, "blocks": [{"design": "grid", "vary": ["ä: b"]}]}
SPEC = parse({"name": "First run", "asset": "urban-street", "vary": [["person-1.pos.x", "CHOICE", 1, 2]]})
PICTURE = b"\xff\xd8\xff\xe0 a picture"


class Page(HTMLParser):
    """Content of a page; elements must be closed in order."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.attributes, self.text, self.scripts, self.preformatted = [], [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, name, attrs):
        self.attributes += [(name, key, value) for key, value in attrs]
        if name not in {"img", "br", "hr", "meta", "link", "col"}:
            self.open.append(name)
        if name == "script":
            self.scripts.append((dict(attrs), ""))

    def handle_endtag(self, name):
        assert self.open.pop() == name

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            attributes, before = self.scripts[-1]
            self.scripts[-1] = (attributes, before + data)
        elif self.open and self.open[-1] != "style":
            self.text.append(data.replace("\u00a0", " "))
            if self.open[-1] == "pre":
                self.preformatted.append(data)

    @property
    def words(self):
        return " ".join(" ".join(self.text).split())


def picture(_frame, kind, *, sensor, function, person=None):
    assert sensor == "default"
    assert (function is None) == (kind not in (PictureKind.OVERLAY, PictureKind.ERRORS))
    assert (person is None) == (kind is not PictureKind.ERRORS)
    return PICTURE


@pytest.fixture(scope="module")
def source(dropping_table):
    analysis = analyze(dropping_table, seed=7, spec=SPEC)
    card = FunctionCard("a-net", "ab" * 32, "deeplab", "fp32", "torch", {"licence": "Apache-2.0"})
    provenance = Provenance(
        run_id="run-1", spec_digest="5b1e9f2e0d5c4b7a", seed=7, asset="urban-street", asset_digest="aa12bb34",
        renderer="raster, revision 3", resolution=(960, 540), numeric_classes={"image": "llvmpipe-mesa-22.3.6"},
        functions=(card,), software="valerie 0.1.0", submitted=datetime(2026, 1, 2, 3, 4, tzinfo=UTC),
        finished=datetime(2026, 1, 2, 3, 9, tzinfo=UTC),
    )  # fmt: skip
    return ReportInput(
        document=DOCUMENT,
        provenance=provenance,
        table=dropping_table,
        summary=analysis.summary,
        trends=analysis.trends,
        findings=analysis.findings,
        variants=309,
        frames=902,
        rejections={"person-1 stands inside building-3": 7, "outside the asset": 2},
        failures=(Failure("prediction", "out of memory", 3, 2, "000012-1"),),
        picture=picture,
    )


@pytest.fixture(scope="module")
def brief(source):
    """A report of a few rows: of a page's time, most goes into figures of many."""
    table = EvaluationTable.from_rows(source.table.arrow.to_pylist()[:12], source.table.parameters)
    return analyzed(source, table)


def analyzed(source, table):
    analysis = analyze(table)
    return dataclasses.replace(
        source, table=table, summary=analysis.summary, trends=analysis.trends, findings=analysis.findings
    )


@pytest.fixture(scope="module")
def html(source):
    return build_report(source)


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


def test_the_page_is_well_formed_and_states_its_provenance(page):
    facts = ("First run", "5b1e9f2e0d5c4b7a", "urban-street", "aa12bb34", "raster, revision 3", "llvmpipe-mesa-22.3.6")

    for fact in (*facts, "ab" * 32, "2026-01-02 03:04 UTC", "evidence to support a safety argument"):
        assert fact in page.words


def test_the_page_loads_nothing_from_elsewhere(page, html):
    links = [value for _, key, value in page.attributes if key in {"src", "href", "srcset", "action", "data"}]

    assert links
    assert all(value.startswith(("data:", "#")) for value in links)
    assert "url(" not in html.split("</style>")[0]


def test_only_the_pages_own_scripts_may_run(page):
    (policy,) = [
        value for name, key, value in page.attributes if name == "meta" and key == "content" and "-src" in value
    ]
    run = [text for attributes, text in page.scripts if attributes.get("type") != "application/json"]
    hashes = {f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}" for text in run}

    assert len(run) == 2
    assert set(re.findall(r"sha256-[^']+", policy)) == hashes
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy
    assert not [key for _, key, _ in page.attributes if key.startswith("on")]


def test_names_from_outside_cannot_become_markup(brief):
    evil = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    rows = brief.table.arrow.to_pylist()
    rows = [{**row, "function": evil if row["function"] == "a-net" else "b-net"} for row in rows]
    rows = [{**row, "character": f"{evil}%{{x}}", "frame_id": row["frame_id"] + evil} for row in rows]
    named = dataclasses.replace(
        analyzed(brief, EvaluationTable.from_rows(rows, brief.table.parameters)),
        document={"name": evil},
        rejections={evil: 1},
        failures=(Failure(evil, evil, 1),),
    )
    page = Page(build_report(named))

    assert len(page.scripts) == 3
    assert not [key for _, key, _ in page.attributes if key == "onerror"]
    assert evil in page.words
    hover = json.loads(page.scripts[0][1])[0]["data"][0]["hovertemplate"]
    assert "<script" not in hover
    assert "%{x}" not in hover.split("<br>")[0]


def test_every_number_of_the_summary_is_in_a_table(source, page):
    for row in source.summary.rows:
        for value in (row.pacc_mean, row.pacc_pooled, row.precision_pooled, row.iou_mean, row.detection_rate):
            assert f"{100 * value:.1f}" in page.words
        assert f"{row.detected:,}/{row.defined:,}" in page.words


def test_every_finding_is_listed_with_its_pair_of_pictures_and_its_spec(source, page):
    findings = source.findings
    assert findings.items
    for finding in (*findings.items, *findings.candidates):
        assert finding.sentence in page.words
        assert finding.spec in page.preformatted
        for view in finding.examples[0] if finding.examples else ():
            assert f"pACC {100 * view.pacc:.1f} %" in page.words
            assert f"frame {view.frame_id}" in page.words
    assert f"{findings.comparisons:,} comparisons searched" in page.words


def test_the_caption_names_those_without_a_trend(source):
    def level(trend):
        shape = Shape.LEVEL if trend.character == "all" else Shape.FALLING
        return dataclasses.replace(trend, curve=dataclasses.replace(trend.curve, shape=shape))

    trends = dataclasses.replace(source.trends, items=tuple(map(level, source.trends.items)))
    page = Page(build_report(dataclasses.replace(source, trends=trends)))
    assert "no trend is shown for all together: no curve predicts other places clearly better than" in page.words


def test_candidates_are_numbered_after_the_findings(source):
    findings = dataclasses.replace(source.findings, candidates=source.findings.items[:1])
    page = Page(build_report(dataclasses.replace(source, findings=findings)))
    assert ("ol", "start", str(len(findings.items) + 1)) in page.attributes


def test_findings_come_first_then_limits_and_provenance_is_folded(source, page, html):
    parts = (source.findings.items[0].sentence, "Means apply only to the listed variants", "Pedestrian Frames")
    order = [page.words.index(part) for part in parts]

    assert order == sorted(order)
    assert html.index("<details><summary>Run, digests, versions") < html.index("5b1e9f2e0d5c4b7a")


def test_everything_that_varied_has_its_figure_and_the_strongest_pair_a_map(source, page):
    for means in level_means(source.table):
        for level, cells in means.rows:
            assert " ".join([level, *(f"{100 * cell.mean:.1f} {cell.n:,}" for cell in cells)]) in page.words
    assert [means.down for means in level_means(source.table)] == [
        "person-1.pos.x", "person-1.pos.y", "person-1.character", "camera"
    ]  # fmt: skip
    (down,) = {means.down for means in strongest_pair(source.table).values()}
    assert f"{down} ↓" in page.words
    assert (
        len([value for name, key, value in page.attributes if (name, key) == ("table", "class") and value == "heat"])
        == 2 + 6  # and pACC over pixel area and occlusion: two functions, two pedestrians and both together
    )


def test_the_account_of_frames_adds_up(page):
    assert "rejected before rendering 9 7 × person-1 stands inside building-3; 2 × outside the asset" in page.words
    assert "Frames planned 902 of 300 variants" in page.words
    assert "evaluated by at least one function 900" in page.words
    assert "without any evaluation 2 failed or cancelled" in page.words
    assert "prediction out of memory 2 3 000012-1" in page.words


def test_each_plot_has_a_static_picture_and_its_figure(page):
    figures = json.loads(page.scripts[0][1])
    static = [value for name, key, value in page.attributes if (name, key, value) == ("img", "class", "static")]
    numbers = [int(value) for _, key, value in page.attributes if key == "data-figure"]

    assert numbers == list(range(6))  # three axes, two functions
    assert len(figures) == len(static) == 6


def test_the_spec_can_be_copied_out_and_run_again(page):
    text = page.preformatted[-1]
    assert yaml.safe_load(text) == DOCUMENT


def test_the_gallery_shows_picture_truth_and_each_prediction(page):
    shown = [value for name, key, value in page.attributes if (name, key) == ("img", "src") and "jpeg" in value]

    assert "Worst in plain sight" in page.words
    assert len(shown) % 2 == 0
    assert base64.b64decode(shown[0].split(",")[1]) == PICTURE


def test_a_picture_that_is_gone_is_marked(brief):
    brief = dataclasses.replace(brief, picture=lambda *_, **__: None)
    assert "not stored any more" in Page(build_report(brief)).words


def test_without_pictures_there_is_no_gallery(source):
    words = Page(build_report(dataclasses.replace(source, picture=None))).words
    assert "Worst in plain sight" not in words


def test_equal_input_gives_equal_bytes(source, html):
    assert build_report(source) == html


def test_what_explains_the_score_is_computed_once_for_the_page_and_its_figures(brief, monkeypatch):
    computed = []
    monkeypatch.setattr(model, "explanations", lambda table, *, seed: computed.append((table, seed)) or ())
    fresh = dataclasses.replace(brief)

    build_report(fresh)
    figure_tables(fresh.table, fresh.trends, fresh.explained)

    assert computed == [(brief.table, brief.trends.seed)]


def test_what_explains_the_score_is_told_by_block_and_not_where_places_are_alike(brief, monkeypatch):
    blocks = tuple(BlockShares(number, (Share("camera", 0.1, 0.2),)) for number in (1, 2))
    explained = Explanation("a-net", blocks, (Importance("distance_m", 0.1, 0.001, alike=True),))
    monkeypatch.setattr(model, "explanations", lambda table, *, seed: (explained,))
    words = Page(build_report(dataclasses.replace(brief, findings=brief.findings))).words
    for text in ("Set by block 1", "Set by block 2", ALIKE_PLACES):
        assert text in words
    assert "not shown" in words
    assert "0.001" not in words


def test_a_run_without_any_evaluation_still_has_a_report(source):
    words = Page(build_report(analyzed(source, EvaluationTable.from_rows([], source.table.parameters)))).words

    assert "No person was evaluated in this run." in words
    assert "without any evaluation 902" in words
    assert "Nothing to compare" in words


def classes_of(function, iou, judged_by=()):
    """Classes of a function: road on 100 pixels with this IoU, person on 40 pixels with IoU 0.4."""
    road = PooledClass("road", 100, iou, iou, iou)
    return AllClasses(
        function, "default", 3, 0.6, 0.5909, 0.9, (road, PooledClass("person", 40, 0.5, 0.5, 0.4)), judged_by
    )


def with_classes(source, *classes):
    return Page(build_report(dataclasses.replace(source, summary=dataclasses.replace(source.summary, classes=classes))))


def test_the_table_of_classes_has_a_line_per_class_and_both_means(brief):
    words = with_classes(brief, classes_of("net", 0.783)).words

    assert "road 71.43 78.3 person 28.57 40.0 mean of these 59.1 mean of the frames' means 60.0" in words
    assert "judged by" not in words
    assert "All classes" not in with_classes(brief).words


def test_a_class_that_a_function_is_not_judged_by_has_a_dash(brief):
    words = with_classes(brief, classes_of("net", 0.783), classes_of("persons", None, ("person",))).words

    assert "road 71.43 78.3 – person 28.57 40.0 40.0" in words
    assert "persons is judged by person alone." in words


def test_functions_that_were_not_compared_are_named_with_the_reason(brief):
    findings = dataclasses.replace(brief.findings, notes=("a-net and b-net ran in different precisions.",))
    page = Page(build_report(dataclasses.replace(brief, findings=findings)))

    assert "a-net and b-net ran in different precisions." in page.words


def test_the_axes_that_are_plotted_are_defined(page):
    for name in ("distance_m", "occlusion_rate", "pixel_area_percent"):
        assert measure_of(name).description[1:] in page.words


def test_a_per_cent_sign_stays_with_its_number(html):
    body = html[html.index("<body>") : html.index("<script")]
    assert "\u00a0%" in body
    assert not re.search(r"\d %", body)


@pytest.mark.parametrize(
    ("start", "kind"), [(b"\x89PNG\r\n", "png"), (b"\xff\xd8\xff\xe0", "jpeg"), (b"RIFF0000WEBPVP8 ", "webp")]
)
def test_a_picture_states_its_type(start, kind):
    assert data_url(start).startswith(f"data:image/{kind};base64,")


def test_warnings_stand_before_everything_else(brief):
    warning = "12 of 24 pictures are black (frames a, b, c, …)."
    summary = dataclasses.replace(brief.summary, warnings=(warning,))
    page = build_report(dataclasses.replace(brief, summary=summary))
    main = page[page.index("<main>") :]
    assert main.index(warning) < main.index("<section")
    assert Page(page).words.count(warning) == 1


def test_the_register_names_condition_insufficiency_evidence_and_re_test(source, page):
    entries = register(source.findings)
    assert entries
    for entry in entries:
        assert f"{entry.id} {entry.triggering_condition} against {entry.reference_condition}" in page.words
        assert entry.functional_insufficiency in page.words
    assert "It is not a statement of compliance." in page.words


def test_the_domain_lists_levels_holes_pairs_and_what_was_held(source, html):
    assert "Operational design domain" not in Page(html).words
    declared = {"type": "FLOAT", "affects": "geometry", "minimum": 0, "unit": "m", "odd": "vulnerable road users"}
    definitions = [
        ParameterDefinition.model_validate({**declared, "path": "scene.person-1.pos.x", "maximum": 100, "default": 0}),
        ParameterDefinition.model_validate({**declared, "path": "scene.person-1.pos.y", "maximum": 1000, "default": 0}),
        ParameterDefinition.model_validate({**declared, "path": "scene.person-2.pos.x", "maximum": 9, "default": 4}),
    ]
    coverage = odd_coverage(definitions, source.table, {})
    words = Page(build_report(dataclasses.replace(source, odd=coverage))).words
    first, second = coverage.varied
    assert first.holes
    for one in (first, second):
        shown = f"{len(one.levels) - len(one.holes)} of {len(one.levels)}"
        assert f"vulnerable road users dynamic elements {one.parameter} {shown} {'; '.join(one.holes)}".strip() in words
    (pair,) = coverage.pairs
    complete = 0 if pair.holes else 1
    assert f"Of 1 pairs of parameters, {complete} show every pair" in words
    for one, other in pair.holes:
        assert f"{one} with {other}" in words
    assert "Held at one value: 1 parameters vulnerable road users person-2.pos.x 4 m" in words
    assert "No parameter stands for zones, " in words
