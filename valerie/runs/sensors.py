"""The sensor of a run: a setting with a variant's values put in, and what it asks of the camera and of other products."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from functools import lru_cache
from typing import Any, Final, NamedTuple

import orjson

from valerie.parameters.assignment import canonical_json
from valerie.parameters.definitions import Value
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.sensor_parameters import SENSOR_ROOT
from valerie.scene.graph.naming import ROOT
from valerie.sensing.settings import SensorSetting

_PREFIX: Final = f"{SENSOR_ROOT}."


class Response(NamedTuple):
    """What of a sensor a prediction depends on.

    Attributes:
        document: canonical JSON of all that makes a difference to the picture.
        needs_depth: the picture depends on the depth of the truth too.
        distorts: the truth has to be distorted with the picture.
        needs_velocity: the picture depends on how things move.
    """

    document: bytes
    needs_depth: bool
    distorts: bool
    needs_velocity: bool


def sensor_values(assignment: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a variant that is the sensor's: path to value."""
    return {path: value for path, value in assignment.items() if path.startswith(_PREFIX)}


def setting_of(setting: SensorSetting, assignment: Mapping[str, Any], *, moves: bool) -> SensorSetting:
    """A setting with what the variant says of the sensor put in; the asset's defaults are not.

    Args:
        setting: of the spec.
        assignment: of the variant.
        moves: whether the run knows how things move; else the shutter makes no difference.
    """
    own = setting.with_assignment(sensor_values(assignment))
    return own if moves else own.without_shutter()


def response(setting: SensorSetting, sensor: Mapping[str, Any], run_seed: int, *, moves: bool = False) -> Response:
    """What a prediction behind a setting depends on.

    Args:
        setting: of the spec; its name makes no pixel.
        sensor: `sensor_values` of the variant, in their canonical form.
        run_seed: counts where chance decides.
        moves: as of `setting_of`.
    """
    return _response(setting, canonical_json(sensor), run_seed, moves)


@lru_cache(maxsize=4096)
def _response(setting: SensorSetting, sensor: bytes, run_seed: int, moves: bool) -> Response:
    own = setting_of(setting, orjson.loads(sensor), moves=moves)
    document = canonical_json(short_document(own, run_seed))
    return Response(document, own.needs_depth, own.moves_truth, own.needs_velocity)


def short_document(setting: SensorSetting, run_seed: int) -> dict[str, Any]:
    """All that makes a difference to the picture of a frame, by parameter; the run's seed where chance decides."""
    document = setting.response()
    return {**document, "seed": run_seed} if setting.needs_seed else document


class Needs(NamedTuple):
    """What a sensor of a run asks for, or does without.

    Attributes:
        focal_length, depth, velocity: the effect that needs it, in words; None: nothing does.
        idle: values that change nothing, in words.
    """

    focal_length: str | None
    depth: str | None
    velocity: str | None
    idle: tuple[str, ...]


#: Effects that need the camera's focal length, and the parameters that switch them on.
_OF_FOCAL_LENGTH: Final = {
    "defocus": ("lens.f_number",),
    "distortion": ("distortion.k1", "distortion.k2", "distortion.p1", "distortion.p2", "distortion.k3"),
    "vignetting": ("lens.vignetting",),
}
#: Effects that need to know how things move.
_OF_VELOCITY: Final = {"motion blur": ("shutter.exposure_ms",), "a rolling shutter": ("shutter.line_time_us",)}
_COUNTING: Final = (
    "noise.shot", "noise.read_electrons", "noise.adc_bits", "pixels.dead_rate", "pixels.hot_rate",
)  # fmt: skip
_CHANCE: Final = (
    "noise.shot", "noise.read_electrons", "pixels.dead_rate", "pixels.hot_rate", "soiling.dirt", "soiling.drops",
)  # fmt: skip
#: Parameters that change nothing as long as all of others are neutral.
_IDLE_WITHOUT: Final = {
    "lens.focus_distance_m": ("lens.f_number",),
    "noise.full_well_electrons": _COUNTING,
    "noise.headroom_ev": _COUNTING,
    "specimen": _CHANCE,
}


def needed_by(setting: SensorSetting, used: Collection[str]) -> Needs:
    """What a setting needs when a run varies some parameters.

    Args:
        setting: of the spec.
        used: paths that any variant may set.
    """
    document = setting.document()

    def active(names: Iterable[str]) -> bool:
        return any(_PREFIX + name in used or document.get(name) for name in names)

    wanting = [effect for effect, names in _OF_FOCAL_LENGTH.items() if active(names)]
    idle = [
        f"{name} changes nothing while {' and '.join(others)} {'is' if len(others) == 1 else 'are'} 0"
        for name, others in _IDLE_WITHOUT.items()
        if (_PREFIX + name in used or name in document) and not active(others)
    ]
    moving = next((effect for effect, names in _OF_VELOCITY.items() if active(names)), None)
    return Needs(wanting[0] if wanting else None, "defocus" if "defocus" in wanting else moving, moving, tuple(idle))


def focal_length_path(camera: str) -> str:
    """The parameter that tells a camera's focal length."""
    return f"{ROOT}.{camera}.focal_length_mm"


def focal_length_mm(manifest: Manifest, camera: str, assignment: Mapping[str, Value]) -> float | None:
    """The focal length of a camera in a variant, millimetres; None where the manifest does not declare it."""
    path = focal_length_path(camera)
    definition = manifest.by_path.get(path)
    if definition is None:
        return None
    return float(assignment.get(path, definition.default))
