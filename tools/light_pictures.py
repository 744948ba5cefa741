"""Render ``docs/images/light.jpg`` for docs/light.md: one tile per light and weather, by the raster engine.

``python -m tools.light_pictures`` runs it and takes two minutes of CPU time.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from PIL import Image

from tools.contact_sheet import captioned, contact_sheet
from valerie.parameters.definitions import Value
from valerie.rendering.base import View
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.scene.assets.asset import load_asset
from valerie.scene.variation.variant import apply
from valerie.sensing.sensor import develop
from valerie.sensing.settings import SensorSetting

OUT: Final = Path(__file__).parents[1] / "docs" / "images" / "light.jpg"
TILE: Final = (320, 180)
ACROSS: Final = 3
#: Largest size of the sheet in bytes.
LARGEST: Final = 200_000


class Tile(NamedTuple):
    """One picture: values below ``scene.``, the camera's setting, and the season of the trees."""

    caption: str
    values: dict[str, Value]
    sensor: dict[str, Value]
    season: str = "summer"


_METERED: Final[dict[str, Value]] = {"auto_exposure": True}
TILES: Final = (
    Tile("sun-1: 12 h on day 172, 50° N", {"sun-1.time_of_day": 12.0, "sun-1.day_of_year": 172}, {}),
    Tile("sun-1: 19 h on the same day", {"sun-1.time_of_day": 19.0, "sun-1.day_of_year": 172}, {"exposure_ev": 0.5}),
    Tile("environment-1.turbidity: 9", {"environment-1.turbidity": 9.0}, {}),
    Tile("environment-1.cloud_cover: 1", {"environment-1.cloud_cover": 1.0}, {"exposure_ev": 1.0}),
    Tile("environment-1.visibility: 60 m", {"environment-1.visibility": 60.0}, {}),
    Tile("environment-1.rain: 12 mm/h", {"environment-1.rain": 12.0, "environment-1.cloud_cover": 0.8}, {"exposure_ev": 0.8}),
    Tile("sun 2° below the horizon (metered)", {"sun-1.elevation": -2.0, "sun-1.azimuth": 215.0}, _METERED),
    Tile("sun 12° below the horizon (metered)", {"sun-1.elevation": -12.0}, _METERED),
    Tile(
        "the same with rain and a car (metered)",
        {
            "sun-1.elevation": -12.0, "environment-1.rain": 4.0, "car-101.kind": "sedan", "car-101.pos.y": 24.0,
        },
        _METERED,
    ),
    Tile(
        "environment-1.snowfall: 2 mm/h",
        {"environment-1.snowfall": 2.0, "environment-1.snow_depth": 0.01, "environment-1.cloud_cover": 1.0},
        {"exposure_ev": 1.3},
        "winter",
    ),
    Tile(
        "environment-1.snow_depth: 8 cm",
        {"environment-1.snow_depth": 0.08, "sun-1.azimuth": 240.0, "sun-1.elevation": 25.0},
        {"exposure_ev": 0.8},
        "winter",
    ),
    Tile(
        "environment-1.leaf_litter: 0.5 in rain",
        {"environment-1.leaf_litter": 0.5, "environment-1.rain": 1.0, "environment-1.cloud_cover": 0.9},
        {"exposure_ev": 1.3},
        "autumn",
    ),
)  # fmt: skip
_PERSON: Final[dict[str, Value]] = {"scene.person-1.pos.y": 9.0, "scene.person-1.pos.x": 3.6}


def main() -> None:
    """Render the tiles and write the sheet in the best quality within `LARGEST`."""
    engine = RasterRenderer()
    assets = {
        season: load_asset({"name": "urban-street", "season": season}) for season in ("summer", "winter", "autumn")
    }
    tiles = []
    for tile in TILES:
        values = _PERSON | {f"scene.{path}": value for path, value in tile.values.items()}
        # Rendering at twice the size keeps a small picture sharp.
        scene, view = apply(values, assets[tile.season]), View("camera-1", 2 * TILE[0], 2 * TILE[1])
        image = engine.layer(scene, view).over(engine.background(scene, view))
        picture = develop(image.pixels, SensorSetting.model_validate(tile.sensor))
        small = Image.fromarray(np.ascontiguousarray(picture)).resize(TILE, Image.Resampling.LANCZOS)
        tiles.append(captioned(small, TILE, tile.caption))
    engine.close()
    sheet = contact_sheet(tiles, ACROSS)
    for quality in range(90, 40, -5):
        sheet.save(OUT, quality=quality, optimize=True, progressive=True)
        if OUT.stat().st_size <= LARGEST:
            return


if __name__ == "__main__":
    main()
