"""Plates of traffic signs with real faces: meshes, materials, textures."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from importlib.resources import files
from typing import Final

import numpy as np
from numpy.typing import NDArray

from urban_street.solids.surfaces import Bag, fan, quads
from valerie.scene.graph.deferred import DeferredTexture
from valerie.scene.graph.model import Material, Mesh, Texture

#: Height of a plate's middle above the foot of its post, metres.
MIDDLE_M: Final = 2.55
_THICK: Final = 0.012
_FOLDER: Final = files(__package__)
#: The faces that layouts place, by index.
PLACED: Final = (
    "no-entry", "maximum-speed-limit-30-kmh", "no-stopping", "other-danger", "information-pedestrians-crossing", "parking",
    "one-way-straight", "yield",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Face:
    """A face: the name of its drawing in the package, width and height in metres, and its outline.

    The outline is convex, counter-clockwise, in shares of the picture from its upper left corner.
    """

    source: str
    size_m: tuple[float, float]
    outline: tuple[tuple[float, float], ...]


@lru_cache(maxsize=1)
def faces() -> dict[str, Face]:
    """Return all faces by name."""
    table = json.loads(_FOLDER.joinpath("faces.json").read_text("utf-8"))
    return {
        name: Face(row["source"], tuple(row["size_m"]), tuple(map(tuple, row["outline"])))
        for name, row in table["faces"].items()
    }


@cache
def plate(name: str) -> tuple[Mesh, ...]:
    """Build the plate of a sign, its face towards −y and grey metal behind, with its middle above the foot of its post.

    Its material is ``sign-<name>``.
    """
    face = faces()[name]
    shares = np.array(face.outline)
    across, up = ((shares - 0.5) * np.array(face.size_m)).T * np.array([[1.0], [-1.0]])
    front = np.stack([across, 0.0 * across, up + MIDDLE_M], -1)
    back = front + np.array([0.0, _THICK, 0.0])
    after = np.roll(np.arange(len(front)), -1)
    bag = Bag()
    bag.add(f"sign-{name}", fan(front, uvs=shares))
    bag.add("steel", fan(back[::-1]), quads(np.stack([front, back, back[after], front[after]], 1)))
    return bag.meshes()


def face_materials() -> dict[str, Material]:
    """Return the materials of all faces: retroreflective film on metal."""
    return {
        f"sign-{name}": Material(f"sign-{name}", (0.82, 0.82, 0.82), f"sign-{name}", roughness=0.45) for name in faces()
    }


def face_textures() -> dict[str, Texture]:
    """Return the pictures of all faces, each read when it is first needed."""
    return {f"sign-{name}": DeferredTexture(f"sign-{name}", partial(_picture, name)) for name in faces()}


def _picture(name: str) -> NDArray[np.uint8]:
    from PIL import Image

    with _FOLDER.joinpath(f"{name}.png").open("rb") as stream, Image.open(stream) as picture:
        return np.asarray(picture.convert("RGB"))
