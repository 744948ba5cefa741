"""What `asset_problems` tells the author of an asset."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from valerie.scene import check
from valerie.scene.asset_files import MANIFEST_FILE
from valerie.scene.check import asset_problems
from valerie.scene.gltf import save_gltf
from valerie.scene.model import Scene
from valerie.testing.assets import simple_asset

BASE = simple_asset().base


def written(folder: Path, nodes: dict[str, Any] | None = None, **changes: Any) -> Path:
    scene = Scene(nodes or BASE.nodes, BASE.materials, BASE.textures, BASE.cameras, BASE.sun)
    save_gltf(scene, folder / "simple.glb")
    document = {**simple_asset().manifest.model_dump(mode="json"), "files": ["simple.glb"], **changes}
    (folder / MANIFEST_FILE).write_text(yaml.safe_dump(document))
    return folder


def renamed(old: str, new: str) -> dict[str, Any]:
    return {path.replace(old, new): replace(node, path=path.replace(old, new)) for path, node in BASE.nodes.items()}


def test_a_good_asset_has_no_problems(tmp_path: Path) -> None:
    assert asset_problems(written(tmp_path)) == []


def test_an_unknown_class_is_named(tmp_path: Path) -> None:
    problems = asset_problems(written(tmp_path, renamed("building-1", "house-1")))
    assert any("'house' is no known class" in problem for problem in problems)


def test_a_plain_name_without_class_is_named(tmp_path: Path) -> None:
    problems = asset_problems(written(tmp_path, renamed("building-1", "Cube")))
    assert any("scene.Cube has no class" in problem for problem in problems)


def test_no_person_is_a_problem(tmp_path: Path) -> None:
    nodes = {path: node for path, node in BASE.nodes.items() if "person" not in path}
    problems = asset_problems(written(tmp_path, nodes, persons=[], movable=[], grounded=[], parameters=[]))
    assert any("no person" in problem for problem in problems)


def test_a_mesh_in_centimetres_is_suspected(tmp_path: Path) -> None:
    nodes = dict(BASE.nodes)
    for path in ("scene.person-1", "scene.car-1"):
        nodes[path] = replace(nodes[path], transform=nodes[path].transform @ np.diag([100.0, 100.0, 100.0, 1.0]))
    problems = asset_problems(written(tmp_path, nodes))
    assert any("scene.person-1 is 180 m high" in problem for problem in problems)
    assert any("scene.car-1 is 120 m high" in problem for problem in problems)


def test_a_mirrored_node_is_a_problem(tmp_path: Path) -> None:
    nodes = dict(BASE.nodes)
    nodes["scene.building-1"] = replace(nodes["scene.building-1"], transform=np.diag([-1.0, 1.0, 1.0, 1.0]))
    assert any("scene.building-1 is mirrored" in problem for problem in asset_problems(written(tmp_path, nodes)))


def test_a_huge_mesh_is_a_problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check, "HUGE_TRIANGLES", 11)
    assert any("a mesh of 12 triangles" in problem for problem in asset_problems(written(tmp_path)))


def test_a_person_in_a_wall_by_default_is_a_problem(tmp_path: Path) -> None:
    wall = {"path": "scene.building-1", "polygon": [[-1, 9], [1, 9], [1, 11], [-1, 11]]}
    problems = asset_problems(written(tmp_path, obstacles=[wall]))
    assert problems == ["with every parameter at its default, person-1 stands inside building-1"]


def test_what_the_manifest_declares_and_the_scene_lacks_is_a_problem(tmp_path: Path) -> None:
    problems = asset_problems(written(tmp_path, cameras=["camera-1", "camera-2", "camera-3"]))
    assert any("camera-3" in problem for problem in problems)


def test_a_broken_file_is_reported_and_not_raised(tmp_path: Path) -> None:
    written(tmp_path)
    (tmp_path / "simple.glb").write_bytes((tmp_path / "simple.glb").read_bytes()[:5000])
    assert any("truncated" in problem for problem in asset_problems(tmp_path))


def test_a_broken_manifest_is_reported_field_by_field(tmp_path: Path) -> None:
    problems = asset_problems(written(tmp_path, bearing_deg="north", person_radius_m=-1))
    assert any("bearing_deg" in problem for problem in problems)
    assert any("person_radius_m" in problem for problem in problems)
