"""Choosing frames of a run by an expression about its metadata, parameters and scores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from sqlalchemy import Connection

from valerie.analysis.where import Where, compile_where
from valerie.db import results
from valerie.errors import InvalidInput, UnknownName
from valerie.pipeline.reading.capture import Capture, capture_of
from valerie.pipeline.reading.tables import character_of, frame_id, table_row
from valerie.runs.pins import Pins
from valerie.runs.spec import ResolvedRun
from valerie.scene.variation.conditions import conditions, with_sun_angles

#: (variant, camera, time): what tells the frames of a run apart.
FrameKey = tuple[int, int, int]


@dataclass(frozen=True, slots=True, eq=False)
class ChosenFrame:
    """A frame whose image and truth are stored.

    Attributes:
        key: (variant, camera, time).
        background, layer, truth: digests.
        velocity: likewise, where the run has them.
        assignment: of its variant.
        moment: the same at the frame's time, as `apply` takes it.
        persons: metadata columns (`valerie.analysis.where.METADATA`) and boxes, one mapping per person; one mapping
            with empty values where the frame has no person.
    """

    key: FrameKey
    background: str
    layer: str
    truth: str
    assignment: Mapping[str, Any]
    moment: Mapping[str, Any]
    persons: tuple[Mapping[str, Any], ...]
    velocity: str | None = None

    def capture(self, resolved: ResolvedRun, sensor_index: int) -> Capture:
        """How one of the run's sensors takes it."""
        return capture_of(
            resolved,
            sensor_index=sensor_index,
            camera_index=self.key[1],
            assignment=self.moment,
            background=self.background,
            layer=self.layer,
            truth=self.truth,
            velocity=self.velocity,
        )


def run_where(text: str, resolved: ResolvedRun, *, field: str = "where") -> Where:
    """A selection over a run's rows, which knows its cameras, sensors and functions.

    Raises:
        InvalidInput, UnknownName: as `compile_where`.
    """
    choices = {
        "camera": resolved.cameras,
        "sensor": tuple(setting.name for setting in resolved.spec.sensors),
        "function": resolved.spec.functions,
    }
    return compile_where(text, resolved.definitions, choices=choices, field=field)


def sensor_index(name: str | None, resolved: ResolvedRun) -> int:
    """The place of a sensor setting in the spec; the first without a name.

    Raises:
        UnknownName: the run has no such setting.
    """
    names = [setting.name for setting in resolved.spec.sensors]
    if name is not None and name not in names:
        raise UnknownName("sensor", name, names, field="sensor")
    return 0 if name is None else names.index(name)


def function_index(name: str, resolved: ResolvedRun) -> int:
    """The place of a function in the spec.

    Raises:
        UnknownName: the run did not evaluate it.
    """
    if name not in resolved.spec.functions:
        raise UnknownName("function of the run", name, resolved.spec.functions, field="function")
    return resolved.spec.functions.index(name)


def as_called(reference: str, resolved: ResolvedRun, pins: Pins) -> str:
    """What a run's spec calls the version that ``name@digest`` means; the reference itself where it is no version of the run."""
    name, at, beginning = reference.partition("@")
    if at and reference not in resolved.spec.functions:
        for called in resolved.spec.functions:
            if called.partition("@")[0] == name and pins.functions[called].digest.startswith(beginning):
                return called
    return reference


def choose_frames(
    connection: Connection, run_id: str, resolved: ResolvedRun, *, where: Where | None = None, sensor: int = 0
) -> list[ChosenFrame]:
    """Finished frames of which at least one person's row is selected; all of them without ``where``.

    Scores are those of the functions that looked through sensor setting ``sensor``; any of them may select a frame,
    unless ``where`` names one.
    """
    scored = None if where is None or not where.scored else _scored(connection, run_id, resolved, where, sensor)
    chosen = []
    for frame in finished_frames(connection, run_id, resolved, sensor):
        if scored is not None:
            wanted = frame.key in scored
        else:
            given = {**frame.assignment, **frame.moment}
            spoken = {} if where is None else with_sun_angles(given, resolved.manifest)
            wanted = where is None or any(where.holds({**spoken, **row}) for row in frame.persons)
        if wanted:
            chosen.append(frame)
    return chosen


def finished_frames(
    connection: Connection, run_id: str, resolved: ResolvedRun, sensor: int = 0
) -> Iterator[ChosenFrame]:
    """All frames of a run whose image and truth are stored, in order."""
    name = resolved.spec.sensors[sensor].name
    rows = results.finished_frames(connection, run_id)
    for key, group in groupby(rows, lambda row: (row.variant_index, row.camera_index, row.time_index)):
        members = list(group)
        first = members[0]
        yield ChosenFrame(
            key=key,
            background=first.background,
            layer=first.layer,
            truth=first.truth,
            assignment=first.assignment,
            moment=resolved.at(first.assignment, first.time_index),
            velocity=first.velocity,
            persons=tuple(_metadata(row, run_id, resolved, name) for row in members),
        )


def evaluated_rows(
    connection: Connection,
    run_id: str,
    resolved: ResolvedRun,
    *,
    sensor: int | None = None,
    function: int | None = None,
) -> Iterator[tuple[FrameKey, dict[str, Any]]]:
    """The long table's rows with *all* assigned parameters, each with the key of its frame."""
    filters = [
        results.Filter(column, "eq", value)
        for column, value in (("sensor_index", sensor), ("function_index", function))
        if value is not None
    ]
    for row in results.rows(connection, run_id, filters=filters):
        key = (row.variant_index, row.camera_index, row.time_index)
        given = {**row.assignment, **resolved.at(row.assignment, row.time_index)}
        yield key, {**with_sun_angles(given, resolved.manifest), **table_row(row, run_id, resolved, {})}


def require_some(frames: list[ChosenFrame], where: Where | None) -> None:
    """Refuse an empty choice.

    Raises:
        InvalidInput: nothing is chosen.
    """
    if not frames:
        text = "selects no finished frame of the run" if where is not None else "the run has no finished frame yet"
        raise InvalidInput(
            text, field="where" if where is not None else "", value=None if where is None else where.text
        )


def _scored(
    connection: Connection, run_id: str, resolved: ResolvedRun, where: Where, sensor: int
) -> frozenset[FrameKey]:
    rows = evaluated_rows(connection, run_id, resolved, sensor=sensor)
    return frozenset(key for key, row in rows if where.holds(row))


def _metadata(row: Any, run_id: str, resolved: ResolvedRun, sensor: str) -> dict[str, Any]:
    nobody = row.instance_id == 0
    seen = ("instance_id", "pixel_area", "pixel_area_percent", "pixel_area_amodal")
    always = (
        "occlusion_rate", "truncation_rate", "distance_m", "depth_m", "bearing_deg", "aspect_deg", "irradiance",
        "shadow_share", "contrast", "box", "amodal_box", "undefined_reason",
    )  # fmt: skip
    return {
        "run_id": run_id,
        "frame_id": frame_id(run_id, row.variant_index, row.camera_index, row.time_index),
        "variant_index": row.variant_index,
        "camera": resolved.cameras[row.camera_index],
        "time_index": row.time_index,
        "time_s": resolved.seconds(row.assignment, row.time_index),
        "sensor": sensor,
        "character": character_of(row.instance_id, row.assignment, resolved),
        **{name: None if nobody else getattr(row, name) for name in seen},
        **{name: getattr(row, name) for name in always},
        **conditions(resolved.at(row.assignment, row.time_index), resolved.manifest)._asdict(),
    }
