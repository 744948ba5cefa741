"""One block of a run: one design over its varied parameters. Its variants are indexed, never stored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import prod
from typing import Final, Protocol

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.assignment import digest
from valerie.parameters.definitions import ParameterDefinition, Value
from valerie.parameters.distributions import Constant, Distribution
from valerie.parameters.samplers import SAMPLERS, Sampler, SamplerFactory

GRID: Final = "grid"
POINTS: Final = "points"

#: Largest number of values of a grid dimension to store. The values of longer dimensions are computed on demand.
_LISTED: Final = 65_536
#: Rows that a sampler draws at once.
_CHUNK: Final = 4096


@dataclass(frozen=True, slots=True)
class Variation:
    """One parameter and its distribution.

    Attributes:
        path: path of the parameter, or within a `Block` its name.
    """

    path: str
    distribution: Distribution


@dataclass(frozen=True, slots=True)
class Block:
    """A part of a run.

    Attributes:
        design: ``grid``, ``points`` or the name of a sampler.
        variations: varied parameters. In a grid the right-most changes fastest.
        constants: path to value, the same in every row. They override the run's constants.
        count: number of variants of a sampler's design; None for ``grid`` and ``points``.
        points: rows of a ``points`` design, path to value. Rows may set different parameters.
    """

    design: str = GRID
    variations: tuple[Variation, ...] = ()
    constants: Mapping[str, Value] | None = None
    count: int | None = None
    points: tuple[Mapping[str, Value], ...] = ()


class BlockRows(Protocol):
    """The variants of one block: path to value, without the constants."""

    @property
    def size(self) -> int: ...

    def read(self, start: int, stop: int) -> Iterator[dict[str, Value]]:
        """Yield rows start … stop − 1. Each dictionary belongs to the caller."""
        ...


def rows_of(
    block: Block,
    definitions: Mapping[str, ParameterDefinition],
    *,
    seed: int,
    index: int,
    samplers: Mapping[str, SamplerFactory] = SAMPLERS,
) -> BlockRows:
    """Return the rows of a block.

    Args:
        block: the block, with paths as names.
        definitions: path to definition.
        index: index of the block in the spec.
        samplers: name to sampler, for designs other than ``grid`` and ``points``.

    Raises:
        InvalidInput: a distribution does not fit its parameter, or ``count`` is missing or not allowed.
        UnknownName: there is no such parameter or design.
    """
    if block.design not in (GRID, POINTS) and block.design not in samplers:
        raise UnknownName("design", block.design, (GRID, POINTS, *samplers), field="design")
    _check_variations(block, definitions)
    if block.design == POINTS:
        return PointRows(block, definitions)
    if block.points:
        raise InvalidInput("only the design points takes points", field="points", limit="design: points")
    if block.design == GRID:
        return GridRows(block, definitions)
    if block.count is None or block.count < 1:
        raise InvalidInput(
            f"the design {block.design} needs the number of variants", field="count", value=block.count, limit=">= 1"
        )
    return SampledRows(block, definitions, samplers[block.design], seed=seed, index=index)


def _check_variations(block: Block, definitions: Mapping[str, ParameterDefinition]) -> None:
    paths: set[str] = set()
    for i, variation in enumerate(block.variations):
        if variation.path not in definitions:
            raise UnknownName("parameter", variation.path, definitions, field=f"vary.{i}")
        if variation.path in paths:
            raise InvalidInput("the parameter is varied twice", field=f"vary.{i}", value=variation.path)
        paths.add(variation.path)
        try:
            variation.distribution.check(definitions[variation.path])
        except InvalidInput as problem:
            raise at(f"vary.{i}", problem) from None


class GridRows:
    """All combinations, the right-most parameter fastest: (a1, b1), (a1, b2), (a2, b1), (a2, b2)."""

    def __init__(self, block: Block, definitions: Mapping[str, ParameterDefinition]) -> None:
        if block.count is not None:
            raise InvalidInput("a grid takes no count, since it has all combinations", field="count", value=block.count)
        self._paths = [variation.path for variation in block.variations]
        self._axes: list[tuple[Value, ...] | _Axis] = []
        counts: list[int] = []
        for i, variation in enumerate(block.variations):
            definition = definitions[variation.path]
            count = variation.distribution.count(definition)
            if count is None:
                raise InvalidInput(
                    f"a grid needs the number of values of a {variation.distribution.distribution}",
                    field=f"vary.{i}.count",
                    limit="count: N, or another design",
                )
            counts.append(count)
            axis = _Axis(variation.distribution, definition)
            self._axes.append(tuple(axis[k] for k in range(count)) if count <= _LISTED else axis)
        self.counts = tuple(counts)
        self._size = prod(counts)

    @property
    def size(self) -> int:
        return self._size

    def read(self, start: int, stop: int) -> Iterator[dict[str, Value]]:
        if start >= stop:
            return
        digits: list[int] = []
        rest = start
        for count in reversed(self.counts):
            rest, digit = divmod(rest, count)
            digits.append(digit)
        digits.reverse()
        axes, counts, paths = self._axes, self.counts, self._paths
        row = {path: axis[digit] for path, axis, digit in zip(paths, axes, digits, strict=True)}
        yield row.copy()
        last = len(paths) - 1
        for _ in range(start + 1, stop):
            # As in an odometer, usually only the right-most wheel turns.
            wheel = last
            digits[wheel] += 1
            while digits[wheel] == counts[wheel]:
                digits[wheel] = 0
                row[paths[wheel]] = axes[wheel][0]
                wheel -= 1
                digits[wheel] += 1
            row[paths[wheel]] = axes[wheel][digits[wheel]]
            yield row.copy()

    def lines(self, row: int) -> dict[str, range]:
        """Return for each path the rows that differ from ``row`` in this path only, itself included, in the order of values."""
        lines: dict[str, range] = {}
        stride = 1
        for path, count in zip(reversed(self._paths), reversed(self.counts), strict=True):
            first = row - row // stride % count * stride
            lines[path] = range(first, first + count * stride, stride)
            stride *= count
        return lines


class SampledRows:
    """The points of a sampler, converted to values by the distributions' quantiles."""

    def __init__(
        self,
        block: Block,
        definitions: Mapping[str, ParameterDefinition],
        factory: SamplerFactory,
        *,
        seed: int,
        index: int,
    ) -> None:
        assert block.count is not None, "checked by rows_of"
        self._size = block.count
        self._constants: dict[str, Value] = {}
        self._varied: list[tuple[str, Distribution, ParameterDefinition]] = []
        for variation in block.variations:
            definition = definitions[variation.path]
            if isinstance(variation.distribution, Constant):
                # A constant is not a dimension of the design, so adding one does not change the other draws.
                self._constants[variation.path] = variation.distribution.value(0, definition)
            else:
                self._varied.append((variation.path, variation.distribution, definition))
        # Different blocks of a spec, and different designs with the same seed, draw different points.
        block_seed = int(digest("sampler", block.design, seed, index), 16)
        self._sampler: Sampler | None = None
        if self._varied:
            self._sampler = factory(dimensions=len(self._varied), count=self._size, seed=block_seed)

    @property
    def size(self) -> int:
        return self._size

    def read(self, start: int, stop: int) -> Iterator[dict[str, Value]]:
        if self._sampler is None:
            for _ in range(start, stop):
                yield self._constants.copy()
            return
        paths = [path for path, _, _ in self._varied]
        for first in range(start, stop, _CHUNK):
            points = self._sampler.points(first, min(first + _CHUNK, stop))
            columns = [
                distribution.quantiles(units, definition)
                for (_, distribution, definition), units in zip(self._varied, points.T, strict=True)
            ]
            for row in zip(*columns, strict=True):
                yield {**self._constants, **dict(zip(paths, row, strict=True))}


class PointRows:
    """The listed assignments in their order."""

    def __init__(self, block: Block, definitions: Mapping[str, ParameterDefinition]) -> None:
        if block.variations:
            raise InvalidInput("the design points varies nothing else", field="vary", limit="points: [...]")
        if block.count is not None:
            raise InvalidInput("the design points takes no count", field="count", value=block.count)
        if not block.points:
            raise InvalidInput("the design points needs at least one point", field="points")
        self._points: list[dict[str, Value]] = []
        for i, point in enumerate(block.points):
            for path in point:
                if path not in definitions:
                    raise UnknownName("parameter", path, definitions, field=f"points.{i}")
            self._points.append(
                {path: definitions[path].check(value, field=f"points.{i}.{path}") for path, value in point.items()}
            )

    @property
    def size(self) -> int:
        return len(self._points)

    def read(self, start: int, stop: int) -> Iterator[dict[str, Value]]:
        for i in range(start, stop):
            yield self._points[i].copy()


class _Axis:
    """The values of one long grid dimension, computed on demand."""

    def __init__(self, distribution: Distribution, definition: ParameterDefinition) -> None:
        self._distribution, self._definition = distribution, definition

    def __getitem__(self, k: int) -> Value:
        return self._distribution.value(k, self._definition)


def at(place: str, problem: InvalidInput) -> InvalidInput:
    """Return the same problem with its field nested in ``place``."""
    field = f"{place}.{problem.field}" if problem.field else place
    if isinstance(problem, UnknownName):
        return UnknownName(problem.kind, problem.name, problem.known, field=field, limit=problem.limit)
    return InvalidInput(problem.message, field=field, value=problem.value, limit=problem.limit)
