"""Additions of a manifest to its files: placed models, and cameras that no file has."""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np
from pydantic import Field, field_validator

from valerie.document import Document
from valerie.errors import InvalidInput
from valerie.scene.graph.model import Camera, Matrix
from valerie.scene.graph.naming import ROOT, is_node_name
from valerie.scene.graph.transforms import camera_transform, place, rotation

#: Largest |x| and |y| in a manifest, metres. Float32 positions stay exact to about a millimetre.
MAX_COORDINATE_M: Final = 10_000.0

Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0, allow_inf_nan=False)]


class PlacedFile(Document):
    """A model whose file does not follow the naming convention. Its nodes are below one node whose name states the class.

    Attributes:
        file: path relative to the manifest. A file may be placed many times.
        node: name of the new node directly below the scene, e.g. ``car-1``.
        position: place of the model's origin, metres, world.
        heading_deg: heading of the node; 0 faces +y.
        turn_deg: turn of the model within its node, about its origin; 180 for a model whose front is glTF's +Z.
        scale: scale of the model within its node; 0.01 for a model in centimetres.
        offset: position of the turned and scaled model within its node, metres. A person's feet belong at the origin.
    """

    file: str
    node: str
    position: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    heading_deg: Angle = 0.0
    turn_deg: Angle = 0.0
    scale: float = Field(default=1.0, gt=0.0, le=10_000.0, allow_inf_nan=False)
    offset: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)

    @field_validator("file")
    @classmethod
    def _is_gltf(cls, file: str) -> str:
        return require_gltf_name(file, field="placed_files.file")

    @field_validator("node")
    @classmethod
    def _is_name(cls, node: str) -> str:
        if not is_node_name(node):
            raise InvalidInput("not a node name", field="placed_files.node", value=node, limit="e.g. car-1")
        return node

    @property
    def path(self) -> str:
        return f"{ROOT}.{self.node}"

    def node_transform(self) -> Matrix:
        """Return the (4, 4) transform, node to world."""
        return place(*self.position, self.heading_deg)

    def model_transform(self) -> Matrix:
        """Return the (4, 4) transform, world of the file to node."""
        matrix = np.eye(4)
        matrix[:3, :3] = rotation(0.0, 0.0, self.turn_deg) * self.scale
        matrix[:3, 3] = self.offset
        return matrix


class PlacedCamera(Document):
    """A camera at a place.

    Attributes:
        name: e.g. ``camera-1``.
        position: optical centre, metres, world.
        yaw_deg, pitch_deg, roll_deg: see `valerie.scene.graph.transforms.camera_transform`; at 0 it looks along +y.
        focal_length_mm, sensor_width_mm: see `valerie.scene.graph.model.Camera`.
    """

    name: str
    position: tuple[Coordinate, Coordinate, Coordinate]
    yaw_deg: Angle = 0.0
    pitch_deg: float = Field(default=0.0, ge=-90.0, le=90.0, allow_inf_nan=False)
    roll_deg: Angle = 0.0
    focal_length_mm: float = Field(default=35.0, ge=1.0, le=2_000.0, allow_inf_nan=False)
    sensor_width_mm: float = Field(default=36.0, ge=1.0, le=100.0, allow_inf_nan=False)

    def camera(self) -> Camera:
        """Return the camera for a scene."""
        transform = camera_transform(self.position, self.yaw_deg, self.pitch_deg, self.roll_deg)
        return Camera(f"{ROOT}.{self.name}", transform, self.focal_length_mm, self.sensor_width_mm)


def require_gltf_name(file: str, *, field: str) -> str:
    """Return ``file`` if it has the name of a glTF file.

    Raises:
        InvalidInput: it is not.
    """
    if not file.lower().endswith((".glb", ".gltf")):
        raise InvalidInput("not a glTF file", field=field, value=file, limit=".glb or .gltf")
    return file
