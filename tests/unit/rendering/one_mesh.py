"""Scenes of a single mesh."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from valerie.scene.graph.model import Camera, Material, Mesh, Node, Scene, Sun, Texture

#: Two metres wide and high, 5 m before a camera at the origin that looks along +y; its texture is upright. Its material is ``m``.
SQUARE: Final = Mesh(
    positions=np.float32([[-1, 5, 0], [1, 5, 0], [1, 5, 2], [-1, 5, 2]]),
    normals=np.float32([[0, -1, 0]] * 4),
    uvs=np.float32([[0, 1], [1, 1], [1, 0], [0, 0]]),
    faces=np.uint32([[0, 1, 2], [0, 2, 3]]),
    material="m",
)


def one_mesh(
    mesh: Mesh, material: Material, camera: Camera, elevation: float = 89.0, image: np.ndarray | None = None
) -> Scene:
    node = Node("scene.wall-1", np.eye(4), (mesh,), label_id=12)
    textures = {} if image is None else {"image": Texture("image", image)}
    return Scene(
        {node.path: node}, {material.name: material}, textures, {"camera-1": camera}, Sun(0.0, math.radians(elevation))
    )
