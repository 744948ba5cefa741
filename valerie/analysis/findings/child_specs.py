"""Specs of runs that examine a finding on fresh places, or the region of a selection."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import prod
from typing import Final

import numpy as np

from valerie.analysis.rows.design import position_paths
from valerie.analysis.rows.levels import Factor
from valerie.analysis.rows.table import EvaluationTable, combine
from valerie.errors import InvalidInput
from valerie.parameters.definitions import ParameterDefinition, ParameterType
from valerie.runs.document.descent import descent
from valerie.runs.document.run_spec import BlockDocument, RunSpec
from valerie.runs.document.varied import VariedChoice, VariedUniform
from valerie.runs.values import Scalar
from valerie.statistics.contrasts import Change
from valerie.statistics.units import LISTED

#: Most new positions between two neighbours of a grid.
_BETWEEN: Final = 20


def child_spec(
    table: EvaluationTable,
    spec: RunSpec,
    factors: Sequence[Factor],
    changes: Sequence[Change],
    places: int | None,
) -> str:
    """Return the YAML of a run that compares the same levels on fresh places.

    A design that draws its variants draws new ones. A grid keeps the two levels of each change and all other listed
    values, at positions between those of the run. It is taken to reject as many variants as the run.

    Args:
        table: evaluations of the run.
        spec: spec of the run.
        factors, changes: of the finding, in the same order.
        places: number of places that the finding needs; None: unknown.
    """
    needed = (places or 0) / _accepted(table)
    child = spec.model_copy(update=descent(spec, table.codes("run_id").names[0]))
    if not any(block.design in LISTED for block in spec.blocks):
        share = max(needed / sum(block.count or 1 for block in spec.blocks), 1.0)
        blocks = tuple(
            block.model_copy(update={"count": int(np.ceil((block.count or 1) * share))}) for block in spec.blocks
        )
        return child.model_copy(update={"blocks": blocks, "seed": spec.seed + 1}).to_yaml()
    values = {path: _values(table, path) for path in table.parameters}
    for factor, change in zip(factors, changes, strict=True):
        if factor.column in values:
            compared = np.isin(factor.codes, (change.before, change.after))
            values[factor.column] = _values(table.select(compared), factor.column)
    positions = position_paths(table.parameters)
    moved = [path for path in positions if path not in {factor.column for factor in factors}]
    kept = prod(len(values[path]) for path in positions if path not in moved)
    for path, between in _between({path: values[path] for path in moved}, needed / kept).items():
        values[path] = [*between]
    vary = tuple(
        VariedChoice(parameter=path, distribution="CHOICE", values=tuple(listed)) for path, listed in values.items()
    )
    block = BlockDocument(vary=vary, constants=_common_constants(spec.blocks))
    return child.model_copy(update={"blocks": (block,)}).to_yaml()


def _accepted(table: EvaluationTable) -> float:
    """Return the share of the planned variants that have rows; 1 if the plan is unknown."""
    known = set(table.codes("run_id").names) <= table.designs.keys()
    planned = sum(count for design in table.designs.values() for _, count in design.blocks)
    seen = combine([table.codes("run_id").index, table.numbers("variant_index")])
    return (int(seen.max()) + 1) / planned if known and planned else 1.0


def _common_constants(blocks: Sequence[BlockDocument]) -> dict[str, Scalar]:
    """Return the constants that all blocks share."""
    first, *others = blocks
    return {
        name: value
        for name, value in first.constants.items()
        if all(other.constants.get(name) == value for other in others)
    }


def _values(table: EvaluationTable, path: str) -> list[Scalar]:
    return sorted(value for value in table.arrow[path].unique().to_pylist() if value is not None)


def _between(positions: Mapping[str, list[Scalar]], places: float) -> dict[str, list[float]]:
    """Return evenly spaced positions between neighbours: as many as ``places`` needs, up to `_BETWEEN`."""
    axes = {path: np.array(values, np.float64) for path, values in positions.items() if len(values) > 1}
    if not axes:
        return {}
    gaps = np.prod([len(values) - 1.0 for values in axes.values()])
    each = next((n for n in range(1, _BETWEEN) if gaps * n ** len(axes) >= places), _BETWEEN)
    parts = np.arange(1, each + 1) / (each + 1)
    return {
        path: np.round(values[:-1, None] + np.diff(values)[:, None] * parts, 4).ravel().tolist()
        for path, values in axes.items()
    }


def drawn_spec(
    table: EvaluationTable, spec: RunSpec, definitions: Iterable[ParameterDefinition], count: int
) -> RunSpec:
    """Return the spec of a run over the region of a selection.

    Every varied number is drawn from the range of the selected rows, every other parameter from their values. A parameter
    with a single value becomes a constant.

    Args:
        table: the selected rows, of one run.
        spec: spec of the run.
        definitions: the run's parameters.
        count: number of variants.

    Raises:
        InvalidInput: there is no row.
    """
    if not len(table):
        raise InvalidInput("selects no row to refine", field="where")
    kinds = {definition.path: definition.type for definition in definitions}
    vary: list[VariedUniform | VariedChoice] = []
    constants = dict(_common_constants(spec.blocks))
    for path in table.parameters:
        values = _values(table, path)
        if len(values) == 1:
            constants[path] = values[0]
        elif kinds[path] in (ParameterType.FLOAT, ParameterType.ANGLE):
            vary.append(VariedUniform(parameter=path, distribution="UNIFORM", minimum=values[0], maximum=values[-1]))
        else:
            vary.append(VariedChoice(parameter=path, distribution="CHOICE", values=tuple(values)))
    block = BlockDocument(
        design="sobol" if vary else "grid", count=count if vary else None, vary=tuple(vary), constants=constants
    )
    return _child(spec, table, block)


def similar_spec(
    table: EvaluationTable,
    every: EvaluationTable,
    spec: RunSpec,
    names: Mapping[str, ParameterDefinition],
    count: int,
) -> RunSpec:
    """Return the spec of a run whose variants resemble those of a selection.

    Each is a selected variant, chosen at random; every number moves by up to half the median gap between its values in the run,
    within the range of the selection. So what the selected values have to do with each other stays (the smoothed bootstrap:
    Efron 1982, section 5.3, ISBN 978-0-89871-179-0). Values of a CHOICE stay as they are, and equal variants are left out.

    Args:
        table: the selected rows, of one run.
        every: all rows of that run.
        spec: of the run.
        names: every name and path of the run's parameters, to the parameter.
        count: largest number of variants.

    Raises:
        InvalidInput: there is no row.
    """
    if not len(table):
        raise InvalidInput("selects no row to look for more like it", field="where")
    chosen = {
        names[varied.parameter].path
        for block in spec.blocks
        for varied in block.vary
        if isinstance(varied, VariedChoice)
    }
    paths = list(table.parameters)
    distinct = sorted(
        {
            tuple((path, value) for path, value in row.items() if value is not None)
            for row in table.arrow.select(paths).to_pylist()
        },
        key=str,
    )
    generator = np.random.default_rng(spec.seed)
    points: list[dict[str, Scalar]] = [dict(distinct[k]) for k in generator.integers(len(distinct), size=count)]
    for path in paths:
        selected = _values(table, path)
        if path in chosen or len(selected) < 2 or names[path].type not in (ParameterType.FLOAT, ParameterType.ANGLE):
            continue
        low, high = float(selected[0]), float(selected[-1])
        half = min(float(np.median(np.diff(np.array(_values(every, path), np.float64)))) / 2, high - low)
        for point, move in zip(points, generator.uniform(-half, half, count), strict=True):
            if path in point:
                # Reflected at the ends of the selection's range, where clipping would pile variants up.
                place = low + abs(float(point[path]) + move - low)
                point[path] = round(float(high - abs(high - place)), 4)
    distinct_points = {tuple(point.items()): point for point in points}
    block = BlockDocument(
        design="points", points=tuple(distinct_points.values()), constants=_common_constants(spec.blocks)
    )
    return _child(spec, table, block, "similar")


def _child(spec: RunSpec, table: EvaluationTable, block: BlockDocument, change: str = "refined") -> RunSpec:
    """Return the spec with a single block, whose constants are the run's, as a form shows them."""
    update = {
        "blocks": (block.model_copy(update={"constants": {}}),),
        "constants": {**spec.constants, **block.constants},
        **descent(spec, table.codes("run_id").names[0], change=change),
    }
    return spec.model_copy(update=update)
