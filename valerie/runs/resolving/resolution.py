"""Resolve a spec against its asset: look up every name and convert every number, without enumerating the variants."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from functools import partial
from typing import Final, NamedTuple

from valerie import plugins
from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.parameters.assignment import canonical_json
from valerie.parameters.blocks import GRID, POINTS, Block, Variation, at
from valerie.parameters.definitions import ParameterDefinition, Value
from valerie.parameters.distributions import Distribution, Homogeneous
from valerie.parameters.samplers import SAMPLERS, SamplerFactory
from valerie.parameters.space import ParameterSpace
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.document.run_spec import BlockDocument, RunSpec
from valerie.runs.document.varied import Varied
from valerie.runs.resolving.backgrounds import few_backgrounds
from valerie.runs.resolving.motion import Times, resolve_times
from valerie.runs.resolving.oversights import oversights, sensor_warnings, shortfall
from valerie.runs.resolving.requirements import Requirement, resolve_requirements
from valerie.runs.resolving.sensors import SensorNeeds, focal_length_path, needs_of
from valerie.runs.resolving.vocabulary import Vocabulary
from valerie.scene.assets.manifest import Manifest
from valerie.scene.legality.rejection import rejection_reason, rejection_reasons
from valerie.scene.light.solar import require_one_notation
from valerie.sensing.settings import Distortion

#: Largest number of variants of a run, unless the caller sets another limit.
MAX_VARIANTS: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class ResolvedRun:
    """A spec that can be computed on its asset.

    Attributes:
        spec, manifest, asset_digest: the arguments of `resolve`.
        definitions: all parameters of the asset, with the spec's names and narrowed ranges.
        space: the variants.
        cameras: names, in the spec's order.
        engine_inputs: all settings of the renderer that change its pixels; empty for an engine without settings.
        annotations: those that the spec names and those that its sensors need.
        times: the moments of each variant, and what moves.
        requirements: requirements that the run is judged by.
        warnings: properties of the spec that its author may not have intended.
        notes: assumptions made where the spec leaves something open.
    """

    spec: RunSpec
    manifest: Manifest
    asset_digest: str
    definitions: tuple[ParameterDefinition, ...]
    space: ParameterSpace
    cameras: tuple[str, ...]
    engine_inputs: Mapping[str, Value] = field(default_factory=dict)
    annotations: tuple[AnnotationKind, ...] = ()
    times: Times = field(default_factory=Times)
    requirements: tuple[Requirement, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def at(self, assignment: Mapping[str, Value], time_index: int) -> Mapping[str, Value]:
        """Return the assignment of one frame: path to value at the frame's moment, for `split` and `apply`.

        Args:
            assignment: assignment of the variant; returned unchanged in a run without time.
            time_index: index of the frame, from 0.
        """
        motion = self.times.motion
        return assignment if motion is None else motion.at(assignment, self.times.elapsed[time_index])

    def near(self, assignment: Mapping[str, Value], time_index: int, seconds: float) -> Mapping[str, Value]:
        """Return the assignment ``seconds`` after a frame's moment, with values clamped to their declared ranges."""
        motion = self.times.motion
        if motion is None:
            return assignment
        return motion.at(assignment, self.times.elapsed[time_index] + seconds, within=True)

    def around(self, assignment: Mapping[str, Value], time_index: int) -> Course:
        """Return the motion of a variant around a frame's moment."""
        motion = self.times.motion
        values = {} if motion is None else {path: value for path, value in assignment.items() if motion.owns(path)}
        return Course(
            partial(self.near, assignment, time_index), canonical_json([self.seconds(assignment, time_index), values])
        )

    def seconds(self, assignment: Mapping[str, Value], time_index: int) -> float:
        """Return the moment of a frame in seconds; 0 in a run without time."""
        motion = self.times.motion
        return 0.0 if motion is None else motion.seconds(assignment, self.times.elapsed[time_index])

    @property
    def infers_backgrounds(self) -> bool:
        """True if functions also see each background without movables (``infer_backgrounds`` of the spec)."""
        chosen = self.spec.infer_backgrounds
        return few_backgrounds(self.space, self.manifest, self.cameras, self.times) if chosen is None else chosen

    def rejection(self, assignment: Mapping[str, Value], moments: Sequence[int] | None = None) -> str | None:
        """Return the reason why a variant is rejected; None if it is legal.

        Args:
            assignment: assignment of the variant.
            moments: indexes of the moments of its sequence to look at; None: all.
        """
        if reason := self.space.violated(assignment):
            return reason
        motion = self.times.motion
        if motion is None:
            return rejection_reason(assignment, self.manifest)
        moments = range(len(self.times.elapsed)) if moments is None else moments
        if reason := motion.rejection(assignment, [self.times.elapsed[index] for index in moments]):
            return reason
        reasons = rejection_reasons([self.at(assignment, index) for index in moments], self.manifest)
        found = ((index, reason) for index, reason in zip(moments, reasons, strict=True) if reason)
        return next((f"{reason} at {self.seconds(assignment, index):g} s" for index, reason in found), None)

    def rejections(
        self, assignments: Sequence[Mapping[str, Value]], moments: Sequence[int] | None = None
    ) -> list[str | None]:
        """Return the `rejection` of each variant, in less time than one by one."""
        if self.times.motion is not None:
            return [self.rejection(assignment, moments) for assignment in assignments]
        reasons = rejection_reasons(assignments, self.manifest)
        return [self.space.violated(a) or reason for a, reason in zip(assignments, reasons, strict=True)]


class Course(NamedTuple):
    """The motion of a variant around a frame's moment.

    Attributes:
        near: returns the assignment a number of seconds later.
        values: canonical JSON of the moment and of the variant's own times and keyframes, which determine the results of
            ``near`` within one run.
    """

    near: Callable[[float], Mapping[str, Value]]
    values: bytes


def resolve(
    spec: RunSpec,
    manifest: Manifest,
    *,
    asset_digest: str = "",
    engines: Collection[str] | None = None,
    functions: Collection[str] | None = None,
    max_variants: int | None = MAX_VARIANTS,
    samplers: Mapping[str, SamplerFactory] = SAMPLERS,
) -> ResolvedRun:
    """Check a spec against its asset.

    Args:
        spec: the spec.
        manifest: manifest of ``spec.asset``.
        asset_digest: digest of ``spec.asset``.
        engines: known names; None accepts any, since a stored run may outlive an installed engine.
        functions: known names; None accepts any.
        max_variants: limit, checked by arithmetic before anything is built; None for no limit.
        samplers: name to sampler, for the designs that draw variants.

    Raises:
        InvalidInputs: every problem, each with its dotted field.
    """
    problems: list[InvalidInput] = []
    times = resolve_times(spec, manifest, problems)
    vocabulary = Vocabulary(spec, manifest, times.motion, problems)
    engine_inputs = _engine_inputs(spec, engines, problems)
    _check_names(spec, manifest, functions, problems)
    resolver = _SpaceResolver(vocabulary, samplers, max_variants)
    space = resolver.space()
    _check_annotations(spec, times, problems)
    if space is None or problems:
        raise InvalidInputs([_as_written(spec, problem) for problem in problems])
    _check_size(spec, space, times, max_variants)
    used = space.used
    cameras = spec.cameras if spec.cameras is not None else manifest.cameras
    needs = [needs_of(sensor, used) for sensor in spec.sensors]
    _check_focal_lengths(needs, cameras, manifest, problems)
    _check_rolling_shutters(spec, used, problems)
    _check_sun(space, problems)
    definitions = tuple(vocabulary.definitions.values())
    requirements = resolve_requirements(spec, definitions, cameras, problems)
    if problems:
        raise InvalidInputs([_as_written(spec, problem) for problem in problems])
    moves = times.motion is not None
    return ResolvedRun(
        spec=spec,
        manifest=manifest,
        asset_digest=asset_digest,
        definitions=definitions,
        space=space,
        cameras=cameras,
        engine_inputs=engine_inputs,
        annotations=_annotations(spec, needs, moves=moves),
        times=times,
        requirements=requirements,
        warnings=(
            *resolver.warnings,
            *sensor_warnings(spec, needs, moves=moves),
            *oversights(vocabulary, space, times, requirements),
        ),
        notes=tuple(vocabulary.notes()),
    )


def _engine_inputs(spec: RunSpec, engines: Collection[str] | None, problems: list[InvalidInput]) -> Mapping[str, Value]:
    if engines is not None and spec.engine not in engines:
        problems.append(plugins.unknown_name("renderer", spec.engine, engines, field="renderer"))
        return {}
    try:
        return plugins.engine_inputs(spec.engine, spec.engine_settings)
    except InvalidInputs as error:
        problems += error.problems
        return {}


def _check_names(
    spec: RunSpec, manifest: Manifest, functions: Collection[str] | None, problems: list[InvalidInput]
) -> None:
    for i, function in enumerate(spec.functions):
        if functions is not None and function not in functions:
            problems.append(plugins.unknown_name("function", function, functions, field=f"functions.{i}"))
    for i, camera in enumerate(spec.cameras or ()):
        if camera not in manifest.cameras:
            problems.append(UnknownName("camera", camera, manifest.cameras, field=f"cameras.{i}"))


@dataclass
class _SpaceResolver:
    """Builder of the parameter space of one spec.

    Attributes:
        vocabulary: the names of the spec; its ``problems`` receive every problem.
        samplers: name to sampler, for the designs that draw variants.
        max_variants: see `resolve`.
        warnings: ranges whose maximum is not reached.
    """

    vocabulary: Vocabulary
    samplers: Mapping[str, SamplerFactory]
    max_variants: int | None
    warnings: list[str] = field(default_factory=list)

    def space(self) -> ParameterSpace | None:
        """Return the space, or None if the spec has any problem; constraints are checked in either case."""
        vocabulary, spec, problems = self.vocabulary, self.vocabulary.spec, self.vocabulary.problems
        blocks = [self._block(block, f"blocks.{i}") for i, block in enumerate(spec.blocks)]
        constants = vocabulary.values(spec.constants, "constants")
        # Constraints cannot compare values that follow a trajectory, since no variant sets them.
        moved = () if vocabulary.motion is None else vocabulary.motion.moved
        definitions = {path: d for path, d in vocabulary.definitions.items() if path not in moved}
        aliases = {name: path for name, path in vocabulary.paths.items() if path in definitions}
        for i, text in enumerate(spec.constraints):
            try:
                ParameterSpace(definitions.values(), constraints=[text], aliases=aliases)
            except InvalidInput as problem:
                problems.append(at(f"constraints.{i}", _without_field(problem)))
        if problems:
            return None
        try:
            return ParameterSpace(
                definitions.values(),
                blocks,
                constants=constants,
                constraints=spec.constraints,
                seed=spec.seed,
                samplers=self.samplers,
                aliases=aliases,
            )
        except InvalidInput as problem:
            problems.append(problem)
            return None

    def _block(self, block: BlockDocument, place: str) -> Block:
        """Return the block in the asset's units, without the entries that have a problem."""
        problems = self.vocabulary.problems
        designs = (GRID, POINTS, *self.samplers)
        if block.design not in designs:
            problems.append(plugins.unknown_name("design", block.design, designs, field=f"{place}.design"))
        if self.max_variants is not None and block.count is not None and block.count > self.max_variants:
            problems.append(_too_many(block.count, self.max_variants, f"{place}.count"))
        variations: list[Variation] = []
        for i, varied in enumerate(block.vary):
            try:
                variations.append(self._variation(varied, f"{place}.vary.{i}", block.design))
            except InvalidInput as problem:
                problems.append(problem)
        return Block(
            design=block.design,
            variations=tuple(variations),
            constants=self.vocabulary.values(block.constants, f"{place}.constants"),
            count=block.count,
            points=tuple(self.vocabulary.values(point, f"{place}.points.{i}") for i, point in enumerate(block.points)),
        )

    def _variation(self, varied: Varied, place: str, design: str) -> Variation:
        path = self.vocabulary.path(varied.parameter, place)
        definition = self.vocabulary.definitions[path]
        try:
            distribution = self._distribution(varied, definition, place)
            distribution.check(definition)
        except InvalidInput as problem:
            # Problems with numbers of the spec already carry their whole field; a distribution knows only its own.
            raise (problem if problem.field.startswith(place) else at(place, problem)) from None
        count = distribution.count(definition)
        if self.max_variants is not None and count is not None and count > self.max_variants:
            culprit = "step" if isinstance(distribution, Homogeneous) else "count"
            if design == GRID or culprit == "step":
                raise _too_many(count, self.max_variants, f"{place}.{culprit}", value=getattr(varied, culprit, None))
        if isinstance(distribution, Homogeneous) and not distribution.reaches_maximum():
            self.warnings.append(f"{self.vocabulary.spec.field(place)}: {shortfall(distribution, definition)}")
        return Variation(path, distribution)

    def _distribution(self, varied: Varied, definition: ParameterDefinition, place: str) -> Distribution:
        fields = varied.model_dump(exclude={"parameter", "distribution"}, exclude_none=True)
        arguments: dict[str, Value | tuple[Value, ...]] = {}
        for key, value in fields.items():
            if key == "values":
                arguments[key] = tuple(
                    self.vocabulary.value(item, definition, f"{place}.values.{k}") for k, item in enumerate(value)
                )
            elif key == "value":
                arguments[key] = self.vocabulary.value(value, definition, f"{place}.value")
            elif key == "count":
                arguments[key] = value
            elif not definition.is_number:
                raise InvalidInput(
                    f"{varied.distribution} needs a number, and {definition.name} is {definition.type}",
                    field=f"{place}.distribution", value=varied.distribution, limit="CHOICE or CONSTANT",
                )  # fmt: skip
            else:
                arguments[key] = self.vocabulary.number(value, definition, f"{place}.{key}")
        distribution: Distribution = varied.makes.model_validate(arguments)
        return distribution


def _check_annotations(spec: RunSpec, times: Times, problems: list[InvalidInput]) -> None:
    for i, kind in enumerate(spec.annotations):
        if kind is AnnotationKind.FLOW and times.step is None:
            problem, limit = "flow leads to the next frame of a sequence", "sequence: {frames: …, step: …}"
        elif kind is AnnotationKind.SCAN:
            problem, limit = "made for a sensor with a rolling shutter, and only for it", "shutter: {line_time_us: …}"
        elif kind is AnnotationKind.VELOCITY and times.motion is None:
            problem, limit = "nothing moves in this run", "sequence, time or trajectories"
        else:
            continue
        problems.append(InvalidInput(problem, field=f"annotations.{i}", value=kind.value, limit=limit))


def _check_size(spec: RunSpec, space: ParameterSpace, times: Times, max_variants: int | None) -> None:
    if max_variants is None:
        return
    if space.size > max_variants:
        raise InvalidInputs([_as_written(spec, _too_many(space.size, max_variants, "blocks"))])
    frames = space.size * len(times.elapsed)
    if frames > max_variants:
        problem = f"{space.size:,} variants with {len(times.elapsed):,} moments each are too many"
        limit = f"{max_variants:,} of both together"
        raise InvalidInputs([InvalidInput(problem, field="sequence.frames", value=frames, limit=limit)])


def _check_focal_lengths(
    needs: list[SensorNeeds], cameras: tuple[str, ...], manifest: Manifest, problems: list[InvalidInput]
) -> None:
    undeclared = [camera for camera in cameras if focal_length_path(camera) not in manifest.by_path]
    if not undeclared:
        return
    limit = f"a parameter {focal_length_path(undeclared[0])} in its manifest"
    for i, need in enumerate(needs):
        if need.focal_length is not None:
            problem = f"{need.focal_length} needs the camera's focal length, which the asset does not declare"
            problems.append(InvalidInput(problem, field=f"sensors.{i}", value=undeclared[0], limit=limit))


def _check_sun(space: ParameterSpace, problems: list[InvalidInput]) -> None:
    """Check that the whole spec, constraints included, gives the sun by its angles or by time and place, not both."""
    constrained = {path for constraint in space.constraints for path in constraint.paths}
    try:
        require_one_notation(space.used | constrained)
    except InvalidInput as problem:
        problems.append(problem)


def _check_rolling_shutters(spec: RunSpec, used: Collection[str], problems: list[InvalidInput]) -> None:
    """Check that all rolling shutters read a frame in the same way, since it has only one scan."""
    ways: dict[tuple[float, Distortion], int] = {}
    for i, sensor in enumerate(spec.sensors):
        if sensor.rolls or "sensor.shutter.line_time_us" in used:
            ways.setdefault((sensor.shutter.line_time_us, sensor.distortion), i)
    if "sensor.shutter.line_time_us" in used:  # each variant has one line time for all sensors
        ways = {(0.0, distortion): i for (_, distortion), i in ways.items()}
    if len(ways) > 1:
        problem = "the rolling shutters of one run differ in line time or distortion"
        limit = "one of both; vary sensor.shutter.line_time_us to compare line times"
        problems.append(InvalidInput(problem, field=f"sensors.{max(ways.values())}.shutter.line_time_us", limit=limit))


def _annotations(spec: RunSpec, needs: list[SensorNeeds], *, moves: bool) -> tuple[AnnotationKind, ...]:
    requested = {
        AnnotationKind.VELOCITY: moves and any(need.velocity is not None for need in needs),
        AnnotationKind.SCAN: moves and any(need.scan for need in needs),
    }
    return (*spec.annotations, *(kind for kind, need in requested.items() if need and kind not in spec.annotations))


def _too_many(count: int, limit: int, place: str, value: object = None) -> InvalidInput:
    size = f"{count:,}" if count < 10**15 else f"about {Decimal(count):.0e}"
    return InvalidInput(f"{size} variants are too many", field=place, value=value, limit=f"{limit:,} variants")


def _without_field(problem: InvalidInput) -> InvalidInput:
    if isinstance(problem, UnknownName):
        return UnknownName(problem.kind, problem.name, problem.known, limit=problem.limit)
    return InvalidInput(problem.message, value=problem.value, limit=problem.limit)


def _as_written(spec: RunSpec, problem: InvalidInput) -> InvalidInput:
    """Return the problem with its field as the user wrote it."""
    place = spec.field(problem.field)
    return problem if place == problem.field else at(place, _without_field(problem))
