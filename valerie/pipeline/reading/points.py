"""Points of a scatter plot: pACC over one axis, as columns of plain lists."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from valerie.analysis.frame_counts import ABSENT
from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.errors import UnknownName
from valerie.measures import Measure, Source, measures_from
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.pipeline.reading.tables import character_of
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.spec import ResolvedRun
from valerie.runs.states import Stage
from valerie.scene.light.solar import ANGLES
from valerie.scene.variation.conditions import Conditions, conditions, varied_conditions


class PlotAxis(NamedTuple):
    """Something that pACC can be plotted over.

    Attributes:
        column: of the long table: a fixed one, or the path of a varied parameter.
        title: what people read, e.g. ``distance``.
        unit: shown behind numbers, after multiplying by ``scale``; may be empty.
        scale: from the column's unit to the shown one (rates are shown in per cent).
        group: ``person``, ``conditions`` or ``varied``.
    """

    column: str
    title: str
    unit: str
    scale: float
    group: str


def _axis(measure: Measure, group: str) -> PlotAxis:
    return PlotAxis(measure.name, measure.title, measure.unit, measure.scale, group)


_NUMERIC: Final = ("FLOAT", "ANGLE", "INT")


def plot_axes(resolved: ResolvedRun) -> tuple[PlotAxis, ...]:
    """What a run's pACC can be plotted over: columns that it fills, and numbers that differ between its frames."""
    varied = set(resolved.space.varied)
    light = (Source.LIGHT,) if AnnotationKind.LIGHT in resolved.annotations else ()
    person = (one for one in measures_from(Source.PLACE, Source.PIXELS, *light) if one.is_number)
    differing = {*varied_conditions(varied), *(("time_s",) if len(resolved.times.elapsed) > 1 else ())}
    circumstances = (one for one in measures_from(Source.CONDITIONS) if one.name in differing)
    parameters = (
        PlotAxis(d.path, d.path.removeprefix("scene."), "°" if d.type == "ANGLE" else d.unit, 1.0, "varied")
        for d in resolved.definitions
        # The sun's angles are conditions already, whichever way they were given.
        if d.path in varied and d.type in _NUMERIC and d.path not in ANGLES
    )
    return (
        *(_axis(one, "person") for one in person),
        *(_axis(one, "conditions") for one in circumstances),
        *parameters,
    )


def read_points(context: Context, run_id: str, column: str, *, limit: int) -> dict[str, Any]:
    """Every evaluated person of a run; of a large run an even sample of the variants, always the same.

    Args:
        context: of the process.
        run_id: the run.
        column: of one of its `plot_axes`.
        limit: about so many points at most.

    Returns:
        names (``functions``, ``sensors``, ``cameras``, ``characters``), lists of equal length (``x``, ``pacc``, ``variant``,
        ``camera`` …) whose codes are positions in the names, ``undefined`` by reason, the ``share`` of the variants shown, and
        the run's ``axes``.

    Raises:
        NotFound, Conflict, UnknownName: no such run, its asset changed, it has no such axis.
    """
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
        resolved = resolve_stored(run, context.settings).resolved
        axes = plot_axes(resolved)
        if column not in [axis.column for axis in axes]:
            raise UnknownName("column to plot over", column, [axis.column for axis in axes], field="column")
        evaluated = run.progress.stages[Stage.EVAL].done if run.progress is not None else 0
        share = min(1.0, limit / max(evaluated * max(len(resolved.manifest.persons), 1), 1))
        stored = column if column in results.COLUMNS else None
        rows = results.points(connection, run_id, stored, share=share)
        assignments = results.assignments(connection, run_id, {row.variant_index for row in rows})
    value_of = _from_row if stored else _from_assignment(column, resolved)
    names = ("x", "pacc", "variant", "camera", "time", "sensor", "function", "character", "instance")
    columns: dict[str, list[Any]] = {name: [] for name in names}
    characters: dict[str, int] = {}
    undefined: Counter[str] = Counter()
    for row in rows:
        if row.undefined_reason == ABSENT:  # no spec put that person there; a summary does not count it either
            continue
        if row.pacc is None:
            undefined[row.undefined_reason or "no value"] += 1
            continue
        assignment = assignments[row.variant_index]
        x = value_of(row, assignment)
        if x is None:
            continue
        character = character_of(row.instance_id, assignment, resolved)
        code = -1 if character is None else characters.setdefault(character, len(characters))
        point = (x, row.pacc, row.variant_index, row.camera_index, row.time_index, row.sensor_index)
        for name, value in zip(names, (*point, row.function_index, code, row.instance_id), strict=True):
            columns[name].append(value)
    return {
        "column": column,
        "functions": list(resolved.spec.functions),
        "sensors": [setting.name for setting in resolved.spec.sensors],
        "cameras": list(resolved.cameras),
        "characters": list(characters),
        **columns,
        "undefined": dict(undefined),
        "share": share,
        "axes": [axis._asdict() for axis in axes],
    }


def _from_row(row: Any, _: Mapping[str, Any]) -> float | None:
    x: float | None = row.x
    return x


def _from_assignment(column: str, resolved: ResolvedRun) -> Callable[[Any, Mapping[str, Any]], float | None]:
    """What the long table has in a column that follows from the assignment of the row's variant."""
    if column == "time_s":
        return lambda row, assignment: resolved.seconds(assignment, row.time_index)
    if column in Conditions._fields:
        place = Conditions._fields.index(column)
        return lambda row, assignment: conditions(resolved.at(assignment, row.time_index), resolved.manifest)[place]
    return lambda _, assignment: assignment.get(column)
