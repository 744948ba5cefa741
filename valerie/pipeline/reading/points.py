"""Points of a scatter plot: pACC over one axis, as columns of plain lists."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from valerie.analysis.rows.frame_counts import ABSENT
from valerie.db import long_table, runs, variants
from valerie.db.archives import reading_run
from valerie.db.long_table import Point
from valerie.db.models import Assignment
from valerie.errors import UnknownName
from valerie.measures import Measure, Source, measures_from
from valerie.parameters.definitions import Value
from valerie.parameters.paths import short_name
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.pipeline.reading.tables import character_of
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.products.states import Stage
from valerie.runs.resolving.spec import ResolvedRun
from valerie.scene.light.solar import ANGLES
from valerie.scene.variation.conditions import Conditions, conditions, varied_conditions


class PlotAxis(NamedTuple):
    """A column that pACC can be plotted over.

    Attributes:
        column: column of the long table: a fixed one, or the path of a varied parameter.
        title: displayed name, e.g. ``distance``.
        unit: displayed after numbers that are multiplied by ``scale``; may be empty.
        scale: factor from the column's unit to the displayed one (rates are displayed in per cent).
        group: ``person``, ``conditions`` or ``varied``.
    """

    column: str
    title: str
    unit: str
    scale: float
    group: str


def _axis(measure: Measure, group: str) -> PlotAxis:
    return PlotAxis(measure.name, measure.title, measure.unit, measure.scale, group)


def plot_axes(resolved: ResolvedRun) -> tuple[PlotAxis, ...]:
    """Return the columns that a run's pACC can be plotted over: those that it fills, and numbers that vary in it."""
    varied = set(resolved.space.varied)
    light = (Source.LIGHT,) if AnnotationKind.LIGHT in resolved.annotations else ()
    person = (measure for measure in measures_from(Source.PLACE, Source.PIXELS, *light) if measure.is_number)
    differing = {*varied_conditions(varied), *(("time_s",) if len(resolved.times.elapsed) > 1 else ())}
    circumstances = (measure for measure in measures_from(Source.CONDITIONS) if measure.name in differing)
    parameters = (
        PlotAxis(d.path, short_name(d.path), d.unit_sign, 1.0, "varied")
        for d in resolved.definitions
        # The sun's angles are conditions already, in either notation.
        if d.path in varied and d.is_number and d.path not in ANGLES
    )
    return (
        *(_axis(measure, "person") for measure in person),
        *(_axis(measure, "conditions") for measure in circumstances),
        *parameters,
    )


@dataclass(frozen=True, slots=True)
class ScatterPoints:
    """Points of a scatter plot, as columns of equal length.

    Attributes:
        column: column on the x axis.
        functions, sensors, cameras, characters: names that codes refer to by index.
        x, pacc: coordinates of the points.
        variant, camera, time, sensor, function, instance: the evaluated person of each point.
        character: code; -1 if the asset names none.
        undefined: number of persons without a pACC, by reason.
        share: share of the variants that is included.
        axes: all possible x axes.
    """

    column: str
    functions: tuple[str, ...]
    sensors: tuple[str, ...]
    cameras: tuple[str, ...]
    axes: tuple[PlotAxis, ...]
    share: float
    characters: list[str] = field(default_factory=list)
    x: list[float] = field(default_factory=list)
    pacc: list[float] = field(default_factory=list)
    variant: list[int] = field(default_factory=list)
    camera: list[int] = field(default_factory=list)
    time: list[int] = field(default_factory=list)
    sensor: list[int] = field(default_factory=list)
    function: list[int] = field(default_factory=list)
    character: list[int] = field(default_factory=list)
    instance: list[int] = field(default_factory=list)
    undefined: Counter[str] = field(default_factory=Counter)

    def add(self, row: Point, pacc: float, x: float, character: str | None) -> None:
        """Add the point of a row with its pACC."""
        if character is not None and character not in self.characters:
            self.characters.append(character)
        self.x.append(x)
        self.pacc.append(pacc)
        self.variant.append(row.variant_index)
        self.camera.append(row.camera_index)
        self.time.append(row.time_index)
        self.sensor.append(row.sensor_index)
        self.function.append(row.function_index)
        self.character.append(-1 if character is None else self.characters.index(character))
        self.instance.append(row.instance_id)


def read_points(context: Context, run_id: str, column: str, *, limit: int) -> ScatterPoints:
    """Read every evaluated person of a run, or for a large run those of a fixed, even sample of its variants.

    Args:
        context: context of the process.
        run_id: id of the run.
        column: column of one of its `plot_axes`.
        limit: approximate largest number of points.

    Raises:
        NotFound, Conflict, UnknownName: no such run, its asset changed, or it has no such axis.
    """
    with reading_run(context.engine, run_id) as connection:
        run = runs.get(connection, run_id)
        resolved = resolve_stored(run, context.settings).resolved
        axes = plot_axes(resolved)
        if column not in [axis.column for axis in axes]:
            raise UnknownName("column to plot over", column, [axis.column for axis in axes], field="column")
        evaluated = run.progress.stages[Stage.EVAL].done if run.progress is not None else 0
        share = min(1.0, limit / max(evaluated * max(len(resolved.manifest.persons), 1), 1))
        stored = column if column in long_table.COLUMNS else None
        rows = long_table.points(connection, run_id, stored, share=share)
        assignments = variants.assignments(connection, run_id, {row.variant_index for row in rows})
    spec = resolved.spec
    points = ScatterPoints(
        column=column,
        functions=tuple(spec.functions),
        sensors=tuple(setting.name for setting in spec.sensors),
        cameras=tuple(resolved.cameras),
        axes=axes,
        share=share,
    )
    value_of = _value_of(column, resolved)
    for row in rows:
        if row.undefined_reason == ABSENT:  # not in the scene; summaries do not count such a person either
            continue
        if row.pacc is None:
            points.undefined[row.undefined_reason or "no value"] += 1
            continue
        assignment = assignments[row.variant_index]
        x = value_of(row, assignment)
        if x is not None:
            points.add(row, row.pacc, x, character_of(row.instance_id, assignment, resolved))
    return points


def _value_of(column: str, resolved: ResolvedRun) -> Callable[[Point, Assignment], float | None]:
    """Return the function that reads a column from a row, or computes it from the assignment of its variant."""
    if column in long_table.COLUMNS:
        return lambda row, _: row.x
    if column == "time_s":
        return lambda row, assignment: resolved.seconds(assignment, row.time_index)
    if column in Conditions._fields:
        place = Conditions._fields.index(column)
        return lambda row, assignment: conditions(resolved.at(assignment, row.time_index), resolved.manifest)[place]
    return lambda _, assignment: _number(assignment.get(column))


def _number(value: Value | None) -> float | None:
    return None if value is None else float(value)
