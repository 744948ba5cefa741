"""Specs of runs that examine a finding on places that its run has not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod
from typing import Final

import numpy as np

from valerie.analysis.design import position_paths
from valerie.analysis.levels import Factor
from valerie.analysis.table import EvaluationTable
from valerie.runs.documents import BlockDocument, RunSpec
from valerie.runs.values import Scalar
from valerie.runs.varied import VariedChoice
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

    A design that draws its variants draws others. A grid keeps the two levels of each change and all that is listed
    besides, at positions between those of the run.

    Args:
        table: of the run.
        spec: of the run.
        factors: of the finding.
        changes: of the finding, in the same order.
        places: number of places that the finding needs; None: unknown.
    """
    child = spec.model_copy(update={"parent_run": table.codes("run_id").names[0], "iteration": spec.iteration + 1})
    if not any(block.design in LISTED for block in spec.blocks):
        share = max((places or 0) / sum(block.count or 1 for block in spec.blocks), 1.0)
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
    for path, between in _between({path: values[path] for path in moved}, (places or 0) / kept).items():
        values[path] = [*between]
    vary = tuple(
        VariedChoice(parameter=path, distribution="CHOICE", values=tuple(listed)) for path, listed in values.items()
    )
    first, *others = spec.blocks
    constants = {
        name: value
        for name, value in first.constants.items()
        if all(one.constants.get(name) == value for one in others)
    }
    return child.model_copy(update={"blocks": (BlockDocument(vary=vary, constants=constants),)}).to_yaml()


def _values(table: EvaluationTable, path: str) -> list[Scalar]:
    return sorted(value for value in table.arrow[path].unique().to_pylist() if value is not None)


def _between(positions: Mapping[str, list[Scalar]], places: float) -> dict[str, list[float]]:
    """Return evenly spaced positions between neighbours, enough for a number of places where that is possible."""
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
