"""Warnings about specs that are legal but probably not intended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from valerie.parameters.definitions import ParameterDefinition
from valerie.parameters.distributions import Homogeneous
from valerie.parameters.space import ParameterSpace
from valerie.rendering.engine import Ability
from valerie.runs.document.run_spec import RunSpec
from valerie.runs.resolving.motion import Times
from valerie.runs.resolving.requirements import Requirement
from valerie.runs.resolving.sensors import SensorNeeds
from valerie.runs.resolving.vocabulary import Vocabulary
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.sensor_parameters import SENSOR_ROOT
from valerie.scene.motion.trajectory import TIME_PATH
from valerie.scene.variation.conditions import conditions
from valerie.statistics.replicates import MIN_POINTS, replicate_number
from valerie.statistics.units import EVEN, INDEPENDENT
from valerie.statistics.verdicts import units_to_decide

#: Number of variants whose sun is checked.
_LOOKED_AT: Final = 64
#: Elevation of the sun at night, and smallest exposure that is not black then.
_TWILIGHT_DEG, _NIGHT_EV = -6.0, 4.0
#: Elevation of the sun by day, and smallest exposure that is white then: 8 EV give a mean grey level of 253.1 at 5° and
#: 254.5 at 65°, 6 EV at most 242.
_DAY_DEG, _DAY_EV = 5.0, 8.0
#: Largest number of values of a range that a warning lists.
_LISTED: Final = 5


def shortfall(distribution: Homogeneous, definition: ParameterDefinition) -> str:
    """Return the warning about a range whose maximum is not a whole number of steps above its minimum."""
    count = distribution.count(definition)
    listed = ", ".join(f"{distribution.value(k, definition):g}" for k in range(min(count, _LISTED)))
    if count > _LISTED:
        listed += f", … {distribution.value(count - 1, definition):g}"
    return (
        f"{distribution.minimum:g}…{distribution.maximum:g} step {distribution.step:g} gives {listed}; "
        f"the maximum {distribution.maximum:g} is not reached"
    )


def sensor_warnings(spec: RunSpec, needs: Sequence[SensorNeeds], *, moves: bool) -> Iterator[str]:
    """Yield the warnings about costs of a run's sensors, and about settings without effect.

    Args:
        spec: the spec.
        needs: needs of each of its sensors.
        moves: True if the run has a sequence, time or trajectories.
    """
    for sensor, need in zip(spec.sensors, needs, strict=True):
        if need.scan:
            yield (
                f"sensor {sensor.name}: a rolling shutter "
                + (
                    "renders each frame in slices, whose number follows from the motion: at most one per line"
                    if moves
                    else "changes nothing: the run has no sequence, time or trajectories"
                )
            )
        if need.velocity is not None and not moves:
            yield (
                f"sensor {sensor.name}: {need.velocity} changes nothing: the run has no sequence, time or trajectories"
            )
        elif need.velocity is not None:
            yield (
                f"sensor {sensor.name}: {need.velocity} needs velocities: they are made for every frame, "
                "and its pictures wait for them and for the ground truth"
            )
        elif need.depth is not None:
            yield (
                f"sensor {sensor.name}: {need.depth} needs depth: its pictures wait for the ground truth too, and "
                "are not shared by variants with a different truth"
            )
        for text in need.idle:
            yield f"sensor {sensor.name}: {text}"


def oversights(
    vocabulary: Vocabulary, space: ParameterSpace, times: Times, requirements: Sequence[Requirement]
) -> Iterator[str]:
    """Yield the warnings about a resolved spec.

    Args:
        vocabulary: the names of the spec.
        space: its variants.
        times: its moments, and what moves.
        requirements: its requirements.
    """
    yield from _about_blocks(vocabulary, space)
    yield from _about_requirements(space, requirements)
    yield from _about_declarations(vocabulary, space)
    yield from _about_times(space, times)
    spec, manifest = vocabulary.spec, vocabulary.manifest
    if not vocabulary.renders(Ability.CUT_OUTS) and (manifest.files or manifest.placed_files):
        yield (
            f"renderer {spec.engine}: the shadows of cut-out textures have no holes; where the asset's files have such "
            "textures (leaves, fences), their shadows are too dark"
        )
    yield from _about_exposure(spec, space, manifest)
    if not spec.functions:
        yield "no function under test: the run makes frames and truth, and evaluates nothing"


def _about_exposure(spec: RunSpec, space: ParameterSpace, manifest: Manifest) -> Iterator[str]:
    """Yield a warning for each sensor whose fixed exposure gives black pictures at night, or white ones by day."""
    varied = {f"{SENSOR_ROOT}.{name}" for name in ("exposure_ev", "auto_exposure", "gain_db")} & space.used
    fixed = [sensor for sensor in spec.sensors if not sensor.auto_exposure]
    if varied or not fixed:
        return
    elevations = []
    for index in range(0, space.size, max(space.size // _LOOKED_AT, 1)):
        _, values = next(iter(space.values(index, index + 1)))
        named = {path: value for path, value in values.items() if path in manifest.by_path}
        elevation = conditions(named, manifest).sun_elevation_deg
        if elevation is not None:
            elevations.append(elevation)
    if not elevations:
        return
    lowest, highest = min(elevations), max(elevations)
    for sensor in fixed:
        exposure = sensor.exposure_ev + sensor.gain_db / 6
        faults = []
        if lowest <= _TWILIGHT_DEG and exposure < _NIGHT_EV:
            faults.append((f"{-lowest:g}° below", "black"))
        if highest >= _DAY_DEG and exposure >= _DAY_EV:
            faults.append((f"{highest:g}° above", "white"))
        for sun, fault in faults:
            yield (
                f"sensor {sensor.name}: with the sun {sun} the horizon, the fixed exposure of {sensor.exposure_ev:g} EV "
                f"gives {fault} pictures; auto_exposure: true meters the background"
            )


def _about_blocks(vocabulary: Vocabulary, space: ParameterSpace) -> Iterator[str]:
    spec = vocabulary.spec
    for i, (block, constants) in enumerate(zip(space.blocks, space.constants, strict=True)):
        for variation in block.variations:
            if variation.path in constants:
                name = vocabulary.definitions[variation.path].name
                yield f"{spec.field(f'blocks.{i}.vary')}: {name} is varied and constant; it is varied"
        if block.count is not None and block.design in EVEN:
            yield from _about_replicates(block.design, block.count, spec.field(f"blocks.{i}.count"))


def _about_requirements(space: ParameterSpace, requirements: Sequence[Requirement]) -> Iterator[str]:
    """Yield a warning if a random design is too small for a verdict with the truth halfway between bound and best."""
    if len(space.blocks) > 1 or space.blocks[0].design not in INDEPENDENT:
        return
    for requirement in requirements:
        statistic = requirement.statistic
        truth = (1 + statistic.at_least) / 2
        units = units_to_decide(truth, at_least=statistic.at_least, confidence=requirement.document.confidence)
        if units is not None and units > space.size:
            yield (
                f"requirement {requirement.document.id}: {space.size:,} variants will hardly decide it; if "
                f"{statistic.quantity} is {100 * statistic.shown(truth):g} %, about {units:,} in its region do"
            )


def _about_replicates(design: str, count: int, place: str) -> Iterator[str]:
    if count < MIN_POINTS:
        yield (
            f"{place}: {count} points of {design} are drawn independently, as in a random design; from {MIN_POINTS} on "
            "they are spread evenly, in replicates that show how certain a mean is"
        )
        return
    number = replicate_number(count)
    if design == "sobol" and (count % number or (count // number) & (count // number - 1)):
        lower = number << ((count // number).bit_length() - 1)
        yield (
            f"{place}: sobol points are balanced in {number} replicates of 2, 4, 8 … points, and {count} are not; "
            f"the nearest are {lower} and {2 * lower}"
        )


def _about_declarations(vocabulary: Vocabulary, space: ParameterSpace) -> Iterator[str]:
    used = space.used
    for parameter in vocabulary.spec.parameters:
        definition = vocabulary.definitions[vocabulary.paths[parameter.name]]
        if definition.path not in used:
            default = definition.text(definition.default)
            yield f"{definition.name} is declared and not varied; it stays at {default}"


def _about_times(space: ParameterSpace, times: Times) -> Iterator[str]:
    if times.motion is None:
        return
    if not times.motion.trajectories:
        yield "sequence: nothing moves; all frames of a variant are the same"
    elif len(times.elapsed) == 1 and TIME_PATH not in space.used:
        yield "trajectories without sequence or time: the run covers only the moment 0 s"
