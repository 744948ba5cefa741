"""Render the gallery: ``docs/images/gallery.jpg``, and ``docs/images/street-<engine>.jpg`` for every engine.

``make gallery`` runs it. A row of the contact sheet is one light and weather with its own pedestrians, a column one engine.
All engines get the same scene document; a tile says so if an engine cannot show it or is not installed.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tools.contact_sheet import captioned, contact_sheet
from valerie import plugins
from valerie.errors import MissingDependency, RenderingError
from valerie.parameters.definitions import Value
from valerie.rendering.base import Renderer, View
from valerie.rendering.engine import EVERYTHING
from valerie.scene.assets.asset import SceneAsset, load_asset
from valerie.scene.variation.variant import apply
from valerie.sensing.sensor import develop
from valerie.sensing.settings import SensorSetting

OUT: Final = Path(__file__).parents[1] / "docs" / "images"
#: Column to engine and its settings.
ENGINES: Final[dict[str, dict[str, Any]]] = {"raster": {}, "cycles": {"quality": "draft"}, "pyrender": {}}
TILE: Final = (480, 270)
LARGE: Final = (1280, 720)


@dataclass(frozen=True, slots=True)
class Condition:
    """One row: values below ``scene.``, and the camera's setting."""

    caption: str
    values: dict[str, Value]
    people: dict[str, dict[str, Value]]
    season: str = "summer"
    sensor: dict[str, Any] = field(default_factory=dict)
    camera: str = "camera-1"


def person(character: str, x: float, y: float, heading: float, **more: Value) -> dict[str, Value]:
    """Return the parameters of one pedestrian."""
    return {"character": character, "pos.x": x, "pos.y": y, "heading": heading, **more}


CONDITIONS: Final = (
    Condition(
        "clear, sun from the right",
        {"sun-1.azimuth": 260.0, "sun-1.elevation": 38.0, "bicycle-101.visible": True, "bicycle-101.pos.y": 15.0},
        {
            "person-1": person("yellow-shirt", 3.0, 7.0, 190.0),
            "person-2": person("black-outfit", 1.4, 3.0, 160.0),
            "person-3": person("striped-boy", 4.3, 9.5, 185.0, pose="standing"),
            "person-4": person("blue-dress", -1.9, 6.0, 200.0),
        },
    ),
    Condition(
        "low sun, autumn",
        {"sun-1.azimuth": 225.0, "sun-1.elevation": 12.0, "environment-1.turbidity": 4.0},
        {
            "person-1": person("red-coat", 1.5, 5.0, 150.0),
            "person-2": person("green-parka", 3.6, 8.0, 230.0, gait_phase=0.5),
            "person-3": person("pink-girl", 2.3, 4.0, 170.0, pose="waving"),
            "person-4": person("grey-hoodie", 6.9, 7.0, 0.0, pose="phone"),
        },
        season="autumn",
        sensor={"exposure_ev": 1.0},
        camera="camera-3",
    ),
    Condition(
        "overcast, winter",
        {"environment-1.cloud_cover": 1.0, "car-101.kind": "estate", "car-101.colour": "red", "car-101.pos.y": 22.0},
        {
            "person-1": person("navy-coat", 4.4, 6.0, 180.0),
            "person-2": person("brown-hat", 1.0, 4.5, 90.0, pose="standing"),
            "person-3": person("orange-workwear", -1.9, 8.0, 180.0),
        },
        season="winter",
        sensor={"exposure_ev": 1.7},
    ),
    Condition(
        "fog, 120 m",
        {"environment-1.cloud_cover": 1.0, "environment-1.visibility": 120.0},
        {
            "person-1": person("black-outfit", 3.2, 9.0, 180.0),
            "person-2": person("white-tee", 1.2, 5.0, 250.0),
            "person-3": person("yellow-shirt", 2.2, 26.0, 0.0),
        },
        sensor={"exposure_ev": 1.3},
        camera="camera-2",
    ),
    Condition(
        "rain, 15 mm/h",
        {"environment-1.cloud_cover": 0.9, "environment-1.rain": 15.0},
        {
            "person-1": person("green-parka", 3.4, 6.0, 180.0, carries="umbrella"),
            "person-2": person("red-coat", 1.4, 8.0, 20.0, carries="umbrella"),
            "person-3": person("navy-coat", 6.9, 5.0, 180.0, carries="shopping-bag"),
        },
        sensor={"exposure_ev": 1.5},
    ),
    Condition(
        "snowfall, 1.5 mm/h on 2 cm of snow",
        {"environment-1.cloud_cover": 1.0, "environment-1.snowfall": 1.5, "environment-1.snow_depth": 0.02},
        {
            "person-1": person("green-parka", 3.0, 5.0, 180.0),
            "person-2": person("red-coat", 1.4, 3.0, 20.0, carries="umbrella"),
            "person-3": person("navy-coat", 6.9, 6.0, 180.0),
        },
        season="winter",
        sensor={"exposure_ev": 1.5},
    ),
    Condition(
        "lying snow, 8 cm, clear",
        {"sun-1.azimuth": 240.0, "sun-1.elevation": 25.0, "environment-1.snow_depth": 0.08},
        {
            "person-1": person("red-coat", 3.2, 7.0, 190.0),
            "person-2": person("green-parka", 1.2, 5.0, 250.0),
            "person-3": person("grey-hoodie", 6.9, 7.0, 0.0),
        },
        season="winter",
        sensor={"exposure_ev": 1.0},
    ),
    Condition(
        "snow at night, lamps",
        {
            "sun-1.elevation": -12.0,
            "environment-1.cloud_cover": 1.0,
            "environment-1.snowfall": 1.0,
            "environment-1.snow_depth": 0.06,
            "car-101.kind": "sedan",
            "car-101.pos.x": 2.5,
            "car-101.pos.y": 30.0,
        },
        {
            "person-1": person("yellow-shirt", 3.2, 8.0, 180.0),
            "person-2": person("black-outfit", 1.4, 13.0, 250.0),
            "person-3": person("navy-coat", 6.9, 6.0, 180.0),
        },
        season="winter",
        sensor={"auto_exposure": True, "exposure_ev": 0.7},
    ),
    Condition(
        "wet leaves, rain of 1 mm/h",
        {"environment-1.cloud_cover": 0.9, "environment-1.rain": 1.0, "environment-1.leaf_litter": 0.5},
        {
            "person-1": person("red-coat", 3.4, 6.0, 180.0, carries="umbrella"),
            "person-2": person("navy-coat", 1.4, 4.0, 20.0),
            "person-3": person("green-parka", 6.9, 5.0, 180.0),
        },
        season="autumn",
        sensor={"exposure_ev": 1.6},
    ),
    Condition(
        "low sun ahead, glare and flare",
        {"sun-1.azimuth": 200.0, "sun-1.elevation": 8.5, "environment-1.turbidity": 4.0},
        {
            "person-1": person("black-outfit", 3.2, 9.0, 180.0),
            "person-2": person("white-tee", 1.2, 5.0, 250.0),
            "person-3": person("striped-boy", 6.9, 6.0, 185.0),
        },
        season="autumn",
        sensor={"auto_exposure": True, "lens": {"glare": 0.02, "flare": 0.003}},
    ),
    Condition(
        "night, street and car lamps",
        {"sun-1.elevation": -12.0, "car-101.kind": "sedan", "car-101.pos.x": 2.5, "car-101.pos.y": 30.0},
        {
            "person-1": person("yellow-shirt", 3.2, 8.0, 180.0),
            "person-2": person("black-outfit", 1.4, 13.0, 250.0),
            "person-3": person("blue-dress", 6.9, 6.0, 180.0),
        },
        sensor={"auto_exposure": True},
    ),
)


@cache
def street(season: str) -> SceneAsset:
    """Return the street with four persons."""
    return load_asset({"name": "urban-street", "persons": 4, "season": season})


def assignment(condition: Condition) -> dict[str, Value]:
    """Return all values of the condition, by full path."""
    values_by_path: dict[str, Value] = {f"scene.{path}": value for path, value in condition.values.items()}
    for name, values in condition.people.items():
        values_by_path |= {f"scene.{name}.{key}": value for key, value in values.items()}
    return values_by_path


def picture(engine: Renderer, asset: SceneAsset, condition: Condition, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the camera's picture of the condition: (height, width, 3) uint8."""
    image = engine.full(apply(assignment(condition), asset), View(condition.camera, *size))
    return develop(image.pixels, SensorSetting.model_validate({"exposure_ev": 0.8, **condition.sensor}))


def tried(engine: Renderer, asset: SceneAsset, condition: Condition) -> NDArray[np.uint8] | str:
    """Return the tile's picture, or the engine's message if it cannot show the condition."""
    try:
        return picture(engine, asset, condition, TILE)
    except RenderingError as error:
        return str(error).partition(":")[0]


def refusal(engine: str, condition: Condition) -> str | None:
    """Return the reason why an engine cannot show a condition, as in the check of a spec; None if it can."""
    names = {path.removeprefix("environment-1.") for path in condition.values if path.startswith("environment-1.")}
    lacking = sorted(names & (EVERYTHING - plugins.declared_engine(engine).shows))
    return f"{engine} has no {', '.join(lacking)}" if lacking else None


def column(engine_name: str, out: Path) -> list[Image.Image]:
    """Return one engine's tiles, and write its large picture."""
    try:
        engine = plugins.create_renderer(engine_name, ENGINES[engine_name])
    except MissingDependency:
        reason = f"{engine_name} is not installed; {plugins.declared_engine(engine_name).install_hint}"
        return [captioned(reason, TILE, f"{engine_name} · {condition.caption}") for condition in CONDITIONS]
    tiles = []
    try:
        for condition in CONDITIONS:
            asset, caption = street(condition.season), f"{engine_name} · {condition.caption}"
            content = refusal(engine_name, condition) or tried(engine, asset, condition)
            tiles.append(captioned(content if isinstance(content, str) else Image.fromarray(content), TILE, caption))
            sys.stdout.write(f"{caption}{': ' + content if isinstance(content, str) else ''}\n")
            sys.stdout.flush()
            if condition is CONDITIONS[0]:
                large = Image.fromarray(picture(engine, asset, condition, LARGE))
                large.save(out / f"street-{engine_name}.jpg", quality=84, optimize=True)
    finally:
        engine.close()
    return tiles


def main(out: Path) -> None:
    """Write all pictures."""
    out.mkdir(parents=True, exist_ok=True)
    columns = [column(name, out) for name in ENGINES]
    sheet = contact_sheet([tile for row in zip(*columns, strict=True) for tile in row], len(columns))
    sheet.save(out / "gallery.jpg", quality=80, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else OUT)
