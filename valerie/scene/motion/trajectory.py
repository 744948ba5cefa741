"""Trajectories: where things are over time, by keyframes (paper, table 1: T(t) of vehicles, humans and sensors).

A trajectory moves one thing: a node that the manifest declares movable, or a camera. Its keyframes give values of parameters
that the manifest declares for it, at times in seconds; between them run splines (`valerie.scene.motion.splines`). Each value
of a keyframe is itself a parameter, ``person-1.trajectory.key-2.pos.x``, and so is the start, ``person-1.trajectory.start``.

A scene at a moment is an assignment like any other: `Motion.at` puts the values of that moment in the place of the trajectory's
parameters. Products are therefore shared by what is seen, and what stands still is made once.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import TURN, Affects, ParameterDefinition, ParameterType, Value, wrap
from valerie.scene.graph.naming import ROOT
from valerie.scene.motion.splines import Spline, linear, smooth, unwrapped

#: The moment of a variant's first frame, a parameter of every run that knows time.
TIME_PATH: Final = f"{ROOT}.time"
#: Name of the time in a keyframe, and below a keyframe's path.
TIME: Final = "time"
#: Times lie within this many seconds of 0.
MAX_TIME_S: Final = 86_400.0
#: Metres that a pedestrian walks in one gait cycle of two steps, unless the trajectory says otherwise: the mean of adults
#: (J. Perry, "Gait Analysis: Normal and Pathological Function", 1992).
STRIDE_M: Final = 1.41
#: Below this speed (m/s) a thing stands and faces where it last went.
_STANDING: Final = 1e-6
#: Computed values are rounded to this many decimals (a micrometre, a millionth of a degree), so that processes on different
#: machines mean the same scene.
_DECIMALS: Final = 6
#: Where in a stretch its first and last direction is read.
_AFTER, _BEFORE = 1e-4, 1.0 - 1e-4
_GROUND: Final = ("pos.x", "pos.y")
_FACING: Final = ("heading", "yaw")
_GAIT: Final = "gait_phase"
#: Nodes and weights of Gauss's quadrature on 0…1, for lengths of paths.
_NODES, _WEIGHTS = (
    0.5 * (part + shift) for part, shift in zip(np.polynomial.legendre.leggauss(8), (1.0, 0.0), strict=True)
)


class Trajectory(BaseModel):
    """Where one thing is over time.

    Attributes:
        path: of the thing, e.g. ``scene.person-1`` or ``scene.camera-1``.
        keyframes: in the order of time; each has ``time`` (s) and the same parameters of the thing, e.g. ``pos.x``, in
            their declared units. Angles turn the shortest way.
        interpolation: ``smooth`` (continuous velocity) or ``linear``. Equal positions in two keyframes are a pause.
        facing: ``path``: heading (yaw of a camera) follows the direction of movement; ``kept``: it does not. By default what
            has a heading faces its path and cameras do not; keyframes that give the angle decide it in any case.
        stride_m: metres walked in one gait cycle of two steps, where the thing has a ``gait_phase`` that no keyframe gives.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    path: str
    keyframes: Annotated[tuple[dict[str, float], ...], Field(min_length=1, max_length=1000)]
    interpolation: Literal["smooth", "linear"] = "smooth"
    facing: Literal["path", "kept"] | None = None
    stride_m: Annotated[float, Field(gt=0, le=100)] = STRIDE_M

    @property
    def name(self) -> str:
        """The thing without ``scene.``, as people call it."""
        return self.path.removeprefix(f"{ROOT}.")

    @property
    def start(self) -> str:
        """Path of the parameter that says when time 0 of the keyframes is."""
        return f"{self.path}.trajectory.start"

    def key(self, index: int, channel: str) -> str:
        """Path of what keyframe ``index`` (from 0; people count from 1) says of a channel or of its time."""
        return f"{self.path}.trajectory.key-{index + 1}.{channel}"

    @property
    def channels(self) -> tuple[str, ...]:
        """What the keyframes give besides the time."""
        return tuple(name for name in self.keyframes[0] if name != TIME)


def check_keyframes(trajectory: Trajectory, parameters: Mapping[str, ParameterDefinition], *, field: str = "") -> None:
    """Refuse a trajectory whose keyframes do not fit the parameters of what it moves.

    Args:
        trajectory: to check.
        parameters: path to declaration, of the whole asset.
        field: of the trajectory, for errors.

    Raises:
        UnknownName: a keyframe gives a parameter that is not declared for the thing.
        InvalidInput: keyframes differ in what they give, leave a range, or are not in the order of time.
    """
    declared = _declared_of(trajectory, parameters)
    numbers = [name for name, one in declared.items() if one.type in (ParameterType.FLOAT, ParameterType.ANGLE)]
    last = -math.inf
    for index, keyframe in enumerate(trajectory.keyframes):
        place = f"{field}.keyframes.{index}"
        if TIME not in keyframe:
            raise InvalidInput("a keyframe has a time", field=place, limit="time: 0 s")
        for name, value in keyframe.items():
            if name == TIME:
                continue
            if name not in numbers:
                raise UnknownName(f"number of {trajectory.name}", name, numbers, field=f"{place}.{name}")
            declared[name].check(value, field=f"{place}.{name}")
        if set(keyframe) != set(trajectory.keyframes[0]):
            raise InvalidInput(
                "all keyframes give the same parameters",
                field=place,
                value=", ".join(keyframe),
                limit=", ".join(trajectory.keyframes[0]),
            )
        time = keyframe[TIME]
        if not -MAX_TIME_S <= time <= MAX_TIME_S:
            raise InvalidInput("out of bounds", field=f"{place}.time", value=time, limit=f"±{MAX_TIME_S:g} s")
        if time <= last:
            raise InvalidInput(
                "keyframes follow each other in time", field=f"{place}.time", value=time, limit=f"> {last:g} s"
            )
        last = time
    if not trajectory.channels:
        raise InvalidInput("the keyframes give nothing but times", field=f"{field}.keyframes", limit="as pos.x: 2 m")
    if trajectory.facing == "path" and not (set(_GROUND) <= set(trajectory.channels) and _facing(declared)):
        raise InvalidInput(
            "what faces its path has pos.x and pos.y in its keyframes, and a heading or yaw of its own",
            field=f"{field}.facing",
            value="path",
        )


class Motion:
    """All trajectories of a run over the parameters of its asset.

    Args:
        trajectories: at most one for each thing, each checked (`check_keyframes`).
        parameters: path to declaration, of the whole asset.
        start: the moment of the first frame, in seconds, unless a variant says otherwise.

    Attributes:
        parameters: declarations of the time, and of all that the trajectories say.
        moved: paths whose values follow trajectories; a variant cannot give them.
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
        """The assignment of one moment: path to value, without time and trajectories.

        Args:
            assignment: of a variant.
            elapsed: seconds since the variant's first frame.
            within: hold values at the ends of their declared ranges, for moments that no frame is taken at.

        Raises:
            InvalidInput: the variant puts keyframes out of order.
        """
        found = {path: value for path, value in assignment.items() if path not in self._own}
        time = self.seconds(assignment, elapsed)
        for thing in self._things:
            values = thing.at(assignment, time)
            found |= thing.held(values) if within else values
        return found

    def seconds(self, assignment: Mapping[str, Value], elapsed: float) -> float:
        """The moment that lies ``elapsed`` seconds after a variant's first frame."""
        return round(float(assignment.get(TIME_PATH, self._start)) + elapsed, _DECIMALS)

    def rejection(self, assignment: Mapping[str, Value], elapsed: Sequence[float]) -> str | None:
        """Why the movement of a variant cannot be, in words; None if it can.

        Args:
            assignment: of a variant.
            elapsed: moments that are looked at.
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
    """One trajectory with the declarations of what it moves."""

    def __init__(self, trajectory: Trajectory, parameters: Mapping[str, ParameterDefinition]) -> None:
        self.trajectory = trajectory
        path, channels = trajectory.path, trajectory.channels
        self._declared = _declared_of(trajectory, parameters)
        moves = set(_GROUND) <= set(channels) and len(trajectory.keyframes) > 1
        facing = _facing(self._declared)
        follows = trajectory.facing or ("kept" if facing == "yaw" else "path")
        self._faces = facing if moves and facing not in channels and follows == "path" else None
        self._walks = moves and _GAIT in self._declared and _GAIT not in channels
        #: Paths that follow the trajectory. The gait's own parameter stays: it says where in the cycle the walk begins.
        self.moved = tuple(f"{path}.{name}" for name in (*channels, *filter(None, (self._faces,))))
        self._angles = frozenset(name for name in channels if self._declared[name].type is ParameterType.ANGLE)
        self._keys = [
            [(trajectory.key(index, name), keyframe[name]) for index, keyframe in enumerate(trajectory.keyframes)]
            for name in (TIME, *channels)
        ]

    def _numbers(self, assignment: Mapping[str, Value]) -> tuple[tuple[float, ...], ...]:
        """Times, then each channel: what the variant says of the keyframes, else what they say themselves."""
        get = assignment.get
        return tuple(tuple(float(get(path, value)) for path, value in row) for row in self._keys)

    def in_order(self, assignment: Mapping[str, Value]) -> bool:
        times = self._numbers(assignment)[0]
        return all(a < b for a, b in pairwise(times))

    def at(self, assignment: Mapping[str, Value], time: float) -> dict[str, Value]:
        """Path to value of all that follows the trajectory, at a time in seconds."""
        trajectory = self.trajectory
        time -= float(assignment.get(trajectory.start, 0.0))
        track = _track(trajectory.interpolation, trajectory.channels, self._angles, self._numbers(assignment))
        found = {name: spline.value(time) for name, spline in track.splines.items()}
        if self._faces:
            direction = track.direction(time)
            if direction is not None:
                found[self._faces] = direction
        if self._walks:
            begun = float(assignment.get(f"{trajectory.path}.{_GAIT}", self._declared[_GAIT].default))
            found[_GAIT] = (begun + track.walked(time) / trajectory.stride_m) % 1.0
        return {f"{trajectory.path}.{name}": self._rounded(name, value) for name, value in found.items()}

    def _rounded(self, name: str, value: float) -> float:
        rounded = round(value, _DECIMALS)
        return rounded % TURN if self._declared[name].type is ParameterType.ANGLE else rounded

    def held(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """The values, none of them beyond its declared range."""
        held: dict[str, Value] = {}
        for path, value in values.items():
            definition = self._declared[path.removeprefix(f"{self.trajectory.path}.")]
            low, high = definition.minimum, definition.maximum
            if definition.type is ParameterType.ANGLE and low is not None and high is not None:
                turned = wrap(float(value), low)
                # Beyond both ends: the nearer one.
                held[path] = turned if turned <= high else (high if turned - high < low + TURN - turned else low)
            else:
                held[path] = min(
                    max(float(value), -math.inf if low is None else low), math.inf if high is None else high
                )
        return held

    def outside(self, values: Mapping[str, Value]) -> str | None:
        """In words which declared range is left."""
        for path, value in values.items():
            definition = self._declared[path.removeprefix(f"{self.trajectory.path}.")]
            try:
                definition.check(value)
            except InvalidInput:
                return f"{definition.name} leaves its range {definition.range_text}"
        return None


@dataclass(frozen=True, slots=True)
class _Track:
    """The splines of one thing in one variant, by channel; angles unwrapped, degrees."""

    times: tuple[float, ...]
    splines: Mapping[str, Spline]

    def direction(self, time: float) -> float | None:
        """Heading of the movement over the ground, degrees; while it stands, of the last movement, else of the next one.

        None where nothing ever moves.
        """
        x, y = (self.splines[name] for name in _GROUND)
        found = _heading(x.velocity(time), y.velocity(time))
        ended = max(bisect_right(self.times, time) - 1, 0)
        # Just before an end and just after a beginning, since the velocity of a pause's neighbours may be 0 at the keyframe.
        for stretch, share in ((k, _BEFORE if k < ended else _AFTER) for k in self._by_nearness(ended)):
            if found is not None:
                break
            begin, end = self.times[stretch : stretch + 2]
            moment = begin + share * (end - begin)
            found = _heading(x.velocity(moment, stretch), y.velocity(moment, stretch))
        return found

    def _by_nearness(self, ended: int) -> Iterator[int]:
        """Stretches that have ended, the latest first, then the others."""
        yield from range(min(ended, len(self.times) - 1) - 1, -1, -1)
        yield from range(ended, len(self.times) - 1)

    def walked(self, time: float) -> float:
        """Metres over the ground from the first keyframe to a time in seconds."""
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
    by_name = {
        name: unwrapped(given) if name in angles else given for name, given in zip(channels, values, strict=True)
    }
    position = [given for name, given in by_name.items() if name.startswith("pos.")]
    splines: dict[str, Spline] = {}
    for name, given in by_name.items():
        if interpolation == "linear":
            splines[name] = linear(times, given)
        else:
            # A position rests as a whole: one coordinate may pause in a bend.
            together = position if name.startswith("pos.") else [given]
            resting = [all(one[k] == one[k + 1] for one in together) for k in range(len(times) - 1)]
            splines[name] = smooth(times, given, resting)
    return _Track(times, splines)


def _heading(vx: float, vy: float) -> float | None:
    """0 faces +y, counter-clockwise seen from above."""
    return math.degrees(math.atan2(-vx, vy)) if math.hypot(vx, vy) > _STANDING else None


def _declared_of(
    trajectory: Trajectory, parameters: Mapping[str, ParameterDefinition]
) -> dict[str, ParameterDefinition]:
    """Return the declarations of what a trajectory moves, by attribute."""
    prefix = f"{trajectory.path}."
    return {path.removeprefix(prefix): definition for path, definition in parameters.items() if path.startswith(prefix)}


def _facing(declared: Mapping[str, Any]) -> str | None:
    return next((name for name in _FACING if name in declared), None)


def _parameters(
    trajectories: Sequence[Trajectory], parameters: Mapping[str, ParameterDefinition], start: float
) -> Iterator[ParameterDefinition]:
    yield _seconds(TIME_PATH, start, "of the first frame")
    for trajectory in trajectories:
        yield _seconds(trajectory.start, 0.0, f"when the trajectory of {trajectory.name} begins")
        for index, keyframe in enumerate(trajectory.keyframes):
            yield _seconds(trajectory.key(index, TIME), keyframe[TIME], "of the keyframe, after the trajectory's start")
            for name in trajectory.channels:
                channel = parameters[f"{trajectory.path}.{name}"]
                path = trajectory.key(index, name)
                changed = {"name": path.removeprefix(f"{ROOT}."), "path": path, "default": keyframe[name]}
                yield channel.model_copy(update={**changed, "description": f"{channel.description} (keyframe)".strip()})


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
