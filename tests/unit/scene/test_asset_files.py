"""Users' assets in folders: read, labelled, digested; and everything that must be refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from valerie.errors import InvalidInput, UnknownName
from valerie.scene.asset import asset_manifest, asset_names, load_asset
from valerie.scene.asset_files import MANIFEST_FILE
from valerie.scene.gltf import save_gltf
from valerie.scene.model import Scene
from valerie.scene.variation import apply
from valerie.testing.assets import simple_asset
from valerie.testing.scenes import assert_same_scene


def write_manifest(folder: Path, **changes: Any) -> None:
    document = {**simple_asset().manifest.model_dump(mode="json"), "files": ["simple.glb"], **changes}
    (folder / MANIFEST_FILE).write_text(yaml.safe_dump(document))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "assets" / "simple"
    place.mkdir(parents=True)
    save_gltf(simple_asset().base, place / "simple.glb")
    write_manifest(place)
    return place


def test_a_folder_gives_the_scene_that_was_saved_into_it(folder: Path) -> None:
    asset = load_asset(str(folder))
    assert_same_scene(asset.base, simple_asset().base)
    assert_same_scene(
        apply({"scene.person-1.heading": 33}, asset), apply({"scene.person-1.heading": 33}, simple_asset())
    )


def test_a_folder_of_the_asset_directory_is_known_by_its_name(folder: Path) -> None:
    assert asset_names(folder.parent) == ("urban-street", "simple")
    manifest, digest = asset_manifest("simple", asset_dir=folder.parent)
    assert load_asset("simple", asset_dir=folder.parent).digest == digest
    assert manifest.cameras == ("camera-1", "camera-2")


def test_two_files_become_one_scene_with_materials_apart(folder: Path) -> None:
    base = simple_asset().base
    for name, wanted in (("static.glb", False), ("people.glb", True)):
        nodes = {path: node for path, node in base.nodes.items() if node.movable is wanted}
        save_gltf(Scene(nodes, base.materials, base.textures, {} if wanted else base.cameras, base.sun), folder / name)
    write_manifest(folder, files=["static.glb", "people.glb"])
    scene = load_asset(str(folder)).base
    assert set(scene.nodes) == set(base.nodes)
    assert scene.nodes["scene.road-1"].meshes[0].material == "static/paving"
    assert scene.materials["static/paving"].base_color_texture == "static/paving"
    assert scene.materials["people/skin"].base_color == base.materials["skin"].base_color


def test_the_digest_changes_with_a_byte_of_a_file_and_not_with_where_it_lies(folder: Path, tmp_path: Path) -> None:
    _, before = asset_manifest(str(folder))
    moved = folder.rename(tmp_path / "elsewhere")
    assert asset_manifest(str(moved))[1] == before
    with (moved / "simple.glb").open("ab") as file:
        file.write(b"\0")
    assert asset_manifest(str(moved))[1] != before


def test_a_file_outside_the_folder_is_refused(folder: Path) -> None:
    (folder.parent / "other.glb").write_bytes((folder / "simple.glb").read_bytes())
    write_manifest(folder, files=["../other.glb"])
    with pytest.raises(InvalidInput, match="outside the asset's folder"):
        asset_manifest(str(folder))


def test_a_link_that_leads_outside_is_refused(folder: Path) -> None:
    outside = (folder / "simple.glb").rename(folder.parent / "outside.glb")
    (folder / "simple.glb").symlink_to(outside)
    with pytest.raises(InvalidInput, match="outside the asset's folder"):
        load_asset(str(folder))


@pytest.mark.parametrize("name", ["../simple", "simple/../../assets/simple", "/etc", ".", ""])
def test_a_name_cannot_lead_out_of_the_asset_directory(folder: Path, name: str) -> None:
    with pytest.raises(UnknownName, match="asset"):
        asset_manifest(name, asset_dir=folder.parent)


def test_a_missing_file_is_named(folder: Path) -> None:
    write_manifest(folder, files=["simpel.glb"])
    with pytest.raises(InvalidInput, match=r"simpel\.glb"):
        asset_manifest(str(folder))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"\xff\xfe\x00", "UTF-8"),
        (b"a: [1, 2", "YAML"),
        (b"- 1\n- 2\n", "mapping"),
        (b"a: &x [1]\nb: *x\n", "aliases"),
        (b"name: a\nname: b\n", "twice"),
        (b"? {a: b}\n: 1\n", "key must be text"),
        (b"[" * 5000, "too deeply"),
        (b"a: !!python/object/apply:os.getcwd []", "YAML"),
    ],
)
def test_a_document_that_is_no_manifest_is_a_clear_error(folder: Path, text: bytes, words: str) -> None:
    (folder / MANIFEST_FILE).write_bytes(text)
    with pytest.raises(InvalidInput, match=words):
        asset_manifest(str(folder))


def test_an_oversized_manifest_is_refused_before_it_is_read(folder: Path) -> None:
    with (folder / MANIFEST_FILE).open("wb") as file:
        file.truncate(10 * 1024 * 1024)
    with pytest.raises(InvalidInput, match="too large"):
        asset_manifest(str(folder))


def test_what_the_manifest_names_must_be_in_the_scene(folder: Path) -> None:
    write_manifest(folder, persons=["scene.person-3"], parameters=[])
    with pytest.raises(UnknownName, match=r"scene\.person-3"):
        load_asset(str(folder))


def test_a_drawn_node_without_class_is_refused_by_name(folder: Path) -> None:
    base = simple_asset().base
    renamed = {
        path.replace("building-1", "house-1"): replace(node, path=path.replace("building-1", "house-1"))
        for path, node in base.nodes.items()
    }
    save_gltf(Scene(renamed, base.materials, base.textures, base.cameras, base.sun), folder / "simple.glb")
    with pytest.raises(InvalidInput, match=r"scene\.house-1"):
        load_asset(str(folder))
    write_manifest(folder, node_classes={"scene.house-1": "building"})
    assert load_asset(str(folder)).base.nodes["scene.house-1"].label_id == 11


def test_cloth_that_two_persons_share_cannot_vary_for_one(folder: Path) -> None:
    base = simple_asset().base
    nodes = {
        path: replace(
            node, meshes=tuple(replace(m, material=m.material.replace("person-2", "person-1")) for m in node.meshes)
        )
        for path, node in base.nodes.items()
    }
    save_gltf(Scene(nodes, base.materials, base.textures, base.cameras, base.sun), folder / "simple.glb")
    with pytest.raises(InvalidInput, match="one of its own"):
        load_asset(str(folder))
