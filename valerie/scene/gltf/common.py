"""Common parts of reader and writer: limits, names of extensions, and the change of axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.plain import Json, JsonObject
from valerie.scene.graph.model import Camera, Environment, Material, Matrix, Node, Sun, Texture

#: Key of this project's properties in ``extras`` of a glTF object.
EXTRAS_KEY: Final = "valerie"

LIGHTS: Final = "KHR_lights_punctual"
SPECULAR: Final = "KHR_materials_specular"
EMISSIVE_STRENGTH: Final = "KHR_materials_emissive_strength"
TRANSMISSION: Final = "KHR_materials_transmission"
DIFFUSE_TRANSMISSION: Final = "KHR_materials_diffuse_transmission"
#: Extensions that a file may require.
SUPPORTED_EXTENSIONS: Final = frozenset({LIGHTS, SPECULAR, EMISSIVE_STRENGTH, TRANSMISSION, DIFFUSE_TRANSMISSION})

#: Limits, checked before anything of that size is allocated.
MAX_NODES: Final = 100_000
MAX_DEPTH: Final = 64
MAX_VERTICES: Final = 30_000_000
MAX_IMAGE_SIDE: Final = 8192
MAX_TEXELS: Final = 2**28


@dataclass(frozen=True, slots=True, eq=False)
class FilePart:
    """The content of one glTF file in this project's axes, without labels.

    Attributes:
        nodes: parents before children, in the file's order.
        sun, environment: None if the file has none.
        movable: paths that the file itself marks as movable.
        notes: sentences on content that is ignored or approximated.
    """

    nodes: tuple[Node, ...]
    materials: Mapping[str, Material]
    textures: Mapping[str, Texture]
    cameras: Mapping[str, Camera]
    sun: Sun | None
    environment: Environment | None
    movable: tuple[str, ...]
    notes: tuple[str, ...]


# y-up = C · z-up with (x, y, z) → (x, z, −y): a permutation with signs, which loses no bit.
_ORDER: Final = np.array([0, 2, 1])
_TO_Y_UP: Final = np.array([1.0, 1.0, -1.0])
_FROM_Y_UP: Final = np.array([1.0, -1.0, 1.0])


def vectors_to_y_up(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Turn (…, 3) vectors with z up into vectors with y up."""
    result: NDArray[np.float32] = vectors[..., _ORDER] * _TO_Y_UP.astype(vectors.dtype)
    return result


def vectors_from_y_up(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Turn (…, 3) vectors with y up into vectors with z up."""
    result: NDArray[np.float32] = vectors[..., _ORDER] * _FROM_Y_UP.astype(vectors.dtype)
    return result


def transform_to_y_up(matrix: Matrix) -> Matrix:
    """Turn a (4, 4) transform between frames with z up into one between frames with y up: C · M · C⁻¹."""
    return _turned(matrix, _TO_Y_UP, both=True)


def transform_from_y_up(matrix: Matrix) -> Matrix:
    """Invert `transform_to_y_up`."""
    return _turned(matrix, _FROM_Y_UP, both=True)


def view_to_y_up(matrix: Matrix) -> Matrix:
    """Turn the world of a (4, 4) camera-to-world transform: C · M; a camera's own axes are those of glTF."""
    return _turned(matrix, _TO_Y_UP, both=False)


def view_from_y_up(matrix: Matrix) -> Matrix:
    """Invert `view_to_y_up`."""
    return _turned(matrix, _FROM_Y_UP, both=False)


def _turned(matrix: Matrix, signs: NDArray[np.float64], *, both: bool) -> Matrix:
    result = np.array(matrix, np.float64)
    result[:3] = result[_ORDER] * signs[:, None]
    if both:
        result[:, :3] = result[:, _ORDER] * signs
    return result


def own_extras(extras: Json) -> JsonObject:
    """Return this project's part of an ``extras`` object; empty if there is none."""
    own = extras.get(EXTRAS_KEY) if isinstance(extras, dict) else None
    return own if isinstance(own, dict) else {}


def number(value: Json, field: str) -> float:
    """Return a value of a file as a number.

    Raises:
        InvalidInput: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InvalidInput("not a number", field=field, value=value)
    return float(value)
