"""Render ``docs/images/sensor.jpg``: one frame of the generated street with each effect of the sensor stage.

``make sensor-strip`` runs it. `valerie.sensing.sensor.develop` computes every tile from the same linear image. Tiles marked
"detail" show a central crop pixel by pixel, the others the whole picture at half its size.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tools.contact_sheet import captioned, contact_sheet
from valerie import plugins
from valerie.rendering.base import LinearImage, View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.scanning import Readout, scan
from valerie.runs.resolving.motion import VELOCITY_SPAN_S
from valerie.runs.resolving.sensors import focal_length_mm
from valerie.scene.assets.asset import load_asset
from valerie.scene.graph.model import Scene
from valerie.scene.variation.variant import apply
from valerie.sensing.sensor import Shot, develop, read_lines
from valerie.sensing.settings import SensorSetting

OUT: Final = Path(__file__).parents[1] / "docs" / "images" / "sensor.jpg"
CAMERA: Final = "camera-1"
#: A person near enough to be visible in a tile.
VARIANT: Final = {
    "scene.person-1.pos.x": 4.2,
    "scene.person-1.pos.y": 6.0,
    "scene.sun-1.azimuth": 150.0,
    "scene.sun-1.elevation": 35.0,
}
#: What the other scenes change, by a word of the tile's caption.
AGAINST_LIGHT: Final[dict[str, dict[str, float | str]]] = {
    "low sun": {"scene.sun-1.azimuth": 200.0, "scene.sun-1.elevation": 9.0},
    "headlamps": {
        "scene.sun-1.elevation": -9.0,
        "scene.car-101.kind": "sedan",
        "scene.car-101.pos.y": 22.0,
        "scene.car-101.heading": 180.0,
    },
}
#: Turn rate of the camera in the shutter's tiles, as in a bend.
YAW_DEG_PER_S: Final = 40.0
ROLLING: Final = SensorSetting.model_validate({"shutter": {"line_time_us": 60}})
WIDTH, HEIGHT = 960, 540
COLUMNS: Final = 5
#: Exposure of tiles that name no other.
EXPOSURE_EV: Final = 0.8

#: (caption, setting, whether the tile shows the crop pixel by pixel).
TILES: Final[tuple[tuple[str, dict[str, Any], bool], ...]] = (
    ("filmic", {}, False),
    ("exposure -2 EV", {"exposure_ev": EXPOSURE_EV - 2.0}, False),
    ("curve srgb: highlights are cut", {"curve": "srgb"}, False),
    ("curve blender-filmic, gamma 1.5, 0.5 EV", {"curve": "blender-filmic", "gamma": 1.5, "exposure_ev": 0.5}, False),
    ("auto exposure", {"exposure_ev": 0.0, "auto_exposure": True}, False),
    ("white balance 3800 K", {"white_balance": {"temperature_k": 3800}}, False),
    ("white balance 11,000 K", {"white_balance": {"temperature_k": 11000}}, False),
    ("tint -12", {"white_balance": {"tint": -12}}, False),
    ("vignetting 3", {"lens": {"vignetting": 3}}, False),
    ("rolling shutter 60 us per row, turning", {}, False),
    ("distortion k1 -0.9 (barrel)", {"distortion": {"k1": -0.9}}, False),
    ("distortion k1 0.9 (pincushion)", {"distortion": {"k1": 0.9}}, False),
    ("dirt 0.15", {"soiling": {"dirt": 0.15}}, False),
    ("drops 0.15", {"soiling": {"drops": 0.15}}, False),
    ("low sun", {"exposure_ev": -0.5, "auto_exposure": True}, False),
    ("low sun, glare 0.02", {"exposure_ev": -0.5, "auto_exposure": True, "lens": {"glare": 0.02}}, False),
    ("low sun, flare 0.002", {"exposure_ev": -0.5, "auto_exposure": True, "lens": {"flare": 0.002}}, False),
    ("headlamps at night", {"exposure_ev": 0.0, "auto_exposure": True}, False),
    ("headlamps at night, glare 0.02", {"exposure_ev": 0.0, "auto_exposure": True, "lens": {"glare": 0.02}}, False),
    ("headlamps at night, flare 0.002", {"exposure_ev": 0.0, "auto_exposure": True, "lens": {"flare": 0.002}}, False),
    ("filmic · detail", {}, True),
    ("f/0.7 focused on the person · detail", {"lens": {"f_number": 0.7, "focus_distance_m": 18}}, True),
    ("shutter open for 10 ms, turning · detail", {"shutter": {"exposure_ms": 10}}, True),
    ("chromatic aberration 0.008 · detail", {"lens": {"chromatic_aberration": 0.008}}, True),
    ("full well 1,000 e, shot noise · detail", {"noise": {"shot": True, "full_well_electrons": 1000}}, True),
    (
        "read noise 40 e, full well 4,000 e · detail",
        {"noise": {"read_electrons": 40, "full_well_electrons": 4000}},
        True,
    ),
    (
        "night gain 24 dB at -4 EV · detail",
        {"exposure_ev": EXPOSURE_EV - 4, "gain_db": 24, "noise": {"shot": True, "read_electrons": 4}},
        True,
    ),
    ("converter 7 bits · detail", {"noise": {"adc_bits": 7}}, True),
    ("dead and hot pixels 0.2 % · detail", {"pixels": {"dead_rate": 0.002, "hot_rate": 0.002}}, True),
    ("JPEG quality 8 · detail", {"jpeg_quality": 8}, True),
)


def frame() -> tuple[dict[str, NDArray[np.float16]], Shot]:
    """Return the linear images and the sensor's other inputs.

    The images are by a word of the tile's caption. The one with a rolling shutter is ``rolling``, that of all other tiles ``""``.
    """
    asset = load_asset("urban-street")
    scene, view = apply(VARIANT, asset), View(CAMERA, WIDTH, HEIGHT)
    engine, truth_pass = plugins.create_renderer("raster"), TruthPass()
    linear = engine.full(scene, view).pixels
    truth = truth_pass.truth(scene, view)

    def near(seconds: float) -> Scene:
        return apply(VARIANT | {f"scene.{CAMERA}.yaw": YAW_DEG_PER_S * seconds}, asset)

    velocity = truth_pass.velocity(scene, near(VELOCITY_SPAN_S), view, truth, VELOCITY_SPAN_S).vectors
    reading = Readout(read_lines(ROLLING, WIDTH, HEIGHT), ROLLING.shutter.line_time_us * 1e-6)
    rolling = scan(engine, truth_pass, near, view, (LinearImage(linear), truth), reading).image(LinearImage(linear))
    images = {word: engine.full(apply(VARIANT | values, asset), view).pixels for word, values in AGAINST_LIGHT.items()}
    truth_pass.close()
    engine.close()
    shot = Shot(focal_length_mm(asset.manifest, CAMERA, VARIANT), truth.depth, velocity, 0, ("strip",))
    return {**images, "rolling": rolling.pixels, "": linear}, shot


def tile(picture: NDArray[np.uint8], caption: str, *, detail: bool) -> Image.Image:
    """Return half of the picture's size, a crop or the whole, with a caption below."""
    width, height = WIDTH // 2, HEIGHT // 2
    image = Image.fromarray(picture)
    if detail:
        left, top = WIDTH // 4, HEIGHT // 3
        image = image.crop((left, top, left + width, top + height))
    else:
        image = image.resize((width, height), Image.Resampling.BOX)
    return captioned(image, (width, height), caption)


def main(out: Path) -> None:
    """Write the contact sheet."""
    images, shot = frame()
    tiles = [
        tile(
            develop(
                next(image for word, image in images.items() if word in caption),
                SensorSetting.model_validate({"exposure_ev": EXPOSURE_EV, **setting}),
                shot,
            ),
            caption,
            detail=detail,
        )
        for caption, setting, detail in TILES
    ]
    out.parent.mkdir(parents=True, exist_ok=True)
    contact_sheet(tiles, COLUMNS).save(out, quality=80, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else OUT)
