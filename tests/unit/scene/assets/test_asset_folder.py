"""Users' assets in folders: reading, labels, digests, and refusals."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.parameters.assignment import digest
from valerie.scene.assets.asset import asset_manifest, asset_names, load_asset
from valerie.scene.assets.asset_folder import MANIFEST_FILE, REVISION
from valerie.scene.gltf.images import encode_png
from valerie.scene.gltf.writer import save_gltf
from valerie.scene.graph.model import Rooms, Scene
from valerie.scene.variation.variant import apply
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
    assert asset_names(folder.parent) == (*asset_names(None), "simple")
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


def test_a_manifest_is_one_object_until_its_file_changes(folder: Path) -> None:
    first, _ = asset_manifest(str(folder))
    assert asset_manifest(str(folder))[0] is first
    write_manifest(folder, person_radius_m=0.4)
    assert asset_manifest(str(folder))[0].person_radius_m == 0.4


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


def test_a_node_that_the_manifest_names_must_be_in_the_scene(folder: Path) -> None:
    write_manifest(folder, persons=["scene.person-3"], parameters=[])
    with pytest.raises(UnknownName, match=r"scene\.person-3"):
        load_asset(str(folder))


def test_all_that_the_manifest_names_and_the_files_lack_is_listed_with_names_of_the_same_class(folder: Path) -> None:
    write_manifest(folder, persons=["scene.person-3"], movable=["scene.car-7"], parameters=[], cameras=["camera-8"])
    with pytest.raises(InvalidInputs) as error:
        load_asset(str(folder))
    person, car, camera = map(str, error.value.problems)
    assert person == "persons: unknown person 'scene.person-3'; did you mean scene.person-2, scene.person-1?"
    assert car == "movable: unknown car 'scene.car-7'; did you mean scene.car-1?"
    assert "camera-8" in camera


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
    with pytest.raises(InvalidInput, match="give it a separate one"):
        load_asset(str(folder))


def test_a_texture_beside_the_file_belongs_to_the_digest(folder: Path) -> None:
    (folder / "textures").mkdir()
    (folder / "textures" / "bark.png").write_bytes(encode_png(np.zeros((2, 2, 3), np.uint8)))
    document = {"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "images": [{"uri": "textures/bark.png"}]}
    (folder / "tree.gltf").write_text(json.dumps(document))
    write_manifest(folder, files=["simple.glb", "tree.gltf"])
    _, before = asset_manifest(str(folder))
    (folder / "textures" / "bark.png").write_bytes(encode_png(np.ones((2, 2, 3), np.uint8)))
    assert asset_manifest(str(folder))[1] != before


def test_the_digest_covers_the_manifest_the_files_and_the_revision_of_their_reader(folder: Path) -> None:
    manifest, found = asset_manifest(str(folder))
    document = manifest.model_dump(mode="json", exclude={"parameters": {"__all__": {"odd", "source"}}})
    hashes = {"simple.glb": hashlib.sha256((folder / "simple.glb").read_bytes()).hexdigest()}
    assert found == digest("asset-files", document, hashes, REVISION)


def test_the_meaning_of_a_parameter_in_a_domain_changes_no_scene(folder: Path) -> None:
    _, before = asset_manifest(str(folder))
    parameters = simple_asset().manifest.model_dump(mode="json")["parameters"]
    parameters[0] |= {"odd": "vulnerable road users", "source": "a survey"}
    write_manifest(folder, parameters=parameters)
    manifest, after = asset_manifest(str(folder))
    assert (manifest.parameters[0].odd, manifest.parameters[0].source) == ("vulnerable road users", "a survey")
    assert after == before


def test_an_unknown_attribute_of_a_domain_is_refused_with_near_matches(folder: Path) -> None:
    parameters = simple_asset().manifest.model_dump(mode="json")["parameters"]
    parameters[0] |= {"odd": "rain"}
    write_manifest(folder, parameters=parameters)
    with pytest.raises(InvalidInputs, match=r"parameters\.0\.odd.*'rain'.*rainfall"):
        asset_manifest(str(folder))


def test_a_placed_file_hangs_below_its_node_turned_scaled_and_without_its_camera(folder: Path) -> None:
    placed = {
        "file": "simple.glb",
        "node": "static-9",
        "position": [3.0, 20.0, 0.5],
        "heading_deg": 90.0,
        "turn_deg": 180.0,
        "scale": 0.5,
        "offset": [0.0, 0.0, 0.25],
    }
    fixed = {"persons": [], "movable": [], "grounded": [], "obstacles": [], "parameters": []}
    cameras = {"cameras": ["front"], "placed_cameras": [{"name": "front", "position": [0, 1, 2], "yaw_deg": 90.0}]}
    write_manifest(folder, files=[], placed_files=[placed], **fixed, **cameras)
    scene = load_asset(str(folder)).base
    assert set(scene.cameras) == {"front"}
    np.testing.assert_allclose(-scene.cameras["front"].transform[:3, 2], [-1.0, 0.0, 0.0], atol=1e-12)
    node = scene.nodes["scene.static-9.car-1"]
    assert node.label_id == scene.nodes["scene.static-9"].label_id != simple_asset().base.nodes["scene.car-1"].label_id
    # 180° within the node and 90° of the node are 270°: x goes to −y, y to x.
    x, y, z = (0.5 * simple_asset().base.world_transform("scene.car-1"))[:3, 3]
    np.testing.assert_allclose(scene.world_transform(node.path)[:3, 3], [3.0 + y, 20.0 - x, 0.75 + z])


def test_every_texture_of_a_material_has_the_name_of_its_file(folder: Path) -> None:
    base = simple_asset().base
    paved = replace(
        base.materials["paving"],
        normal_texture="paving",
        roughness_texture="paving",
        rooms=Rooms("paving", 3.6, 4.0, 9.0),
    )
    save_gltf(replace(base, materials={**base.materials, "paving": paved}), folder / "model.glb")
    write_manifest(folder, placed_files=[{"file": "model.glb", "node": "static-1", "position": [0, 0, 0]}])
    scene = load_asset(str(folder)).base
    assert scene.materials["static-1/paving"].textures == ("model/paving",) * 4
    assert "model/paving" in scene.textures


def test_one_file_placed_twice_has_materials_of_its_own_each_time(folder: Path) -> None:
    base = simple_asset().base
    save_gltf(Scene(base.nodes, base.materials, base.textures, base.cameras, base.sun), folder / "model.glb")
    placed = [{"file": "model.glb", "node": f"static-{n}", "position": [40.0 * n, 0, 0]} for n in (1, 2)]
    write_manifest(folder, placed_files=placed)
    scene = load_asset(str(folder)).base
    first, second = (scene.nodes[f"scene.static-{n}.road-1"].meshes[0] for n in (1, 2))
    assert (first.material, second.material) == ("static-1/paving", "static-2/paving")
    assert first.positions is second.positions
    assert scene.materials[first.material].base_color_texture == "model/paving"


def test_a_placed_camera_that_a_file_has_too_is_refused(folder: Path) -> None:
    write_manifest(folder, placed_cameras=[{"name": "camera-1", "position": [0, 0, 1.5]}])
    with pytest.raises(InvalidInput, match="a file already has a camera with this name"):
        load_asset(str(folder))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"placed_files": [{"file": "simple.obj", "node": "car-9"}]}, "not a glTF file"),
        ({"placed_files": [{"file": "simple.glb", "node": "car 9"}]}, "not a node name"),
        ({"placed_files": [{"file": "simple.glb", "node": "car-9", "scale": 0}]}, "placed_files.0.scale"),
        (
            {"placed_files": [{"file": "simple.glb", "node": "car-9"}, {"file": "simple.glb", "node": "car-9"}]},
            "named twice",
        ),
        ({"placed_cameras": [{"name": "camera-7", "position": [0, 0, 1]}]}, "camera-7"),
    ],
)
def test_an_impossible_placement_is_refused(folder: Path, change: dict[str, Any], message: str) -> None:
    write_manifest(folder, **change)
    with pytest.raises(InvalidInput, match=message):
        asset_manifest(str(folder))


def test_stems_that_are_equal_do_not_mix_materials(folder: Path) -> None:
    base = simple_asset().base
    for name in ("a", "b"):
        (folder / name).mkdir()
        nodes = {f"scene.building-{name}": replace(base.nodes["scene.building-1"], path=f"scene.building-{name}")}
        paint = {key: replace(m, roughness=0.25 if name == "a" else 0.75) for key, m in base.materials.items()}
        save_gltf(Scene(nodes, paint, base.textures, {}, base.sun), folder / name / "house.glb")
    classes = {f"scene.building-{name}": "building" for name in "ab"}
    write_manifest(folder, files=["simple.glb", "a/house.glb", "b/house.glb"], node_classes=classes)
    scene = load_asset(str(folder)).base
    rough = {n: scene.materials[scene.nodes[f"scene.building-{n}"].meshes[0].material].roughness for n in "ab"}
    assert rough == {"a": 0.25, "b": 0.75}
