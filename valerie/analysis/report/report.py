"""One self-contained HTML file: it opens offline, loads nothing, and reads well on paper and without scripts.

Its Content-Security-Policy (with hashes) forbids all connections and all scripts but its own two. Plots are static
pictures; where scripts run, plotly draws the same numbers over them. The markup is in ``templates``.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Iterator, Sequence
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import orjson
import yaml
from markupsafe import Markup

from valerie.analysis import wording
from valerie.analysis.claims.published import CrossExample, cross_examples, numbers_beside
from valerie.analysis.claims.text import ledger_notes
from valerie.analysis.comparison.beside import Beside, SharedPerson
from valerie.analysis.comparison.wording import fidelity_sentence
from valerie.analysis.findings.effects import Means, level_means, strongest_pair
from valerie.analysis.findings.findings import Finding
from valerie.analysis.findings.wording import candidate_text, measured_note, searched_sentence
from valerie.analysis.report.distributions import distributions, means_by_occlusion
from valerie.analysis.report.examples import Example, choose_examples
from valerie.analysis.report.in_short import in_short
from valerie.analysis.report.model import ReportInput
from valerie.analysis.report.pages import own_file, page_environment
from valerie.analysis.report.panels import Panel, make_panel, styles
from valerie.analysis.report.plots import plotly_figure, static_figure
from valerie.analysis.report.register import register
from valerie.analysis.report.seeing import seeing
from valerie.analysis.rows.frame_counts import ALL, characters, settings
from valerie.analysis.summary.all_classes import AllClasses
from valerie.analysis.summary.summary import Summary
from valerie.analysis.summary.wording import certainty_sentences, limits, occlusion_sentence
from valerie.analysis.trends.trends import AXES, Trend
from valerie.analysis.verdicts import text as verdict_text
from valerie.errors import MissingDependency
from valerie.labels import TRAIN_LABELS
from valerie.measures import Measure, measure_of
from valerie.plain import JsonObject
from valerie.runs.moments import moment_text
from valerie.runs.products.pictures import PictureKind
from valerie.statistics.intervals import Interval


class _Plot(NamedTuple):
    """One panel of a trend section; ``number`` is its index among the page's figures."""

    title: str
    number: int
    picture: str
    panel: Panel
    trends: tuple[Trend, ...]


class _ClassRow(NamedTuple):
    """One line of the table of all classes; shares and values are rates."""

    name: str
    share: float | None
    values: tuple[float | None, ...]


def build_report(source: ReportInput) -> str:
    """Return the report.

    Args:
        source: its content; equal input gives equal bytes.

    Returns:
        A complete HTML document.

    Raises:
        MissingDependency: plotly, matplotlib or scikit-learn is not installed.
    """
    plotly, script = _plotly_source(), own_file("report.js")
    figures: list[JsonObject] = []
    names = characters(source.table)
    seen = seeing(source.table, threshold=source.summary.threshold)
    plots = [(axis, list(_plots(source, axis, figures))) for axis in AXES if _drawn(source, axis)]
    policy = (
        "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
        f"script-src {_hash(plotly)} {_hash(script)}"
    )
    return (
        _environment()
        .get_template("report.html.j2")
        .render(
            source=source,
            summary=source.summary,
            findings=source.findings,
            name=str(source.document.get("name") or source.provenance.run_id),
            runs=len(source.table.codes("run_id").names),
            cameras=len(source.table.codes("camera").names),
            characters=names,
            plots=plots,
            found=[(finding, _pair(source, finding)) for finding in source.findings.items],
            candidates=[(finding, _pair(source, finding)) for finding in source.findings.candidates],
            searched=searched_sentence(source.findings),
            in_short=in_short(source, seen),
            seeing=seen,
            ledger=source.ledger,
            numbers=() if source.claims is None else numbers_beside(source.claims, source.table),
            crosses=list(_crosses(source)),
            distributions={axis.name: distributions(source.table, axis) for axis in AXES},
            by_occlusion=list(_by_occlusion(source)),
            flips=list(_flips(source, source.beside)),
            limits=limits(source.summary, source.findings),
            register=register(source.findings),
            certainty=certainty_sentences(source.summary),
            parameters=level_means(source.table),
            pair=strongest_pair(source.table),
            explanations=source.explained,
            examples=list(_examples(source)),
            occlusion=occlusion_sentence(source.summary.occlusion),
            class_rows=_class_rows(source.summary.classes),
            rejected=sum(source.rejections.values()),
            rejections=[
                f"{n:,} × {reason}" for reason, n in sorted(source.rejections.items(), key=lambda i: (-i[1], i[0]))
            ],
            undefined_pacc=_undefined(source.summary),
            spec=yaml.safe_dump(dict(source.document), sort_keys=False, allow_unicode=True, width=100),
            policy=policy,
            plotly=Markup(plotly),  # noqa: S704  # the packages' own files
            script=Markup(script),  # noqa: S704
            figures=Markup(orjson.dumps(figures).decode().replace("<", "\\u003c")),  # noqa: S704
            styles=styles(names),
        )
    )


def data_url(data: bytes) -> str:
    """Return a picture file (PNG, JPEG, WebP by its first bytes) as a data URL."""
    if data.startswith(b"\x89PNG"):
        kind = "png"
    elif data.startswith(b"RIFF") and data[8:12] == b"WEBP":
        kind = "webp"
    else:
        kind = "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


@cache
def _environment() -> jinja2.Environment:
    environment = page_environment("valerie.analysis.report", _finalize)
    environment.filters |= {
        "count": lambda number: f"{number:,}",
        "percent": wording.percent,
        "points": wording.points,
        "fidelity_sentence": fidelity_sentence,
        "pedestrian": wording.pedestrian,
        "reasons": wording.reasons_text,
        "classes": wording.classes_text,
        "settled": candidate_text,
        "measured_note": measured_note,
        "ledger_notes": ledger_notes,
        "for_whom": wording.for_whom,
        "population_of_differences": wording.population_of_differences,
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
        "number": _number,
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
            yield _Plot(title, len(figures) - 1, picture, panel, trends)


def _by_occlusion(source: ReportInput) -> Iterator[tuple[str, list[tuple[str, Means]]]]:
    """Yield the heat maps of pACC over pixel area and occlusion: title and maps, that of all pedestrians first."""
    maps = means_by_occlusion(source.table)
    for setting, title in wording.setting_labels(maps).items():
        if maps[setting]:
            yield title, maps[setting]


def _crosses(source: ReportInput) -> Iterator[tuple[CrossExample, list[tuple[str, list[tuple[str, str | None]]]]]]:
    """Yield the examples that a document of claims asks for: each level of ``down`` with its (caption, data URL)."""
    if source.claims is None:
        return
    for example in cross_examples(source.claims, source.table):
        rows: dict[str, list[tuple[str, str | None]]] = {level: [] for level in example.down}
        for view in example.views:
            scores = " · ".join(f"{name} {wording.percent(pacc)} %" for name, pacc in sorted(view.pacc.items()))
            caption = f"{example.cross.across} {view.across}: {scores}"
            rows[view.down].append((caption, _picture(source, view.frame_id, view.sensor, None)))
        yield example, list(rows.items())


def _flips(source: ReportInput, beside: Beside | None) -> Iterator[tuple[str, list[tuple[str, str | None]]]]:
    """Yield the persons in whom two runs differ most: title and (caption, data URL) of both.

    A comparison of another run has no pictures here.
    """
    if beside is None or beside.run_here != source.provenance.run_id:
        return
    for comparison in beside.functions:
        pairs: tuple[tuple[str, SharedPerson], ...] = (
            *(("fell", pair) for pair in comparison.fell),
            *(("rose", pair) for pair in comparison.rose[:1]),
        )
        for word, pair in pairs:
            title = f"{comparison.title}: {word} from {wording.percent(pair.here)} to {wording.percent(pair.there)} %"
            here = _picture(source, pair.frame_here, pair.sensor, pair.function, pair.instance_id)
            there = _picture(source, pair.frame_there, pair.sensor_there, pair.function_there, pair.instance_id)
            yield title, [(f"here · frame {pair.frame_here}", here), (f"there · frame {pair.frame_there}", there)]


def _picture(
    source: ReportInput, frame_id: str, sensor: str, function: str | None, person: int | None = None
) -> str | None:
    """Return the data URL of a picture, of a prediction over it, or of a person from near.

    None if there is none.
    """
    if source.picture is None:
        return None
    of_frame = PictureKind.PICTURE if function is None else PictureKind.OVERLAY
    kind = of_frame if person is None else PictureKind.ERRORS
    data = source.picture(frame_id, kind, sensor=sensor, function=function, person=person)
    return None if data is None else data_url(data)


def _number(column: str, share: bool, value: float | None) -> str:
    """Return a number of a column as text with its unit."""
    if value is None:
        return wording.DASH
    measure = measure_of(column)
    return f"{wording.percent(value, 2)} %" if share or measure.unit == "%" else measure.text(value)


def _examples(source: ReportInput) -> Iterator[tuple[Example, list[tuple[str, str | None]]]]:
    """Yield example frames with (caption, data URL) of their pictures; the URL is None if a picture is gone."""
    if source.picture is None:
        return
    for example in choose_examples(source.table):
        picture = partial(source.picture, example.frame_id, sensor=example.sensor)
        shots = [
            ("picture", picture(PictureKind.PICTURE, function=None)),
            ("truth", picture(PictureKind.TRUTH_OVERLAY, function=None)),
        ]
        for function, pacc in sorted(example.pacc.items()):
            caption = f"{function}: pACC {wording.percent(pacc)} %"
            shots.append((caption, picture(PictureKind.OVERLAY, function=function)))
            near = picture(PictureKind.ERRORS, function=function, person=example.instance_id)
            shots.append((f"{function}, from near", near))
        yield example, [(caption, None if data is None else data_url(data)) for caption, data in shots]


def _pair(source: ReportInput, finding: Finding) -> list[tuple[str, str | None]]:
    """Return (caption, data URL) of the two views that differ most, before and after: the persons from near, then the frames."""
    if source.picture is None or not finding.examples:
        return []
    near, frames = [], []
    step = finding.steps[0]
    for level, view in zip((step.before, step.after), finding.examples[0], strict=True):
        caption = f"{step.factor} {level}: pACC {wording.percent(view.pacc)} %"
        near.append((caption, _picture(source, view.frame_id, view.sensor, view.function, view.instance_id)))
        frames.append((f"frame {view.frame_id}", _picture(source, view.frame_id, view.sensor, view.function)))
    return [*near, *frames]


def _shade(mean: float) -> str:
    """Return the colour of a rate: warm at 0, white at one half, cool at 1 (Okabe and Ito's vermilion and blue)."""
    end = (213, 94, 0) if mean < 0.5 else (0, 114, 178)
    strength = abs(2 * mean - 1) * 0.75
    return "#" + "".join(f"{round(255 + (channel - 255) * strength):02x}" for channel in end)


def _class_rows(classes: Sequence[AllClasses]) -> list[_ClassRow]:
    """Return IoU per class and function from pooled counts, then the two means."""
    pixels = {scores.name: scores.pixels for table in classes for scores in table.classes}
    ious = [{scores.name: scores.iou for scores in table.classes} for table in classes]
    rows = [
        _ClassRow(label.name, pixels[label.name] / sum(pixels.values()), tuple(own.get(label.name) for own in ious))
        for label in TRAIN_LABELS
        if label.name in pixels
    ]
    rows.append(_ClassRow("mean of these", None, tuple(table.miou_pooled for table in classes)))
    rows.append(_ClassRow("mean of the frames' means", None, tuple(table.miou_mean for table in classes)))
    return rows


def _undefined(summary: Summary) -> list[tuple[str, dict[str, int]]]:
    """Return (label of function and sensor, reason to number) over all pedestrians together."""
    labels = wording.setting_labels((row.function, row.sensor) for row in summary.rows)
    together = any(row.character == ALL for row in summary.rows)
    rows: Iterable[Any] = (row for row in summary.rows if row.character == ALL or not together)
    return [(labels[row.function, row.sensor], row.undefined) for row in rows]


def _plotly_source() -> str:
    """Return plotly.js from the installed package without importing the package."""
    spec = find_spec("plotly")
    if spec is None or spec.origin is None:
        raise MissingDependency("the report needs plotly: install valerie[report]")
    return (Path(spec.origin).parent / "package_data" / "plotly.min.js").read_text("utf-8")


def _hash(script: str) -> str:
    digest = hashlib.sha256(script.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"
