"""The drafted manifest for a folder of files: it is accepted, and describes the files."""

from pathlib import Path

import pytest
import yaml

from valerie.errors import InvalidInput
from valerie.scene.assets.asset import load_asset
from valerie.scene.checks import Severity, asset_findings
from valerie.scene.checks.manifest_draft import draft_manifest, manifest_draft
from valerie.scene.gltf.writer import save_gltf
from valerie.scene.graph.model import Node, Scene
from valerie.scene.legality.rejection import rejection_reason
from valerie.testing.assets import simple_asset

BASE = simple_asset().base


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "My Street"
    place.mkdir()
    save_gltf(BASE, place / "simple.glb")
    return place


def test_a_drafted_asset_loads_and_has_no_errors(folder: Path) -> None:
    draft_manifest(folder)
    assert [f for f in asset_findings(folder) if f.severity is Severity.ERROR] == []
    manifest = load_asset(str(folder)).manifest
    assert (manifest.name, manifest.title) == ("my-street", "My Street")
    assert manifest.persons == ("scene.person-1", "scene.person-2")
    assert manifest.movable == manifest.persons
    assert manifest.cameras == ("camera-1", "camera-2")
    assert manifest.by_path["scene.person-1.pos.y"].default == 10.0


def test_nobody_stands_inside_a_drafted_outline(folder: Path) -> None:
    draft_manifest(folder)
    manifest = load_asset(str(folder)).manifest
    outlined = {obstacle.path: obstacle for obstacle in manifest.obstacles}
    assert {"scene.building-1", "scene.car-1"} <= outlined.keys()
    x, y = (
        sum(c) / len(outlined["scene.building-1"].polygon)
        for c in zip(*outlined["scene.building-1"].polygon, strict=True)
    )
    inside = {"scene.person-1.pos.x": x, "scene.person-1.pos.y": y}
    assert rejection_reason(inside, manifest) == "person-1 stands inside building-1"


def test_files_that_know_no_convention_are_placed_and_named_after_themselves(folder: Path) -> None:
    house = BASE.nodes["scene.building-1"]
    nodes = {"scene.Cube": Node("scene.Cube", house.transform, house.meshes)}
    for name in ("Truck_03.glb", "thing.glb", "other.glb"):
        save_gltf(Scene(nodes, BASE.materials, BASE.textures, {}, BASE.sun), folder / name)
    placed = {entry["file"]: entry["node"] for entry in manifest_draft(folder)["placed_files"]}
    assert placed == {"Truck_03.glb": "truck-3", "other.glb": "static-1", "thing.glb": "static-2"}


def test_without_a_camera_one_is_added_that_looks_along_the_street(tmp_path: Path) -> None:
    save_gltf(Scene(BASE.nodes, BASE.materials, BASE.textures, {}, BASE.sun), tmp_path / "simple.glb")
    document = manifest_draft(tmp_path)
    (camera,) = document["placed_cameras"]
    x0, y0, x1, _ = document["extent"]
    assert camera["position"] == [(x0 + x1) / 2, y0, 1.6]
    draft_manifest(tmp_path)
    assert set(load_asset(str(tmp_path)).base.cameras) == {"camera-1"}


def test_a_manifest_is_never_overwritten(folder: Path) -> None:
    path = draft_manifest(folder)
    document = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump({**document, "title": "mine"}))
    with pytest.raises(InvalidInput, match="not overwritten"):
        draft_manifest(folder)
    assert yaml.safe_load(path.read_text())["title"] == "mine"


def test_a_folder_without_files_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="no glTF file"):
        draft_manifest(tmp_path)
