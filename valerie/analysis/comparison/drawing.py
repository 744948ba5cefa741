"""A comparison of versions as tables in a terminal and as one picture."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Final

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from valerie.analysis.comparison.before_after import VersionComparison
from valerie.analysis.comparison.wording import change_sentence, numeric_classes_sentence, undecided_groups
from valerie.analysis.wording import classes_text, for_whom, percent

#: Colours of Okabe and Ito (2008), distinguishable with all common forms of colour blindness.
_COLORS: Final = ("#555555", "#0072B2", "#E69F00", "#009E73", "#CC79A7")
_MARKERS: Final = ("o", "D", "s", "^", "v")
#: Width of the small line above the picture, in characters.
_CHARACTERS: Final = 160


def comparison_renderable(comparison: VersionComparison) -> RenderableType:
    """Return the tables of groups and classes and the lists of changes, for a rich console."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("persons", no_wrap=True)
    headings = ("n", "pACC mean", "pooled", f"≥ {comparison.threshold:g}", "precision", "IoU", "false px")
    for name in headings:
        table.add_column(name, justify="right", no_wrap=True)
    for group in comparison.groups:
        table.add_row(Text(group.name, style="bold"), f"{group.persons:,}")
        for number, (version, side) in enumerate(zip(comparison.versions, group.sides, strict=True)):
            mean = percent(side.pacc_mean)
            if number:
                own = group.differences[number - 1]
                span = "" if own.low is None or own.high is None else f" [{100 * own.low:+.0f}, {100 * own.high:+.0f}]"
                mean += f"  {100 * own.mean:+.1f}{span}" if group.persons else ""
            table.add_row(
                f"  {version}",
                "",
                mean,
                percent(side.pacc_pooled),
                percent(side.detected),
                f"{percent(side.precision_mean)} / {percent(side.precision_pooled)}",
                f"{percent(side.iou_mean)} / {percent(side.iou_pooled)}",
                f"{side.false_pixels:,}",
            )
    classes = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    judged = classes_text(comparison.judged_by) if comparison.judged_by else "no class that all are judged by"
    classes.add_column(f"{judged}: mean / pooled")
    for version in comparison.versions:
        classes.add_column(version, justify="right")
    for name, sides in comparison.overall.items():
        classes.add_row(name, *(f"{percent(mean)} / {percent(pooled)}" for mean, pooled in sides))
    classes.add_section()
    classes.add_row(Text("pooled IoU / recall", style="dim"))
    for name, sides in comparison.classes.items():
        classes.add_row(name, *(f"{percent(iou)} / {percent(recall)}" for iou, recall in sides))
    whole = comparison.groups[0].differences[:1] if comparison.groups else ()
    meant = for_whom(whole[0].estimand) if whole else ""
    note = (
        f"In per cent. Differences of pACC are to the first version: the mean over places with its own 95 % interval"
        f"{meant}. Better and worse are judged over all groups together (false discovery rate 2.5 % each). Precision and "
        "IoU are those of the frames that show the group's persons: mean / pooled. Groups selected by the scores of the first "
        "version favour every later version (regression to the mean)."
    )
    parts: list[RenderableType] = [table, classes, Text(note, style="dim")]
    if comparison.numeric_classes:
        parts.append(Text(numeric_classes_sentence(comparison), style="dim" if comparison.alike else "bold"))
    for number, version in enumerate(comparison.versions[1:], start=1):
        for title, sign in (("better", 1), ("worse", -1)):
            changes = [change_sentence(change) for change in comparison.changes(number) if sign * change.step > 0]
            parts.append(Text(f"\n{version}, {title}:", style="bold"))
            parts += [Text(f"  {line}") for line in changes or [f"nothing is clearly {title}"]]
        if undecided := undecided_groups({group.name: group.differences[number - 1] for group in comparison.groups}):
            parts.append(Text(undecided, style="dim"))
    return Group(*parts)


def draw_comparison(comparison: VersionComparison, path: Path, *, title: str = "") -> None:
    """Draw mean pACC per group and pooled IoU per class, all versions on one line.

    Args:
        comparison: the comparison to draw.
        path: PNG or SVG file to write.
        title: heading of the picture.
    """
    from matplotlib.figure import Figure

    groups = [group for group in comparison.groups if group.persons]
    classes = list(comparison.classes.items())
    rows = max(len(groups), len(classes))
    figure = Figure(figsize=(13, 1.9 + 0.42 * rows), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for place, group in enumerate(groups):
        values = [side.pacc_mean for side in group.sides]
        pooled = [side.pacc_pooled for side in group.sides]
        _line(left, place, values, pooled)
    left.set_yticks(range(len(groups)), [f"{group.name}  (n = {group.persons})" for group in groups])
    left.set_xlabel("pACC of persons, %: filled: frame mean, hollow: pooled")
    for place, (_, sides) in enumerate(classes):
        _line(right, place, [side[0] for side in sides], None)
    right.set_yticks(range(len(classes)), [name for name, _ in classes])
    right.set_xlabel("IoU per class, pooled, %")
    for axes, count in ((left, len(groups)), (right, len(classes))):
        axes.set_xlim(-3, 103)
        axes.set_ylim(count - 0.5, -0.5)
        axes.grid(axis="x", color="#dddddd")
        axes.set_axisbelow(True)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)
    handles = [
        left.plot([], [], marker=_MARKERS[i % 5], color=_COLORS[i % 5], linestyle="none", label=version)[0]
        for i, version in enumerate(comparison.versions)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    left.set_title(fill(numeric_classes_sentence(comparison), _CHARACTERS), loc="left", fontsize=8, color="#555555")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _line(axes: object, place: int, values: list[float | None], pooled: list[float | None] | None) -> None:
    """Draw the values of all versions in one row, joined by a line, each version in its own colour."""
    from matplotlib.axes import Axes

    assert isinstance(axes, Axes)
    known = [100 * value for value in values if value is not None]
    if known:
        axes.plot([min(known), max(known)], [place, place], color="#bbbbbb", linewidth=1.5, zorder=1)
    for number, value in enumerate(values):
        color, marker = _COLORS[number % 5], _MARKERS[number % 5]
        if value is not None:
            axes.scatter(100 * value, place, color=color, marker=marker, s=46, zorder=3)
        hollow = None if pooled is None else pooled[number]
        if hollow is not None:
            axes.scatter(100 * hollow, place, facecolor="none", edgecolor=color, marker=marker, s=46, zorder=2)
