"""Selecting rows of results by an expression: ``pacc < 0.5 and distance_m > 25 and camera == 'camera-1'``.

The grammar is that of constraints (`valerie.parameters.constraints`). Names are the columns of the long table and the
asset's parameters, by name or path. A row that lacks a value that decides is not selected, as in SQL.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from valerie.measures import MEASURES, OF_FUNCTION, names_from
from valerie.parameters.constraints import Constraint, Operand, compile_constraint
from valerie.parameters.definitions import ParameterDefinition, ParameterType, Value

#: Columns that no function is needed for: they are known as soon as the truth is.
METADATA: Final = tuple(measure.name for measure in MEASURES if measure.source not in OF_FUNCTION)


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the long table as something that an expression speaks of; without a value it is missing."""

    name: str
    type: ParameterType
    choices: tuple[str, ...] = ()
    default: Value | None = None

    @property
    def path(self) -> str:
        """The key of its value in a row."""
        return self.name


@dataclass(frozen=True, slots=True)
class Where:
    """A compiled selection.

    Attributes:
        text: as it was written.
        names: columns and parameter paths that it speaks of.
    """

    text: str
    names: frozenset[str]
    _constraint: Constraint

    @property
    def scored(self) -> bool:
        """Whether it speaks of what a function made of the frames."""
        return not self.names.isdisjoint(names_from(*OF_FUNCTION))

    def holds(self, row: Mapping[str, Any]) -> bool:
        """Whether a row (column or parameter path to value; parameters it lacks have their defaults) is selected."""
        return self._constraint.holds(row)


def compile_where(
    text: str,
    definitions: Iterable[ParameterDefinition] = (),
    *,
    choices: Mapping[str, Sequence[str]] | None = None,
    field: str = "where",
) -> Where:
    """Parse and type-check a selection.

    Args:
        text: see the module.
        definitions: the run's parameters.
        choices: of columns of names, e.g. the run's cameras, so that a misspelt one is told.
        field: where the text stands, for errors.

    Raises:
        InvalidInput: it does not follow the grammar or compares different kinds.
        UnknownName: neither a column nor a parameter; or text that is no choice.
    """
    names: dict[str, Operand] = {}
    for definition in definitions:
        names |= {definition.path: definition, definition.name: definition}
    for measure in MEASURES:
        kind = ParameterType.FLOAT if measure.is_number else ParameterType.CATEGORICAL
        names[measure.name] = Column(measure.name, kind, tuple((choices or {}).get(measure.name, ())))
    constraint = compile_constraint(text, names, field=field, word="column")
    return Where(text, constraint.paths, constraint)
