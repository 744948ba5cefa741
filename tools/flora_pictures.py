"""Render ``docs/images/trees.jpg`` and ``docs/images/signs.jpg``: the kinds of trees and of sign faces, by the raster engine.

``make flora`` runs it and takes a minute of CPU time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from tools.contact_sheet import captioned, contact_sheet, save_sheet
from urban_street.signs.faces import MIDDLE_M, face_materials, face_textures, faces, plate
from urban_street.solids.surfaces import Bag, pose, quads
from urban_street.street.foliage import build_tree, clad
from urban_street.street.materials import foliage_materials, foliage_textures, make_materials, make_textures
from urban_street.street.plan import Season, StreetSettings
from urban_street.street.species import SPECIES
from valerie.rendering.base import View
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.scene.graph.model import Camera, Environment, Node, Scene, Sun
from valerie.scene.graph.transforms import camera_transform
from valerie.sensing.sensor import develop
from valerie.sensing.settings import SensorSetting

OUT: Final = Path(__file__).parents[1] / "docs" / "images"
TREE: Final = (236, 250)
_SETTINGS: Final = StreetSettings()
#: Kinds that look different in other seasons.
_SEASONS: Final[tuple[tuple[str, Season], ...]] = (
    ("cherry", "spring"), ("maple", "autumn"), ("birch", "autumn"), ("lime", "winter"),
)  # fmt: skip


def main() -> None:
    """Write both sheets."""
    engine = RasterRenderer()
    tiles = [_tree(engine, kind, "summer") for kind in SPECIES]
    tiles.append(
        _portrait(
            engine, clad(np.array([-0.6, -0.35, 0.0]), np.array([0.6, 0.35, 1.1]), 40.0, 0.09, _rng()), "hedge", 1.6
        )
    )
    tiles += [_tree(engine, kind, season) for kind, season in _SEASONS]
    save_sheet(contact_sheet(tiles, 6), OUT / "trees.jpg")
    save_sheet(_signs(engine), OUT / "signs.jpg")
    engine.close()


def _rng() -> np.random.Generator:
    return np.random.default_rng(5)


def _tree(engine: RasterRenderer, kind: str, season: Season) -> Image.Image:
    bag = build_tree(SPECIES[kind], _rng(), kind)
    return _portrait(engine, bag, f"{kind}, {season}", SPECIES[kind].shape.height, season)


def _portrait(engine: RasterRenderer, bag: Bag, caption: str, height: float, season: Season = "summer") -> Image.Image:
    """Return a tile of an object on a lawn."""
    bag.add("turf", quads([[(-60.0, -60.0, 0.0), (60.0, -60.0, 0.0), (60.0, 60.0, 0.0), (-60.0, 60.0, 0.0)]], tile=5.0))
    nodes = [Node("scene", np.eye(4)), Node("scene.vegetation-1", np.eye(4), bag.meshes(), 21)]
    place = (0.0, -2.45 * height, 0.30 * height)
    return captioned(_picture(engine, nodes, place, 4.6, 82.0, TREE, StreetSettings(season=season)), TREE, caption)


def _picture(
    engine: RasterRenderer, nodes: Sequence[Node], place: tuple[float, float, float], pitch: float, focal_length: float,
    size: tuple[int, int], settings: StreetSettings = _SETTINGS,
) -> Image.Image:  # fmt: skip
    """Return a picture of nodes by a camera that looks along +y, with the sun behind its left shoulder."""
    used = {mesh.material for node in nodes for mesh in node.meshes}
    materials = make_materials(0) | foliage_materials(settings.season) | face_materials()
    materials = {name: materials[name] for name in used}
    textures = make_textures(settings) | foliage_textures(settings) | face_textures()
    scene = Scene(
        nodes={node.path: node for node in nodes},
        materials=materials,
        textures={name: textures[name] for material in materials.values() for name in material.textures},
        cameras={"camera-1": Camera("scene.camera-1", camera_transform(place, 0.0, pitch, 0.0), focal_length)},
        sun=Sun(azimuth=math.radians(230.0), elevation=math.radians(38.0)),
        environment=Environment(bearing=0.0),
    )
    view = View("camera-1", 2 * size[0], 2 * size[1])
    picture = develop(engine.background(scene, view).pixels, SensorSetting())
    return Image.fromarray(np.ascontiguousarray(picture)).resize(size, Image.Resampling.LANCZOS)


def _signs(engine: RasterRenderer) -> Image.Image:
    """Return a picture of all faces in rows on a wall, and at its end the back of a plate."""
    columns, step = 15, 0.95
    wall = Bag()
    wall.add("concrete", quads([[(-9.0, 0.1, -9.0), (9.0, 0.1, -9.0), (9.0, 0.1, 9.0), (-9.0, 0.1, 9.0)]], tile=4.0))
    nodes = [Node("scene", np.eye(4)), Node("scene.wall-1", np.eye(4), wall.meshes())]
    names = [*faces(), "stop"]
    rows = math.ceil(len(names) / columns)
    for k, name in enumerate(names):
        row, column = divmod(k, columns)
        x, z = (column - 0.5 * (columns - 1)) * step, (0.5 * (rows - 1) - row) * step - MIDDLE_M
        nodes.append(
            Node(f"scene.traffic-sign-{k + 1}", pose(x, -0.1, z, math.pi * (k == len(names) - 1)), plate(name), 20)
        )
    return _picture(engine, nodes, (0.0, -14.0, 0.0), 0.0, 33.0, (1440, round(1440 * rows / columns)))


if __name__ == "__main__":
    main()
