"""Render ``docs/images/people.jpg``: every character and every pose of the street's people, by the raster engine.

``make people`` runs it; a few minutes of CPU time. ``python -m tools.people --of grey-suit/bicycle --out look.png`` writes
front, side and back of a character or a pose at full size, to look for faults.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from tools.contact_sheet import captioned, contact_sheet, save_sheet
from urban_street.human import CHARACTERS
from urban_street.human.stances import DEFAULT, POSES
from urban_street.pedestrians import Crowd, PersonPlace, aid_classes
from urban_street.solids.surfaces import quads, to_mesh
from valerie.rendering.base import View
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.scene.assets.objects import classified
from valerie.scene.graph.draft import Draft
from valerie.scene.graph.model import Camera, Environment, Material, Node, Scene, Stance, Sun
from valerie.scene.graph.transforms import camera_transform, place
from valerie.sensing.sensor import develop
from valerie.sensing.settings import SensorSetting

OUT: Final = Path(__file__).parents[1] / "docs" / "images" / "people.jpg"
#: Tile of the sheet, pixels; and of a single look at a person.
TILE: Final = (150, 236)
LARGE: Final = (300, 460)
ACROSS: Final = 11
#: Distance of the camera, metres, the height that a tile shows, and the height of its middle.
_AWAY: Final = 9.0
_SHOWN: Final = 2.15
_MIDDLE: Final = 0.98
_PERSON: Final = "scene.person-1"
#: Poses with something long ahead or beside the person.
WITH_AID: Final = ("stroller", "bicycle", "dog")
#: Who takes a pose on the sheet.
_TAKES: Final = {
    "standing": "violet-sari", "phone": "checked-skirt", "waving": "pink-girl", "running": "coral-runner",
    "sitting": "grey-hoodie", "kneeling": "yellow-shirt", "crouching": "azure-jersey", "wheelchair": "navy-coat",
    "stroller": "mint-mother", "bicycle": "grey-suit", "crutches": "white-tee", "walking-frame": "plum-cardigan",
    "cane": "brown-hat", "box": "lime-vest", "dog": "camel-coat",
}  # fmt: skip


def studio() -> Scene:
    """Return a person, ``scene.person-1``, on a grey ground under a high sun."""
    ground = quads([[[-30.0, -30.0, 0.0], [30.0, -30.0, 0.0], [30.0, 30.0, 0.0], [-30.0, 30.0, 0.0]]])
    crowd = Crowd()
    nodes = [
        Node("scene.road-1", np.eye(4), (to_mesh(ground, "ground"),)),
        *crowd.nodes("person-1", PersonPlace(0.0, 0.0, 180.0, CHARACTERS[0])),
    ]
    return Scene(
        nodes=classified(nodes, aid_classes(["person-1"]), (_PERSON,)),
        materials={"ground": Material("ground", base_color=(0.32, 0.32, 0.31), roughness=0.95)} | crowd.materials,
        textures=crowd.textures,
        cameras={},
        sun=Sun(azimuth=math.radians(150.0), elevation=math.radians(48.0)),
        environment=Environment(cloud_cover=0.35),
    )


def looked_at(
    engine: RasterRenderer, scene: Scene, character: str, stance: Stance, turn: float, size: tuple[int, int]
) -> Image.Image:
    """Return a picture of the person, whose front is turned ``turn`` degrees away from the camera."""
    width, rows = size
    camera = Camera(
        "scene.camera-1",
        camera_transform((0.0, -_AWAY, 1.2), 0.0, -math.degrees(math.atan2(1.2 - _MIDDLE, _AWAY)), 0.0),
        36.0 * _AWAY / (_SHOWN * width / rows),
    )
    draft = Draft(scene)
    draft.choose(_PERSON, character)
    draft.stance(_PERSON, pose=stance.pose, gait_phase=stance.gait_phase, carries=stance.carries)
    posed = draft.finish()
    person = replace(posed.nodes[_PERSON], transform=place(0.0, 0.0, 0.0, 180.0 + turn))
    posed = replace(posed, nodes={**posed.nodes, _PERSON: person}, cameras={"camera-1": camera})
    image = engine.full(posed, View("camera-1", 2 * width, 2 * rows))  # twice the size keeps a small picture sharp
    picture = develop(image.pixels, SensorSetting(exposure_ev=0.5))
    return Image.fromarray(np.ascontiguousarray(picture)).resize(size, Image.Resampling.LANCZOS)


def everybody(engine: RasterRenderer) -> Iterator[Image.Image]:
    """Yield a tile of each character, walking, and of each other pose."""
    scene = studio()
    shown = [(name, DEFAULT, name) for name in CHARACTERS]
    shown += [(_TAKES[pose], replace(DEFAULT, pose=pose), pose) for pose in POSES if pose != DEFAULT.pose]
    for name, stance, caption in shown:
        turn = -8.0 if stance.pose in WITH_AID else -28.0  # a stroller stays within the tile
        yield captioned(looked_at(engine, scene, name, stance, turn, TILE), TILE, caption)


def closer(engine: RasterRenderer, words: list[str]) -> Iterator[Image.Image]:
    """Yield front, side and back of what the words name: a character, a pose after a slash, a carried thing after another."""
    scene = studio()
    for word in words:
        given = word.split("/")
        name, pose, carries = (*given, *("", DEFAULT.pose, DEFAULT.carries)[len(given) :])
        for turn in (-25.0, -90.0, 180.0):
            yield captioned(looked_at(engine, scene, name, Stance(pose, 0.0, carries), turn, LARGE), LARGE, word)


def main() -> None:
    """Write the sheet, or the larger pictures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--of", nargs="*", default=[], metavar="CHARACTER[/POSE[/CARRIES]]")
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    engine = RasterRenderer()
    try:
        if options.of:
            contact_sheet(list(closer(engine, options.of)), 6).save(options.out)
            return
        sheet = contact_sheet(list(everybody(engine)), ACROSS)
    finally:
        engine.close()
    save_sheet(sheet, options.out)


if __name__ == "__main__":
    main()
