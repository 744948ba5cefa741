"""The sensor stage, which turns a linear image into the camera image that a function under test receives.

The effects follow the path of the light:

1. *scene-referred light*: defocus; motion blur; dirt and drops on the front glass; glare; flare;
   distortion with lateral chromatic aberration, in one resampling; vignetting
2. *electrons*: exposure, dead and hot pixels, shot noise, read noise, full well, gain, converter
3. *camera values*: white balance
4. *display values*: tone curve, sRGB transfer, gamma, 8 bits, JPEG

Neutral effects are skipped. Exposure, gain, white balance, a per-channel curve and gamma map one channel value to another, and a
float16 has only 65,536 values. For these effects, the stage evaluates the float64 formula once per setting for every value and
looks up each frame in that table: exact, and 2 ms of CPU time for 960 × 540. The other effects work in float32 and end in the
same table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.color import linear_to_srgb
from valerie.errors import InvalidInput
from valerie.parameters.assignment import digest
from valerie.sensing.blender_filmic import blender_filmic
from valerie.sensing.colour import white_balance_gains
from valerie.sensing.curves import CURVES
from valerie.sensing.defocus import circle_of_confusion, defocus
from valerie.sensing.distortion import directions, distort, pixel_map
from valerie.sensing.electronics import break_pixels, expose
from valerie.sensing.flare import flared
from valerie.sensing.glare import veiled
from valerie.sensing.jpeg import through_jpeg
from valerie.sensing.metering import LONGEST_EV, metered_ev
from valerie.sensing.motion import Movement, collect_light
from valerie.sensing.optics import vignetting
from valerie.sensing.resampling import bilinear
from valerie.sensing.settings import SensorSetting
from valerie.sensing.soiling import dirty, rained_on

#: Part of every prediction's digest. Raise it by hand whenever the pixels of a setting change.
REVISION: Final = 2
#: Sensor width to which focal lengths in millimetres refer, as everywhere in the scene.
SENSOR_WIDTH_MM: Final = 36.0
#: The largest finite float16, which stands for infinite light.
_BRIGHTEST: Final = 65504.0

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """The data of a frame besides its linear image. The stage reads only the data that the setting needs.

    Attributes:
        focal_length_mm: focal length of the camera on a sensor 36 mm wide.
        depth: (H, W) float32, metres along the optical axis, inf for the sky.
        velocity: (H, W, 2) float32, pixels per second to the right and down.
        run_seed: seed of the run.
        content: digests of the linear image, which give every image its own noise.
        metered_ev: what automatic exposure adds (`valerie.sensing.metering.metered_ev`); None meters the linear image itself.
    """

    focal_length_mm: float | None = None
    depth: NDArray[np.float32] | None = None
    velocity: NDArray[np.float32] | None = None
    run_seed: int = 0
    content: tuple[str, ...] = ()
    metered_ev: float | None = None


def develop(linear: NDArray[np.float16], setting: SensorSetting, shot: Shot | None = None) -> NDArray[np.uint8]:
    """Return the camera image of a linear image.

    Args:
        linear: (H, W, 3) float16, scene-referred, linear Rec. 709. NaN and negative values count as 0, inf as white.
        setting: the camera.
        shot: data of the frame, if the setting needs any.

    Returns:
        (H, W, 3) uint8 sRGB, a new array; equal for equal input.

    Raises:
        InvalidInput: the image is not (H, W, 3) float16, or the setting needs data that ``shot`` lacks.
    """
    if linear.dtype != np.float16 or linear.ndim != 3 or linear.shape[2] != 3:
        layout = f"{linear.dtype} {linear.shape}"
        raise InvalidInput("not a linear image", field="linear", value=layout, limit="(H, W, 3) float16")
    if setting.auto_exposure:
        setting = _metered(setting, shot.metered_ev if shot is not None else None, linear)
    balance = white_balance_gains(setting.white_balance.temperature_k, setting.white_balance.tint)
    factor = 2.0**setting.exposure_ev
    if setting.gain_db:
        factor *= 10.0 ** (setting.gain_db / 20.0)
    values: NDArray[np.float16] | Floats = linear
    if _bends_light(setting) or setting.counts_electrons:
        shot = shot if shot is not None else Shot()
        light = np.nan_to_num(linear.astype(np.float32), nan=0.0, posinf=_BRIGHTEST, neginf=0.0)
        values = _through_lens(np.maximum(light, np.float32(0.0), out=light), setting, shot)
    if setting.counts_electrons and shot is not None:
        values = _counted(values.astype(np.float32, copy=False), setting, shot)
        factor = 1.0
    picture = _shown(values, [factor * gain for gain in balance], setting)
    return through_jpeg(picture, setting.jpeg_quality) if setting.jpeg_quality else picture


def pixelwise(setting: SensorSetting) -> bool:
    """Return True if a pixel of the picture depends on that pixel of the linear image, the exposure and noise alone."""
    pixels = setting.pixels
    broken = pixels.dead_rate or pixels.hot_rate
    return not (_bends_light(setting) or setting.rolls or broken or setting.jpeg_quality)


def _metered(setting: SensorSetting, metered: float | None, linear: NDArray[np.float16]) -> SensorSetting:
    """Return the setting with the metered exposure: by time as far as it reaches, then by gain."""
    stops = metered_ev(linear) if metered is None else metered
    by_time = min(stops, LONGEST_EV)
    gain_db = setting.gain_db + 20.0 * math.log10(2.0) * (stops - by_time)
    return setting.model_copy(update={"exposure_ev": setting.exposure_ev + by_time, "gain_db": gain_db})


def respond(linear: NDArray[np.float64], setting: SensorSetting) -> NDArray[np.float64]:
    """Return the display values in [0, 1] of neutral light, without noise and rounding. Any shape, float64."""
    gain = 10.0 ** (setting.gain_db / 20.0) if setting.gain_db else 1.0
    return _respond(linear, 2.0**setting.exposure_ev * gain, setting.curve, setting.gamma)


def _bends_light(setting: SensorSetting) -> bool:
    lens, soiling = setting.lens, setting.soiling
    return bool(
        setting.needs_focal_length
        or setting.needs_velocity
        or lens.glare
        or lens.flare
        or lens.chromatic_aberration
        or soiling.dirt
        or soiling.drops
    )


def _through_lens(light: Floats, setting: SensorSetting, shot: Shot) -> Floats:
    height, width = light.shape[:2]
    lens, soiling = setting.lens, setting.soiling
    focal_px = 0.0
    if setting.needs_focal_length:
        if shot.focal_length_mm is None:
            raise InvalidInput("the sensor setting needs the camera's focal length", field="shot.focal_length_mm")
        focal_px = focal_length_px(shot.focal_length_mm, width)
    if setting.needs_depth and (shot.depth is None or shot.depth.shape != (height, width)):
        effect = "defocus" if setting.defocuses else "motion blur"
        raise InvalidInput(f"{effect} needs the depth of every pixel", field="shot.depth", limit=(height, width))
    if setting.defocuses and shot.depth is not None and shot.focal_length_mm is not None:
        radius = circle_of_confusion(
            shot.depth,
            focal_length_mm=shot.focal_length_mm,
            focal_px=focal_px,
            f_number=lens.f_number,
            focus_distance_m=lens.focus_distance_m,
        )
        light = defocus(light, radius)
    if setting.needs_velocity and shot.depth is not None:
        if shot.velocity is None or shot.velocity.shape != (height, width, 2):
            limit = (height, width, 2)
            raise InvalidInput("motion blur needs the velocity of every pixel", field="shot.velocity", limit=limit)
        movement = Movement(shot.velocity, shot.depth)
        light = collect_light(light, movement, setting.shutter.exposure_ms * 1e-3)
    if soiling.dirt:
        light = dirty(light, soiling.dirt, _specimen_seed(setting, shot, "dirt"))
    if soiling.drops:
        light = rained_on(light, soiling.drops, _specimen_seed(setting, shot, "drops"))
    if lens.glare:
        light = veiled(light, lens.glare)
    if lens.flare:
        light = flared(light, lens.flare)
    if lens.chromatic_aberration or not setting.distortion.identity:
        light = _displaced(light, setting, focal_px)
    if lens.vignetting:
        light = light * vignetting(width, height, focal_px, lens.vignetting)
    return light


def seen_from(
    setting: SensorSetting,
    width: int,
    height: int,
    *,
    focal_length_mm: float | None = None,
) -> NDArray[np.intp]:
    """Return, for each pixel of the camera image, the flat index of the rendered pixel that it shows, (H, W).

    Ground truth is resampled with it.

    Args:
        setting: the camera; only the distortion matters.
        width, height: pixels.
        focal_length_mm: as for `Shot`; needed if the lens distorts.

    Raises:
        InvalidInput: The lens distorts and there is no focal length.
    """
    if setting.distortion.identity:
        return np.arange(height * width, dtype=np.intp).reshape(height, width)
    if focal_length_mm is None:
        raise InvalidInput("the sensor setting needs the camera's focal length", field="focal_length_mm")
    return pixel_map(setting.distortion, width, height, focal_length_px(focal_length_mm, width)).nearest()


def read_lines(
    setting: SensorSetting, width: int, height: int, focal_length_mm: float | None = None
) -> NDArray[np.float64]:
    """Return the row of the picture that shows each rendered pixel; 0 is the middle of the picture.

    Args:
        setting: the camera; only the distortion matters.
        width, height: pixels.
        focal_length_mm: as for `seen_from`.

    Returns:
        (H, W), or (H, 1) without distortion.

    Raises:
        InvalidInput: The lens distorts and there is no focal length.
    """
    half_y = 0.5 * (height - 1)
    if setting.distortion.identity:
        return (np.arange(height, dtype=np.float64) - half_y)[:, None]
    if focal_length_mm is None:
        raise InvalidInput("the sensor setting needs the camera's focal length", field="focal_length_mm")
    focal_px = focal_length_px(focal_length_mm, width)
    _, lens_y = distort(setting.distortion, *directions(width, height, focal_px))
    zoom = pixel_map(setting.distortion, width, height, focal_px).zoom
    # Pixels that the lens maps outside the image have no row. They take the nearest one.
    lines: NDArray[np.float64] = np.clip(lens_y * focal_px * zoom, -half_y, half_y)
    return lines


def _displaced(light: Floats, setting: SensorSetting, focal_px: float) -> Floats:
    """Apply distortion and lateral chromatic aberration in one resampling.

    Lateral chromatic aberration is a difference of magnification between the colours: the linear term of the radial model of
    J. Mallon and P. F. Whelan, "Calibration and removal of lateral chromatic aberration in images", Pattern Recognition Letters
    28(1), 2007, 125-135 (doi 10.1016/j.patrec.2006.06.013). Red and blue differ from green equally, in opposite directions.
    """
    height, width = light.shape[:2]
    middle_x, middle_y = 0.5 * (width - 1), 0.5 * (height - 1)
    aberration = setting.lens.chromatic_aberration
    if setting.distortion.identity:
        # Broadcasting one row of x and one column of y avoids repeated work.
        x, y = np.arange(width, dtype=np.float64)[None, :], np.arange(height, dtype=np.float64)[:, None]
    else:
        source = pixel_map(setting.distortion, width, height, focal_px)
        x, y = source.x, source.y
    displaced = np.empty_like(light)
    for channel, larger in enumerate((1.0 + aberration, 1.0, 1.0 - aberration)):
        at_x, at_y = x, y
        if larger != 1.0:
            at_x, at_y = middle_x + (x - middle_x) / larger, middle_y + (y - middle_y) / larger
        displaced[..., channel] = bilinear(np.ascontiguousarray(light[..., channel]), at_x, at_y)
    return displaced


def _counted(light: Floats, setting: SensorSetting, shot: Shot) -> Floats:
    """Expose light and count it in electrons, with the gain."""
    exposed: Floats = light * np.float32(2.0**setting.exposure_ev)
    pixels = setting.pixels
    if pixels.dead_rate or pixels.hot_rate:
        generator = np.random.default_rng(_specimen_seed(setting, shot, "pixels"))
        exposed = break_pixels(exposed, pixels, 2.0 * 2.0**setting.noise.headroom_ev, generator)
    gain = 10.0 ** (setting.gain_db / 20.0) if setting.gain_db else 1.0
    noise = np.random.default_rng(_seed("noise", shot.run_seed, shot.content, setting.specimen))
    return expose(exposed, setting.noise, gain=gain, generator=noise)


def _shown(values: NDArray[np.float16] | Floats, factors: list[float], setting: SensorSetting) -> NDArray[np.uint8]:
    """Convert camera values, times a factor per channel, to 8 bits."""
    if setting.curve == "blender-filmic":
        light = np.nan_to_num(values.astype(np.float32, copy=False), nan=0.0, posinf=_BRIGHTEST, neginf=0.0)
        display = blender_filmic(light * np.array(factors, np.float32))
        if setting.gamma != 1.0:
            display = display ** np.float32(1.0 / setting.gamma)
        picture: NDArray[np.uint8] = np.floor(display * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)
        return picture
    if values.dtype != np.float16:
        values = np.minimum(values, np.float32(_BRIGHTEST)).astype(np.float16)
    bits = np.ascontiguousarray(values).view(np.uint16)
    tables = [_table(factor, setting.curve, setting.gamma) for factor in factors]
    # Every uint16 is a valid index, so mode="clip" only saves numpy's range check.
    if factors[0] == factors[1] == factors[2]:
        return np.take(tables[0], bits, mode="clip")
    picture = np.empty(bits.shape, np.uint8)
    for channel, table in enumerate(tables):
        picture[..., channel] = np.take(table, bits[..., channel], mode="clip")
    return picture


def focal_length_px(focal_length_mm: float, width: int) -> float:
    """Return the focal length in pixels for an image ``width`` pixels wide."""
    return focal_length_mm / SENSOR_WIDTH_MM * width


def _specimen_seed(setting: SensorSetting, shot: Shot, effect: str) -> int:
    return _seed(effect, shot.run_seed, setting.specimen)


def _seed(*parts: object) -> int:
    return int(digest("sensor", *parts), 16)


def _respond(linear: NDArray[np.float64], factor: float, curve: str, gamma: float) -> NDArray[np.float64]:
    exposed = np.nan_to_num(linear, nan=0.0, posinf=np.inf, neginf=0.0) * factor
    # 1e6 is white on every curve. Without the limit, the rational curves would compute inf / inf.
    exposed = np.clip(exposed, 0.0, 1e6)
    if curve == "blender-filmic":
        grey = np.repeat(exposed.astype(np.float32)[..., None], 3, axis=-1)
        display = blender_filmic(grey)[..., 1].astype(np.float64)
    else:
        display = linear_to_srgb(np.clip(CURVES[curve](exposed), 0.0, 1.0))
    return np.clip(display, 0.0, 1.0) ** (1.0 / gamma)


@lru_cache(maxsize=48)  # 64 KiB each; a pure function of its arguments
def _table(factor: float, curve: str, gamma: float) -> NDArray[np.uint8]:
    """Return the 8-bit value of every float16, indexed by its bits, (65536,) uint8."""
    every_value = np.arange(65536, dtype=np.uint32).astype(np.uint16).view(np.float16).astype(np.float64)
    table: NDArray[np.uint8] = np.floor(_respond(every_value, factor, curve, gamma) * 255.0 + 0.5).astype(np.uint8)
    table.setflags(write=False)
    return table
