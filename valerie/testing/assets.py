"""A tiny asset of boxes, simple enough to compute expected values for tests of every stage.

All boxes are axis-aligned and have round numbers: a ground plane of 40 × 60 m at z = 0 (``road-1``), a building of 4 × 6 × 8 m, a
car of 1.8 × 4.2 × 1.4 m and two persons of 0.5 × 0.4 × 1.8 m. There are two cameras and the sun.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.parameters.assignment import digest
from valerie.parameters.declaring import angle, choice, number
from valerie.parameters.definitions import Affects, ParameterDefinition
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.assets.manifest import Footprint, GroundRegion, Manifest
from valerie.scene.assets.objects import classified
from valerie.scene.graph.model import Camera, Environment, Material, Mesh, Node, Scene, Sun, Texture
from valerie.scene.graph.transforms import camera_transform, place

#: Default places of the two persons: (x, y, heading in degrees).
PERSON_PLACES: Final = {"scene.person-1": (0.0, 10.0, 180.0), "scene.person-2": (3.0, 15.0, 0.0)}
_COATS: Final = {"red-coat": (0.6, 0.05, 0.05), "blue-coat": (0.05, 0.05, 0.6)}


def box_mesh(low: tuple[float, float, float], high: tuple[float, float, float], material: str) -> Mesh:
    """Build a box between two corners: 24 vertices with face normals, 12 triangles, each face with the whole texture."""
    corners: list[list[float]] = []
    normals: list[list[float]] = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for outward, level in ((-1.0, low[axis]), (1.0, high[axis])):
            square = [(low[u], low[v]), (high[u], low[v]), (high[u], high[v]), (low[u], high[v])]
            for a, b in square if outward > 0 else square[::-1]:
                corner = [0.0, 0.0, 0.0]
                corner[axis], corner[u], corner[v] = level, a, b
                normal = [0.0, 0.0, 0.0]
                normal[axis] = outward
                corners.append(corner)
                normals.append(normal)
    faces = [[4 * side + i for i in triangle] for side in range(6) for triangle in ((0, 1, 2), (0, 2, 3))]
    return Mesh(
        positions=np.array(corners, np.float32),
        normals=np.array(normals, np.float32),
        uvs=np.tile(np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32), (6, 1)),
        faces=np.array(faces, np.uint32),
        material=material,
    )


def _paving() -> NDArray[np.uint8]:
    """Return a texture, (64, 64, 3) uint8: a grid of joints on grey, so that images of the ground are not constant."""
    image = np.full((64, 64, 3), 128, np.uint8)
    image[::8] = image[:, ::8] = (90, 88, 85)
    return image


def _person(path: str, *, visible: bool) -> list[Node]:
    name = path.rpartition(".")[2]
    x, y, heading = PERSON_PLACES[path]
    nodes = [Node(path, place(x, y, 0.0, heading), visible=visible)]
    for coat in _COATS:
        # A nose shows which way the box faces (+y).
        meshes = (
            box_mesh((-0.25, -0.2, 0.0), (0.25, 0.2, 1.5), f"{name}/cloth-{coat}"),
            box_mesh((-0.12, -0.12, 1.5), (0.12, 0.12, 1.8), "skin"),
            box_mesh((-0.03, 0.12, 1.6), (0.03, 0.17, 1.66), "skin"),
        )
        nodes.append(Node(f"{path}.{coat}", np.eye(4), meshes, visible=visible and coat == "red-coat"))
    return nodes


def _parameters() -> tuple[ParameterDefinition, ...]:
    parameters: list[ParameterDefinition] = []
    for path, (x, y, heading) in PERSON_PLACES.items():
        parameters += [
            number(f"{path}.pos.x", -15, 15, x, Affects.GEOMETRY, "m"),
            number(f"{path}.pos.y", 0, 50, y, Affects.GEOMETRY, "m"),
            angle(f"{path}.heading", heading, Affects.GEOMETRY),
            choice(
                f"{path}.character",
                (*_COATS, "absent"),
                "red-coat" if path.endswith("-1") else "absent",
                Affects.GEOMETRY,
            ),
            number(f"{path}.cloth.metallic", 0, 1, 0.0, Affects.MATERIAL),
            number(f"{path}.cloth.roughness", 0, 1, 0.8, Affects.MATERIAL),
        ]
    parameters += [
        angle("scene.sun-1.azimuth", 140.0, Affects.LIGHT),
        number("scene.sun-1.elevation", 5, 85, 45.0, Affects.LIGHT, "deg"),
        number("scene.sun-1.irradiance", 0, 2, 1.0, Affects.LIGHT),
        number("scene.camera-1.pos.x", -5, 5, 0.0, Affects.GEOMETRY, "m"),
        number("scene.camera-2.focal_length_mm", 20, 100, 35.0, Affects.GEOMETRY, "mm"),
        number("sensor.exposure_ev", -4, 4, 0.0, Affects.SENSOR_RADIOMETRY, "EV"),
        number("sensor.gamma", 0.5, 3, 1.0, Affects.SENSOR_RADIOMETRY),
    ]
    return tuple(parameters)


def simple_manifest() -> Manifest:
    """Return the manifest of `simple_asset`."""
    return Manifest(
        name="simple",
        title="Boxes on a plane",
        extent=(-20.0, -5.0, 20.0, 55.0),
        parameters=_parameters(),
        movable=tuple(PERSON_PLACES),
        obstacles=(
            Footprint(path="scene.building-1", polygon=((-8, 12), (-4, 12), (-4, 18), (-8, 18))),
            Footprint(path="scene.car-1", polygon=((1.1, 5.9), (2.9, 5.9), (2.9, 10.1), (1.1, 10.1)), height_m=1.4),
        ),
        ground=(GroundRegion(polygon=((5, -5), (20, -5), (20, 55), (5, 55)), height=0.25),),
        persons=tuple(PERSON_PLACES),
        cameras=("camera-1", "camera-2"),
    )


def simple_scene(manifest: Manifest) -> Scene:
    """Build the scene of `simple_asset`.

    Args:
        manifest: `simple_manifest`, or one that declares the same nodes movable.
    """
    nodes = [
        Node("scene.road-1", np.eye(4), (box_mesh((-20, -5, -0.5), (5, 55, 0), "paving"),)),
        Node("scene.sidewalk-1", np.eye(4), (box_mesh((5, -5, -0.5), (20, 55, 0.25), "paving"),)),
        Node("scene.building-1", place(-6, 15), (box_mesh((-2, -3, 0), (2, 3, 8), "plaster"),)),
        Node("scene.car-1", place(2, 8), (box_mesh((-0.9, -2.1, 0.2), (0.9, 2.1, 1.4), "paint"),)),
        Node("scene.car-1.door-1", place(-0.9, 0.3), (box_mesh((-0.02, -0.5, 0.4), (0, 0.5, 1.2), "paint"),)),
    ]
    for path in PERSON_PLACES:
        nodes += _person(path, visible=path.endswith("-1"))
    coats = [
        replace(Material(f"{path.rpartition('.')[2]}/cloth-{coat}"), base_color=color)
        for path in PERSON_PLACES
        for coat, color in _COATS.items()
    ]
    materials = [
        Material("paving", (0.5, 0.5, 0.5), base_color_texture="paving", roughness=0.9),
        Material("plaster", (0.7, 0.65, 0.5), roughness=0.9),
        Material("paint", (0.1, 0.2, 0.5), metallic=0.2, roughness=0.3),
        Material("skin", (0.6, 0.4, 0.3), roughness=0.6),
        *coats,
    ]
    return Scene(
        nodes=classified(nodes, {}, manifest.movable),
        materials={material.name: material for material in materials},
        textures={"paving": Texture("paving", _paving())},
        cameras={
            "camera-1": Camera("scene.camera-1", camera_transform((0, -2, 1.5), 0, 0, 0), focal_length_mm=35.0),
            "camera-2": Camera("scene.camera-2", camera_transform((-3, 0, 3), 345, -5, 0), focal_length_mm=35.0),
        },
        sun=Sun(azimuth=math.radians(140), elevation=math.radians(45)),
        environment=Environment(),
    )


@lru_cache(maxsize=1)
def simple_asset() -> SceneAsset:
    """Return an asset with ground, building, car, two persons (``red-coat``, ``blue-coat`` or ``absent``), two cameras and a sun.

    ``person-1`` wears ``red-coat`` at (0, 10) and faces ``camera-1``, which stands at (0, −2, 1.5) and looks along +y.
    ``person-2`` is absent. The car at (2, 8) hides places behind it from ``camera-1``.
    """
    manifest = simple_manifest()
    return SceneAsset(manifest, digest("simple-asset", 1), simple_scene(manifest))
