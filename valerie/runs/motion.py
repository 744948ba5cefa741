"""Time in a run: which moments are looked at, and what moves. From the spec's words to `valerie.scene.motion.trajectory`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from valerie.errors import InvalidInput
from valerie.parameters.units import to_unit
from valerie.runs.documents import RunSpec, TrajectoryDocument
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.naming import ROOT
from valerie.scene.motion.trajectory import MAX_TIME_S, TIME, TIME_PATH, Motion, Trajectory

#: Velocities are measured over this many seconds from a frame's moment on.
VELOCITY_SPAN_S: Final = 0.005
#: How specs call the moment of the first frame.
_TIME_NAMES: Final = frozenset({TIME, TIME_PATH})
#: Decimals of a frame's time: microseconds.
_DECIMALS: Final = 6


@dataclass(frozen=True, slots=True)
class Times:
    """What a run knows of time.

    Attributes:
        elapsed: seconds of each frame after the first one of its variant; a single 0 without a sequence.
        step: seconds between two frames; None without a sequence.
        motion: what moves; None where the run names neither sequence nor time nor trajectory.
    """

    elapsed: tuple[float, ...] = (0.0,)
    step: float | None = None
    motion: Motion | None = None


def resolve_times(spec: RunSpec, manifest: Manifest, problems: list[InvalidInput]) -> Times:
    """Check sequence and trajectories against the asset.

    Args:
        spec: what was asked for.
        manifest: of its asset.
        problems: gets every problem, each with its dotted field.
    """
    if spec.sequence is None and not spec.trajectories and not (manifest.trajectories and _names_time(spec)):
        return Times()
    elapsed, step, start = _sequence(spec, problems)
    own: dict[str, Trajectory] = {}
    for index, document in enumerate(spec.trajectories):
        place = f"trajectories.{index}"
        try:
            trajectory = _trajectory(document, manifest, place)
            manifest.require_trajectory(trajectory, field=place)
            own[trajectory.path] = trajectory
        except InvalidInput as problem:
            problems.append(problem)
    merged = {trajectory.path: trajectory for trajectory in manifest.trajectories} | own
    return Times(elapsed, step, Motion(tuple(merged.values()), manifest.by_path, start))


def _sequence(spec: RunSpec, problems: list[InvalidInput]) -> tuple[tuple[float, ...], float | None, float]:
    if spec.sequence is None:
        return (0.0,), None, 0.0
    found: dict[str, float] = {}
    for name in ("step", "start"):
        place, written = f"sequence.{name}", getattr(spec.sequence, name)
        try:
            seconds = to_unit(written, "s", field=place).number
            if name == "step" and seconds <= 0:
                raise InvalidInput("out of bounds", field=place, value=written, limit="> 0 s")
            if abs(seconds) > MAX_TIME_S:
                raise InvalidInput("out of bounds", field=place, value=written, limit=f"±{MAX_TIME_S:g} s")
            found[name] = seconds
        except InvalidInput as problem:
            problems.append(problem)
    step, start = found.get("step", 1.0), found.get("start", 0.0)
    last = start + (spec.sequence.frames - 1) * step
    if last > MAX_TIME_S:
        problems.append(
            InvalidInput("the sequence ends too late", field="sequence", value=last, limit=f"{MAX_TIME_S:g} s")
        )
        return (0.0,), step, start
    return tuple(round(k * step, _DECIMALS) for k in range(spec.sequence.frames)), step, start


def _trajectory(document: TrajectoryDocument, manifest: Manifest, place: str) -> Trajectory:
    path = document.path if document.path.startswith(f"{ROOT}.") else f"{ROOT}.{document.path}"
    keyframes = []
    for index, keyframe in enumerate(document.keyframes):
        numbers = {}
        for name, written in keyframe.items():
            channel = manifest.by_path.get(f"{path}.{name}")
            unit = "s" if name == TIME else channel.unit if channel is not None and channel.is_number else None
            # An unknown name is `Manifest.require_trajectory`'s to report, with what it might have meant.
            field = f"{place}.keyframes.{index}.{name}"
            numbers[name] = 0.0 if unit is None else to_unit(written, unit, field=field).number
        keyframes.append(numbers)
    given: dict[str, Any] = {}
    if document.stride_m is not None:
        stride = to_unit(document.stride_m, "m", field=f"{place}.stride_m").number
        if not 0 < stride <= 100:
            raise InvalidInput(
                "out of bounds", field=f"{place}.stride_m", value=document.stride_m, limit="above 0, to 100 m"
            )
        given["stride_m"] = stride
    return Trajectory(
        path=path, keyframes=tuple(keyframes), interpolation=document.interpolation, facing=document.facing, **given
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
