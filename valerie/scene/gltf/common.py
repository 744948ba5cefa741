"""What reading and writing share: limits, names of extensions, and the change of axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from valerie.scene.graph.model import Camera, Environment, Material, Matrix, Node, Sun, Texture

#: Key of this project's facts in a glTF object's ``extras``.
EXTRAS_KEY: Final = "valerie"

LIGHTS: Final = "KHR_lights_punctual"
SPECULAR: Final = "KHR_materials_specular"
EMISSIVE_STRENGTH: Final = "KHR_materials_emissive_strength"
#: What a file may require of its reader.
SUPPORTED_EXTENSIONS: Final = frozenset({LIGHTS, SPECULAR, EMISSIVE_STRENGTH})

#: Checked before anything of that size is allocated.
MAX_NODES: Final = 100_000
MAX_DEPTH: Final = 64
MAX_VERTICES: Final = 30_000_000
MAX_IMAGE_SIDE: Final = 8192
MAX_TEXELS: Final = 2**28


@dataclass(frozen=True, slots=True, eq=False)
class FilePart:
    """What one glTF file holds, in this project's axes, before labels are given.

    Attributes:
        nodes: parents before children, in the file's order.
        sun, environment: None where the file has none.
        movable: paths that the file itself marks as movable.
        notes: what the file has and this project ignores or approximates, in words.
    """

    nodes: tuple[Node, ...]
    materials: Mapping[str, Material]
    textures: Mapping[str, Texture]
    cameras: Mapping[str, Camera]
    sun: Sun | None
    environment: Environment | None
    movable: tuple[str, ...]
    notes: tuple[str, ...]


# y-up = C · z-up with (x, y, z) → (x, z, −y): a permutation with signs, so that no bit is lost.
_ORDER: Final = np.array([0, 2, 1])
_TO_Y_UP: Final = np.array([1.0, 1.0, -1.0])
_FROM_Y_UP: Final = np.array([1.0, -1.0, 1.0])


def vectors_to_y_up(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """(…, 3) z up to (…, 3) y up."""
    turned: NDArray[np.float32] = vectors[..., _ORDER] * _TO_Y_UP.astype(vectors.dtype)
    return turned


def vectors_from_y_up(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """(…, 3) y up to (…, 3) z up."""
    turned: NDArray[np.float32] = vectors[..., _ORDER] * _FROM_Y_UP.astype(vectors.dtype)
    return turned


def transform_to_y_up(matrix: Matrix) -> Matrix:
    """(4, 4) object to parent, both z up, to the same between y-up frames: C · M · C⁻¹."""
    return _turned(matrix, _TO_Y_UP, both=True)


def transform_from_y_up(matrix: Matrix) -> Matrix:
    """The inverse of `transform_to_y_up`."""
    return _turned(matrix, _FROM_Y_UP, both=True)


def view_to_y_up(matrix: Matrix) -> Matrix:
    """(4, 4) camera to world: only the world turns, since a camera's own axes are glTF's: C · M."""
    return _turned(matrix, _TO_Y_UP, both=False)


def view_from_y_up(matrix: Matrix) -> Matrix:
    """The inverse of `view_to_y_up`."""
    return _turned(matrix, _FROM_Y_UP, both=False)


def _turned(matrix: Matrix, signs: NDArray[np.float64], *, both: bool) -> Matrix:
    result = np.array(matrix, np.float64)
    result[:3] = result[_ORDER] * signs[:, None]
    if both:
        result[:, :3] = result[:, _ORDER] * signs
    return result


def own_extras(extras: Any) -> dict[str, Any]:
    """This project's part of an ``extras`` object; empty where there is none."""
    found = extras.get(EXTRAS_KEY) if isinstance(extras, dict) else None
    return found if isinstance(found, dict) else {}
