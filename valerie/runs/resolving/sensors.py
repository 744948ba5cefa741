"""The sensors of a run: their settings with a variant's values, and the camera data and products that they need."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from functools import lru_cache
from typing import Final, NamedTuple

import orjson

from valerie.parameters.assignment import canonical_json
from valerie.parameters.definitions import Value
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.sensor_parameters import SENSOR_ROOT
from valerie.scene.graph.naming import ROOT
from valerie.sensing.settings import COUNTING, RANDOM, SensorSetting

_PREFIX: Final = f"{SENSOR_ROOT}."


class Response(NamedTuple):
    """The part of a sensor that a prediction depends on.

    Attributes:
        document: canonical JSON of everything that changes the picture.
        needs_depth: True if the picture also depends on the depth of the truth.
        distorts: True if the truth must be distorted like the picture.
        needs_velocity: True if the picture depends on velocities.
        rolls: True if the picture is read line by line.
    """

    document: bytes
    needs_depth: bool
    distorts: bool
    needs_velocity: bool
    rolls: bool


class RollingShutter(NamedTuple):
    """The line-by-line reading of a frame.

    Attributes:
        setting: setting of a sensor with a rolling shutter, with the variant's values.
        blurs: True if one of these sensors has an exposure time.
    """

    setting: SensorSetting
    blurs: bool

    @property
    def document(self) -> list[object]:
        """Inputs of a scan besides the scene."""
        return [self.setting.shutter.line_time_us, self.setting.distortion.model_dump(), self.blurs]


def rolling_shutter(sensors: Iterable[SensorSetting], assignment: Mapping[str, Value]) -> RollingShutter | None:
    """Return the rolling shutter of a run's sensors; None if none has one.

    Args:
        sensors: sensors of the spec; those with a rolling shutter agree in line time and distortion.
        assignment: assignment of the variant.
    """
    rolling = [setting for setting in (setting_of(s, assignment, moves=True) for s in sensors) if setting.rolls]
    if not rolling:
        return None
    return RollingShutter(rolling[0], any(setting.needs_velocity for setting in rolling))


def sensor_values(assignment: Mapping[str, Value]) -> dict[str, Value]:
    """Return the part of an assignment that belongs to the sensor: path to value."""
    return {path: value for path, value in assignment.items() if path.startswith(_PREFIX)}


def setting_of(setting: SensorSetting, assignment: Mapping[str, Value], *, moves: bool) -> SensorSetting:
    """Return a setting with a variant's values for the sensor; the asset's defaults do not override the setting.

    Args:
        setting: setting in the spec.
        assignment: assignment of the variant.
        moves: True if the run has motion; otherwise the shutter has no effect.
    """
    of_variant = setting.with_assignment(sensor_values(assignment))
    return of_variant if moves else of_variant.without_shutter()


def response_of(setting: SensorSetting, sensor: Mapping[str, Value], run_seed: int, *, moves: bool = False) -> Response:
    """Return the response of a sensor.

    Args:
        setting: setting in the spec; its name changes no pixel.
        sensor: `sensor_values` of the variant, in their canonical form.
        run_seed: seed of the run; it matters only to settings with random effects.
        moves: see `setting_of`.
    """
    return _response(setting, canonical_json(sensor), run_seed, moves)


@lru_cache(maxsize=4096)
def _response(setting: SensorSetting, sensor: bytes, run_seed: int, moves: bool) -> Response:
    of_variant = setting_of(setting, orjson.loads(sensor), moves=moves)
    document = canonical_json(short_document(of_variant, run_seed))
    return Response(
        document, of_variant.needs_depth, of_variant.moves_truth, of_variant.needs_velocity, of_variant.rolls
    )


def short_document(setting: SensorSetting, run_seed: int) -> dict[str, Value]:
    """Return the values that change the picture of a frame, by parameter, with the run's seed if effects are random."""
    document = setting.response()
    return {**document, "seed": run_seed} if setting.needs_seed else document


class SensorNeeds(NamedTuple):
    """The inputs that a sensor of a run needs, and its settings without effect.

    Attributes:
        focal_length, depth, velocity: the effect that needs this input, in words; None if no effect does.
        scan: True if a rolling shutter reads the picture line by line.
        idle: one sentence for each setting that changes nothing.
    """

    focal_length: str | None
    depth: str | None
    velocity: str | None
    scan: bool
    idle: tuple[str, ...]


#: Effects that need the camera's focal length, and the parameters that turn them on.
_OF_FOCAL_LENGTH: Final = {
    "defocus": ("lens.f_number",),
    "distortion": ("distortion.k1", "distortion.k2", "distortion.p1", "distortion.p2", "distortion.k3"),
    "vignetting": ("lens.vignetting",),
}
#: Parameters that change nothing while all of the others listed are 0.
_IDLE_WITHOUT: Final = {
    "lens.focus_distance_m": ("lens.f_number",),
    "noise.full_well_electrons": COUNTING,
    "noise.headroom_ev": COUNTING,
    "specimen": RANDOM,
}


def needs_of(setting: SensorSetting, used: Collection[str]) -> SensorNeeds:
    """Return the needs of a sensor setting in a run.

    Args:
        setting: of the spec.
        used: paths that any variant may set.
    """
    document = setting.document()

    def active(names: Iterable[str]) -> bool:
        return any(_PREFIX + name in used or document.get(name) for name in names)

    lens_effects = [effect for effect, names in _OF_FOCAL_LENGTH.items() if active(names)]
    idle = [
        f"{name} changes nothing while {' and '.join(others)} {'is' if len(others) == 1 else 'are'} 0"
        for name, others in _IDLE_WITHOUT.items()
        if (_PREFIX + name in used or name in document) and not active(others)
    ]
    blur = "motion blur" if active(["shutter.exposure_ms"]) else None
    return SensorNeeds(
        focal_length=lens_effects[0] if lens_effects else None,
        depth="defocus" if "defocus" in lens_effects else blur,
        velocity=blur,
        scan=active(["shutter.line_time_us"]),
        idle=tuple(idle),
    )


def focal_length_path(camera: str) -> str:
    """Return the path of the parameter with a camera's focal length."""
    return f"{ROOT}.{camera}.focal_length_mm"


def focal_length_mm(manifest: Manifest, camera: str, assignment: Mapping[str, Value]) -> float | None:
    """Return the focal length of a camera in a variant, in millimetres; None if the manifest does not declare it."""
    path = focal_length_path(camera)
    definition = manifest.by_path.get(path)
    if definition is None:
        return None
    return float(assignment.get(path, definition.default))
