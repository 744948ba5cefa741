"""A spec against an asset: every name looked up, every number in the asset's units, nothing enumerated."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any, Final

from valerie import plugins
from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.parameters.blocks import GRID, POINTS, Block, Variation, at
from valerie.parameters.definitions import ParameterDefinition, ParameterType, Value
from valerie.parameters.distributions import Distribution, Homogeneous, check_range
from valerie.parameters.samplers import SAMPLERS, SamplerFactory
from valerie.parameters.space import ParameterSpace
from valerie.parameters.units import is_quantity, to_unit
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.engine import Ability, Engine
from valerie.runs.documents import BlockDocument, DeclaredParameter, RunSpec
from valerie.runs.motion import Times, resolve_times
from valerie.runs.sensors import focal_length_path, needed_by
from valerie.runs.varied import Varied
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.naming import ENVIRONMENT_PATH, ROOT
from valerie.scene.legality.rejection import rejection_reason
from valerie.scene.light.solar import ELEVATION, require_one_notation
from valerie.scene.motion.trajectory import TIME_PATH

#: Variants of a run, unless the caller allows another number.
MAX_VARIANTS: Final = 1_000_000

#: Values of a range that are written out in a warning.
_SHOWN: Final = 5


@dataclass(frozen=True, slots=True)
class ResolvedRun:
    """A spec that is known to be computable on its asset.

    Attributes:
        spec, manifest, asset_digest: what was resolved.
        definitions: all of the asset's, with this spec's names and narrowed ranges.
        space: the variants.
        cameras: names, in the spec's order.
        engine_inputs: settings of the renderer that its pixels depend on, complete; empty for one without settings.
        annotations: those that the spec asks for, and those that its sensors need.
        times: the moments of each variant and what moves.
        warnings: what the user may not have meant.
        notes: what was assumed where the spec left it open.
    """

    spec: RunSpec
    manifest: Manifest
    asset_digest: str
    definitions: tuple[ParameterDefinition, ...]
    space: ParameterSpace
    cameras: tuple[str, ...]
    engine_inputs: Mapping[str, Any] = field(default_factory=dict)
    annotations: tuple[AnnotationKind, ...] = ()
    times: Times = field(default_factory=Times)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def at(self, assignment: Mapping[str, Value], time_index: int) -> Mapping[str, Value]:
        """The assignment of one frame: path to value at its moment, as `split` and `apply` take it.

        Args:
            assignment: of the variant; itself the answer in a run without time.
            time_index: of the frame, from 0.
        """
        motion = self.times.motion
        return assignment if motion is None else motion.at(assignment, self.times.elapsed[time_index])

    def near(self, assignment: Mapping[str, Value], time_index: int, seconds: float) -> Mapping[str, Value]:
        """The assignment of the moment so many seconds after a frame, held within declared ranges."""
        motion = self.times.motion
        if motion is None:
            return assignment
        return motion.at(assignment, self.times.elapsed[time_index] + seconds, within=True)

    def seconds(self, assignment: Mapping[str, Value], time_index: int) -> float:
        """When a frame is taken, in seconds; 0 in a run without time."""
        motion = self.times.motion
        return 0.0 if motion is None else motion.seconds(assignment, self.times.elapsed[time_index])

    def rejection(self, assignment: Mapping[str, Value]) -> str | None:
        """Why no frame is made of a variant, in words; None if it is legal at every moment of its sequence."""
        reason = self.space.violated(assignment)
        if reason is not None or self.times.motion is None:
            return reason or rejection_reason(assignment, self.manifest)
        if reason := self.times.motion.rejection(assignment, self.times.elapsed):
            return reason
        for index in range(len(self.times.elapsed)):
            if reason := rejection_reason(self.at(assignment, index), self.manifest):
                return f"{reason} at {self.seconds(assignment, index):g} s"
        return None


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
        spec: what was asked for.
        manifest: of ``spec.asset``.
        asset_digest: of ``spec.asset``; handed on.
        engines: known names; None takes any, since a stored run outlives what was installed.
        functions: known names, or None.
        max_variants: checked by arithmetic before anything is made; None for no limit.
        samplers: name to sampler, of the designs that draw.

    Raises:
        InvalidInputs: every problem, each with its dotted field.
    """
    resolver = _Resolver(spec, manifest)
    times = resolver.times
    definitions = resolver.definitions()
    engine_inputs: Mapping[str, Any] = {}
    if engines is not None and spec.engine not in engines:
        resolver.problems.append(plugins.unknown_name("renderer", spec.engine, engines, field="renderer"))
    else:
        try:
            engine_inputs = plugins.engine_inputs(spec.engine, spec.engine_settings)
        except InvalidInputs as error:
            resolver.problems += error.problems
    for i, function in enumerate(spec.functions):
        if functions is not None and function not in functions:
            unknown = plugins.unknown_name("function", function, functions, field=f"functions.{i}")
            resolver.problems.append(unknown)
    for i, camera in enumerate(spec.cameras or ()):
        if camera not in manifest.cameras:
            resolver.problems.append(UnknownName("camera", camera, manifest.cameras, field=f"cameras.{i}"))
    blocks = [resolver.block(block, f"blocks.{i}", max_variants, samplers) for i, block in enumerate(spec.blocks)]
    constants = resolver.values(spec.constants, "constants")
    space = resolver.space(definitions, blocks, constants, samplers)
    resolver.check_annotations()
    if space is None or resolver.problems:
        raise InvalidInputs([_placed(spec, problem) for problem in resolver.problems])
    if max_variants is not None and space.size > max_variants:
        raise InvalidInputs([_placed(spec, _too_many(space.size, max_variants, "blocks"))])
    frames = space.size * len(times.elapsed)
    if max_variants is not None and frames > max_variants:
        problem = f"{space.size:,} variants with {len(times.elapsed):,} moments each are too many"
        limit = f"{max_variants:,} of both together"
        raise InvalidInputs([_placed(spec, InvalidInput(problem, field="sequence.frames", value=frames, limit=limit))])
    resolver.check_sensors(space)
    resolver.check_sun(space)
    if resolver.problems:
        raise InvalidInputs([_placed(spec, problem) for problem in resolver.problems])
    resolver.look_for_oversights(space)
    return ResolvedRun(
        spec=spec,
        manifest=manifest,
        asset_digest=asset_digest,
        definitions=definitions,
        space=space,
        cameras=spec.cameras if spec.cameras is not None else manifest.cameras,
        engine_inputs=engine_inputs,
        annotations=resolver.annotations(),
        times=times,
        warnings=tuple(resolver.warnings),
        notes=tuple(resolver.notes()),
    )


@dataclass
class _Resolver:
    """Collects problems, warnings and assumed units on the way through one spec."""

    spec: RunSpec
    manifest: Manifest
    problems: list[InvalidInput] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    times: Times = field(init=False)
    _engine: Engine | None = field(init=False)
    _needs_velocity: bool = False
    _by_path: dict[str, ParameterDefinition] = field(default_factory=dict)
    #: Every name, of the asset and of the spec, and every path to its path.
    _paths: dict[str, str] = field(default_factory=dict)
    #: Parameters that were given numbers without unit.
    _unitless: dict[str, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.times = resolve_times(self.spec, self.manifest, self.problems)
        self._engine = plugins.known_engine(self.spec.engine)

    def definitions(self) -> tuple[ParameterDefinition, ...]:
        """The asset's declarations and those of time and trajectories, with the spec's own names and ranges in force."""
        of_time = () if self.times.motion is None else self.times.motion.parameters
        self._by_path = {definition.path: definition for definition in (*self.manifest.parameters, *of_time)}
        risen = self._by_path.get(ELEVATION)
        if not self._shows(Ability.NIGHT) and risen is not None and risen.minimum is not None:
            self._by_path[ELEVATION] = risen.model_copy(update={"minimum": max(risen.minimum, 0.0)})
        self._paths = {definition.name: path for path, definition in self._by_path.items()}
        self._paths |= {path: path for path in self._by_path}
        declared: dict[str, int] = {}
        for i, parameter in enumerate(self.spec.parameters):
            try:
                self._declare(parameter, f"parameters.{i}", declared, i)
            except InvalidInput as problem:
                self.problems.append(problem)
        return tuple(self._by_path.values())

    def _declare(self, parameter: DeclaredParameter, place: str, declared: dict[str, int], i: int) -> None:
        path = self._path(parameter.path, f"{place}.path")
        if path in declared:
            raise InvalidInput(f"declared already as parameters.{declared[path]}", field=f"{place}.path", value=path)
        declared[path] = i
        if self._paths.get(parameter.name, path) != path:
            raise InvalidInput(
                "the name belongs to another parameter of the asset", field=f"{place}.name", value=parameter.name
            )
        asset = self._by_path[path]
        # The name counts from here on, so that a wrong range does not make every use of it an unknown name.
        self._paths[parameter.name] = path
        self._by_path[path] = asset.model_copy(update={"name": parameter.name})
        if parameter.type is not asset.type:
            raise InvalidInput(
                "the asset declares another type",
                field=f"{place}.type",
                value=parameter.type.value,
                limit=asset.type.value,
            )
        self._by_path[path] = self._narrowed(parameter, asset, place)

    def _narrowed(self, parameter: DeclaredParameter, asset: ParameterDefinition, place: str) -> ParameterDefinition:
        change: dict[str, Any] = {"name": parameter.name}
        if parameter.choices:
            for k, choice in enumerate(parameter.choices):
                asset.check(choice, field=f"{place}.choices.{k}")
            if len(set(parameter.choices)) != len(parameter.choices):
                raise InvalidInput("a choice stands twice", field=f"{place}.choices", value=list(parameter.choices))
            change["choices"] = parameter.choices
        for end in ("minimum", "maximum"):
            written = getattr(parameter, end)
            if written is None:
                continue
            if not asset.is_number:
                raise InvalidInput(f"a {asset.type} parameter has no range", field=f"{place}.{end}", value=written)
            change[end] = self._number(written, asset, f"{place}.{end}")
        narrowed = asset.model_copy(update=change)
        low, high = narrowed.minimum, narrowed.maximum
        if low is not None and high is not None:
            if low > high:
                raise InvalidInput("the minimum is above the maximum", field=f"{place}.minimum", value=low, limit=high)
            try:
                check_range(low, high, asset)
            except InvalidInput as problem:
                message = f"a spec may narrow the asset's declaration, never widen it: {problem.message}"
                field = f"{place}.{problem.field}"
                raise InvalidInput(message, field=field, value=problem.value, limit=problem.limit) from None
        return narrowed

    def _path(self, name: str, place: str) -> str:
        if name not in self._paths:
            raise UnknownName("parameter", name, self._paths, field=place)
        path = self._paths[name]
        motion = self.times.motion
        if motion is not None and path in motion.moved:
            trajectory = motion.moved[path]
            channel = path.removeprefix(f"{trajectory.path}.")
            other = trajectory.key(0, channel) if channel in trajectory.channels else "facing: kept"
            raise InvalidInput(
                f"it follows the trajectory of {trajectory.name}; vary what the trajectory says",
                field=place, value=name, limit=f"as {other.removeprefix(f'{ROOT}.')}",
            )  # fmt: skip
        attribute = path.rpartition(".")[2]
        if (
            path.startswith(f"{ENVIRONMENT_PATH}.")
            and attribute in set(Ability)
            and not self._shows(Ability(attribute))
        ):
            engine, ability = self.spec.engine, Ability(attribute)
            others = (name for name in plugins.RENDERERS if ability in plugins.declared_engine(name).shows)
            raise InvalidInput(
                f"the engine {engine!r} cannot show it", field=place, value=path, limit=", ".join(others)
            )
        return path

    def _shows(self, ability: Ability) -> bool:
        """Return whether the run's engine can show something; one that is gone is not asked."""
        return self._engine is None or ability in self._engine.shows

    def _number(self, written: Any, definition: ParameterDefinition, place: str) -> float:
        number, unit_given = to_unit(written, definition.unit, field=place)
        if definition.unit and not unit_given:
            self._unitless.setdefault(definition.path)
        return number

    def _value(self, written: Any, definition: ParameterDefinition, place: str) -> Value:
        """A value as it was written, in the definition's unit."""
        is_number = isinstance(written, int | float) and not isinstance(written, bool)
        if definition.is_number and (is_number or (isinstance(written, str) and is_quantity(written))):
            return definition.check(self._number(written, definition, place), field=place)
        return definition.check(written, field=place)

    def values(self, given: Mapping[str, Any], place: str) -> dict[str, Value]:
        """Parameter to value as written, as path to value."""
        found: dict[str, Value] = {}
        for name, written in given.items():
            try:
                path = self._path(name, f"{place}.{name}")
                if path in found:
                    raise InvalidInput("the parameter is given twice", field=f"{place}.{name}", value=path)
                found[path] = self._value(written, self._by_path[path], f"{place}.{name}")
            except InvalidInput as problem:
                self.problems.append(problem)
        return found

    def block(
        self, block: BlockDocument, place: str, max_variants: int | None, samplers: Mapping[str, SamplerFactory]
    ) -> Block:
        """The block in the asset's units; what has a problem is left out of it."""
        if block.design not in (GRID, POINTS, *samplers):
            self.problems.append(
                plugins.unknown_name("design", block.design, (GRID, POINTS, *samplers), field=f"{place}.design")
            )
        if max_variants is not None and block.count is not None and block.count > max_variants:
            self.problems.append(_too_many(block.count, max_variants, f"{place}.count"))
        variations: list[Variation] = []
        for i, varied in enumerate(block.vary):
            try:
                variations.append(self._variation(varied, f"{place}.vary.{i}", block, max_variants))
            except InvalidInput as problem:
                self.problems.append(problem)
        return Block(
            design=block.design,
            variations=tuple(variations),
            constants=self.values(block.constants, f"{place}.constants"),
            count=block.count,
            points=tuple(self.values(point, f"{place}.points.{i}") for i, point in enumerate(block.points)),
        )

    def _variation(self, varied: Varied, place: str, block: BlockDocument, max_variants: int | None) -> Variation:
        path = self._path(varied.parameter, place)
        definition = self._by_path[path]
        try:
            distribution = self._distribution(varied, definition, place)
            distribution.check(definition)
        except InvalidInput as problem:
            # Numbers that were read here carry their whole place already.
            raise (problem if problem.field.startswith(place) else at(place, problem)) from None
        count = distribution.count(definition)
        if max_variants is not None and count is not None and count > max_variants:
            which = "step" if isinstance(distribution, Homogeneous) else "count"
            if block.design == GRID or which == "step":
                raise _too_many(count, max_variants, f"{place}.{which}", value=getattr(varied, which, None))
        if isinstance(distribution, Homogeneous) and not distribution.reaches_maximum():
            self._warn_short(distribution, definition, self.spec.field(place))
        return Variation(path, distribution)

    def _distribution(self, varied: Varied, definition: ParameterDefinition, place: str) -> Distribution:
        written = varied.model_dump(exclude={"parameter", "distribution"}, exclude_none=True)
        made: dict[str, Any] = {}
        for key, value in written.items():
            if key == "values":
                made[key] = tuple(self._value(one, definition, f"{place}.values.{k}") for k, one in enumerate(value))
            elif key == "value":
                made[key] = self._value(value, definition, f"{place}.value")
            elif key == "count":
                made[key] = value
            elif not definition.is_number:
                raise InvalidInput(
                    f"{varied.distribution} needs a number, and {definition.name} is {definition.type}",
                    field=f"{place}.distribution", value=varied.distribution, limit="CHOICE or CONSTANT",
                )  # fmt: skip
            else:
                made[key] = self._number(value, definition, f"{place}.{key}")
        distribution: Distribution = varied.makes(**made)
        return distribution

    def _warn_short(self, distribution: Homogeneous, definition: ParameterDefinition, place: str) -> None:
        count = distribution.count(definition)
        shown = [f"{distribution.value(k, definition):g}" for k in range(min(count, _SHOWN))]
        listed = ", ".join(shown) + (f", … {distribution.value(count - 1, definition):g}" if count > _SHOWN else "")
        self.warnings.append(
            f"{place}: {distribution.minimum:g}…{distribution.maximum:g} step {distribution.step:g} gives {listed}; "
            f"the maximum {distribution.maximum:g} is not reached"
        )

    def space(
        self,
        definitions: tuple[ParameterDefinition, ...],
        blocks: list[Block],
        constants: dict[str, Value],
        samplers: Mapping[str, SamplerFactory],
    ) -> ParameterSpace | None:
        """The space, or None beside a problem; constraints are checked even if a block has one."""
        if self.times.motion is not None:
            # A constraint sees what a variant gives, and it gives no value that follows a trajectory.
            definitions = tuple(one for one in definitions if one.path not in self.times.motion.moved)
        known = {definition.path for definition in definitions}
        aliases = {name: path for name, path in self._paths.items() if path in known}
        arguments: dict[str, Any] = {"seed": self.spec.seed, "samplers": samplers, "aliases": aliases}
        for i, text in enumerate(self.spec.constraints):
            try:
                ParameterSpace(definitions, constraints=[text], aliases=aliases)
            except InvalidInput as problem:
                self.problems.append(at(f"constraints.{i}", _without_field(problem)))
        if self.problems:
            return None
        try:
            return ParameterSpace(
                definitions, blocks, constants=constants, constraints=self.spec.constraints, **arguments
            )
        except InvalidInput as problem:
            self.problems.append(problem)
            return None

    def annotations(self) -> tuple[AnnotationKind, ...]:
        """Those of the spec, and the velocity where a sensor needs it."""
        needed = self._needs_velocity and self.times.motion is not None
        asked = self.spec.annotations
        return (*asked, AnnotationKind.VELOCITY) if needed and AnnotationKind.VELOCITY not in asked else asked

    def check_annotations(self) -> None:
        """Flow leads to the next frame, and velocity needs something that can move."""
        for i, kind in enumerate(self.spec.annotations):
            if kind is AnnotationKind.FLOW and self.times.step is None:
                problem, limit = "flow leads to the next frame of a sequence", "sequence: {frames: …, step: …}"
            elif kind is AnnotationKind.VELOCITY and self.times.motion is None:
                problem, limit = "nothing moves in this run", "sequence, time or trajectories"
            else:
                continue
            self.problems.append(InvalidInput(problem, field=f"annotations.{i}", value=kind.value, limit=limit))

    def check_sensors(self, space: ParameterSpace) -> None:
        """What sensors need of the cameras is declared; warn of what they cost and of values without effect."""
        used = _used(space) | {self._paths[name] for name in self.spec.constants}
        cameras = self.spec.cameras if self.spec.cameras is not None else self.manifest.cameras
        for i, sensor in enumerate(self.spec.sensors):
            needs = needed_by(sensor, used)
            untold = [camera for camera in cameras if focal_length_path(camera) not in self.manifest.by_path]
            if needs.focal_length is not None and untold:
                problem = f"{needs.focal_length} needs the camera's focal length, which the asset does not declare"
                limit = f"a parameter {focal_length_path(untold[0])} in its manifest"
                self.problems.append(InvalidInput(problem, field=f"sensors.{i}", value=untold[0], limit=limit))
            if needs.velocity is not None and self.times.motion is None:
                self.warnings.append(
                    f"sensor {sensor.name}: {needs.velocity} changes nothing: the run has no sequence, time or trajectories"
                )
            elif needs.velocity is not None:
                self._needs_velocity = True
                self.warnings.append(
                    f"sensor {sensor.name}: {needs.velocity} needs velocities: they are made for every frame, and its pictures "
                    "wait for them and for the ground truth"
                )
            elif needs.depth is not None:
                self.warnings.append(
                    f"sensor {sensor.name}: {needs.depth} needs depth: its pictures wait for the ground truth too, and "
                    "are not shared by variants with other truth"
                )
            self.warnings += [f"sensor {sensor.name}: {text}" for text in needs.idle]

    def check_sun(self, space: ParameterSpace) -> None:
        """The sun is given one way in the whole spec, constraints included: angles that time sets cannot be spoken of."""
        spoken = {path for constraint in space.constraints for path in constraint.paths}
        try:
            require_one_notation(_used(space) | {self._paths[name] for name in self.spec.constants} | spoken)
        except InvalidInput as problem:
            self.problems.append(problem)

    def look_for_oversights(self, space: ParameterSpace) -> None:
        """Warn of what is legal and probably not meant."""
        used = _used(space)
        constant = {self._paths[name] for name in self.spec.constants}
        for i, block in enumerate(space.blocks):
            place = self.spec.field(f"blocks.{i}.vary")
            for path in {v.path for v in block.variations} & (constant | set(block.constants or ())):
                self.warnings.append(f"{place}: {self._by_path[path].name} is varied and constant; it is varied")
            count = block.count
            if block.design == "sobol" and count is not None and count & (count - 1):
                lower = 1 << (count.bit_length() - 1)
                place = self.spec.field(f"blocks.{i}.count")
                self.warnings.append(
                    f"{place}: sobol points are balanced for powers of two, and {count} is none; "
                    f"near are {lower} and {2 * lower}"
                )
        for parameter in self.spec.parameters:
            path = self._paths[parameter.name]
            definition = self._by_path[path]
            if path in used | constant:
                continue
            self.warnings.append(
                f"{definition.name} is declared and not varied; it stays at {_shown(definition.default, definition)}"
            )
        self._look_at_times(used | constant)
        if not self._shows(Ability.CUT_OUTS) and (self.manifest.files or self.manifest.placed_files):
            self.warnings.append(
                f"renderer {self.spec.engine}: it draws cut-out textures whole; where the asset's files have them (leaves, "
                "fences), its images are out of step with the ground truth"
            )
        if not self.spec.functions:
            self.warnings.append("no function under test: the run makes frames and truth, and evaluates nothing")

    def _look_at_times(self, used: Collection[str]) -> None:
        motion = self.times.motion
        if motion is None:
            return
        if not motion.trajectories:
            self.warnings.append("sequence: nothing moves; all frames of a variant are the same")
        elif len(self.times.elapsed) == 1 and TIME_PATH not in used:
            self.warnings.append("trajectories without sequence or time: the run looks at the moment 0 s alone")

    def notes(self) -> Iterable[str]:
        """Which unit numbers without one were given."""
        for path in self._unitless:
            definition = self._by_path[path]
            yield f"{definition.name}: numbers without unit are in {definition.unit}"


def _used(space: ParameterSpace) -> set[str]:
    """Paths that any block varies, holds constant or mentions in a point."""
    used = {v.path for block in space.blocks for v in block.variations}
    used |= {path for block in space.blocks for path in block.constants or ()}
    return used | {path for block in space.blocks for point in block.points for path in point}


def _shown(value: Value, definition: ParameterDefinition) -> str:
    number = definition.is_number and definition.type is not ParameterType.INT
    return f"{value:g} {definition.unit}".rstrip() if number else str(value)


def _too_many(count: int, limit: int, place: str, value: object = None) -> InvalidInput:
    shown = f"{count:,}" if count < 10**15 else f"about {Decimal(count):.0e}"
    return InvalidInput(f"{shown} variants are too many", field=place, value=value, limit=f"{limit:,} variants")


def _without_field(problem: InvalidInput) -> InvalidInput:
    if isinstance(problem, UnknownName):
        return UnknownName(problem.kind, problem.name, problem.known, limit=problem.limit)
    return InvalidInput(problem.message, value=problem.value, limit=problem.limit)


def _placed(spec: RunSpec, problem: InvalidInput) -> InvalidInput:
    """The problem at the place where the user wrote it."""
    place = spec.field(problem.field)
    return problem if place == problem.field else at(place, _without_field(problem))
