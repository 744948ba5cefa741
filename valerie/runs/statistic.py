"""The statistic that a requirement bounds: a mean, a share or a quantile of a score.

    mean(pacc) >= 0.8
    share(pacc >= 0.5) >= 95 %
    quantile(iou, 0.05) >= 0.3
    quantile(fp, 0.99) <= 200

Every statistic becomes a lower bound on the mean of scores between 0 and 1, which `valerie.statistics.verdicts` judges.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput, UnknownName
from valerie.measures import Measure, Source, measures_from
from valerie.parameters.quantities import to_unit

#: Name to measure of the scores that a requirement may bound.
SCORES: Final = {measure.name: measure for measure in measures_from(Source.PERSON_SCORE, Source.FRAME_SCORE)}
_FORMS: Final = "mean(pacc) >= 0.8, share(pacc >= 0.5) >= 95 %, or quantile(pacc, 0.05) >= 0.3; also with <="
_SIGN: Final = r"(>=|<=|≥|≤)"
_NUMBER: Final = r"([0-9.eE+\-]+\s*%?)"
_STATISTIC: Final = re.compile(rf"\s*([a-z]+)\s*\(([^()]*)\)\s*{_SIGN}\s*{_NUMBER}\s*")
_CONDITION: Final = re.compile(rf"\s*([A-Za-z_]+)\s*{_SIGN}\s*{_NUMBER}\s*")
_ORDER: Final = re.compile(rf"\s*([A-Za-z_]+)\s*,\s*{_NUMBER}\s*")
_SPELLED: Final = {"≥": ">=", "≤": "<="}
_COMPARE: Final[dict[str, Callable[[Any, Any], Any]]] = {">=": operator.ge, "<=": operator.le}


@dataclass(frozen=True, slots=True)
class Statistic:
    """A mean or a share, and its bound; a quantile reaches t where the share of values on that side of t does.

    Attributes:
        measure: the score.
        condition: (comparison, threshold) that the values of a share have to meet; None: the mean of the values.
        sign: ``>=`` or ``<=``.
        bound: bound of the mean or share, 0…1.
    """

    measure: Measure
    condition: tuple[str, float] | None
    sign: str
    bound: float

    @property
    def quantity(self) -> str:
        """The bounded quantity, such as ``share(pacc >= 0.5)``."""
        if self.condition is None:
            return f"mean({self.measure.name})"
        comparison, threshold = self.condition
        return f"share({self.measure.name} {comparison} {threshold:g})"

    @property
    def of_persons(self) -> bool:
        """True for a score of a person, False for one of a whole frame."""
        return self.measure.source is Source.PERSON_SCORE

    @property
    def at_least(self) -> float:
        """Lower bound of the mean of `scores`."""
        return self.bound if self.sign == ">=" else float(1 - Decimal(repr(self.bound)))

    def scores(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N,) scores between 0 and 1 of (N,) values: higher is better; NaN stays NaN."""
        scores = values
        if self.condition is not None:
            comparison, threshold = self.condition
            scores = np.where(np.isnan(values), np.nan, _COMPARE[comparison](values, threshold))
        return scores if self.sign == ">=" else 1 - scores

    def shown(self, mean: float) -> float:
        """Return a mean of scores as the quantity that is bounded."""
        return mean if self.sign == ">=" else 1 - mean


def parse_statistic(text: str, *, field: str = "") -> Statistic:
    """Read a statistic.

    Args:
        text: in the grammar above.
        field: place of the text, for errors.

    Raises:
        InvalidInput: the text has none of the forms, or a number is out of bounds.
        UnknownName: there is no such statistic or score.
    """
    parts = _STATISTIC.fullmatch(text)
    if parts is None:
        raise InvalidInput("not a statistic with a bound", field=field, value=text, limit=_FORMS)
    name, inside, sign, number = parts.groups()
    sign, bound = _SPELLED.get(sign, sign), _number(number, text, field)
    if name == "mean":
        measure = _score(inside.strip(), field)
        if (measure.low, measure.high) != (0.0, 1.0):
            rates = ", ".join(score.name for score in SCORES.values() if (score.low, score.high) == (0.0, 1.0))
            raise InvalidInput(
                "a mean is bounded for scores from 0 to 1; bound a share or a quantile", field=field,
                value=measure.name, limit=rates,
            )  # fmt: skip
        return Statistic(measure, None, sign, _within(bound, text, field))
    if name == "share":
        condition = _CONDITION.fullmatch(inside)
        if condition is None:
            raise InvalidInput("a share is of a comparison", field=field, value=text, limit=_FORMS)
        score, comparison, threshold = condition.groups()
        comparison = _SPELLED.get(comparison, comparison)
        return Statistic(
            _score(score, field), (comparison, _number(threshold, text, field)), sign, _within(bound, text, field)
        )
    if name == "quantile":
        order = _ORDER.fullmatch(inside)
        if order is None:
            raise InvalidInput("a quantile has a score and an order", field=field, value=text, limit=_FORMS)
        part = _within(_number(order[2], text, field), text, field)
        share = part if sign == "<=" else float(1 - Decimal(repr(part)))
        return Statistic(_score(order[1], field), (sign, bound), ">=", _within(share, text, field))
    raise UnknownName("statistic", name, ("mean", "share", "quantile"), field=field, limit=_FORMS)


def _score(name: str, field: str) -> Measure:
    if name not in SCORES:
        raise UnknownName("score", name, SCORES, field=field)
    return SCORES[name]


def _number(written: str, text: str, field: str) -> float:
    try:
        return to_unit(written.strip(), "", field=field).number
    except InvalidInput:
        raise InvalidInput(f"{written.strip()!r} is not a number", field=field, value=text, limit=_FORMS) from None


def _within(bound: float, text: str, field: str) -> float:
    if not 0 <= bound <= 1:
        raise InvalidInput(
            "the bound of a rate lies between 0 and 1", field=field, value=text, limit="0 … 1, or 0 … 100 %"
        )
    return bound
