"""Selections of rows by an expression: ``pacc < 0.5 and distance_m > 25 and camera == 'camera-1'``.

The grammar is that of constraints (`valerie.parameters.constraints`). Names are the columns of the long table and the
asset's parameters, by name or path. As in SQL, a row is not selected if the result depends on a missing value.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from valerie.measures import MEASURES, OF_FUNCTION, WITHOUT_FUNCTION, Row, names_from
from valerie.parameters.constraints import Constraint, Operand, compile_constraint
from valerie.parameters.definitions import ParameterDefinition, ParameterType, Value
from valerie.runs.document.run_spec import RunSpec

#: Columns that are known once the truth exists, without any function.
METADATA: Final = names_from(*WITHOUT_FUNCTION)


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the long table as an operand of an expression; it has no default."""

    name: str
    type: ParameterType
    choices: tuple[str, ...] = ()
    default: Value | None = None
    share: bool = False

    @property
    def path(self) -> str:
        """Key of the value in a row."""
        return self.name


@dataclass(frozen=True, slots=True)
class Where:
    """A compiled selection.

    Attributes:
        text: source text.
        names: columns and parameter paths in it.
    """

    text: str
    names: frozenset[str]
    _constraint: Constraint
    _opposite: Constraint

    @property
    def scored(self) -> bool:
        """True if the expression depends on a function under test."""
        return not self.names.isdisjoint(names_from(*OF_FUNCTION))

    def holds(self, row: Row) -> bool:
        """Return True if a row is selected.

        Args:
            row: column or parameter path to value; missing parameters have their defaults.
        """
        return self._constraint.holds(row)

    def excludes(self, row: Row) -> bool:
        """Return True if a row is not selected for any possible missing values."""
        return self._opposite.holds(row)


def choices_of(spec: RunSpec, cameras: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the possible names in the columns of a run's rows, for `compile_where`."""
    return {
        "camera": tuple(cameras),
        "sensor": tuple(setting.name for setting in spec.sensors),
        "function": spec.functions,
    }


def compile_where(
    text: str,
    definitions: Iterable[ParameterDefinition] = (),
    *,
    choices: Mapping[str, Sequence[str]] | None = None,
    field: str = "where",
) -> Where:
    """Parse and type-check a selection.

    Args:
        text: the expression.
        definitions: the run's parameters.
        choices: column to its possible names, for example of the run's cameras.
        field: name of the field for error messages.

    Raises:
        InvalidInput: the text does not follow the grammar, or compares values of different types.
        UnknownName: a name is neither a column nor a parameter, or a text is none of the choices.
    """
    names: dict[str, Operand] = {}
    for definition in definitions:
        names |= {definition.path: definition, definition.name: definition}
    for measure in MEASURES:
        kind = ParameterType.FLOAT if measure.is_number else ParameterType.CATEGORICAL
        offered = tuple((choices or {}).get(measure.name, ()))
        names[measure.name] = Column(measure.name, kind, offered, share=measure.unit == "%")
    constraint = compile_constraint(text, names, field=field, word="column")
    opposite = compile_constraint(f"not ({text})", names, field=field, word="column")
    return Where(text, constraint.paths, constraint, opposite)
