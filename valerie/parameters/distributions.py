"""Distributions: the values of one parameter in a grid, and the value for a number in [0, 1) in all other designs.

HOMOGENEOUS and GAUSSIAN are the paper's (section 4.0.1). All numbers are in the unit of the parameter's definition.
Steps are counted in decimals: 0 … 1 in steps of 0.1 has 11 values, and the fourth is 0.3.

A Gaussian x ~ N(μ, σ²) truncated to [a, b] has the quantile μ + σ·Φ⁻¹(Φ(α) + u·(Φ(β) − Φ(α))) with α = (a − μ)/σ and
β = (b − μ)/σ.
"""

from __future__ import annotations

import math
from decimal import ROUND_FLOOR, Decimal
from functools import lru_cache
from typing import Annotated, ClassVar, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from valerie.document import Document
from valerie.errors import InvalidInput
from valerie.parameters.definitions import MAX_MAGNITUDE, TURN, ParameterDefinition, ParameterType, Value, wrap

#: Share of a step by which a range may miss its maximum and still reach it.
STEP_TOLERANCE: Final = Decimal("1e-9")

Number = Annotated[float, Field(allow_inf_nan=False, ge=-MAX_MAGNITUDE, le=MAX_MAGNITUDE)]
Count = Annotated[int, Field(ge=1, strict=True)]


class _Distribution(Document):
    #: True if a grid needs ``count``.
    continuous: ClassVar[bool] = False

    def check(self, definition: ParameterDefinition) -> None:
        """Check that the distribution fits the definition.

        Raises:
            InvalidInput: it does not. The error names the distribution's own field (``step``, ``mean`` …).
        """
        raise NotImplementedError

    def count(self, definition: ParameterDefinition) -> int | None:
        """Return the number of values in a grid; None for a continuous distribution without ``count``."""
        raise NotImplementedError

    def value(self, k: int, definition: ParameterDefinition) -> Value:
        """Return the k-th value in a grid, k = 0 … count − 1."""
        raise NotImplementedError

    def quantile(self, u: float, definition: ParameterDefinition) -> Value:
        """Return the value at ``u`` in [0, 1). The values of a discrete distribution have equal weight."""
        return self.quantiles(np.array([u]), definition)[0]

    def quantiles(self, units: NDArray[np.float64], definition: ParameterDefinition) -> list[Value]:
        """Return the `quantile` of each of ``units``, (n,)."""
        count = self.count(definition)
        assert count is not None, "continuous distributions have their own quantiles"
        chosen = [min(int(u * count), count - 1) for u in units.tolist()]
        values = {k: self.value(k, definition) for k in set(chosen)}
        return [values[k] for k in chosen]

    def unit(self, value: Value, definition: ParameterDefinition) -> float:
        """Return the number in [0, 1] whose quantile is ``value``: the middle of the share of a discrete value.

        Raises:
            InvalidInput: the distribution does not have this value.
        """
        count = self.count(definition)
        assert count is not None, "continuous distributions have their own unit"
        checked = definition.check(value, field=definition.name)
        for k in range(count):
            if self.value(k, definition) == checked:
                return (k + 0.5) / count
        raise _not_a_value(value, definition)


class Homogeneous(_Distribution):
    """Values ``minimum + k · step ≤ maximum``. An ANGLE drops its last value if it equals the first modulo 360."""

    distribution: Literal["HOMOGENEOUS"] = "HOMOGENEOUS"
    minimum: Number
    maximum: Number
    step: Number

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if self.step <= 0:
            raise InvalidInput("the step must be above 0", field="step", value=self.step, limit="> 0")
        if self.minimum > self.maximum:
            raise InvalidInput(
                "the minimum is above the maximum", field="minimum", value=self.minimum, limit=self.maximum
            )
        return self

    def check(self, definition: ParameterDefinition) -> None:
        _require_number(self.distribution, definition)
        check_range(self.minimum, self.maximum, definition)
        if definition.type is ParameterType.INT:
            for name in ("minimum", "step"):
                number = getattr(self, name)
                if not number.is_integer():
                    raise InvalidInput("an INT takes a whole number", field=name, value=number)

    @property
    def _steps(self) -> Decimal:
        return (_decimal(self.maximum) - _decimal(self.minimum)) / _decimal(self.step)

    def count(self, definition: ParameterDefinition) -> int:
        steps = int((self._steps + STEP_TOLERANCE).to_integral_value(ROUND_FLOOR))
        if definition.type is ParameterType.ANGLE and steps > 0:
            overlap = abs(steps - Decimal(TURN) / _decimal(self.step))
            return steps if overlap <= STEP_TOLERANCE else steps + 1
        return steps + 1

    def reaches_maximum(self) -> bool:
        """Return True if the maximum is a whole number of steps from the minimum."""
        return abs(self._steps - self._steps.to_integral_value()) <= STEP_TOLERANCE

    def value(self, k: int, definition: ParameterDefinition) -> Value:
        number = min(float(_decimal(self.minimum) + k * _decimal(self.step)), self.maximum)
        return _typed([number], definition)[0]


class Gaussian(_Distribution):
    """Normal distribution, truncated to the declared range.

    An ANGLE declared over a full turn is truncated to mean ± 180 and wrapped, since such a range has no ends. An INT
    is the rounded value of a normal distribution truncated to [minimum − ½, maximum + ½]. A grid takes the
    mid-quantiles (k + ½) / count.
    """

    continuous: ClassVar[bool] = True

    distribution: Literal["GAUSSIAN"] = "GAUSSIAN"
    mean: Number
    standard_deviation: Number
    points: Count | None = Field(default=None, alias="count")

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, serialize_by_alias=True)

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if self.standard_deviation <= 0:
            raise InvalidInput(
                "the standard deviation must be above 0",
                field="standard_deviation",
                value=self.standard_deviation,
                limit="> 0",
            )
        return self

    def check(self, definition: ParameterDefinition) -> None:
        _require_number(self.distribution, definition)
        _, share_low, share_high = _truncation(self.mean, self.standard_deviation, *self._support(definition))
        if share_high - share_low <= 0.0:
            raise InvalidInput(
                "the declared range is too many standard deviations away from the mean",
                field="mean",
                value=self.mean,
                limit=definition.range_text,
            )

    def _support(self, definition: ParameterDefinition) -> tuple[float, float]:
        low, high = definition.bounds
        if definition.type is ParameterType.INT:
            return low - 0.5, high + 0.5
        if definition.type is ParameterType.ANGLE:
            if high - low >= TURN:
                return self.mean - TURN / 2, self.mean + TURN / 2
            # Take the periodic copy of the range that is nearest to the mean.
            turns = TURN * round((self.mean - (low + high) / 2) / TURN)
            return low + turns, high + turns
        return low, high

    def count(self, definition: ParameterDefinition) -> int | None:  # noqa: ARG002  the protocol's signature
        return self.points

    def value(self, k: int, definition: ParameterDefinition) -> Value:
        assert self.points is not None, "a grid of a continuous distribution has a count"
        return self.quantile((k + 0.5) / self.points, definition)

    def quantiles(self, units: NDArray[np.float64], definition: ParameterDefinition) -> list[Value]:
        from scipy.special import ndtri

        low, high = self._support(definition)
        sign, share_low, share_high = _truncation(self.mean, self.standard_deviation, low, high)
        z = sign * ndtri(share_low + (units if sign > 0 else 1.0 - units) * (share_high - share_low))
        # 12 digits, since the libraries of two machines may differ in the last bits and assignments must not.
        numbers = [float(f"{number:.12g}") for number in (self.mean + self.standard_deviation * z).tolist()]
        return _typed(np.clip(numbers, low, high).tolist(), definition)

    def unit(self, value: Value, definition: ParameterDefinition) -> float:
        from scipy.special import ndtr

        low, high = self._support(definition)
        number = _number(value, definition, low)
        if not low <= number <= high:
            raise _not_a_value(value, definition, f"{low:g}…{high:g}")
        sign, share_low, share_high = _truncation(self.mean, self.standard_deviation, low, high)
        # An INT takes the middle of the share that rounds to it.
        half = 0.5 if definition.type is ParameterType.INT else 0.0
        ends = (max(number - half, low), min(number + half, high))
        shares = [float(ndtr(sign * (end - self.mean) / self.standard_deviation)) for end in ends]
        u = (sum(shares) / 2 - share_low) / (share_high - share_low)
        return min(max(u if sign > 0 else 1.0 - u, 0.0), 1.0)


class Uniform(_Distribution):
    """Uniform distribution over [minimum, maximum], which default to the declared range.

    A grid takes the mid-quantiles (k + ½) / count.
    """

    continuous: ClassVar[bool] = True

    distribution: Literal["UNIFORM"] = "UNIFORM"
    minimum: Number | None = None
    maximum: Number | None = None
    points: Count | None = Field(default=None, alias="count")

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, serialize_by_alias=True)

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if self.minimum is not None and self.maximum is not None and self.minimum > self.maximum:
            raise InvalidInput(
                "the minimum is above the maximum", field="minimum", value=self.minimum, limit=self.maximum
            )
        return self

    def check(self, definition: ParameterDefinition) -> None:
        _require_number(self.distribution, definition)
        low, high = self._ends(definition)
        for name, end in (("minimum", low), ("maximum", high)):
            if not math.isfinite(end):
                raise InvalidInput(f"the parameter declares no {name}, so the spec must give one", field=name)
        if low > high:
            raise InvalidInput("the minimum is above the maximum", field="minimum", value=low, limit=high)
        check_range(low, high, definition)
        if definition.type is ParameterType.INT and math.ceil(low) > math.floor(high):
            raise InvalidInput(
                "there is no whole number between minimum and maximum", field="minimum", value=low, limit=high
            )

    def _ends(self, definition: ParameterDefinition) -> tuple[float, float]:
        low, high = definition.bounds
        return low if self.minimum is None else self.minimum, high if self.maximum is None else self.maximum

    def count(self, definition: ParameterDefinition) -> int | None:  # noqa: ARG002  the protocol's signature
        return self.points

    def value(self, k: int, definition: ParameterDefinition) -> Value:
        assert self.points is not None, "a grid of a continuous distribution has a count"
        return self.quantile((k + 0.5) / self.points, definition)

    def quantiles(self, units: NDArray[np.float64], definition: ParameterDefinition) -> list[Value]:
        low, high = self._ends(definition)
        if definition.type is ParameterType.INT:
            first, last = math.ceil(low), math.floor(high)
            return [min(first + int(u * (last - first + 1)), last) for u in units.tolist()]
        return _typed(np.clip(low + units * (high - low), low, high).tolist(), definition)

    def unit(self, value: Value, definition: ParameterDefinition) -> float:
        low, high = self._ends(definition)
        number = _number(value, definition, low)
        if not low <= number <= high:
            raise _not_a_value(value, definition, f"{low:g}…{high:g}")
        if definition.type is ParameterType.INT:
            first, last = math.ceil(low), math.floor(high)
            return (number - first + 0.5) / (last - first + 1)
        return (number - low) / (high - low) if high > low else 0.5


class Choice(_Distribution):
    """Listed values, in their order."""

    distribution: Literal["CHOICE"] = "CHOICE"
    values: Annotated[tuple[Value, ...], Field(min_length=1)]

    def check(self, definition: ParameterDefinition) -> None:
        values: set[Value] = set()
        for i, value in enumerate(self.values):
            checked = definition.check(value, field=f"values.{i}")
            if checked in values:
                raise InvalidInput("listed twice", field=f"values.{i}", value=value)
            values.add(checked)

    def count(self, definition: ParameterDefinition) -> int:  # noqa: ARG002  the protocol's signature
        return len(self.values)

    def value(self, k: int, definition: ParameterDefinition) -> Value:
        return definition.check(self.values[k])


class Constant(_Distribution):
    """A single value."""

    distribution: Literal["CONSTANT"] = "CONSTANT"
    constant: Value = Field(alias="value")

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, serialize_by_alias=True)

    def check(self, definition: ParameterDefinition) -> None:
        definition.check(self.constant, field="value")

    def count(self, definition: ParameterDefinition) -> int:  # noqa: ARG002  the protocol's signature
        return 1

    def value(self, k: int, definition: ParameterDefinition) -> Value:  # noqa: ARG002  the protocol's signature
        return definition.check(self.constant)


Distribution = Annotated[
    Homogeneous | Gaussian | Uniform | Choice | Constant,
    Field(discriminator="distribution"),
]


def check_range(low: float, high: float, definition: ParameterDefinition) -> None:
    """Check that a range lies within the declared one; an ANGLE's range is compared modulo 360.

    Raises:
        InvalidInput: it does not. The error names ``minimum`` or ``maximum``.
    """
    if definition.type is ParameterType.ANGLE:
        assert definition.minimum is not None, "an ANGLE has both bounds"
        assert definition.maximum is not None, "an ANGLE has both bounds"
        if high - low > TURN:
            raise InvalidInput("an ANGLE spans at most one turn", field="maximum", value=high, limit=low + TURN)
        if definition.maximum - definition.minimum >= TURN:
            return
        high += wrap(low, definition.minimum) - low
        low = wrap(low, definition.minimum)
    if definition.minimum is not None and low < definition.minimum:
        raise InvalidInput("below the declared range", field="minimum", value=low, limit=definition.range_text)
    if definition.maximum is not None and low > definition.maximum:
        raise InvalidInput("above the declared range", field="minimum", value=low, limit=definition.range_text)
    if definition.maximum is not None and high > definition.maximum:
        raise InvalidInput("above the declared range", field="maximum", value=high, limit=definition.range_text)


def _require_number(distribution: str, definition: ParameterDefinition) -> None:
    if not definition.is_number:
        raise InvalidInput(
            f"{distribution} needs a number, and {definition.name} is {definition.type}",
            field="distribution",
            value=distribution,
            limit="CHOICE or CONSTANT",
        )


def _number(value: Value, definition: ParameterDefinition, start: float) -> float:
    """Return a checked number; for an ANGLE, its copy within one turn from ``start``."""
    number = float(definition.check(value, field=definition.name))
    return wrap(number, start) if definition.type is ParameterType.ANGLE else number


def _not_a_value(value: Value, definition: ParameterDefinition, limit: str | None = None) -> InvalidInput:
    return InvalidInput("the distribution does not have this value", field=definition.name, value=value, limit=limit)


def _decimal(number: float) -> Decimal:
    return Decimal(repr(number))


def _typed(numbers: list[float], definition: ParameterDefinition) -> list[Value]:
    if definition.type is ParameterType.ANGLE:
        start = definition.minimum
        assert start is not None, "an ANGLE has both bounds"
        return [wrap(number, start) for number in numbers]
    if definition.type is ParameterType.INT:
        # The support of a Gaussian INT is half a unit wider than the range, and its upper end would round beyond the range.
        high = math.inf if definition.maximum is None else math.floor(definition.maximum)
        return [int(min(math.floor(number + 0.5), high)) for number in numbers]
    return [number + 0.0 for number in numbers]


@lru_cache(maxsize=4096)
def _truncation(mean: float, deviation: float, low: float, high: float) -> tuple[float, float, float]:
    """Return (sign, Φ(α), Φ(β)); a range above the mean is mirrored, since Φ is precise only in the lower tail."""
    from scipy.special import ndtr

    alpha, beta = (low - mean) / deviation, (high - mean) / deviation
    sign = -1.0 if alpha > 0 else 1.0
    if sign < 0:
        alpha, beta = -beta, -alpha
    return sign, float(ndtr(alpha)), float(ndtr(beta))
