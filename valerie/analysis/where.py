"""Selecting rows of results by an expression: ``pacc < 0.5 and distance_m > 25 and camera == 'camera-1'``.

The grammar is that of constraints (`valerie.parameters.constraints`). Names are the columns of the long table and the
asset's parameters, by name or path. A row that lacks a value that decides is not selected, as in SQL.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import pyarrow as pa

from valerie.analysis.table import COLUMNS
from valerie.parameters.constraints import Constraint, Operand, compile_constraint
from valerie.parameters.definitions import ParameterDefinition, ParameterType, Value

#: Columns that no function is needed for: they are known as soon as the truth is.
METADATA: Final = (
    "run_id", "variant_index", "frame_id", "camera", "time_s", "character", "sensor", "instance_id", "pixel_area",
    "pixel_area_percent", "pixel_area_amodal", "occlusion_rate", "truncation_rate", "distance_m", "depth_m",
    "bearing_deg", "aspect_deg", "irradiance", "shadow_share", "contrast", "sun_azimuth_deg",
    "sun_elevation_deg", "road_friction", "undefined_reason",
)  # fmt: skip


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
        return bool(self.names & (_NAMES - frozenset(METADATA)))

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
    for name, dtype, _, _ in COLUMNS:
        is_text = pa.types.is_dictionary(dtype) or pa.types.is_string(dtype)
        kind = ParameterType.CATEGORICAL if is_text else ParameterType.FLOAT
        names[name] = Column(name, kind, tuple((choices or {}).get(name, ())))
    constraint = compile_constraint(text, names, field=field, word="column")
    return Where(text, constraint.paths, constraint)


_NAMES: Final = frozenset(name for name, _, _, _ in COLUMNS)
