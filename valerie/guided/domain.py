"""The operational domain: parameters with their distributions, mapped to the unit cube and back.

A point of the unit cube has one quantile per parameter, so the operational density is uniform there and distances are shares
of the domain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.blocks import Variation
from valerie.parameters.definitions import TURN, ParameterDefinition, ParameterType, Value
from valerie.parameters.distributions import Choice, Constant, Homogeneous
from valerie.parameters.quantities import to_unit
from valerie.parameters.samplers import UnitPoints

#: Smallest share of legal points in a domain; it bounds the number of attempts for each draw.
LEAST_LEGAL: Final = 1e-4
_TRIES: Final = 1000
_TURN_RADIANS: Final = 2 * math.pi
#: Largest quantile.
BELOW_ONE: Final = float(np.nextafter(1.0, 0.0))


class Axis(StrEnum):
    """The kind of a parameter's values."""

    #: Any number in a range.
    CONTINUOUS = "continuous"
    #: Discrete numbers in a range.
    STEPPED = "stepped"
    #: Values without distances.
    UNORDERED = "unordered"


class Cube:
    """The unit cube, or its legal part.

    Args:
        dimensions: number of dimensions.
        accepts: returns (n,) True where a point of (n, dimensions) is legal; None: all are.
    """

    def __init__(self, dimensions: int, accepts: Callable[[UnitPoints], ArrayLike] | None = None) -> None:
        self.dimensions, self._accepts = dimensions, accepts

    def legal(self, points: UnitPoints) -> NDArray[np.bool_]:
        """Return (n,) bool, True where a point of (n, dimensions) is legal."""
        if self._accepts is None:
            return np.ones(len(points), np.bool_)
        return np.asarray(self._accepts(points), np.bool_)

    def features(self, points: UnitPoints) -> NDArray[np.float64]:
        """Return coordinates, (n, k), for models of scores, in which similar values are close together."""
        return points

    def draw(self, rng: np.random.Generator, count: int) -> UnitPoints:
        """Return ``count`` legal points, drawn from the operational density: uniform over the legal part.

        Raises:
            InvalidInput: less than `LEAST_LEGAL` of the cube is legal.
        """
        if self._accepts is None:
            return rng.random((count, self.dimensions))
        drawn: list[UnitPoints] = []
        missing, tried = count, 0
        while missing > 0:
            points = rng.random((max(missing, min(_TRIES, 2 * count)), self.dimensions))
            while missing > 0 and len(points):  # legality costs most, so only as many points are tried as needed
                some, points = points[:missing], points[missing:]
                tried += len(some)
                drawn.append(some[self.legal(some)])
                missing -= len(drawn[-1])
            if tried * LEAST_LEGAL > max(count - missing, 1):
                raise InvalidInput(
                    "hardly any variant is legal",
                    field="vary",
                    value=f"{count - missing} of {tried:,}",
                    limit=LEAST_LEGAL,
                )
        return np.concatenate([np.empty((0, self.dimensions)), *drawn])


class Domain(Cube):
    """The operational domain.

    Args:
        definitions: parameters of the asset.
        variations: the varied parameters by path or name, one for each dimension of the unit cube.
        rejections: returns for each variant, of which it gets the values by path, the reason why it is rejected; None
            if it is legal. By default all are legal. The operational density is conditional on legal variants, so
            illegal ones do not count in a failure rate.

    Attributes:
        definitions: one for each dimension.
        variations: see above.

    Raises:
        InvalidInput, UnknownName: the field begins with ``vary``.
    """

    def __init__(
        self,
        definitions: Sequence[ParameterDefinition],
        variations: Sequence[Variation],
        rejections: Callable[[Sequence[dict[str, Value]]], Sequence[str | None]] | None = None,
    ) -> None:
        by_name = {key: definition for definition in definitions for key in (definition.name, definition.path)}
        chosen: list[ParameterDefinition] = []
        for i, variation in enumerate(variations):
            if variation.path not in by_name:
                raise UnknownName("parameter", variation.path, by_name, field=f"vary.{i}")
            definition = by_name[variation.path]
            if definition in chosen:
                raise InvalidInput("the parameter is varied twice", field=f"vary.{i}", value=variation.path)
            variation.distribution.check(definition)
            chosen.append(definition)
        if not chosen:
            raise InvalidInput("a domain needs a parameter", field="vary", limit=">= 1")
        self.definitions, self.variations = tuple(chosen), tuple(variations)
        super().__init__(
            len(chosen),
            None if rejections is None else lambda points: [why is None for why in rejections(self.variants(points))],
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(definition.name for definition in self.definitions)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Kind of each parameter."""
        return tuple(
            Axis.UNORDERED
            if isinstance(variation.distribution, Choice | Constant)
            else Axis.CONTINUOUS
            if variation.distribution.continuous and definition.type is not ParameterType.INT
            else Axis.STEPPED
            for definition, variation in zip(self.definitions, self.variations, strict=True)
        )

    @property
    def periodic(self) -> NDArray[np.bool_]:
        """(dimensions,) True for an ANGLE that covers a full turn, so that 0 and 1 are neighbours."""
        return np.array([self._goes_round(dimension) for dimension in range(self.dimensions)])

    def _goes_round(self, dimension: int) -> bool:
        definition, distribution = self.definitions[dimension], self.variations[dimension].distribution
        if definition.type is not ParameterType.ANGLE or self.axes[dimension] is Axis.UNORDERED:
            return False
        first, last = (float(distribution.quantile(u, definition)) for u in (0.0, BELOW_ONE))
        step = distribution.step if isinstance(distribution, Homogeneous) else 0.0
        return abs(math.remainder(first - last - step, TURN)) < 1e-6

    def features(self, points: UnitPoints) -> NDArray[np.float64]:
        """Return coordinates, (n, k): a circle for a periodic parameter, one for each value of an unordered one."""
        columns: list[NDArray[np.float64]] = []
        for dimension, (axis, goes_round) in enumerate(zip(self.axes, self.periodic, strict=True)):
            quantiles = points[:, dimension]
            if goes_round:
                angles = _TURN_RADIANS * quantiles
                columns += [np.cos(angles) / _TURN_RADIANS, np.sin(angles) / _TURN_RADIANS]
            elif axis is Axis.UNORDERED:
                count = self.variations[dimension].distribution.count(self.definitions[dimension]) or 1
                chosen = np.minimum((quantiles * count).astype(np.int64), count - 1)
                columns += list((chosen == np.arange(count)[:, None]) / math.sqrt(2))
            else:
                columns.append(quantiles)
        return np.column_stack(columns)

    def values(self, point: ArrayLike) -> dict[str, Value]:
        """Return the values at a point, (dimensions,) in [0, 1], by path."""
        return self.variants(np.asarray(point, np.float64)[None])[0]

    def variants(self, points: UnitPoints) -> list[dict[str, Value]]:
        """Return the `values` at each of the points, (n, dimensions)."""
        columns = [
            variation.distribution.quantiles(units, definition)
            for definition, variation, units in zip(self.definitions, self.variations, _inside(points).T, strict=True)
        ]
        paths = [definition.path for definition in self.definitions]
        return [dict(zip(paths, row, strict=True)) for row in zip(*columns, strict=True)]

    def point(self, values: Mapping[str, Value]) -> UnitPoints:
        """Return the point, (dimensions,) in [0, 1), of values by path or name; a number may have a unit.

        A value that many points share gets their midpoint.

        Raises:
            InvalidInput, UnknownName: a varied parameter has no value, another one has, or its distribution does not have
                this value.
        """
        keys = {key for definition in self.definitions for key in (definition.path, definition.name)}
        for name in values:
            if name not in keys:
                raise UnknownName("varied parameter", name, keys, field=name)
        quantiles = []
        for definition, variation in zip(self.definitions, self.variations, strict=True):
            name = definition.path if definition.path in values else definition.name
            if name not in values:
                refusal = "the parameter has no value, and a point needs those of all varied ones"
                raise InvalidInput(refusal, field=definition.name)
            value = values[name]
            if definition.is_number and isinstance(value, str):
                value = to_unit(value, definition.unit, field=definition.name).number
            quantiles.append(variation.distribution.unit(value, definition))
        return _inside(np.array(quantiles))

    def snapped(self, points: UnitPoints) -> UnitPoints:
        """Return points with the same values; equal steps or choices get equal coordinates."""
        points = _inside(points.copy())
        for dimension, axis in enumerate(self.axes):
            if axis is not Axis.CONTINUOUS:
                distribution, definition = self.variations[dimension].distribution, self.definitions[dimension]
                values = distribution.quantiles(points[:, dimension], definition)
                points[:, dimension] = [distribution.unit(value, definition) for value in values]
        return points

    def steps(self, start: ArrayLike, end: ArrayLike) -> NDArray[np.float64]:
        """Return the differences from ``start`` to ``end``, (…, dimensions); the shorter way round for periodic parameters."""
        ways = np.asarray(end, np.float64) - np.asarray(start, np.float64)
        return np.where(self.periodic, ways - np.round(ways), ways)


def _inside(points: UnitPoints) -> UnitPoints:
    return np.clip(points, 0.0, BELOW_ONE)


def shown(value: Value) -> str:
    """Format a value with four digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
