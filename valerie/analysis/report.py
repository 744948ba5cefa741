"""One self-contained HTML file: opens offline, asks for nothing, reads well on paper and without scripts.

The page forbids itself every connection and every script but its own two (Content-Security-Policy with hashes). Plots
are static pictures first; where scripts run, plotly draws the same numbers over them.
"""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import orjson

from valerie.analysis import sections
from valerie.analysis.examples import choose_examples
from valerie.analysis.frame_counts import characters, setting_labels, settings
from valerie.analysis.html import Html, data_url, join, tag
from valerie.analysis.panels import COMBINED_COLOR, Panel, make_panel, styles
from valerie.analysis.plots import plotly_figure, static_figure
from valerie.analysis.reading import READING, STATEMENT
from valerie.analysis.report_model import ReportInput
from valerie.analysis.trends import AXES
from valerie.errors import MissingDependency
from valerie.measures import Measure
from valerie.runs.moments import moment_text


def build_report(source: ReportInput) -> str:
    """Write the report.

    Args:
        source: everything that is shown.

    Returns:
        A complete HTML document.

    Raises:
        MissingDependency: plotly or matplotlib is not installed.
    """
    plotly, script, style = _plotly_source(), _own("report.js"), _own("report.css")
    name = str(source.document.get("name") or source.provenance.run_id)
    figures: list[dict[str, Any]] = []
    body = join(
        _header(source, name),
        tag(
            "main",
            _section("Summary", "summary", _summary(source)),
            _section("Findings", "findings", sections.findings_list(source.findings)),
            [_trend_section(source, axis, figures) for axis in AXES if _has(source, axis)],
            _gallery(source),
            _section(
                "Where every frame went",
                "accounting",
                sections.accounting(
                    variants=source.variants,
                    frames=source.frames,
                    rejections=source.rejections,
                    failures=source.failures,
                    summary=source.summary,
                ),
            ),
            _section("How to read this", "reading", _reading()),
            _section(
                "Provenance",
                "provenance",
                join(sections.provenance_list(source.provenance), sections.spec_text(source.document)),
            ),
        ),
        tag("footer", tag("p", STATEMENT)),
    )
    data = orjson.dumps(figures).decode().replace("<", "\\u003c")
    policy = (
        "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
        f"script-src {_hash(plotly)} {_hash(script)}"
    )
    head = join(
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="referrer", content="no-referrer"),
        tag("link", rel="icon", href="data:,"),
        tag("title", f"{name} · VALERIE report"),
        tag("style", Html(style)),
    )
    scripts = join(
        tag("script", Html(data), type="application/json", id="figures"),
        tag("script", Html(plotly)),
        tag("script", Html(script)),
    )
    page = tag("html", tag("head", head), tag("body", body, scripts), lang="en")
    return f"<!DOCTYPE html>\n{page}\n"


def _header(source: ReportInput, name: str) -> Html:
    facts, summary = source.provenance, source.summary
    functions = len({row.function for row in summary.rows}) or len(facts.functions)
    cameras = len(source.table.codes("camera").names)
    finished = "still running" if facts.finished is None else f"finished {moment_text(facts.finished)}"
    lead = (
        f"{summary.frames:,} frames from {cameras} camera{'s' if cameras != 1 else ''}, seen by {functions} "
        f"function{'s' if functions != 1 else ''}; {finished}."
    )
    links = [("summary", "Summary"), ("findings", "Findings")]
    links += [(axis.name, axis.title.capitalize()) for axis in AXES if _has(source, axis)]
    if source.picture is not None:
        links.append(("examples", "Examples"))
    links += [("accounting", "Frames"), ("reading", "Reading"), ("provenance", "Provenance")]
    cells = [
        ("Asset", facts.asset),
        ("Renderer", facts.renderer),
        ("Resolution", f"{facts.resolution[0]} × {facts.resolution[1]}"),
        ("Seed", str(facts.seed)),
        ("Spec digest", facts.spec_digest),
        ("Functions", ", ".join(card.name for card in facts.functions)),
    ]
    return tag(
        "header",
        tag("p", "VALERIE validation report", class_="kicker"),
        tag("h1", name),
        tag("p", lead, class_="lead"),
        tag("dl", [tag("div", tag("dt", key), tag("dd", value)) for key, value in cells], class_="card"),
        tag("p", STATEMENT, class_="statement"),
        tag("nav", [tag("a", text, href=f"#{anchor}") for anchor, text in links], aria_label="Sections"),
    )


def _summary(source: ReportInput) -> Html:
    summary = source.summary
    if not summary.rows:
        return tag("p", "No person was evaluated in this run.")
    return join(
        sections.summary_table(summary),
        sections.occlusion_note(summary.occlusion),
        sections.empty_table(summary.empty),
        sections.classes_table(summary.classes),
    )


def _has(source: ReportInput, axis: Measure) -> bool:
    return any(trend.column == axis.name for trend in source.trends.items)


def _trend_section(source: ReportInput, axis: Measure, figures: list[dict[str, Any]]) -> Html:
    cells = []
    for (function, sensor), title in setting_labels(settings(source.table)).items():
        panel = make_panel(source.table, source.trends, axis.name, function, sensor, seed=source.trends.seed)
        if not panel.total:
            continue
        trends = source.trends.of(axis.name, function, sensor)
        cells.append(
            tag(
                "figure",
                tag("figcaption", title, _share(panel)),
                _plot(panel, title, figures),
                sections.bins_table(trends, source.trends.threshold),
                class_="panel",
            )
        )
    title = f"pACC over {axis.title}"
    return _section(title, axis.name, join(_legend(source), tag("div", cells, class_="panels")))


def _share(panel: Panel) -> Html:
    text = f"n = {panel.total:,}" if panel.drawn == panel.total else f"n = {panel.total:,}, {panel.drawn:,} drawn"
    return tag("span", f" {text}", class_="interval")


def _plot(panel: Panel, title: str, figures: list[dict[str, Any]]) -> Html:
    figures.append(plotly_figure(panel))
    picture = tag(
        "img", src=data_url(static_figure(panel)), alt=f"{title}: pACC over {panel.axis.title}", class_="static"
    )
    return tag("div", picture, tag("div", class_="live"), class_="plot", data_figure=len(figures) - 1)


def _legend(source: ReportInput) -> Html:
    names = characters(source.table)
    found = styles(names)
    entries = [_key(name, _line(found[name].color, 2), _dot(found[name].color)) for name in names]
    if len(names) > 1:
        entries.append(_key("all together", _line(COMBINED_COLOR, 3)))
    entries.append(_key("mean of a bin", _whisker(COMBINED_COLOR)))
    text = "curve: polynomial, degree by cross-validation · band and whiskers: 95 %"
    return tag("p", entries, tag("span", text, class_="interval"), class_="legend")


def _key(text: str, *marks: Html) -> Html:
    return tag("span", tag("svg", marks, viewBox="0 0 26 14", width=26, height=14, aria_hidden="true"), text)


def _line(color: str, width: int) -> Html:
    return tag("line", x1=1, x2=25, y1=7, y2=7, stroke=color, stroke_width=width)


def _dot(color: str) -> Html:
    return tag("circle", cx=13, cy=7, r=3.4, fill=color)


def _whisker(color: str) -> Html:
    line = tag("line", x1=13, x2=13, y1=0, y2=14, stroke=color, stroke_width=1.6)
    return join(line, tag("rect", x=9.8, y=3.8, width=6.4, height=6.4, fill="#fff", stroke=color, stroke_width=1.6))


def _gallery(source: ReportInput) -> Html:
    if source.picture is None:
        return Html("")
    examples = choose_examples(source.table)
    if not examples:
        return Html("")
    functions = [function for function, _ in settings(source.table)]
    shown = sections.gallery(examples, list(dict.fromkeys(functions)), source.picture)
    return _section("Examples", "examples", shown)


def _reading() -> Html:
    return tag("dl", [join(tag("dt", term), tag("dd", text)) for term, text in READING], class_="facts")


def _section(title: str, anchor: str, content: Html) -> Html:
    return tag("section", tag("h2", title), content, id=anchor)


def _own(name: str) -> str:
    return (files("valerie.analysis") / name).read_text("utf-8")


def _plotly_source() -> str:
    """plotly.js as the installed package carries it; the package itself is not imported."""
    spec = find_spec("plotly")
    if spec is None or spec.origin is None:
        raise MissingDependency("the report needs plotly: install valerie[report]")
    return (Path(spec.origin).parent / "package_data" / "plotly.min.js").read_text("utf-8")


def _hash(script: str) -> str:
    digest = hashlib.sha256(script.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"
