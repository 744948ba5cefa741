"""Regions of weakness: bounds on measures and parameters that contain the frames in which a function is weak.

A selection of rows (`valerie.runs.resolving.where`) becomes bounds on those quantities that the selection *narrows*. A
quantity that varies as widely within the selection as in the run is not part of the weakness and stays free. Bounds cover
the middle of the selected rows, so that a few outliers do not widen the region.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from valerie.document import Document
from valerie.errors import InvalidInput
from valerie.measures import Row
from valerie.parameters.definitions import TURN, ParameterType

#: Share of the selected rows within the bounds of one quantity.
_COVERED: Final = 0.9
#: Widest bounds of a quantity in the region, as a share of the run's range.
_NARROWER: Final = 0.8


class Range(Document):
    """Numbers from ``low`` to ``high``, both included."""

    kind: Literal["range"] = "range"
    low: float
    high: float

    def holds(self, value: Any) -> bool:
        return value is not None and self.low <= float(value) <= self.high

    def __str__(self) -> str:
        return f"{self.low:g} … {self.high:g}"


class Arc(Document):
    """Angles from ``start`` counter-clockwise over ``width``, in degrees."""

    kind: Literal["arc"] = "arc"
    start: Annotated[float, Field(ge=0, lt=TURN)]
    width: Annotated[float, Field(ge=0, le=TURN)]

    def holds(self, value: Any) -> bool:
        return value is not None and (float(value) - self.start) % TURN <= self.width

    def __str__(self) -> str:
        return f"{self.start:g}° … {(self.start + self.width) % TURN:g}°"


class Choices(Document):
    """Names of a CATEGORICAL or BOOL quantity."""

    kind: Literal["choices"] = "choices"
    names: tuple[str, ...]

    def holds(self, value: Any) -> bool:
        return value in self.names

    def __str__(self) -> str:
        return ", ".join(self.names)


Bound = Annotated[Range | Arc | Choices, Field(discriminator="kind")]


class Region(Document):
    """A region; without bounds, everything is inside.

    Attributes:
        bounds: name of the quantity to its bound.
        rows: number of rows that the bounds were taken from.
    """

    bounds: dict[str, Bound] = Field(default={})
    rows: int = 0

    def holds(self, values: Row) -> bool:
        """Return True if all bounds hold; a missing quantity is outside."""
        return all(bound.holds(values.get(name)) for name, bound in self.bounds.items())

    def allows(self, values: Row) -> bool:
        """Return True if the bounds hold for the quantities in ``values``; the others are not measured yet."""
        return all(bound.holds(values[name]) for name, bound in self.bounds.items() if name in values)

    def __str__(self) -> str:
        return "; ".join(f"{name} {bound}" for name, bound in self.bounds.items()) or "everything"


def region_of(
    selected: Iterable[Row],
    everything: Iterable[Row],
    quantities: Mapping[str, ParameterType],
) -> Region:
    """Return the region of the selected rows.

    Args:
        selected: the rows that are weak.
        everything: all rows of the run; a bound must be narrower than their range.
        quantities: name to type of the quantities that the region may bound.

    Raises:
        InvalidInput: no row is selected.
    """
    inside, rows = list(selected), list(everything)
    if not inside:
        raise InvalidInput("selects no row of the run", field="where")
    bounds: dict[str, Bound] = {}
    for name, kind in quantities.items():
        some = [row[name] for row in inside if row.get(name) is not None]
        every = [row[name] for row in rows if row.get(name) is not None]
        bound = _bound(some, every, kind) if some else None
        if bound is not None:
            bounds[name] = bound
    return Region(bounds=bounds, rows=len(inside))


def _bound(some: Sequence[Any], every: Sequence[Any], kind: ParameterType) -> Bound | None:
    if kind in (ParameterType.CATEGORICAL, ParameterType.BOOL):
        return _choices([str(value) for value in some], {str(value) for value in every})
    numbers, all_numbers = np.asarray(some, np.float64), np.asarray(every, np.float64)
    if kind is ParameterType.ANGLE:
        return _arc(numbers, all_numbers)
    return _range(numbers, all_numbers)


def _choices(some: Sequence[str], known: set[str]) -> Choices | None:
    """Return the most frequent names that cover the selected rows; None if these are all names."""
    counts = {name: some.count(name) for name in set(some)}
    chosen: list[str] = []
    for name in sorted(counts, key=lambda name: (-counts[name], name)):
        if sum(counts[other] for other in chosen) >= 0.95 * len(some):
            break
        chosen.append(name)
    return Choices(names=tuple(sorted(chosen))) if set(chosen) != known else None


def _range(some: NDArray[np.float64], every: NDArray[np.float64]) -> Range | None:
    tail = (1.0 - _COVERED) / 2
    # Use values that occur, so that the steps of a grid stay whole.
    low, high = (float(x) for x in np.quantile(some, (tail, 1.0 - tail), method="closest_observation"))
    whole = float(every.max() - every.min())
    if high - low > _NARROWER * whole or whole == 0.0:
        return None
    values = np.unique(every)
    below, above = values[values < low], values[values > high]
    # Extend half-way to the next value outside, so that a single step of a grid also has a width.
    margins = [float(low - below[-1]) / 2] if below.size else []
    margins += [float(above[0] - high) / 2] if above.size else []
    margin = max(margins, default=0.0) if low == high else None
    return Range(
        low=low - (float(low - below[-1]) / 2 if below.size else margin or 0.0),
        high=high + (float(above[0] - high) / 2 if above.size else margin or 0.0),
    )


def _arc(some: NDArray[np.float64], every: NDArray[np.float64]) -> Arc | None:
    start, width = _shortest_arc(some, _COVERED)
    _, whole = _shortest_arc(every, 1.0)
    if whole == 0.0 or width > _NARROWER * whole:
        return None
    values = np.unique(every % TURN)
    outside = values[(values - start) % TURN > width + 1e-9]
    before = float(((start - outside) % TURN).min()) / 2 if outside.size else 0.0
    after = float(((outside - start - width) % TURN).min()) / 2 if outside.size else 0.0
    return Arc(start=(start - before) % TURN, width=min(width + before + after, TURN))


def _shortest_arc(angles: NDArray[np.float64], share: float) -> tuple[float, float]:
    """Return (start, width) in degrees of the shortest arc that contains ``share`` of the angles."""
    ordered = np.sort(angles % TURN)
    count = max(1, math.ceil(share * len(ordered)))
    twice = np.concatenate([ordered, ordered + TURN])
    widths = twice[count - 1 : count - 1 + len(ordered)] - ordered
    first = int(np.argmin(widths))
    return float(ordered[first]), float(widths[first])
