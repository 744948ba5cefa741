"""Points, curves and bins of one plot; `valerie.analysis.report.plots` draws them with either library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from valerie.analysis.rows.frame_counts import ALL, Group, characters, rows_of
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.trends.trends import Trends
from valerie.measures import Measure, measure_of
from valerie.statistics.curves import Shape

#: Largest number of drawn points; beyond it a random sample is drawn. Curves and bins always use all points.
MAX_POINTS: Final = 2500
#: Colours that are distinguishable with all common forms of colour blindness (Okabe & Ito 2008) and in grey.
COMBINED_COLOR: Final = "#d55e00"
CHARACTER_COLORS: Final = ("#1b1b1b", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
CHARACTER_SYMBOLS: Final = ("circle", "diamond", "square", "triangle-up", "cross", "star")


@dataclass(frozen=True, slots=True)
class Style:
    """Colour and symbol of a character in every plot of a report; either suffices to identify it."""

    color: str
    symbol: str


@dataclass(frozen=True, slots=True)
class Points:
    """Points of one character: x in displayed units, pACC in per cent, and frame ids."""

    character: str
    style: Style
    x: tuple[float, ...]
    y: tuple[float, ...]
    frames: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Line:
    """A curve with its 95 % band, if it has one, or a dashed polynomial: x in displayed units, pACC in per cent, 0…100."""

    character: str
    style: Style
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    dashed: bool = False


@dataclass(frozen=True, slots=True)
class Mark:
    """Mean of one bin over all characters: mean x, and mean pACC in per cent."""

    x: float
    y: float
    label: str


@dataclass(frozen=True, slots=True)
class Panel:
    """pACC over one axis for one function and sensor setting.

    Attributes:
        axis: measure on the x axis.
        function, sensor: names of the function and of the sensor setting.
        points: points of each character.
        lines: per character, then of all characters together: the curve, then the polynomial if no bin contradicts it.
        marks: means of the bins, over all characters.
        contradicted: characters whose polynomial is not drawn, because bins contradict it.
        level: characters whose curve is a constant, since a rise or a fall does not predict better by more than chance.
        drawn, total: number of drawn points, and of all.
    """

    axis: Measure
    function: str
    sensor: str
    points: tuple[Points, ...]
    lines: tuple[Line, ...]
    marks: tuple[Mark, ...]
    contradicted: tuple[str, ...]
    level: tuple[str, ...]
    drawn: int
    total: int


def styles(names: Sequence[str]) -> dict[str, Style]:
    """Return the style of each character, in the order of ``names``, and of `ALL`."""
    by_name = {
        name: Style(CHARACTER_COLORS[i % len(CHARACTER_COLORS)], CHARACTER_SYMBOLS[i % len(CHARACTER_SYMBOLS)])
        for i, name in enumerate(names)
    }
    return {**by_name, ALL: Style(COMBINED_COLOR, "square-open")}


def make_panel(table: EvaluationTable, trends: Trends, column: str, function: str, sensor: str, *, seed: int) -> Panel:
    """Return one panel.

    Args:
        table: the run's evaluations.
        trends: its trends.
        column: column on the x axis.
        function, sensor: names of the function and of the sensor setting.
        seed: of the sample where there are more than `MAX_POINTS` points.
    """
    axis = measure_of(column)
    names = characters(table)
    style = styles(names)
    x, pacc, frames = table.numbers(column), table.numbers("pacc"), table.arrow["frame_id"]
    usable = rows_of(table, Group(function, sensor, ALL)) & np.isfinite(x) & np.isfinite(pacc)
    total = int(np.count_nonzero(usable))
    chosen = np.flatnonzero(usable)
    if total > MAX_POINTS:
        chosen = np.sort(np.random.default_rng(seed).choice(chosen, MAX_POINTS, replace=False))
    shown = np.zeros(len(table), np.bool_)
    shown[chosen] = True
    points = []
    for name in names:
        rows = np.flatnonzero(shown & rows_of(table, Group(function, sensor, name)))
        xs, ys = np.round(x[rows] * axis.scale, 4), np.round(pacc[rows] * 100, 2)
        ids = tuple(frames.take(rows).to_pylist())
        points.append(Points(name, style[name], tuple(xs.tolist()), tuple(ys.tolist()), ids))
    lines: list[Line] = []
    marks: list[Mark] = []
    contradicted, level = [], []
    for trend in trends.of(column, function, sensor):
        own = trend.character, style[trend.character]
        if trend.curve is not None:
            curve = trend.curve
            if curve.shape is Shape.LEVEL:
                level.append(trend.character)
            y, low, high = map(_per_cent, (curve.y, curve.low, curve.high))
            lines.append(Line(*own, _shown(curve.x, axis.scale), y, low, high))
        if trend.polynomial is not None:
            if trend.polynomial.contradicted:
                contradicted.append(trend.character)
            else:
                lines.append(
                    Line(*own, _shown(trend.polynomial.x, axis.scale), _per_cent(trend.polynomial.y), dashed=True)
                )
        if trend.character == ALL or len(names) == 1:
            marks = [
                Mark(b.x * axis.scale, b.mean * 100, f"{axis.range_text(b.low, b.high)}: n = {b.n}") for b in trend.bins
            ]
    return Panel(
        axis,
        function,
        sensor,
        tuple(points),
        tuple(lines),
        tuple(marks),
        tuple(contradicted),
        tuple(level),
        len(chosen),
        total,
    )


def _shown(x: Sequence[float], scale: float) -> tuple[float, ...]:
    return tuple(np.round(np.array(x) * scale, 4).tolist())


def _per_cent(y: Sequence[float]) -> tuple[float, ...]:
    return tuple(np.round(np.clip(np.array(y) * 100, 0, 100), 4).tolist())
