"""The sensor setting: all camera effects of the sensor stage as one frozen document.

Ranges, units and neutral values come from `valerie.scene.assets.sensor_parameters`. Physics and sources are in the modules of
the effects and in ``docs/sensor.md``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final, Literal

from pydantic import Field

from valerie.document import Document
from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import Value
from valerie.scene.assets.sensor_parameters import SENSOR_PARAMETERS, SENSOR_ROOT

ToneCurve = Literal["srgb", "filmic", "aces", "blender-filmic"]

#: Parameters that make the sensor count light in electrons, with a well that saturates.
COUNTING: Final = (
    "noise.shot", "noise.read_electrons", "noise.adc_bits", "pixels.dead_rate", "pixels.hot_rate",
)  # fmt: skip
#: Parameters that make a picture random: noise, or the places of faulty pixels, dirt and drops.
RANDOM: Final = (
    "noise.shot", "noise.read_electrons", "pixels.dead_rate", "pixels.hot_rate", "soiling.dirt", "soiling.drops",
)  # fmt: skip


def _field(name: str) -> Any:
    """Return the pydantic field of a sensor parameter. Its default is the neutral value."""
    row = SENSOR_PARAMETERS[name]
    unit = f" ({row.unit})" if row.unit else ""
    return Field(row.neutral, ge=row.minimum, le=row.maximum, description=row.description + unit)


class WhiteBalance(Document):
    """The light that the camera takes for white; see `valerie.sensing.colour`."""

    temperature_k: float = _field("white_balance.temperature_k")
    tint: float = _field("white_balance.tint")


class Lens(Document):
    """Focus, vignetting, glare, flare and chromatic aberration; see the modules of `valerie.sensing`."""

    f_number: float = _field("lens.f_number")
    focus_distance_m: float = _field("lens.focus_distance_m")
    vignetting: float = _field("lens.vignetting")
    glare: float = _field("lens.glare")
    flare: float = _field("lens.flare")
    chromatic_aberration: float = _field("lens.chromatic_aberration")


class Distortion(Document):
    """Coefficients of the Brown–Conrady model, named and scaled as OpenCV's; see `valerie.sensing.distortion`."""

    k1: float = _field("distortion.k1")
    k2: float = _field("distortion.k2")
    p1: float = _field("distortion.p1")
    p2: float = _field("distortion.p2")
    k3: float = _field("distortion.k3")

    @property
    def identity(self) -> bool:
        """True if no pixel moves."""
        return self == _NO_DISTORTION


class Shutter(Document):
    """Exposure time and rolling shutter; see `valerie.sensing.motion`."""

    exposure_ms: float = _field("shutter.exposure_ms")
    line_time_us: float = _field("shutter.line_time_us")


class Soiling(Document):
    """Dirt and drops on the front glass; see `valerie.sensing.soiling`."""

    dirt: float = _field("soiling.dirt")
    drops: float = _field("soiling.drops")


class Noise(Document):
    """Shot noise, read noise, full well and converter; see `valerie.sensing.electronics`."""

    shot: bool = _field("noise.shot")
    read_electrons: float = _field("noise.read_electrons")
    full_well_electrons: float = _field("noise.full_well_electrons")
    headroom_ev: float = _field("noise.headroom_ev")
    adc_bits: int = _field("noise.adc_bits")


class FaultyPixels(Document):
    """Rates of dead (black) and hot (saturated) pixels; see `valerie.sensing.electronics`."""

    dead_rate: float = _field("pixels.dead_rate")
    hot_rate: float = _field("pixels.hot_rate")


class SensorSetting(Document):
    """The response of a camera.

    The effects apply in this order: lens (defocus, shutter, soiling, glare, flare, distortion, chromatic aberration, vignetting),
    exposure, noise and converter, white balance, tone curve, sRGB transfer, gamma, JPEG.

    Attributes:
        name: name in the spec and in results.
        curve: ``filmic`` (Hable), ``blender-filmic``, ``aces`` (Narkowicz) or ``srgb`` (no tone curve); see
            `valerie.sensing.curves`.
        white_balance: the light that the camera takes for white.
        lens: focus, vignetting, glare, flare and chromatic aberration.
        distortion: Brown–Conrady coefficients; the same map distorts the ground truth.
        shutter: motion blur and rolling shutter; ground truth moves with the rows.
        soiling: dirt and drops on the front glass.
        noise: shot noise, read noise and converter.
        pixels: dead and hot pixels.
    """

    name: str = Field("default", min_length=1, max_length=64)
    exposure_ev: float = _field("exposure_ev")
    auto_exposure: bool = _field("auto_exposure")
    gain_db: float = _field("gain_db")
    curve: ToneCurve = "filmic"
    gamma: float = _field("gamma")
    white_balance: WhiteBalance = WhiteBalance()
    lens: Lens = Lens()
    distortion: Distortion = Distortion()
    shutter: Shutter = Shutter()
    soiling: Soiling = Soiling()
    noise: Noise = Noise()
    pixels: FaultyPixels = FaultyPixels()
    jpeg_quality: int = _field("jpeg_quality")
    specimen: int = _field("specimen")

    def values(self) -> Iterator[tuple[str, Any]]:
        """Iterate over all parameters as (name below ``sensor``, value), e.g. ``("noise.read_electrons", 4.0)``."""
        for name in SENSOR_PARAMETERS:
            group, _, field = name.rpartition(".")
            yield name, getattr(getattr(self, group) if group else self, field)

    def document(self) -> dict[str, Value]:
        """Return exposure, curve, gamma and every value that is not neutral, by name below ``sensor``.

        Digests of specs and images include it. Since neutral values are absent, a new effect leaves old digests unchanged.
        """
        return {
            name: value for name, value in self.values() if name in _ALWAYS or value != SENSOR_PARAMETERS[name].neutral
        }

    def response(self) -> dict[str, Value]:
        """Return the part of `document` that affects the image."""
        document = self.document()
        idle: list[str] = []
        if not self.defocuses:
            idle += ["lens.f_number", "lens.focus_distance_m"]
        if not self.counts_electrons:
            idle += ["noise.full_well_electrons", "noise.headroom_ev"]
        if not self.needs_seed:
            idle += ["specimen"]
        # The exposure follows from the background; other digests stay as they are.
        metered: dict[str, Value] = {"auto_exposure": "background"} if self.auto_exposure else {}
        return {name: value for name, value in document.items() if name not in idle} | metered

    @property
    def counts_electrons(self) -> bool:
        """True if any of `COUNTING` is on."""
        return self._has_any(COUNTING)

    @property
    def needs_seed(self) -> bool:
        """True if any of `RANDOM` is on."""
        return self._has_any(RANDOM)

    def _has_any(self, names: tuple[str, ...]) -> bool:
        return any(value for name, value in self.values() if name in names)

    @property
    def defocuses(self) -> bool:
        """True if the lens blurs points out of focus."""
        return self.lens.f_number > 0.0

    @property
    def needs_velocity(self) -> bool:
        """True if the image depends on velocities."""
        return self.shutter.exposure_ms > 0.0

    @property
    def rolls(self) -> bool:
        """True if the image is read line by line."""
        return self.shutter.line_time_us > 0.0

    @property
    def needs_depth(self) -> bool:
        """True if the image depends on depths."""
        return self.defocuses or self.needs_velocity

    @property
    def moves_truth(self) -> bool:
        """True if labels lie elsewhere in the camera image than in the rendered image."""
        return not self.distortion.identity or self.rolls

    def without_shutter(self) -> SensorSetting:
        """Return the same camera with a neutral shutter."""
        return self if self.shutter == _NO_SHUTTER else self.model_copy(update={"shutter": _NO_SHUTTER})

    @property
    def needs_focal_length(self) -> bool:
        """True if the image depends on the camera's focal length."""
        return self.defocuses or self.lens.vignetting > 0.0 or not self.distortion.identity

    def with_assignment(self, sensor: Mapping[str, Value]) -> SensorSetting:
        """Return this setting with the ``sensor.…`` values of a variant, e.g. ``{"sensor.exposure_ev": 0.5}``.

        Raises:
            UnknownName: A path below ``sensor`` names no field.
            InvalidInput: A path is outside ``sensor``.
            pydantic.ValidationError: A value is outside its field's range.
        """
        if not sensor:
            return self
        values = self.model_dump()
        for path, value in sensor.items():
            root, _, name = path.partition(".")
            if root != SENSOR_ROOT:
                raise InvalidInput("not a parameter of the sensor", field=path, limit="paths below 'sensor'")
            if name not in SENSOR_PARAMETERS:
                paths = [f"{SENSOR_ROOT}.{parameter}" for parameter in SENSOR_PARAMETERS]
                raise UnknownName("sensor parameter", path, paths, field=path)
            group, _, field = name.rpartition(".")
            (values[group] if group else values)[field] = value
        return SensorSetting.model_validate(values)


#: The camera of a spec that names none. It meters the exposure and has the noise of a vehicle's camera, which is below one grey
#: level by day.
METERING: Final = SensorSetting(
    auto_exposure=True, noise=Noise(shot=True, read_electrons=3.0, full_well_electrons=100_000.0)
)
_NO_DISTORTION: Final = Distortion()
_NO_SHUTTER: Final = Shutter()
#: Parameters in every document, even if neutral.
_ALWAYS: Final = frozenset({"exposure_ev", "curve", "gamma"})
