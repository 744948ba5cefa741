"""The camera's own radiometry: a linear image in, the picture that a function under test sees out.

The whole stage works on one channel value at a time, and a float16 has only 65,536 values: so the float64 formula is
evaluated once per setting for every one of them, and a frame is a look-up: exact, and 2 CPU-ms for 960 × 540.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from valerie.errors import InvalidInput, UnknownName
from valerie.sensing.curves import CURVES, linear_to_srgb

#: Raised by hand whenever a setting gives other pixels; part of every prediction's digest.
REVISION: Final = 1

ToneCurve = Literal["srgb", "filmic", "aces"]


class SensorSetting(BaseModel):
    """One camera response; the order is exposure, tone curve, sRGB transfer, gamma.

    Attributes:
        name: name in the spec and in results.
        exposure_ev: stops; the linear image is multiplied by ``2 ** exposure_ev``.
        curve: ``filmic`` (Hable), ``aces`` (Narkowicz) or ``srgb`` (no tone curve); see `valerie.sensing.curves`.
        gamma: the display value becomes ``v ** (1 / gamma)``, as Blender's view gamma (the paper, section 6, uses 1.5).
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field("default", min_length=1, max_length=64)
    exposure_ev: Annotated[float, Field(ge=-16.0, le=16.0)] = 0.0
    curve: ToneCurve = "filmic"
    gamma: Annotated[float, Field(ge=0.1, le=10.0)] = 1.0

    def with_assignment(self, sensor: Mapping[str, object]) -> SensorSetting:
        """This setting with the ``sensor.…`` values of a variant put in, e.g. ``{"sensor.exposure_ev": 0.5}``.

        Raises:
            UnknownName: a path below ``sensor`` that no field answers to.
            InvalidInput: a path outside ``sensor``.
            pydantic.ValidationError: a value outside the field's range.
        """
        if not sensor:
            return self
        values = self.model_dump()
        for path, value in sensor.items():
            root, _, attribute = path.partition(".")
            if root != "sensor":
                raise InvalidInput("not a parameter of the sensor", field=path, limit="paths below 'sensor'")
            if attribute not in values or attribute == "name":
                known = [f"sensor.{name}" for name in values if name != "name"]
                raise UnknownName("sensor parameter", path, known, field=path)
            values[attribute] = value
        return SensorSetting.model_validate(values)


def develop(linear: NDArray[np.float16], setting: SensorSetting) -> NDArray[np.uint8]:
    """Make the picture of a linear image.

    Args:
        linear: (H, W, 3) float16, scene-referred, linear Rec. 709. NaN and negative values count as 0, inf as white.
        setting: exposure, tone curve and gamma.

    Returns:
        (H, W, 3) uint8 sRGB, a new array.

    Raises:
        InvalidInput: the image is not (H, W, 3) float16.
    """
    if linear.dtype != np.float16 or linear.ndim != 3 or linear.shape[2] != 3:
        given = f"{linear.dtype} {linear.shape}"
        raise InvalidInput("not a linear image", field="linear", value=given, limit="(H, W, 3) float16")
    table = _table(setting.exposure_ev, setting.curve, setting.gamma)
    # mode="clip" spares numpy the range check; every uint16 is a valid index.
    return np.take(table, np.ascontiguousarray(linear).view(np.uint16), mode="clip")


def respond(linear: NDArray[np.float64], setting: SensorSetting) -> NDArray[np.float64]:
    """The stage's formula without rounding: linear values of any shape to display values in [0, 1], float64."""
    exposed = np.nan_to_num(linear, nan=0.0, posinf=np.inf, neginf=0.0) * 2.0**setting.exposure_ev
    # 1e6 is white on every curve, and keeps inf / inf out of the rational ones.
    toned = CURVES[setting.curve](np.clip(exposed, 0.0, 1e6))
    display = linear_to_srgb(np.clip(toned, 0.0, 1.0))
    return np.clip(display, 0.0, 1.0) ** (1.0 / setting.gamma)


@lru_cache(maxsize=32)  # 64 KiB each; a pure function of its arguments
def _table(exposure_ev: float, curve: ToneCurve, gamma: float) -> NDArray[np.uint8]:
    """(65536,) uint8: the picture value of every float16, by its bits."""
    every_value = np.arange(65536, dtype=np.uint32).astype(np.uint16).view(np.float16).astype(np.float64)
    setting = SensorSetting(exposure_ev=exposure_ev, curve=curve, gamma=gamma)
    table: NDArray[np.uint8] = np.floor(respond(every_value, setting) * 255.0 + 0.5).astype(np.uint8)
    table.setflags(write=False)
    return table
