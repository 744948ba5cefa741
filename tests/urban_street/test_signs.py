"""Test the faces of traffic signs: pictures, plates, the parameter, and their notice."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import shapely

from urban_street.signs.faces import MIDDLE_M, face_materials, face_textures, faces, plate
from valerie.labels import label_of_node_class
from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.assets.attributes import ABSENT
from valerie.scene.variation.variant import apply

ROOT = Path(__file__).parents[2]
SIGNS = ROOT / "urban_street" / "signs"
#: Shapes of plates by name: the outline's area as a share of its bounding box, from geometry.
SHAPES = {
    "no-entry": np.pi / 4, "maximum-speed-limit-30-kmh": np.pi / 4, "parking": 1.0, "yield": 0.5, "children": 0.5,
    "stop": 2.0 * (np.sqrt(2.0) - 1.0), "priority-road": 0.5,
}  # fmt: skip


def test_there_are_a_hundred_and_they_differ() -> None:
    pictures = {name: texture.image for name, texture in face_textures().items()}
    assert len(pictures) >= 100
    small = {}
    for name, image in pictures.items():
        assert image.ndim == 3
        assert max(image.shape) <= 256
        assert image.std() > 10.0
        small[image.tobytes()] = name
    assert len(small) == len(pictures)
    assert sum(file.stat().st_size for file in SIGNS.iterdir() if file.is_file()) < 5_000_000


@pytest.mark.parametrize("name", SHAPES)
def test_a_plate_has_the_shape_of_its_sign(name: str) -> None:
    outline = shapely.Polygon(faces()[name].outline)
    assert outline.area == pytest.approx(SHAPES[name], abs=0.1)


@pytest.mark.parametrize("name", faces())
def test_a_plate_shows_its_face_to_the_front_and_metal_behind(name: str) -> None:
    meshes = {mesh.material: mesh for mesh in plate(name)}
    assert meshes.keys() == {f"sign-{name}", "steel"}
    face, metal = meshes[f"sign-{name}"], meshes["steel"]
    corners = face.positions[face.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (area[:, 1] < 0.0).all()  # counter-clockwise seen from −y
    assert 0.15 < np.linalg.norm(area, axis=1).sum() / 2.0 < 0.65  # square metres of a plate in a town
    low, high = face.positions.min(axis=0), face.positions.max(axis=0)
    assert 0.5 * (low[2] + high[2]) == pytest.approx(MIDDLE_M, abs=0.01)
    assert face.uvs.min() >= 0.0
    assert face.uvs.max() <= 1.0
    # u runs to the right and v downwards as seen from the front
    assert face.uvs[face.positions[:, 0].argmax(), 0] > 0.9
    assert face.uvs[face.positions[:, 2].argmax(), 1] < 0.1
    assert metal.positions[:, 1].max() == pytest.approx(face.positions[:, 1].max() + 0.012, abs=1e-6)
    assert face_materials()[f"sign-{name}"].textures == (f"sign-{name}",)


def test_the_default_face_is_shown_and_others_can_be_chosen(asset: SceneAsset) -> None:
    paths = [definition.path for definition in asset.manifest.parameters if definition.path.endswith(".face")]
    assert len(paths) == 4
    for path in paths:
        node = path.removesuffix(".face")
        definition = asset.manifest.definition(path)
        assert definition.choices == (*faces(), ABSENT)

        def shown(value: str | None, path: str = path, node: str = node) -> list[str]:
            scene = apply({} if value is None else {path: value}, asset)
            return [
                n.name for n in scene.nodes.values() if n.parent == node and n.visible and scene.nodes[node].visible
            ]

        assert shown(None) == [definition.default]
        assert shown("stop") == ["stop"]
        assert shown(ABSENT) == []


def test_a_chosen_face_is_labelled_traffic_sign(asset: SceneAsset, truth_pass: TruthPass) -> None:
    """A rectangle, a disc and a triangle in the truth: the pixels differ by shape and have the class of a sign."""
    path = "scene.traffic-sign-1.face"
    label = label_of_node_class("traffic-sign").id
    view = View("camera-1", 640, 360)

    def pixels(face: str) -> int:
        return int(np.sum(truth_pass.truth(apply({path: face}, asset), view).class_map == label))

    none = pixels(ABSENT)
    square, disc = pixels("parking") - none, pixels("no-entry") - none
    assert square > 200
    assert disc / square == pytest.approx(np.pi / 4 * (0.62 / 0.64) ** 2, abs=0.08)


def test_the_notice_names_every_picture_with_its_drawing_creator_licence_and_changes() -> None:
    notice = (ROOT / "NOTICE").read_text("utf-8")
    named = dict(re.findall(r"^([\w-]+)\.png: ([\w-]+)\.svg$", notice, re.MULTILINE))
    assert named == {name: face.source for name, face in faces().items()}
    assert {file.stem for file in SIGNS.glob("*.png")} == named.keys()
    for words in (
        "mapillary_sprite_source",
        "Copyright (c) 2015 mapillary",
        "MIT License",
        "Changed: rasterised",
        'THE SOFTWARE IS PROVIDED "AS IS"',
    ):
        assert words in notice
