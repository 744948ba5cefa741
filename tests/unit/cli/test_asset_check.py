"""`valerie asset check` of a user's folder: what it prints, and how it ends."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import Result
from typer.testing import CliRunner

from tests.plugin_package import install_boxes
from valerie.cli.main import app
from valerie.cli.shell import Exit
from valerie.scene.assets.asset_folder import MANIFEST_FILE
from valerie.scene.gltf.writer import save_gltf
from valerie.scene.graph.model import Scene
from valerie.scene.graph.transforms import camera_transform
from valerie.testing.assets import simple_asset

ASSET = simple_asset()
BASE = ASSET.base


def written(folder: Path, scene: Scene = BASE, **changes: Any) -> Path:
    """The boxes as a user's asset, with other entries of the manifest."""
    save_gltf(scene, folder / "yard.glb")
    document = {**ASSET.manifest.model_dump(mode="json"), "files": ["yard.glb"], **changes}
    (folder / MANIFEST_FILE).write_text(yaml.safe_dump(document))
    return folder


def edited(folder: Path, edit: Callable[[dict[str, Any]], None]) -> Path:
    """The same folder with another JSON chunk in its GLB (glTF 2.0, section 4.4)."""
    path = folder / "yard.glb"
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    edit(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    size = 20 + len(text) + len(rest)
    path.write_bytes(struct.pack("<4sIIII", b"glTF", 2, size, len(text), 0x4E4F534A) + text + rest)
    return folder


def without_camera_parameters() -> list[dict[str, Any]]:
    return [p for p in ASSET.manifest.model_dump(mode="json")["parameters"] if not p["path"].startswith("scene.camera")]


def seen_from(position: tuple[float, float, float], yaw: float, pitch: float = 0.0) -> Scene:
    camera = replace(BASE.cameras["camera-1"], transform=camera_transform(position, yaw, pitch, 0.0))
    return replace(BASE, cameras={"camera-1": camera})


def check(folder: Path, *options: str) -> Result:
    return CliRunner().invoke(app, ["asset", "check", str(folder), *options])


def findings(folder: Path) -> tuple[int, list[dict[str, Any]]]:
    """Exit code, and the findings of ``--json``, which say ``ok`` exactly where the command ends well."""
    done = check(folder, "--json")
    document = json.loads(done.stdout)
    assert document["ok"] is (done.exit_code == 0)
    assert ("digest" in document) is document["ok"]
    return done.exit_code, document["findings"]


def test_a_good_asset_ends_well_and_is_summed_up(tmp_path: Path) -> None:
    done = check(written(tmp_path))
    assert done.exit_code == 0
    # Boxes have 12 triangles: road, pavement, house, car, its door, and the three of the person who is there.
    assert "96 visible triangles" in done.stdout
    assert "2 cameras" in done.stdout
    assert done.stderr == ""
    assert findings(tmp_path) == (0, [])


def test_an_asset_with_no_person_is_refused(tmp_path: Path) -> None:
    scene = replace(BASE, nodes={path: node for path, node in BASE.nodes.items() if "person" not in path})
    written(tmp_path, scene, persons=[], movable=[], grounded=[], parameters=[])
    code, (found,) = findings(tmp_path)
    assert code == Exit.INVALID_INPUT == 2
    assert (found["severity"], found["code"]) == ("error", "no-person")
    done = check(tmp_path)
    assert done.exit_code == 2
    assert done.stderr.startswith("error: ")
    assert "person" in done.stderr
    assert done.stdout == ""


def test_persons_that_the_manifest_names_and_the_file_lacks_are_said_in_those_words(tmp_path: Path) -> None:
    scene = replace(BASE, nodes={path: node for path, node in BASE.nodes.items() if "person" not in path})
    written(tmp_path, scene)
    code, found = findings(tmp_path)
    assert code == 2
    assert [(doubt["severity"], doubt["code"], doubt["where"]) for doubt in found] == [
        ("error", "no-person", "scene.person-1"),
        ("error", "no-person", "scene.person-2"),
    ]
    text = check(tmp_path).stderr
    assert text.count("no such person in the files") == 2
    assert "scene.road-1" not in text


def test_a_misspelt_person_is_told_with_the_name_to_give_it_though_the_manifest_names_another(tmp_path: Path) -> None:
    def misspell(document: dict[str, Any]) -> None:
        (person,) = [node for node in document["nodes"] if node.get("name") == "person-1"]
        person["name"] = "Person_01"

    done = check(edited(written(tmp_path), misspell))
    assert done.exit_code == 2
    assert "scene.Person_01 looks like it: call it person-1" in done.stderr
    assert "it is drawn and has no class" in done.stderr


def test_a_nameless_person_is_found_by_its_height(tmp_path: Path) -> None:
    def unname(document: dict[str, Any]) -> None:
        (person,) = [node for node in document["nodes"] if node.get("name") == "person-1"]
        del person["name"]

    done = check(edited(written(tmp_path), unname))
    assert "without a name" in done.stderr
    assert "has no class and the height of a person (1.80 m): call it person-1" in done.stderr


def test_a_camera_inside_a_wall_is_told_and_does_no_harm_to_others(tmp_path: Path) -> None:
    scene = seen_from((-6.0, 15.0, 4.0), 0.0)  # the middle of the house
    written(tmp_path, scene, cameras=["camera-1"], parameters=without_camera_parameters())
    code, found = findings(tmp_path)
    assert code == 0
    inside = [doubt for doubt in found if doubt["code"] == "inside-solid"]
    assert [(doubt["severity"], doubt["where"]) for doubt in inside] == [("warning", "scene.camera-1")]
    assert "scene.building-1" in inside[0]["message"]


def test_a_pedestrian_out_of_view_is_told_with_what_is_undefined_then(tmp_path: Path) -> None:
    scene = seen_from((0.0, 5.0, 1.5), 0.0, 89.0)  # up into the sky
    written(tmp_path, scene, cameras=["camera-1"], parameters=without_camera_parameters())
    code, (found,) = findings(tmp_path)
    assert code == 0
    assert (found["severity"], found["code"], found["where"]) == ("warning", "out-of-view", "scene.person-1")
    assert "its pacc would always be undefined (outside the image)" in check(tmp_path).stderr


def test_a_mesh_without_normals_is_told_and_gets_those_of_its_faces(tmp_path: Path) -> None:
    def strip(document: dict[str, Any]) -> None:
        (road,) = [node for node in document["nodes"] if node.get("name") == "road-1"]
        for primitive in document["meshes"][road["mesh"]]["primitives"]:
            del primitive["attributes"]["NORMAL"]

    code, (found,) = findings(edited(written(tmp_path), strip))
    assert code == 0
    assert (found["severity"], found["where"]) == ("note", "yard.glb")
    assert "normals" in found["message"]
    assert found["message"].endswith(": road-1")


def test_normals_of_no_length_are_told_with_their_node_and_computed_as_missing_ones_are(tmp_path: Path) -> None:
    road = BASE.nodes["scene.road-1"]
    flat = replace(road.meshes[0], normals=np.zeros_like(road.meshes[0].normals))
    written(tmp_path, replace(BASE, nodes={**BASE.nodes, "scene.road-1": replace(road, meshes=(flat,))}))
    code, (found,) = findings(tmp_path)
    assert code == 0
    assert (found["severity"], found["where"]) == ("note", "yard.glb")
    assert "no length" in found["message"]
    assert found["message"].endswith(": road-1")


def test_a_mesh_of_a_million_triangles_is_told_with_its_count(tmp_path: Path) -> None:
    road = BASE.nodes["scene.road-1"]
    (mesh,) = road.meshes
    many = replace(mesh, faces=np.resize(mesh.faces, (1_000_008, 3)))
    written(tmp_path, replace(BASE, nodes={**BASE.nodes, "scene.road-1": replace(road, meshes=(many,))}))
    code, (found,) = findings(tmp_path)
    assert code == 0
    assert (found["severity"], found["code"], found["where"]) == ("warning", "huge-mesh", "scene.road-1")
    assert (found["value"], found["limit"]) == ("1,000,008 triangles", "1,000,000")


def test_missing_textures_are_all_listed_and_refused(tmp_path: Path) -> None:
    written(tmp_path, files=["yard.glb", "tree.gltf"])
    images = [{"uri": f"textures/{name}.png"} for name in ("bark", "leaves")]
    document = {"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "images": images}
    (tmp_path / "tree.gltf").write_text(json.dumps(document))
    code, found = findings(tmp_path)
    assert code == 2
    assert [(doubt["severity"], doubt["value"]) for doubt in found] == [
        ("error", "textures/bark.png"),
        ("error", "textures/leaves.png"),
    ]
    lines = check(tmp_path).stderr.splitlines()
    assert all("tree.gltf" in line and "there is no such file" in line for line in lines)


def test_nodes_without_a_name_are_refused_with_the_name_that_they_go_by(tmp_path: Path) -> None:
    def unname(document: dict[str, Any]) -> None:
        (house,) = [node for node in document["nodes"] if node.get("name") == "building-1"]
        del house["name"]

    code, found = findings(edited(written(tmp_path, obstacles=[]), unname))
    assert code == 2
    assert any(doubt["severity"] == "note" and "without a name" in doubt["message"] for doubt in found)
    (nameless,) = [doubt for doubt in found if doubt["code"] == "no-class"]
    assert nameless["severity"] == "error"
    assert nameless["where"].startswith("scene.node_")


@pytest.mark.parametrize("text", ["", "name: [yard", "- 1\n- 2\n"])
def test_a_manifest_that_is_none_is_refused_without_a_stack_trace(tmp_path: Path, text: str) -> None:
    written(tmp_path)
    (tmp_path / MANIFEST_FILE).write_text(text)
    done = check(tmp_path)
    assert done.exit_code == 2
    assert MANIFEST_FILE in done.stderr
    assert "Traceback" not in done.output


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    done = check(tmp_path / "nowhere")
    assert done.exit_code != 0
    assert "nowhere" in str(done.exception) + done.output


def test_generated_assets_can_be_checked_with_arguments_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install_boxes(tmp_path / "boxes", monkeypatch)
    done = CliRunner().invoke(app, ["asset", "check", "boxes", "--with", "bearing_deg=400"])
    assert "bearing_deg" in str(done.exception) + done.output
    assert done.exit_code != 0
