"""The numbers of a report's figures, a table each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

import pyarrow as pa

from valerie.analysis.findings.effects import Means, level_means, strongest_pair
from valerie.analysis.findings.importance import Explanation
from valerie.analysis.report.distributions import QUANTILES, Distribution, distributions, means_by_occlusion
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.trends.trends import AXES, Trend, Trends
from valerie.measures import Measure

#: Rows of a table before they become columns; values are numbers, texts or None.
_Rows = Iterable[dict[str, Any]]


def figure_tables(table: EvaluationTable, trends: Trends, explained: Sequence[Explanation]) -> dict[str, pa.Table]:
    """Return the numbers of all figures by name; figures without any are left out.

    Points are a sample of the long table, which `valerie rows` writes. Rates are in 0…1, other columns in their own unit.

    Args:
        table: the run's evaluations.
        trends: its trends.
        explained: what explains its scores.
    """
    spreads = [(axis, distributions(table, axis)) for axis in AXES]
    figures: dict[str, _Rows] = {
        "bins": (_of(trend) | asdict(part) for trend in trends.items for part in trend.bins),
        "curves": (row for trend in trends.items for row in _curves(trend)),
        "distributions": (row for axis, spread in spreads for one in spread for row in _bins(axis, one)),
        "quantiles": (row for axis, spread in spreads for one in spread for row in _quantiles(axis, one)),
        "levels": (row for means in level_means(table) for row in _cells(means)),
        "strongest-pair": (
            {"function": function} | row for function, means in strongest_pair(table).items() for row in _cells(means)
        ),
        "area-by-occlusion": (
            {"function": function, "sensor": sensor, "character": character} | row
            for (function, sensor), maps in means_by_occlusion(table).items()
            for character, means in maps
            for row in _cells(means)
        ),
        "set-factors": (
            {"function": one.function, "block": part.block} | asdict(share)
            for one in explained
            for part in one.blocks
            for share in part.shares
        ),
        "measured-quantities": (
            {"function": one.function} | asdict(measured) for one in explained for measured in one.measured
        ),
    }
    rows = {name: list(own) for name, own in figures.items()}
    return {name: pa.Table.from_pylist(own) for name, own in rows.items() if own}


def _of(trend: Trend) -> dict[str, Any]:
    return {
        "column": trend.column, "function": trend.function, "sensor": trend.sensor, "character": trend.character,
    }  # fmt: skip


def _curves(trend: Trend) -> Iterator[dict[str, Any]]:
    """Yield the points of the curve with its band, and of the polynomial if the report draws it."""
    if (curve := trend.curve) is not None:
        none = (None,) * len(curve.x)
        for x, y, low, high in zip(curve.x, curve.y, curve.low or none, curve.high or none, strict=True):
            yield _of(trend) | {"line": "curve", "x": x, "pacc": y, "low": low, "high": high}
    if (polynomial := trend.polynomial) is not None and not polynomial.contradicted:
        for x, y in zip(polynomial.x, polynomial.y, strict=True):
            yield _of(trend) | {"line": "polynomial", "x": x, "pacc": y, "low": None, "high": None}


def _bins(axis: Measure, one: Distribution) -> Iterator[dict[str, Any]]:
    for low, high, persons in one.bins:
        yield {"column": axis.name, "character": one.character, "low": low, "high": high, "persons": persons}


def _quantiles(axis: Measure, one: Distribution) -> Iterator[dict[str, Any]]:
    for order, value in zip((0.0, *QUANTILES, 1.0), (one.low, *one.quantiles, one.high), strict=True):
        yield {"column": axis.name, "character": one.character, "order": order, "value": value}


def _cells(means: Means) -> Iterator[dict[str, Any]]:
    for level, cells in means.rows:
        for column, cell in zip(means.columns, cells, strict=True):
            yield {
                "factor": means.down, "level": level, "by": means.across, "by_level": column,
                "persons": cell.n, "pacc": cell.mean,
            }  # fmt: skip
