"""The parameters of a camera's sensor: the only list of names, units, ranges and neutral values.

`valerie.scene.assets.attributes` makes parameters below ``sensor`` from it, and `valerie.sensing.settings` the fields of a sensor
setting. ``docs/sensor.md`` describes the effect of each on a picture, with its source. Each is neutral by default: the picture
is then the same, bit for bit, as without the effect. If the physically neutral value is infinite (bits, f-number), 0 stands for
it.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType, Value

SENSOR_ROOT: Final = "sensor"


class SensorParameter(NamedTuple):
    """One parameter.

    Attributes:
        name: name below ``sensor``, e.g. ``noise.read_electrons``.
        minimum, maximum: range that a setting accepts; None for BOOL and CATEGORICAL.
        neutral: the default, at which the effect is absent, or has no consequence while related parameters are neutral.
        description: text for users.
        choices: values of a CATEGORICAL parameter.
        usual: the narrower range that an asset declares, if the widest is of no use.
        affects: the stage whose input it is. Geometric parameters move the pixels of picture and truth.
    """

    name: str
    type: ParameterType
    unit: str
    minimum: float | None
    maximum: float | None
    neutral: Value
    description: str
    choices: tuple[str, ...] = ()
    usual: tuple[float, float] | None = None
    affects: Affects = Affects.SENSOR_RADIOMETRY

    def definition(self) -> ParameterDefinition:
        """Return the declaration of the parameter for an asset."""
        low, high = self.usual or (self.minimum, self.maximum)
        return ParameterDefinition(
            path=f"{SENSOR_ROOT}.{self.name}",
            type=self.type,
            unit=self.unit,
            minimum=low,
            maximum=high,
            choices=self.choices,
            default=self.neutral,
            affects=self.affects,
            description=self.description,
        )


_FLOAT, _INT, _BOOL, _CHOICE = (
    ParameterType.FLOAT,
    ParameterType.INT,
    ParameterType.BOOL,
    ParameterType.CATEGORICAL,
)


def _coefficient(name: str, limit: float, description: str) -> SensorParameter:
    return SensorParameter(
        f"distortion.{name}", _FLOAT, "", -limit, limit, 0.0, description, affects=Affects.SENSOR_GEOMETRY
    )


_ROWS: Final = (
    SensorParameter(
        "exposure_ev", _FLOAT, "EV", -16, 16, 0.0,
        "stops of exposure: the linear image is multiplied by 2 ** exposure_ev", usual=(-4.0, 12.0),
    ),
    SensorParameter(
        "auto_exposure", _BOOL, "", None, None, False,
        "meters the exposure on the background, within −6…11 EV; exposure_ev corrects it",
    ),
    SensorParameter(
        "gain_db", _FLOAT, "dB", 0, 48, 0.0,
        "amplification after counting, 10 ** (gain_db / 20), of the noise too",
    ),
    SensorParameter(
        "curve", _CHOICE, "", None, None, "filmic", "tone curve", choices=("srgb", "filmic", "aces", "blender-filmic")
    ),
    SensorParameter(
        "gamma", _FLOAT, "", 0.1, 10, 1.0,
        "maps the display value v after the tone curve to v ** (1 / gamma); the paper uses 1.5", usual=(0.5, 3.0),
    ),
    SensorParameter(
        "white_balance.temperature_k", _FLOAT, "K", 2500, 15000, 6504.0,
        "colour temperature that the camera takes for white; above 6504 the picture is warmer",
    ),
    SensorParameter(
        "white_balance.tint", _FLOAT, "", -30, 30, 0.0,
        "distance of that white from the Planckian locus in 0.001 Duv; above 0 the picture is more magenta",
    ),
    SensorParameter("lens.f_number", _FLOAT, "", 0, 64, 0.0, "f-number of a thin lens; 0: a pinhole, everything is in focus"),
    SensorParameter("lens.focus_distance_m", _FLOAT, "m", 0.1, 10_000, 20.0, "distance of focus"),
    SensorParameter("lens.vignetting", _FLOAT, "", 0, 4, 0.0, "exponent of cos⁴; 1: the natural fall-off of a simple lens"),
    SensorParameter(
        "lens.glare", _FLOAT, "", 0, 0.5, 0.0,
        "share of the light that the lens scatters over the picture: veils dark areas, makes lamps glow", usual=(0, 0.1),
    ),
    SensorParameter(
        "lens.flare", _FLOAT, "", 0, 0.5, 0.0,
        "share of the light that becomes ghosts and stars: of the sun and of lamps in the picture", usual=(0, 0.02),
    ),
    SensorParameter(
        "lens.chromatic_aberration", _FLOAT, "", -0.02, 0.02, 0.0,
        "lateral: magnifies red and reduces blue, relative to green, by this share",
    ),
    _coefficient("k1", 1.0, "radial, r²; below 0 barrel, above 0 pincushion (OpenCV's k1)"),
    _coefficient("k2", 1.0, "radial, r⁴ (OpenCV's k2)"),
    _coefficient("p1", 0.1, "tangential (OpenCV's p1)"),
    _coefficient("p2", 0.1, "tangential (OpenCV's p2)"),
    _coefficient("k3", 1.0, "radial, r⁶ (OpenCV's k3)"),
    SensorParameter(
        "shutter.exposure_ms", _FLOAT, "ms", 0, 1000, 0.0,
        "time for which the shutter is open: blurs moving objects, but does not brighten; 0: none", usual=(0, 200),
    ),
    SensorParameter(
        "shutter.line_time_us", _FLOAT, "us", 0, 1000, 0.0,
        "delay from one row to the next (rolling shutter); 0: all at once", affects=Affects.SENSOR_GEOMETRY,
    ),
    SensorParameter("soiling.dirt", _FLOAT, "", 0, 0.6, 0.0, "share of the front glass that dust covers"),
    SensorParameter("soiling.drops", _FLOAT, "", 0, 0.6, 0.0, "share of the front glass that water drops cover"),
    SensorParameter("noise.shot", _BOOL, "", None, None, False, "photon noise"),
    SensorParameter("noise.read_electrons", _FLOAT, "electrons", 0, 1000, 0.0, "standard deviation of the read noise"),
    SensorParameter(
        "noise.full_well_electrons", _FLOAT, "electrons", 100, 1e6, 10_000.0, "capacity of a pixel before it saturates"
    ),
    SensorParameter(
        "noise.headroom_ev", _FLOAT, "EV", 0, 8, 2.5, "stops above diffuse white (linear 1) at which the well is full"
    ),
    SensorParameter("noise.adc_bits", _INT, "", 0, 16, 0, "bits of the analogue-digital converter; 0: no converter"),
    SensorParameter("pixels.dead_rate", _FLOAT, "", 0, 0.1, 0.0, "share of pixels that are always black"),
    SensorParameter("pixels.hot_rate", _FLOAT, "", 0, 0.1, 0.0, "share of pixels that are always saturated"),
    SensorParameter("jpeg_quality", _INT, "", 0, 100, 0, "quality of JPEG compression; 0: none"),
    SensorParameter(
        "specimen", _INT, "", 0, 1_000_000, 0,
        "number of the camera of its kind: decides the places of faulty pixels, dirt and drops, and the noise",
    ),
)  # fmt: skip

#: Name below ``sensor`` to parameter, in the order in which light meets them.
SENSOR_PARAMETERS: Final[Mapping[str, SensorParameter]] = MappingProxyType({row.name: row for row in _ROWS})
