"""Render ``docs/images/vehicles.jpg``: every body of a car, and the trucks, on a bare ground.

``make vehicles`` runs it. ``python -m tools.vehicle_sheet OUT.png KIND…`` shows each named kind from the front, the side and
the rear, large enough to judge a design.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from tools.contact_sheet import captioned, contact_sheet
from urban_street.solids.surfaces import boxes, to_mesh
from urban_street.vehicles import KINDS, build_vehicle, dimensions
from urban_street.vehicles.paints import ALL_PAINTS
from valerie.rendering.base import Renderer, View
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.scene.graph.model import Camera, Material, Node, Scene, Sun
from valerie.scene.graph.transforms import camera_transform
from valerie.sensing.sensor import develop
from valerie.sensing.settings import SensorSetting

OUT: Final = Path(__file__).parents[1] / "docs" / "images" / "vehicles.jpg"
TILE: Final = (300, 170)
LARGE: Final = (620, 350)
COLUMNS: Final = 5
#: Directions from the vehicle to the camera: degrees from +y, counter-clockwise from above.
BEARINGS: Final = {"front": -38.0, "side": -90.0, "rear": -148.0}
EYE_M: Final = 1.55
#: Classes on the sheet.
SHOWN: Final = ("car", "truck")


#: Paints of kinds that the street knows in one colour; the others go through all paints in turn.
_USUAL: Final = {
    "taxi": "yellow",
    "ambulance": "white",
    "police-car": "silver",
    "camper": "sand",
    "classic-car": "petrol",
}


def scene_of(kind: str, seed: int, bearing_deg: float) -> Scene:
    """Return a vehicle on an asphalt plane, with the camera at a bearing."""
    paints = list(ALL_PAINTS)
    content = build_vehicle(kind, seed, _USUAL.get(kind, paints[7 * seed % len(paints)]))
    length, width, height = dimensions(kind)
    turn = math.radians(bearing_deg)
    seen = abs(math.sin(turn)) * length + abs(math.cos(turn)) * width
    distance = 1.58 * max(seen, 1.7 * height) + 0.4 * length * abs(math.cos(turn))
    place = (-math.sin(turn) * distance, math.cos(turn) * distance, EYE_M)
    pitch = -math.degrees(math.atan2(EYE_M - 0.46 * height, distance))
    ground = to_mesh(boxes([[-90.0, -90.0, -0.5]], [[90.0, 90.0, 0.0]]), "ground")
    nodes = [
        Node("scene", np.eye(4)),
        Node("scene.road-1", np.eye(4), (ground,), label_id=7),
        *(Node(f"scene.{part.name}", part.transform, part.meshes, label_id=26) for part in content.parts),
    ]
    asphalt = Material("ground", (0.16, 0.16, 0.165), roughness=0.9)
    return Scene(
        nodes={node.path: node for node in nodes},
        materials={**content.materials, asphalt.name: asphalt},
        textures=content.textures,
        cameras={"camera-1": Camera("scene.camera-1", camera_transform(place, bearing_deg + 180.0, pitch, 0.0), 50.0)},
        sun=Sun(azimuth=math.radians(75.0), elevation=math.radians(38.0)),
    )


def picture(engine: Renderer, kind: str, seed: int, bearing: str, size: tuple[int, int]) -> Image.Image:
    """Return the picture of a kind from one of `BEARINGS`."""
    image = engine.full(scene_of(kind, seed, BEARINGS[bearing]), View("camera-1", *size))
    return Image.fromarray(develop(image.pixels, SensorSetting(exposure_ev=0.7)))


def main(arguments: list[str]) -> None:
    """Write the sheet, or large views of the named kinds."""
    out = Path(arguments[0]) if arguments else OUT
    kinds, bearings, size = [kind for kind, name in KINDS.items() if name in SHOWN], ["front"], TILE
    if arguments[1:]:
        kinds, bearings, size = arguments[1:], list(BEARINGS), LARGE
    engine = RasterRenderer()
    try:
        tiles = [
            captioned(picture(engine, kind, seed, bearing, size), size, kind)
            for seed, kind in enumerate(kinds, start=2)
            for bearing in bearings
        ]
    finally:
        engine.close()
    contact_sheet(tiles, COLUMNS if len(bearings) == 1 else len(bearings)).save(out, quality=80, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:])
