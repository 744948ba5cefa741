"""Trajectories: poses over time by keyframes (paper, table 1: T(t) of vehicles, humans and sensors).

A trajectory moves its target: a movable node, or a camera. Its keyframes give values of the target's parameters at times in
seconds, and splines join them (`valerie.scene.motion.splines`). Each value of a keyframe is itself a parameter,
``person-1.trajectory.key-2.pos.x``, and so is the start, ``person-1.trajectory.start``.

A moment is an ordinary assignment: `Motion.at` replaces the trajectory's parameters by the values of that moment. Equal moments
therefore share their products.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from valerie.document import Document
from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import TURN, Affects, ParameterDefinition, ParameterType, Value, wrap
from valerie.scene.graph.naming import ROOT
from valerie.scene.motion.splines import Spline, linear, smooth, unwrapped

#: Path of the time of a variant's first frame, a parameter of every run with time.
TIME_PATH: Final = f"{ROOT}.time"
#: Name of the time in a keyframe, and below the keyframe's path.
TIME: Final = "time"
#: Times lie within this many seconds of 0.
MAX_TIME_S: Final = 86_400.0
#: Metres that a pedestrian walks in one gait cycle of two steps, unless the trajectory gives another length: the mean of adults
#: (J. Perry, "Gait Analysis: Normal and Pathological Function", 1992).
STRIDE_M: Final = 1.41
#: Speed in m/s below which a target stands, and faces the direction of its last movement.
_STANDING: Final = 1e-6
#: Decimals of computed values (a micrometre, a millionth of a degree), so that all machines get the same scene.
_DECIMALS: Final = 6
#: Shares of a stretch at which its first and its last direction are evaluated.
_AFTER, _BEFORE = 1e-4, 1.0 - 1e-4
_GROUND: Final = ("pos.x", "pos.y")
_FACING: Final = ("heading", "yaw")
_GAIT: Final = "gait_phase"
#: Nodes and weights of Gaussian quadrature on 0…1, for path lengths.
_NODES, _WEIGHTS = (
    0.5 * (part + shift) for part, shift in zip(np.polynomial.legendre.leggauss(8), (1.0, 0.0), strict=True)
)


class Trajectory(Document):
    """The pose of one target over time.

    Attributes:
        path: the target's path, e.g. ``scene.person-1`` or ``scene.camera-1``.
        keyframes: keyframes in order of time. Each has ``time`` (s) and the same parameters of the target, e.g. ``pos.x``, in
            their declared units. Angles turn the shorter way.
        interpolation: ``smooth`` (continuous velocity) or ``linear``. Equal positions in two keyframes are a pause.
        facing: ``path`` if the heading (yaw of a camera) follows the direction of movement, ``kept`` if not. By default,
            targets with a heading face their path and cameras do not. Keyframes that give the angle take precedence.
        stride_m: metres walked in one gait cycle of two steps, for a target with a ``gait_phase`` that no keyframe gives.
    """

    path: str
    keyframes: Annotated[tuple[dict[str, float], ...], Field(min_length=1, max_length=1000)]
    interpolation: Literal["smooth", "linear"] = "smooth"
    facing: Literal["path", "kept"] | None = None
    stride_m: Annotated[float, Field(gt=0, le=100)] = STRIDE_M

    @property
    def name(self) -> str:
        """Return the path without ``scene.``."""
        return self.path.removeprefix(f"{ROOT}.")

    @property
    def start(self) -> str:
        """Return the path of the start: the moment at which the keyframes' time is 0."""
        return f"{self.path}.trajectory.start"

    def key(self, index: int, channel: str) -> str:
        """Return the path of a channel, or of the time, of keyframe ``index`` (from 0; the path counts from 1)."""
        return f"{self.path}.trajectory.key-{index + 1}.{channel}"

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the names of the parameters that the keyframes give besides the time."""
        return tuple(name for name in self.keyframes[0] if name != TIME)


def check_keyframes(trajectory: Trajectory, parameters: Mapping[str, ParameterDefinition], *, field: str = "") -> None:
    """Refuse a trajectory whose keyframes do not fit the parameters of its target.

    Args:
        parameters: path to declaration, of the whole asset.
        field: of the trajectory, for errors.

    Raises:
        UnknownName: a keyframe gives a parameter that the target does not declare.
        InvalidInput: keyframes give different parameters, leave a range, or are not in order of time.
    """
    definitions = _declared_of(trajectory, parameters)
    numbers = [
        name
        for name, definition in definitions.items()
        if definition.type in (ParameterType.FLOAT, ParameterType.ANGLE)
    ]
    last = -math.inf
    for index, keyframe in enumerate(trajectory.keyframes):
        place = f"{field}.keyframes.{index}"
        if TIME not in keyframe:
            raise InvalidInput("a keyframe needs a time", field=place, limit="time: 0 s")
        for name, value in keyframe.items():
            if name == TIME:
                continue
            if name not in numbers:
                raise UnknownName(f"number of {trajectory.name}", name, numbers, field=f"{place}.{name}")
            definitions[name].check(value, field=f"{place}.{name}")
        if set(keyframe) != set(trajectory.keyframes[0]):
            raise InvalidInput(
                "all keyframes must give the same parameters",
                field=place,
                value=", ".join(keyframe),
                limit=", ".join(trajectory.keyframes[0]),
            )
        time = keyframe[TIME]
        if not -MAX_TIME_S <= time <= MAX_TIME_S:
            raise InvalidInput("out of bounds", field=f"{place}.time", value=time, limit=f"±{MAX_TIME_S:g} s")
        if time <= last:
            raise InvalidInput(
                "keyframes must be in order of time", field=f"{place}.time", value=time, limit=f"> {last:g} s"
            )
        last = time
    if not trajectory.channels:
        raise InvalidInput("the keyframes give only times", field=f"{field}.keyframes", limit="e.g. pos.x: 2 m")
    if trajectory.facing == "path" and not (set(_GROUND) <= set(trajectory.channels) and _facing(definitions)):
        raise InvalidInput(
            "facing the path needs pos.x and pos.y in the keyframes, and a heading or yaw to set",
            field=f"{field}.facing",
            value="path",
        )


class Motion:
    """All trajectories of a run.

    Args:
        trajectories: at most one per target, checked by `check_keyframes`.
        parameters: path to declaration, of the whole asset.
        start: the moment of the first frame, seconds, unless a variant gives another.

    Attributes:
        parameters: declarations of the time and of the values of all keyframes.
        moved: path to the trajectory that sets its value. A variant cannot give such a value.
    """

    def __init__(
        self, trajectories: Sequence[Trajectory], parameters: Mapping[str, ParameterDefinition], start: float = 0.0
    ) -> None:
        self.trajectories = tuple(trajectories)
        self._things = tuple(_Thing(trajectory, parameters) for trajectory in trajectories)
        self.parameters = tuple(_parameters(trajectories, parameters, start))
        self.moved: dict[str, Trajectory] = {path: thing.trajectory for thing in self._things for path in thing.moved}
        self._own = frozenset(definition.path for definition in self.parameters)
        self._start = start

    def at(self, assignment: Mapping[str, Value], elapsed: float, *, within: bool = False) -> dict[str, Value]:
        """Return the assignment of one moment: path to value, without time and trajectories.

        Args:
            elapsed: seconds since the variant's first frame.
            within: True to clip values to their declared ranges, for moments without a frame.

        Raises:
            InvalidInput: the variant puts keyframes out of order.
        """
        moment = {path: value for path, value in assignment.items() if path not in self._own}
        time = self.seconds(assignment, elapsed)
        for thing in self._things:
            values = thing.at(assignment, time)
            moment |= thing.held(values) if within else values
        return moment

    def owns(self, path: str) -> bool:
        """Return True if a path is the time or a keyframe's value."""
        return path in self._own

    def seconds(self, assignment: Mapping[str, Value], elapsed: float) -> float:
        """Return the moment ``elapsed`` seconds after a variant's first frame."""
        return round(float(assignment.get(TIME_PATH, self._start)) + elapsed, _DECIMALS)

    def rejection(self, assignment: Mapping[str, Value], elapsed: Sequence[float]) -> str | None:
        """Return the reason why the movement of a variant is impossible; None if it is possible.

        Args:
            elapsed: the moments to check, seconds since the first frame.
        """
        for thing in self._things:
            if not thing.in_order(assignment):
                return f"the keyframes of {thing.trajectory.name} are not in the order of time"
        for seconds in elapsed:
            time = self.seconds(assignment, seconds)
            for thing in self._things:
                if reason := thing.outside(thing.at(assignment, time)):
                    return f"{reason} at {time:g} s"
        return None


class _Thing:
    """One trajectory with the declarations of the parameters that it moves."""

    def __init__(self, trajectory: Trajectory, parameters: Mapping[str, ParameterDefinition]) -> None:
        self.trajectory = trajectory
        path, channels = trajectory.path, trajectory.channels
        self._declared = _declared_of(trajectory, parameters)
        moves = set(_GROUND) <= set(channels) and len(trajectory.keyframes) > 1
        facing = _facing(self._declared)
        follows = trajectory.facing or ("kept" if facing == "yaw" else "path")
        self._faces = facing if moves and facing not in channels and follows == "path" else None
        self._walks = moves and _GAIT in self._declared and _GAIT not in channels
        #: Paths that follow the trajectory. The gait's parameter remains free: it is the phase at which the walk begins.
        self.moved = tuple(f"{path}.{name}" for name in (*channels, *filter(None, (self._faces,))))
        self._angles = frozenset(name for name in channels if self._declared[name].type is ParameterType.ANGLE)
        self._keys = [
            [(trajectory.key(index, name), keyframe[name]) for index, keyframe in enumerate(trajectory.keyframes)]
            for name in (TIME, *channels)
        ]

    def _numbers(self, assignment: Mapping[str, Value]) -> tuple[tuple[float, ...], ...]:
        """Return the keyframes' times, then each channel: the variant's values, else those of the keyframes."""
        get = assignment.get
        return tuple(tuple(float(get(path, value)) for path, value in row) for row in self._keys)

    def in_order(self, assignment: Mapping[str, Value]) -> bool:
        times = self._numbers(assignment)[0]
        return all(a < b for a, b in pairwise(times))

    def at(self, assignment: Mapping[str, Value], time: float) -> dict[str, Value]:
        """Return path to value of all parameters that follow the trajectory, at a time in seconds."""
        trajectory = self.trajectory
        time -= float(assignment.get(trajectory.start, 0.0))
        track = _track(trajectory.interpolation, trajectory.channels, self._angles, self._numbers(assignment))
        numbers = {name: spline.value(time) for name, spline in track.splines.items()}
        if self._faces:
            direction = track.direction(time)
            if direction is not None:
                numbers[self._faces] = direction
        if self._walks:
            phase = float(assignment.get(f"{trajectory.path}.{_GAIT}", self._declared[_GAIT].default))
            numbers[_GAIT] = (phase + track.walked(time) / trajectory.stride_m) % 1.0
        return {f"{trajectory.path}.{name}": self._rounded(name, value) for name, value in numbers.items()}

    def _rounded(self, name: str, value: float) -> float:
        number = round(value, _DECIMALS)
        return number % TURN if self._declared[name].type is ParameterType.ANGLE else number

    def held(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Return the values, each clipped to its declared range."""
        within: dict[str, Value] = {}
        for path, value in values.items():
            definition = self._declared[path.removeprefix(f"{self.trajectory.path}.")]
            low, high = definition.minimum, definition.maximum
            if definition.type is ParameterType.ANGLE and low is not None and high is not None:
                angle = wrap(float(value), low)
                # Beyond both ends, take the nearer end.
                within[path] = angle if angle <= high else (high if angle - high < low + TURN - angle else low)
            else:
                within[path] = min(
                    max(float(value), -math.inf if low is None else low), math.inf if high is None else high
                )
        return within

    def outside(self, values: Mapping[str, Value]) -> str | None:
        """Return a sentence about the first value outside its declared range; None if all are inside."""
        for path, value in values.items():
            definition = self._declared[path.removeprefix(f"{self.trajectory.path}.")]
            try:
                definition.check(value)
            except InvalidInput:
                return f"{definition.name} leaves its range {definition.range_text}"
        return None


@dataclass(frozen=True, slots=True)
class _Track:
    """The splines of one target in one variant, by channel; angles unwrapped, degrees."""

    times: tuple[float, ...]
    splines: Mapping[str, Spline]

    def direction(self, time: float) -> float | None:
        """Return the heading of the movement over the ground, degrees; None if nothing ever moves.

        At rest, it is the heading of the last movement, else of the next one.
        """
        x, y = (self.splines[name] for name in _GROUND)
        heading = _heading(x.velocity(time), y.velocity(time))
        ended = max(bisect_right(self.times, time) - 1, 0)
        # Evaluate just before an end and just after a start, since the velocity next to a pause may be 0 at the keyframe.
        for stretch, share in ((k, _BEFORE if k < ended else _AFTER) for k in self._by_nearness(ended)):
            if heading is not None:
                break
            begin, end = self.times[stretch : stretch + 2]
            moment = begin + share * (end - begin)
            heading = _heading(x.velocity(moment, stretch), y.velocity(moment, stretch))
        return heading

    def _by_nearness(self, ended: int) -> Iterator[int]:
        """Yield the stretches that have ended, the latest first, then the others."""
        yield from range(min(ended, len(self.times) - 1) - 1, -1, -1)
        yield from range(ended, len(self.times) - 1)

    def walked(self, time: float) -> float:
        """Return the metres over the ground from the first keyframe to a time in seconds."""
        x, y = (self.splines[name] for name in _GROUND)
        total = 0.0
        for index in range(len(self.times) - 1):
            begin, end = self.times[index : index + 2]
            h = min(end, time) - begin
            if h <= 0.0:
                break
            for node, weight in zip(_NODES, _WEIGHTS, strict=True):
                moment = begin + float(node) * h
                total += h * float(weight) * math.hypot(x.velocity(moment, index), y.velocity(moment, index))
        return total


@lru_cache(maxsize=256)
def _track(
    interpolation: str, channels: tuple[str, ...], angles: frozenset[str], numbers: tuple[tuple[float, ...], ...]
) -> _Track:
    times, *values = numbers
    by_name = {name: unwrapped(row) if name in angles else row for name, row in zip(channels, values, strict=True)}
    position = [row for name, row in by_name.items() if name.startswith("pos.")]
    splines: dict[str, Spline] = {}
    for name, row in by_name.items():
        if interpolation == "linear":
            splines[name] = linear(times, row)
        else:
            # A position rests only if all coordinates do: in a bend, one of them may pause.
            coordinates = position if name.startswith("pos.") else [row]
            resting = [
                all(coordinate[k] == coordinate[k + 1] for coordinate in coordinates) for k in range(len(times) - 1)
            ]
            splines[name] = smooth(times, row, resting)
    return _Track(times, splines)


def _heading(vx: float, vy: float) -> float | None:
    """Return the heading in degrees of a velocity: 0 faces +y, counter-clockwise seen from above; None at rest."""
    return math.degrees(math.atan2(-vx, vy)) if math.hypot(vx, vy) > _STANDING else None


def _declared_of(
    trajectory: Trajectory, parameters: Mapping[str, ParameterDefinition]
) -> dict[str, ParameterDefinition]:
    """Return the declarations of the target's parameters, by attribute."""
    prefix = f"{trajectory.path}."
    return {path.removeprefix(prefix): definition for path, definition in parameters.items() if path.startswith(prefix)}


def _facing(names: Container[str]) -> str | None:
    return next((name for name in _FACING if name in names), None)


def _parameters(
    trajectories: Sequence[Trajectory], parameters: Mapping[str, ParameterDefinition], start: float
) -> Iterator[ParameterDefinition]:
    yield _seconds(TIME_PATH, start, "time of the first frame")
    for trajectory in trajectories:
        yield _seconds(trajectory.start, 0.0, f"start of the trajectory of {trajectory.name}")
        for index, keyframe in enumerate(trajectory.keyframes):
            yield _seconds(
                trajectory.key(index, TIME), keyframe[TIME], "time of the keyframe after the trajectory's start"
            )
            for name in trajectory.channels:
                channel = parameters[f"{trajectory.path}.{name}"]
                path = trajectory.key(index, name)
                own = {"name": path.removeprefix(f"{ROOT}."), "path": path, "default": keyframe[name]}
                yield channel.model_copy(update={**own, "description": f"{channel.description} (keyframe)".strip()})


def _seconds(path: str, default: float, description: str) -> ParameterDefinition:
    return ParameterDefinition(
        path=path,
        type=ParameterType.FLOAT,
        minimum=-MAX_TIME_S,
        maximum=MAX_TIME_S,
        unit="s",
        default=default,
        affects=Affects.GEOMETRY,
        description=description,
    )
