"""Choice of a run's frames by an expression about metadata, parameters and scores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import Connection

from valerie.db import frames as stored_frames
from valerie.db import long_table
from valerie.db.links import StoredFrame
from valerie.db.measured import SeenPerson
from valerie.db.models import Assignment
from valerie.errors import InvalidInput, UnknownName
from valerie.measures import TableRow
from valerie.parameters.definitions import Value
from valerie.pipeline.base.resolved_runs import StoredRun
from valerie.pipeline.reading.tables import frame_columns, person_columns, table_row
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.resolving.spec import ResolvedRun
from valerie.runs.resolving.where import Where, choices_of, compile_where
from valerie.scene.variation.conditions import with_sun_angles


@dataclass(frozen=True, slots=True, eq=False)
class ChosenFrame:
    """A frame whose image and truth are stored.

    Attributes:
        stored: its row.
        moment: the variant's assignment at the frame's time, for `apply`.
        columns: the frame's part of its persons' rows.
        persons: its persons with their light; in a frame without persons, one with instance 0.
    """

    stored: StoredFrame
    moment: Mapping[str, Value]
    columns: TableRow
    persons: tuple[SeenPerson, ...]

    @property
    def key(self) -> FrameKey:
        """The frame."""
        return self.stored.key

    @property
    def values(self) -> Assignment:
        """Path to value of all parameters that the variant or the moment sets."""
        return {**self.stored.assignment, **self.moment}

    def row(self, person: SeenPerson, resolved: ResolvedRun) -> TableRow:
        """Return the metadata columns (`valerie.runs.resolving.where.METADATA`) of a person of the frame."""
        of_person = person_columns(person.instance_id, person.measures, self.stored.assignment, resolved)
        return {**self.columns, **of_person}


@dataclass(frozen=True, slots=True, eq=False)
class EvaluatedPerson:
    """A row of the long table.

    Attributes:
        frame: the frame.
        instance_id: id of the person; 0 in a frame without persons.
        row: the columns, with *all* assigned parameters.
    """

    frame: FrameKey
    instance_id: int
    row: TableRow


def run_where(text: str, resolved: ResolvedRun, *, field: str = "where") -> Where:
    """Compile an expression over a run's rows, with the names of its cameras, sensors and functions.

    Raises:
        InvalidInput, UnknownName: as for `compile_where`.
    """
    choices = choices_of(resolved.spec, resolved.cameras)
    return compile_where(text, resolved.definitions, choices=choices, field=field)


def sensor_index(name: str | None, resolved: ResolvedRun) -> int:
    """Return the index of a sensor setting in the spec; without a name, that of the first.

    Raises:
        UnknownName: the run has no such setting.
    """
    return _index("sensor", name, [setting.name for setting in resolved.spec.sensors], field="sensor")


def function_index(name: str | None, resolved: ResolvedRun) -> int:
    """Return the index of a function in the spec; without a name, that of the first.

    Raises:
        UnknownName: the run has no such function.
    """
    return _index("function of the run", name, resolved.spec.functions, field="function")


def _index(kind: str, name: str | None, names: Sequence[str], *, field: str) -> int:
    if name is None:
        return 0
    if name not in names:
        raise UnknownName(kind, name, names, field=field)
    return names.index(name)


def as_called(reference: str, run: StoredRun) -> str:
    """Return the name in a run's spec of the version ``name@digest``; the reference itself if the run does not have it."""
    functions = run.resolved.spec.functions
    name, at, beginning = reference.partition("@")
    if at and reference not in functions:
        for function in functions:
            if function.partition("@")[0] == name and run.pins.functions[function].digest.startswith(beginning):
                return function
    return reference


def choose_frames(
    connection: Connection, run: StoredRun, *, where: Where | None = None, sensor: int = 0
) -> list[ChosenFrame]:
    """Return the finished frames with at least one selected person's row; all of them without ``where``.

    Scores are those of all functions through sensor setting ``sensor``; any function may select a frame, unless ``where``
    names one.
    """
    frames = finished_frames(connection, run, sensor)
    if where is None:
        return list(frames)
    if where.scored:
        persons = evaluated_persons(connection, run, sensor=sensor)
        selected = {person.frame for person in persons if where.holds(person.row)}
        return [frame for frame in frames if frame.key in selected]
    return [frame for frame in frames if _any_person(frame, run.resolved, where)]


def finished_frames(connection: Connection, run: StoredRun, sensor: int = 0) -> Iterator[ChosenFrame]:
    """Yield all frames of a run whose image and truth are stored, in order."""
    resolved = run.resolved
    name = resolved.spec.sensors[sensor].name
    for stored, persons in stored_frames.finished(connection, run.id):
        yield ChosenFrame(
            stored=stored,
            moment=resolved.at(stored.assignment, stored.key.time),
            columns={
                **frame_columns(stored.key, stored.assignment, resolved),
                "time_index": stored.key.time,
                "sensor": name,
            },
            persons=persons,
        )


def evaluated_persons(
    connection: Connection, run: StoredRun, *, sensor: int | None = None, function: int | None = None
) -> Iterator[EvaluatedPerson]:
    """Read the rows of the long table.

    Args:
        connection: connection to read with.
        run: the run.
        sensor, function: indices in the spec; None: all.
    """
    filters = [
        long_table.Filter(column, "eq", value)
        for column, value in (("sensor_index", sensor), ("function_index", function))
        if value is not None
    ]
    for stored in long_table.rows(connection, run.id, filters=filters):
        values = values_at(stored.frame, stored.assignment, run.resolved)
        yield EvaluatedPerson(stored.frame, stored.instance_id, {**values, **table_row(stored, run, ())})


def values_at(frame: FrameKey, assignment: Assignment, resolved: ResolvedRun) -> Mapping[str, Value]:
    """Return path to value of all parameters that a variant or the moment of its frame sets."""
    return with_sun_angles({**assignment, **resolved.at(assignment, frame.time)}, resolved.manifest)


def require_some(frames: list[ChosenFrame], where: Where | None) -> None:
    """Refuse an empty choice.

    Raises:
        InvalidInput: nothing is chosen.
    """
    if frames:
        return
    if where is None:
        raise InvalidInput("the run has no finished frame yet")
    raise InvalidInput("selects no finished frame of the run", field="where", value=where.text)


def _any_person(frame: ChosenFrame, resolved: ResolvedRun, where: Where) -> bool:
    values = with_sun_angles(frame.values, resolved.manifest)
    return any(where.holds({**values, **frame.row(person, resolved)}) for person in frame.persons)
