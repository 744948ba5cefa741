"""The measure of a study: a statistic over the rows of one variant, converted to a score between 0 and 1.

    min(pacc) >= 0.5
    max(iou) <= 0.9
    mean(iou) >= 0.6
    share(pacc >= 0.5) >= 95 %
    quantile(pacc, 0.1) >= 0.3

The last three are the statistics of requirements (`valerie.runs.statistic`). Rows without a value do not count; a variant
without any row that counts has no score.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from valerie.errors import InvalidInput, UnknownName
from valerie.runs.statistic import Statistic, parse_statistic

_EXTREME: Final = re.compile(r"\s*(min|max)\s*\((\s*[A-Za-z_]+\s*)\)(.*)", re.DOTALL)
_OVER: Final[dict[str, Callable[..., float]]] = {"min": np.min, "max": np.max, "mean": np.mean}
_OPPOSITE: Final = {">=": "<", "<=": ">"}


@dataclass(frozen=True, slots=True)
class VariantMeasure:
    """A measure.

    Attributes:
        text: the measure as written.
        statistic: statistic of the rows' values.
        over: aggregation of the rows: ``min``, ``max`` or ``mean``.
    """

    text: str
    statistic: Statistic
    over: str

    @property
    def column(self) -> str:
        """The measured column of the long table."""
        return self.statistic.measure.name

    @property
    def at_least(self) -> float:
        """Score below which a variant fails."""
        return self.statistic.at_least

    @property
    def quantity(self) -> str:
        """The bounded quantity of a variant, such as ``min(pacc)``."""
        return self.statistic.quantity if self.over == "mean" else f"{self.over}({self.column})"

    @property
    def missed(self) -> str:
        """The rows that speak against a variant, as an expression: ``pacc < 0.5``."""
        if self.statistic.condition is None:
            return f"{self.column} {_OPPOSITE[self.statistic.sign]} {self.statistic.bound:g}"
        comparison, threshold = self.statistic.condition
        if self.statistic.sign == ">=":
            comparison = _OPPOSITE[comparison]
        return f"{self.column} {comparison} {threshold:g}"

    def score(self, values: ArrayLike) -> float:
        """Return the score of a variant: the higher the better, NaN where it has none.

        Args:
            values: (N,) values of the rows that count; NaN where a row has none.
        """
        rows = np.asarray(values, np.float64)
        rows = rows[~np.isnan(rows)]
        if not len(rows):
            return float("nan")
        if self.over == "mean":
            return float(np.mean(self.statistic.scores(rows)))
        extreme = np.array([_OVER[self.over](rows)])
        return float(self.statistic.scores(extreme)[0])

    def shown(self, score: float) -> float:
        """Return a score as the bounded quantity."""
        return self.statistic.shown(score)


def parse_measure(text: str) -> VariantMeasure:
    """Read a measure.

    Raises:
        InvalidInput, UnknownName: as for `parse_statistic`.
    """
    extreme = _EXTREME.fullmatch(text)
    over, column, rest = ("mean", "", "") if extreme is None else extreme.groups()
    try:
        statistic = parse_statistic(text if extreme is None else f"mean({column}){rest}", field="measure")
    except UnknownName as unknown:
        if unknown.kind != "statistic":
            raise
        raise UnknownName("statistic", unknown.name, (*unknown.known, "min", "max"), field="measure") from None
    except InvalidInput as refused:
        form = "min(pacc) >= 0.5, mean(" if extreme is None else f"{over}("
        limit = str(refused.limit).replace("mean(", form, 1)
        raise InvalidInput(refused.message, field="measure", value=text, limit=limit) from None
    return VariantMeasure(text, statistic, over)
