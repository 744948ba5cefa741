"""Time in a run: the moments of its frames, and the trajectories of its objects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from valerie.errors import InvalidInput
from valerie.parameters.quantities import to_unit
from valerie.runs.document.run_spec import RunSpec, TrajectoryDocument
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.naming import ROOT
from valerie.scene.motion.trajectory import MAX_TIME_S, TIME, TIME_PATH, Motion, Trajectory

#: Seconds after a frame's moment over which velocities are measured.
VELOCITY_SPAN_S: Final = 0.005
#: Names for the moment of the first frame in specs.
_TIME_NAMES: Final = frozenset({TIME, TIME_PATH})
#: Decimals of a frame's time: microseconds.
_DECIMALS: Final = 6


@dataclass(frozen=True, slots=True)
class Times:
    """The moments of a run's frames, and its motion.

    Attributes:
        elapsed: seconds of each frame after the first frame of its variant; a single 0 without a sequence.
        step: seconds between two frames; None without a sequence.
        motion: moving objects; None if the run has no sequence, time or trajectory.
    """

    elapsed: tuple[float, ...] = (0.0,)
    step: float | None = None
    motion: Motion | None = None


def resolve_times(spec: RunSpec, manifest: Manifest, problems: list[InvalidInput]) -> Times:
    """Check the sequence and the trajectories of a spec against its asset.

    Args:
        spec: the spec.
        manifest: manifest of its asset.
        problems: receives every problem, each with its dotted field.
    """
    if spec.sequence is None and not spec.trajectories and not (manifest.trajectories and _names_time(spec)):
        return Times()
    elapsed, step, start = _sequence(spec, problems)
    of_spec: dict[str, Trajectory] = {}
    for index, document in enumerate(spec.trajectories):
        place = f"trajectories.{index}"
        try:
            trajectory = _trajectory(document, manifest, place)
            manifest.require_trajectory(trajectory, field=place)
            of_spec[trajectory.path] = trajectory
        except InvalidInput as problem:
            problems.append(problem)
    of_asset = {trajectory.path: trajectory for trajectory in manifest.trajectories}
    trajectories = tuple((of_asset | of_spec).values())
    return Times(elapsed, step, Motion(trajectories, manifest.by_path, start))


def _sequence(spec: RunSpec, problems: list[InvalidInput]) -> tuple[tuple[float, ...], float | None, float]:
    if spec.sequence is None:
        return (0.0,), None, 0.0
    try:
        step = _seconds(spec.sequence.step, "sequence.step")
        if step <= 0:
            raise InvalidInput("out of bounds", field="sequence.step", value=spec.sequence.step, limit="> 0 s")
    except InvalidInput as problem:
        problems.append(problem)
        step = 1.0
    try:
        start = _seconds(spec.sequence.start, "sequence.start")
    except InvalidInput as problem:
        problems.append(problem)
        start = 0.0
    last = start + (spec.sequence.frames - 1) * step
    if last > MAX_TIME_S:
        problems.append(
            InvalidInput("the sequence ends too late", field="sequence", value=last, limit=f"{MAX_TIME_S:g} s")
        )
        return (0.0,), step, start
    return tuple(round(k * step, _DECIMALS) for k in range(spec.sequence.frames)), step, start


def _seconds(written: object, place: str) -> float:
    seconds = to_unit(written, "s", field=place).number
    if abs(seconds) > MAX_TIME_S:
        raise InvalidInput("out of bounds", field=place, value=written, limit=f"±{MAX_TIME_S:g} s")
    return seconds


def _trajectory(document: TrajectoryDocument, manifest: Manifest, place: str) -> Trajectory:
    path = document.path if document.path.startswith(f"{ROOT}.") else f"{ROOT}.{document.path}"
    keyframes = []
    for index, keyframe in enumerate(document.keyframes):
        numbers = {}
        for name, written in keyframe.items():
            channel = manifest.by_path.get(f"{path}.{name}")
            unit = "s" if name == TIME else channel.unit if channel is not None and channel.is_number else None
            # `Manifest.require_trajectory` reports unknown names, with suggestions.
            field = f"{place}.keyframes.{index}.{name}"
            numbers[name] = 0.0 if unit is None else to_unit(written, unit, field=field).number
        keyframes.append(numbers)
    stride: dict[str, float] = {}
    if document.stride_m is not None:
        metres = to_unit(document.stride_m, "m", field=f"{place}.stride_m").number
        if not 0 < metres <= 100:
            raise InvalidInput(
                "out of bounds", field=f"{place}.stride_m", value=document.stride_m, limit="above 0, to 100 m"
            )
        stride["stride_m"] = metres
    return Trajectory(
        path=path, keyframes=tuple(keyframes), interpolation=document.interpolation, facing=document.facing, **stride
    )


def _names_time(spec: RunSpec) -> bool:
    return any(name in _TIME_NAMES for name in _named(spec))


def _named(spec: RunSpec) -> Iterator[str]:
    yield from (parameter.path for parameter in spec.parameters)
    yield from spec.constants
    for block in spec.blocks:
        yield from block.constants
        yield from (varied.parameter for varied in block.vary)
        for point in block.points:
            yield from point
