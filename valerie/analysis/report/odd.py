"""Coverage of an operational design domain: which parts of each parameter's range, and of each pair of ranges, a run shows.

Parameters carry attributes in the terms of ISO 34503 (`valerie.parameters.odd`). A range is cut into equal parts, each with its
lower end; choices are levels of their own. Pairs are those of Grindal, Offutt and Andler 2005, *Software Testing, Verification
and Reliability* 15, 167–199, doi:10.1002/stvr.319: each level of a parameter together with each level of another. Coverage says
what was looked at. It is no statement about what lies inside a level, and none of compliance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations, pairwise
from typing import Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from valerie.analysis.rows.table import EvaluationTable
from valerie.parameters.definitions import ParameterDefinition, ParameterType, Value
from valerie.parameters.odd import OddAttribute
from valerie.parameters.paths import short_name
from valerie.plain import JsonObject

#: Equal parts of the range of a number.
PARTS: Final = 5


@dataclass(frozen=True, slots=True)
class Covered:
    """A varied parameter.

    Attributes:
        attribute: that it stands for.
        parameter: its path without ``scene.``, as findings name it.
        source: where its range comes from; empty where nobody said.
        levels: the choices, or the parts of its range, in order.
        frames: number of evaluated frames at each level.
    """

    attribute: OddAttribute
    parameter: str
    source: str
    levels: tuple[str, ...]
    frames: tuple[int, ...]

    @property
    def holes(self) -> tuple[str, ...]:
        """Levels that no evaluated frame shows."""
        return tuple(level for level, frames in zip(self.levels, self.frames, strict=True) if not frames)


@dataclass(frozen=True, slots=True)
class CoveredPair:
    """Two varied parameters together.

    Attributes:
        first, second: them.
        frames: number of evaluated frames at each level of the first with each of the second.
    """

    first: Covered
    second: Covered
    frames: tuple[tuple[int, ...], ...]

    @property
    def holes(self) -> tuple[tuple[str, str], ...]:
        """Pairs of levels that each occur, but never together."""
        return tuple(
            (one, other)
            for one, alone, row in zip(self.first.levels, self.first.frames, self.frames, strict=True)
            for other, too, together in zip(self.second.levels, self.second.frames, row, strict=True)
            if alone and too and not together
        )

    @property
    def possible(self) -> int:
        """Number of pairs of levels that each occur."""
        return int(np.count_nonzero(self.first.frames) * np.count_nonzero(self.second.frames))


@dataclass(frozen=True, slots=True)
class Held:
    """A parameter with one value throughout the run: the rest of its range is a hole."""

    attribute: OddAttribute
    parameter: str
    value: str


@dataclass(frozen=True, slots=True)
class OddCoverage:
    """The part of an operational design domain that a run shows.

    Attributes:
        varied, held: parameters that stand for an attribute.
        pairs: each two of ``varied``.
        absent: attributes that no parameter of the asset stands for.
    """

    varied: tuple[Covered, ...]
    pairs: tuple[CoveredPair, ...]
    held: tuple[Held, ...]
    absent: tuple[OddAttribute, ...]

    @property
    def held_by_attribute(self) -> dict[OddAttribute, list[Held]]:
        """Parameters with one value, by what they stand for."""
        return {name: own for name in OddAttribute if (own := [hole for hole in self.held if hole.attribute is name])}


def odd_coverage(
    definitions: Sequence[ParameterDefinition], table: EvaluationTable, constants: Mapping[str, Value]
) -> OddCoverage:
    """Return the coverage of a run.

    Args:
        definitions: parameters of the asset, with the ranges that the spec declares.
        table: the evaluations; a parameter without a value has its default.
        constants: path to value of parameters that the run does not vary.
    """
    meant = [definition for definition in definitions if definition.odd is not None]
    first_rows = np.unique(table.codes("frame_id").index, return_index=True)[1]
    varied: list[tuple[Covered, NDArray[np.int64]]] = []
    held: list[Held] = []
    for definition in meant:
        assert definition.odd is not None
        if definition.path in table.parameters:
            levels, places = _levels(definition, table, first_rows)
            frames = tuple(np.bincount(places, minlength=len(levels)).tolist())
            varied.append(
                (Covered(definition.odd, short_name(definition.path), definition.source, levels, frames), places)
            )
        else:
            value = constants.get(definition.path, definition.default)
            held.append(Held(definition.odd, short_name(definition.path), definition.text(value)))
    pairs = [
        CoveredPair(one, other, _together(one, places, other, others))
        for (one, places), (other, others) in combinations(varied, 2)
    ]
    present = {definition.odd for definition in meant}
    absent = tuple(attribute for attribute in OddAttribute if attribute not in present)
    return OddCoverage(tuple(one for one, _ in varied), tuple(pairs), tuple(held), absent)


def odd_json(coverage: OddCoverage) -> JsonObject:
    """Return the coverage as JSON values; pairs name their parameters."""
    pairs = [
        {"first": pair.first.parameter, "second": pair.second.parameter, "frames": pair.frames, "holes": pair.holes}
        for pair in coverage.pairs
    ]
    varied = [{**asdict(name), "branch": name.attribute.branch, "holes": name.holes} for name in coverage.varied]
    return {**asdict(coverage), "varied": varied, "pairs": pairs}


def odd_table(coverage: OddCoverage) -> pa.Table:
    """Return the number of frames at each level, then at each pair of levels."""
    alone = [
        (name.attribute, name.parameter, level, "", "", frames)
        for name in coverage.varied
        for level, frames in zip(name.levels, name.frames, strict=True)
    ]
    together = [
        (pair.first.attribute, pair.first.parameter, level, pair.second.parameter, other, frames)
        for pair in coverage.pairs
        for level, row in zip(pair.first.levels, pair.frames, strict=True)
        for other, frames in zip(pair.second.levels, row, strict=True)
    ]
    names = ("attribute", "parameter", "level", "other_parameter", "other_level", "frames")
    rows = [dict(zip(names, row, strict=True)) for row in (*alone, *together)]
    return pa.Table.from_pylist(rows, schema=_SCHEMA)


_SCHEMA: Final = pa.schema(
    {
        "attribute": pa.string(),
        "parameter": pa.string(),
        "level": pa.string(),
        "other_parameter": pa.string(),
        "other_level": pa.string(),
        "frames": pa.int64(),
    }
)


def _levels(
    definition: ParameterDefinition, table: EvaluationTable, rows: NDArray[np.int64]
) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Return the levels of a parameter, and the place of these rows among them, (N,)."""
    if definition.type is ParameterType.CATEGORICAL:
        codes = table.codes(definition.path)
        names = [*codes.names, str(definition.default)]
        place_of = {name: place for place, name in enumerate(definition.choices)}
        places = np.array([place_of[name] for name in names], np.int64)  # a row without a value has the code −1
        return definition.choices, places[codes.index[rows]]
    values = table.numbers(definition.path)[rows]
    values = np.where(np.isfinite(values), values, float(definition.default))
    if definition.type is ParameterType.BOOL:
        return ("false", "true"), values.astype(np.int64)
    low = values.min() if definition.minimum is None else definition.minimum
    high = values.max() if definition.maximum is None else definition.maximum
    if low == high:
        return (definition.text(low),), np.zeros(len(values), np.int64)
    edges = [float(f"{edge:.12g}") for edge in np.linspace(low, high, PARTS + 1)]  # 0.6 is at least three fifths of 1
    names = [f"{start:g}…{definition.text(end)}" for start, end in pairwise(edges)]
    return tuple(names), np.clip(np.digitize(values, edges) - 1, 0, PARTS - 1).astype(np.int64)


def _together(
    one: Covered, places: NDArray[np.int64], other: Covered, others: NDArray[np.int64]
) -> tuple[tuple[int, ...], ...]:
    shape = len(one.levels), len(other.levels)
    counts = np.bincount(places * shape[1] + others, minlength=shape[0] * shape[1]).reshape(shape)
    return tuple(tuple(row) for row in counts.tolist())
