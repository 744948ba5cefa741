"""The sections of a report, each a function from numbers to markup; tables need no script."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import yaml

from valerie.analysis.all_classes import AllClasses, classes_text
from valerie.analysis.examples import Example
from valerie.analysis.findings import Findings
from valerie.analysis.frame_counts import ALL, setting_labels
from valerie.analysis.html import Html, data_url, join, tag
from valerie.analysis.intervals import Interval
from valerie.analysis.regression import Curve
from valerie.analysis.report_model import Failure, PictureKind, PictureSource, Provenance
from valerie.analysis.summary import OCCLUDED, EmptyFrames, OcclusionShare, Summary, SummaryRow
from valerie.analysis.trends import Trend
from valerie.labels import TRAIN_LABELS
from valerie.measures import measure_of
from valerie.runs.moments import moment_text

DASH: Final = "–"


def percent(value: float | None, digits: int = 1) -> str:
    """A rate as per cent without the sign, for columns that state it; a dash where undefined."""
    return DASH if value is None else f"{100 * value:.{digits}f}"


def summary_table(summary: Summary) -> Html:
    """The table of section 6.2: a block of lines per function, one line per pedestrian."""
    threshold = f"{summary.threshold:g}"
    head = tag(
        "thead",
        tag(
            "tr",
            tag("th", "Pedestrian", scope="col", rowspan=2),
            tag("th", "Frames", scope="col", rowspan=2, class_="number"),
            tag("th", "pACC, %", scope="colgroup", colspan=5, class_="group"),
            tag("th", f"Detected, pACC ≥ {threshold}", scope="colgroup", colspan=2, class_="group"),
            tag("th", "Precision, %", scope="colgroup", colspan=2, class_="group"),
            tag("th", "IoU, %", scope="colgroup", colspan=2, class_="group"),
            tag("th", "Undefined", scope="col", rowspan=2, class_="reasons"),
        ),
        tag(
            "tr",
            [
                tag("th", text, scope="col", class_=kind)
                for text, kind in (
                    ("mean (95 %)", "number"), ("min", "number"), ("max", "number"), ("pooled", "number"),
                    ("0 – 100", ""),
                    ("share (95 %)", "number"), ("n", "number"), ("mean", "number"), ("pooled", "number"),
                    ("mean", "number"), ("pooled", "number"),
                )
            ],
        ),
    )  # fmt: skip
    blocks = []
    for (function, sensor), label in setting_labels((row.function, row.sensor) for row in summary.rows).items():
        lines = [tag("tr", tag("th", label, colspan=14, scope="rowgroup"), class_="block")]
        rows = [row for row in summary.rows if (row.function, row.sensor) == (function, sensor)]
        lines += [_summary_line(row) for row in rows]
        blocks.append(tag("tbody", lines))
    return tag("div", tag("table", head, blocks, class_="summary"), class_="wide")


def _summary_line(row: SummaryRow) -> Html:
    number = {"class_": "number"}
    reasons = ", ".join(f"{count} {reason}" for reason, count in row.undefined.items()) or "none"
    return tag(
        "tr",
        tag("th", _pedestrian(row.character), scope="row"),
        tag("td", f"{row.frames:,}", **number),
        tag("td", tag("b", percent(row.pacc_mean)), _within(row.pacc_mean_interval), **number),
        tag("td", percent(row.pacc_min), **number),
        tag("td", percent(row.pacc_max), **number),
        tag("td", percent(row.pacc_pooled), **number),
        tag("td", _range_picture(row)),
        tag("td", tag("b", percent(row.detection_rate)), _within(row.detection_interval), **number),
        tag("td", f"{row.detected:,}/{row.defined:,}", class_="number quiet"),
        tag("td", percent(row.precision_mean), **number),
        tag("td", percent(row.precision_pooled), **number),
        tag("td", percent(row.iou_mean), **number),
        tag("td", percent(row.iou_pooled), **number),
        tag("td", reasons, class_="reasons" if row.undefined else "reasons quiet"),
        class_="total" if row.character == ALL else None,
    )


def _within(interval: Interval | None) -> Html:
    if interval is None:
        return Html("")
    return tag("span", f" {percent(interval.low)}–{percent(interval.high)}", class_="interval")


def _range_picture(row: SummaryRow) -> Html:
    """Minimum to maximum as a line, the mean's interval as a bar, the mean as a dot; 0 to 100 % from left to right."""
    if row.pacc_mean is None or row.pacc_min is None or row.pacc_max is None:
        return Html("")
    left, right, mean = (round(2 + 96 * value, 2) for value in (row.pacc_min, row.pacc_max, row.pacc_mean))
    parts = [
        tag("line", x1=2, x2=98, y1=8, y2=8, class_="scale"),
        tag("line", x1=left, x2=right, y1=8, y2=8, class_="spread"),
    ]
    if row.pacc_mean_interval is not None:
        low, high = (2 + 96 * value for value in (row.pacc_mean_interval.low, row.pacc_mean_interval.high))
        parts.append(tag("rect", x=round(low, 2), y=5, width=round(high - low, 2), height=6, class_="likely"))
    parts.append(tag("circle", cx=mean, cy=8, r=2.6, class_="mean"))
    label = f"from {percent(row.pacc_min)} to {percent(row.pacc_max)} %, mean {percent(row.pacc_mean)} %"
    return tag("svg", parts, viewBox="0 0 100 16", class_="range", role="img", aria_label=label)


def occlusion_note(shares: Sequence[OcclusionShare]) -> Html:
    """How much of the data is occluded, per pedestrian."""
    told = [share for share in shares if share.share is not None]
    if not told:
        return Html("")
    texts = [
        f"{'all' if s.character == ALL else s.character} {percent(s.share)} % ({s.occluded:,} of {s.persons:,})"
        for s in told
    ]
    return tag("p", f"More than {100 * OCCLUDED:g} % occluded: {'; '.join(texts)}.", class_="note")


def empty_table(empty: Sequence[EmptyFrames]) -> Html:
    """Frames without a person: what was called person there."""
    if not empty:
        return Html("")
    rows = [
        (e.function, e.sensor, f"{e.frames:,}", f"{e.with_false_positives:,}", f"{e.false_positive_pixels:,}")
        for e in empty
    ]
    heads = ("Function", "Sensor", "Frames without a person", "with person pixels", "such pixels")
    return join(tag("h3", "Frames without a person"), table(heads, rows, numbers=(2, 3, 4)))


def classes_table(classes: Sequence[AllClasses]) -> Html:
    """IoU of every class from pooled counts, a column per function and sensor setting, the means in the last two lines.

    Where a function is judged by fewer than all classes, a note says by which.
    """
    if not classes:
        return Html("")
    pixels = {c.name: c.pixels for one in classes for c in one.classes}
    whole = max(sum(pixels.values()), 1)
    ious = [{c.name: c.iou for c in one.classes} for one in classes]
    rows = [
        (label.name, percent(pixels[label.name] / whole, 2), *(percent(of.get(label.name)) for of in ious))
        for label in TRAIN_LABELS
        if label.name in pixels
    ]
    rows.append(("mean of these", "", *(percent(one.miou_pooled) for one in classes)))
    rows.append(("mean of the frames' means", "", *(percent(one.miou_mean) for one in classes)))
    names = setting_labels((one.function, one.sensor) for one in classes)
    heads = ("Class", "Share of the pixels, %", *(f"IoU of {name}, %" for name in names.values()))
    partial = {one.function: classes_text(one.judged_by) for one in classes if one.judged_by}
    notes = [f"{name} is judged by {text}." for name, text in partial.items()]
    if notes:
        notes.append("Means are over the classes that a function is judged by; a dash is another one.")
    note = tag("p", " ".join(notes), class_="note") if notes else None
    return join(tag("h3", "All classes"), table(heads, rows, numbers=range(1, len(heads))), note)


def findings_list(findings: Findings) -> Html:
    """The sentences, strongest evidence first, and what was looked at to find them."""
    if not findings.examined:
        few = "Too few persons or situations for any comparison. Vary more parameters, or more values of them."
        return join(tag("p", few), _unpaired_note(findings))
    made = (
        f"{findings.examined} comparisons were made; the intervals hold together with {100 * findings.level:g} % "
        f"confidence (bootstrap over situations, {findings.resamples:,} draws, seed {findings.seed}). "
    )
    if not findings.items:
        none = "None shows an effect that the choice of situations could not explain."
        return join(tag("p", made + none), _unpaired_note(findings))
    items = [
        tag(
            "li",
            finding.sentence,
            tag(
                "span",
                f" {finding.situations:,} situations · {finding.evidence:.1f} standard errors",
                class_="interval",
            ),
        )
        for finding in findings.items
    ]
    hidden = findings.held - len(findings.items)
    more = f"{hidden} weaker changes along the same axes are not listed. " if hidden else ""
    note = "A difference between bins may have another cause than the axis: nearer pedestrians are also larger."
    listed = tag("ol", items, class_="findings")
    return join(listed, tag("p", made + more + note, class_="note"), _unpaired_note(findings))


def _unpaired_note(findings: Findings) -> Html | None:
    return tag("p", " ".join(findings.unpaired), class_="note") if findings.unpaired else None


def bins_table(trends: Sequence[Trend], threshold: float) -> Html:
    """The binned means of one panel, folded away; a block of lines per pedestrian."""
    shown = [trend for trend in trends if trend.bins]
    if not shown:
        return Html("")
    heads = (measure_of(shown[0].column).unit, "n", "mean pACC, %", "95 %", f"≥ {threshold:g}, %", "95 %")
    head = tag("thead", tag("tr", [tag("th", text, scope="col", class_="number") for text in heads]))
    blocks = []
    for trend in shown:
        scale, curve = measure_of(trend.column).scale, trend.curve
        lines = [
            tag("tr", tag("th", _pedestrian(trend.character), _fit(curve), colspan=6, scope="rowgroup"), class_="block")
        ]
        for b in trend.bins:
            cells = (
                f"{b.low * scale:g}–{b.high * scale:g}",
                f"{b.n:,}",
                percent(b.mean),
                _within(b.mean_interval),
                percent(b.detected / b.n),
                _within(b.detection_interval),
            )
            lines.append(tag("tr", [tag("td", cell, class_="number") for cell in cells]))
        blocks.append(tag("tbody", lines))
    numbers = tag("div", tag("table", head, blocks, class_="bins"), class_="wide")
    return tag("details", tag("summary", "Numbers: bins and curves"), numbers)


def _fit(curve: Curve | None) -> Html:
    if curve is None:
        return tag("span", " no curve: too few situations", class_="interval")
    text = f" curve: degree {curve.degree}, residual {percent(curve.rmse)} points, {curve.situations:,} situations"
    return tag("span", text, class_="interval")


def _pedestrian(character: str) -> str:
    return "all together" if character == ALL else character


def gallery(examples: Sequence[Example], functions: Sequence[str], picture: PictureSource) -> Html:
    """Example frames: the picture, the truth, and what each function made of it."""
    figures = []
    for example in examples:
        shots = [("picture", PictureKind.PICTURE, None), ("truth", PictureKind.TRUTH, None)]
        cells = [_shot(example, picture, kind, function, caption) for caption, kind, function in shots]
        for function in functions:
            if function in example.pacc:
                caption = f"{function}: pACC {percent(example.pacc[function])} %"
                cells.append(_shot(example, picture, PictureKind.PREDICTION, function, caption))
        facts = [example.character, example.camera, f"frame {example.frame_id}"]
        if example.time_s is not None:
            facts.append(f"at {example.time_s:g} s")
        if example.distance_m is not None:
            facts.append(f"{example.distance_m:.1f} m")
        if example.occlusion_rate is not None:
            facts.append(f"{percent(example.occlusion_rate)} % occluded")
        if example.pixel_area_percent is not None:
            facts.append(f"{example.pixel_area_percent:.3f} % of the image")
        figures.append(
            tag(
                "section",
                tag("h3", example.title),
                tag("p", " · ".join(fact for fact in facts if fact), class_="note"),
                tag("div", cells, class_="shots"),
                class_="example",
            )
        )
    return join(figures)


def _shot(example: Example, picture: PictureSource, kind: PictureKind, function: str | None, caption: str) -> Html:
    data = picture(example.frame_id, kind, sensor=example.sensor, function=function)
    shown = (
        tag("div", "not stored any more", class_="missing")
        if data is None
        else tag("img", src=data_url(data), alt=f"{caption}, frame {example.frame_id}")
    )
    return tag("figure", shown, tag("figcaption", caption))


def accounting(
    *, variants: int, frames: int, rejections: Mapping[str, int], failures: Sequence[Failure], summary: Summary
) -> Html:
    """Where every variant and every frame went; nothing is missing without a reason."""
    rejected = sum(rejections.values())
    lost = frames - summary.frames
    rows = [
        ("Variants of the space", f"{variants:,}", ""),
        ("rejected before rendering", f"{rejected:,}", "; ".join(f"{n:,} × {r}" for r, n in _most_first(rejections))),
        ("Frames planned", f"{frames:,}", f"of {variants - rejected:,} variants"),
        ("evaluated by at least one function", f"{summary.frames:,}", ""),
        ("without any evaluation", f"{lost:,}", "failed or cancelled: see failures" if lost else ""),
    ]
    labels = setting_labels((row.function, row.sensor) for row in summary.rows)
    for row in summary.rows:
        if row.character == ALL or not any(r.character == ALL for r in summary.rows):
            reasons = "; ".join(f"{count:,} × {reason}" for reason, count in row.undefined.items())
            what = f"{labels[row.function, row.sensor]}: pACC undefined"
            rows.append((what, f"{sum(row.undefined.values()):,}", reasons))
    parts = [table(("", "Number", "Why"), rows, numbers=(1,))]
    if failures:
        heads = ("Stage", "Error", "Products", "Attempts", "For example")
        listed = [(f.stage, f.error, f"{f.count:,}", str(f.attempts), f.example) for f in failures]
        parts += [tag("h3", "Failures"), table(heads, listed, numbers=(2, 3))]
    else:
        parts.append(tag("p", "Nothing failed for good.", class_="note"))
    return join(parts)


def provenance_list(facts: Provenance) -> Html:
    """What is needed to make the results again."""
    width, height = facts.resolution
    pairs = [
        ("Run", facts.run_id),
        ("Spec digest", facts.spec_digest),
        ("Seed", str(facts.seed)),
        ("Asset", f"{facts.asset} · {facts.asset_digest}"),
        ("Renderer", facts.renderer),
        ("Resolution", f"{width} × {height}"),
        *((f"Numeric class, {stage}", text) for stage, text in facts.numeric_classes.items()),
        *((f"Function {f.name}", f"{f.architecture} · {f.engine} {f.precision} · {f.digest}") for f in facts.functions),
        *((f"{f.name}: {key}", text) for f in facts.functions for key, text in f.provenance.items()),
        ("Submitted", moment_text(facts.submitted)),
        ("Finished", "not yet" if facts.finished is None else moment_text(facts.finished)),
        ("Software", facts.software),
        *facts.more.items(),
    ]
    return tag("dl", [join(tag("dt", key), tag("dd", value)) for key, value in pairs], class_="facts")


def spec_text(document: Mapping[str, object]) -> Html:
    """The whole spec as YAML: save it as a file and run it again."""
    text = yaml.safe_dump(dict(document), sort_keys=False, allow_unicode=True, width=100)
    return tag("details", tag("summary", "The spec, as YAML"), tag("pre", text))


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: Sequence[int] = ()) -> Html:
    """A plain table; columns in ``numbers`` are set right."""

    def kind(column: int) -> str | None:
        return "number" if column in numbers else None

    head = tag("tr", [tag("th", text, scope="col", class_=kind(i)) for i, text in enumerate(heads)])
    body = [tag("tr", [tag("td", text, class_=kind(i)) for i, text in enumerate(row)]) for row in rows]
    return tag("div", tag("table", tag("thead", head), tag("tbody", body)), class_="wide")


def _most_first(counts: Mapping[str, int]) -> list[tuple[str, int]]:
    return sorted(counts.items(), key=lambda item: (-item[1], item[0]))
