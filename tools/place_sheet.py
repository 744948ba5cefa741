"""Render the places beside the street: ``docs/images/places.jpg``, by `raster`.

``make gallery`` runs it. A row is one place: by day from two cameras, and in another light or weather.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from PIL import Image

from tools.contact_sheet import captioned, contact_sheet
from tools.gallery import OUT, TILE, Condition, picture
from valerie import plugins
from valerie.parameters.definitions import Value
from valerie.scene.assets.asset import load_asset

_DUSK: Final[dict[str, Value]] = {"sun-1.elevation": -5.0}
_RAIN: Final[dict[str, Value]] = {"environment-1.cloud_cover": 0.95, "environment-1.rain": 12.0}
_FOG: Final[dict[str, Value]] = {"environment-1.cloud_cover": 1.0, "environment-1.visibility": 150.0}
_METERED: Final = {"auto_exposure": True}
PLACES: Final[dict[str, tuple[Condition, ...]]] = {
    "street-crossing": (
        Condition("by day", {}, {}),
        Condition("along-green", {"traffic-light-1.kind": "along-green"}, {}, camera="camera-2"),
        Condition("dusk", _DUSK, {}, sensor=_METERED),
    ),
    "rural-road": (
        Condition("by day", {}, {}),
        Condition("from a van", {}, {}, camera="camera-3"),
        Condition("fog, 150 m", _FOG, {}, sensor={"exposure_ev": 1.3}),
    ),
    "car-park": (
        Condition("by day", {}, {}),
        Condition("low sun", {"sun-1.elevation": 14.0, "sun-1.azimuth": 250.0}, {}, camera="camera-2"),
        Condition("rain", _RAIN, {}, sensor={"exposure_ev": 1.5}, camera="camera-3"),
    ),
    "bus-stop": (
        Condition("by day", {}, {}),
        Condition("rain", _RAIN, {}, sensor={"exposure_ev": 1.5}, camera="camera-3"),
        Condition("dusk", _DUSK, {}, sensor=_METERED),
    ),
    "motorway-exit": (
        Condition("by day", {}, {}),
        Condition("low sun", {"sun-1.elevation": 10.0, "sun-1.azimuth": 110.0}, {}, camera="camera-2"),
        Condition("dusk", _DUSK, {}, sensor=_METERED, camera="camera-3"),
    ),
}  # fmt: skip


def main(out: Path) -> None:
    """Write the sheet."""
    out.mkdir(parents=True, exist_ok=True)
    engine, tiles = plugins.create_renderer("raster"), list[Image.Image]()
    try:
        for name, conditions in PLACES.items():
            asset = load_asset(name)
            for condition in conditions:
                caption = f"{name} · {condition.caption}"
                tiles.append(captioned(Image.fromarray(picture(engine, asset, condition, TILE)), TILE, caption))
                sys.stdout.write(f"{caption}\n")
                sys.stdout.flush()
    finally:
        engine.close()
    contact_sheet(tiles, 3).save(out / "places.jpg", quality=70, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else OUT)
