"""One self-contained HTML file: it opens offline, asks for nothing, and reads well on paper and without scripts.

The page forbids itself every connection and every script but its own two (Content-Security-Policy with hashes). Plots
are static pictures first; where scripts run, plotly draws the same numbers over them. The markup is in ``templates``.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import orjson
import yaml
from markupsafe import Markup

from valerie.analysis import verdict_text, wording
from valerie.analysis.all_classes import AllClasses
from valerie.analysis.effects import level_means, strongest_pair
from valerie.analysis.examples import Example, choose_examples
from valerie.analysis.findings import Finding
from valerie.analysis.frame_counts import ALL, characters, settings
from valerie.analysis.importance import explanations
from valerie.analysis.panels import make_panel, styles
from valerie.analysis.plots import plotly_figure, static_figure
from valerie.analysis.report_model import PictureKind, ReportInput
from valerie.analysis.summary import Summary
from valerie.analysis.trends import AXES, Trend
from valerie.errors import MissingDependency
from valerie.labels import TRAIN_LABELS
from valerie.measures import Measure, measure_of
from valerie.plain import JsonObject
from valerie.runs.moments import moment_text
from valerie.statistics.intervals import Interval


class _Plot(NamedTuple):
    """One panel of a trend section; ``number`` is its place among the page's figures, as in `Panel` what else is drawn."""

    title: str
    number: int
    picture: str
    drawn: int
    total: int
    contradicted: tuple[str, ...]
    trends: tuple[Trend, ...]


class _ClassRow(NamedTuple):
    """One line of the table of all classes; shares and values are rates."""

    name: str
    share: float | None
    values: tuple[float | None, ...]


def build_report(source: ReportInput) -> str:
    """Write the report.

    Args:
        source: everything that is shown; equal input gives equal bytes.

    Returns:
        A complete HTML document.

    Raises:
        MissingDependency: plotly, matplotlib or scikit-learn is not installed.
    """
    scripts = (_plotly_source(), _own("report.js"))
    figures: list[JsonObject] = []
    names = characters(source.table)
    plots = [(axis, list(_plots(source, axis, figures))) for axis in AXES if _drawn(source, axis)]
    policy = (
        "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
        f"script-src {' '.join(map(_hash, scripts))}"
    )
    return (
        _environment()
        .get_template("report.html.j2")
        .render(
            source=source,
            summary=source.summary,
            findings=source.findings,
            name=str(source.document.get("name") or source.provenance.run_id),
            cameras=len(source.table.codes("camera").names),
            characters=names,
            plots=plots,
            found=[(finding, _pair(source, finding)) for finding in source.findings.items],
            candidates=[(finding, _pair(source, finding)) for finding in source.findings.candidates],
            searched=wording.searched_sentence(source.findings),
            limits=wording.limits(source.summary, source.findings),
            certainty=wording.certainty_sentences(source.summary.rows),
            parameters=level_means(source.table),
            pair=strongest_pair(source.table),
            explanations=explanations(source.table, seed=source.trends.seed),
            examples=list(_examples(source)),
            occlusion=wording.occlusion_sentence(source.summary.occlusion),
            class_rows=_class_rows(source.summary.classes),
            rejected=sum(source.rejections.values()),
            rejections=[
                f"{n:,} × {reason}" for reason, n in sorted(source.rejections.items(), key=lambda i: (-i[1], i[0]))
            ],
            undefined_pacc=_undefined(source.summary),
            spec=yaml.safe_dump(dict(source.document), sort_keys=False, allow_unicode=True, width=100),
            policy=policy,
            style=Markup(_own("report.css")),  # noqa: S704  # the package's own files
            scripts=[Markup(script) for script in scripts],  # noqa: S704
            figures=Markup(orjson.dumps(figures).decode().replace("<", "\\u003c")),  # noqa: S704
            styles=styles(names),
        )
    )


def data_url(data: bytes) -> str:
    """Return a picture file as a data URL; its first bytes tell the type (PNG, JPEG, WebP)."""
    if data.startswith(b"\x89PNG"):
        kind = "png"
    elif data.startswith(b"RIFF") and data[8:12] == b"WEBP":
        kind = "webp"
    else:
        kind = "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("valerie.analysis"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_finalize,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "count": lambda number: f"{number:,}",
        "percent": wording.percent,
        "pedestrian": wording.pedestrian,
        "reasons": wording.reasons_text,
        "classes": wording.classes_text,
        "settled": wording.candidate_text,
        "shade": _shade,
        "verdict_title": verdict_text.title,
        "verdict_sentence": verdict_text.sentence,
        "verdict_notes": verdict_text.notes,
        "sentence": lambda text: f"{text[0].upper()}{text[1:]}.",
    }
    environment.tests["interval_known"] = lambda interval: isinstance(interval, Interval)
    environment.globals |= {
        "labels": lambda rows: wording.setting_labels((row.function, row.sensor) for row in rows),
        "measure_of": measure_of,
        "moment_text": moment_text,
    }
    return environment


def _finalize(value: object) -> object:
    """Keep a per cent sign on the line of its number."""
    return value.replace(" %", "\u00a0%") if isinstance(value, str) and not isinstance(value, Markup) else value


def _drawn(source: ReportInput, axis: Measure) -> bool:
    return any(trend.column == axis.name for trend in source.trends.items)


def _plots(source: ReportInput, axis: Measure, figures: list[JsonObject]) -> Iterator[_Plot]:
    """Draw pACC over one axis for each function and sensor, and add the interactive figures to ``figures``."""
    for (function, sensor), title in wording.setting_labels(settings(source.table)).items():
        panel = make_panel(source.table, source.trends, axis.name, function, sensor, seed=source.trends.seed)
        if panel.total:
            figures.append(plotly_figure(panel))
            trends = source.trends.of(axis.name, function, sensor)
            picture = data_url(static_figure(panel))
            yield _Plot(title, len(figures) - 1, picture, panel.drawn, panel.total, panel.contradicted, trends)


def _examples(source: ReportInput) -> Iterator[tuple[Example, list[tuple[str, str | None]]]]:
    """Yield example frames with (caption, data URL) of their pictures; the URL is None where a picture is gone."""
    if source.picture is None:
        return
    for example in choose_examples(source.table):
        picture = partial(source.picture, example.frame_id, sensor=example.sensor)
        shots = [
            ("picture", picture(PictureKind.PICTURE, function=None)),
            ("truth", picture(PictureKind.TRUTH, function=None)),
        ]
        for function, pacc in sorted(example.pacc.items()):
            caption = f"{function}: pACC {wording.percent(pacc)} %"
            shots.append((caption, picture(PictureKind.PREDICTION, function=function)))
        yield example, [(caption, None if data is None else data_url(data)) for caption, data in shots]


def _pair(source: ReportInput, finding: Finding) -> list[tuple[str, str | None]]:
    """Return (caption, data URL) of the predictions in the two views that differ most, before and after."""
    if source.picture is None or not finding.examples:
        return []
    shots = []
    step = finding.steps[0]
    for level, view in zip((step.before, step.after), finding.examples[0], strict=True):
        data = source.picture(view.frame_id, PictureKind.PREDICTION, sensor=view.sensor, function=view.function)
        caption = f"{step.factor} {level}: pACC {wording.percent(view.pacc)} % · frame {view.frame_id}"
        shots.append((caption, None if data is None else data_url(data)))
    return shots


def _shade(mean: float) -> str:
    """Return the colour of a rate: warm at 0, white at one half, cool at 1 (Okabe and Ito's vermilion and blue)."""
    end = (213, 94, 0) if mean < 0.5 else (0, 114, 178)
    strength = abs(2 * mean - 1) * 0.75
    return "#" + "".join(f"{round(255 + (channel - 255) * strength):02x}" for channel in end)


def _class_rows(classes: Sequence[AllClasses]) -> list[_ClassRow]:
    """Return IoU per class and function from pooled counts, then the two means."""
    pixels = {scores.name: scores.pixels for one in classes for scores in one.classes}
    ious = [{scores.name: scores.iou for scores in one.classes} for one in classes]
    rows = [
        _ClassRow(label.name, pixels[label.name] / sum(pixels.values()), tuple(own.get(label.name) for own in ious))
        for label in TRAIN_LABELS
        if label.name in pixels
    ]
    rows.append(_ClassRow("mean of these", None, tuple(one.miou_pooled for one in classes)))
    rows.append(_ClassRow("mean of the frames' means", None, tuple(one.miou_mean for one in classes)))
    return rows


def _undefined(summary: Summary) -> list[tuple[str, dict[str, int]]]:
    """Return (function and sensor, reason to number) over all pedestrians together."""
    labels = wording.setting_labels((row.function, row.sensor) for row in summary.rows)
    together = any(row.character == ALL for row in summary.rows)
    rows: Iterable[Any] = (row for row in summary.rows if row.character == ALL or not together)
    return [(labels[row.function, row.sensor], row.undefined) for row in rows]


def _own(name: str) -> str:
    return (files("valerie.analysis") / "templates" / name).read_text("utf-8")


def _plotly_source() -> str:
    """Return plotly.js as the installed package carries it; the package itself is not imported."""
    spec = find_spec("plotly")
    if spec is None or spec.origin is None:
        raise MissingDependency("the report needs plotly: install valerie[report]")
    return (Path(spec.origin).parent / "package_data" / "plotly.min.js").read_text("utf-8")


def _hash(script: str) -> str:
    digest = hashlib.sha256(script.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"
