"""Findings of the check of an asset, before a run."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from valerie.scene.assets.asset import load_asset
from valerie.scene.assets.asset_folder import MANIFEST_FILE
from valerie.scene.checks import Doubt, Severity, asset_findings, scene_findings, shapes
from valerie.scene.gltf.writer import save_gltf
from valerie.scene.graph.model import Scene
from valerie.scene.graph.transforms import place
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


def only(findings: list[Doubt], code: str) -> Doubt:
    (found,) = [finding for finding in findings if finding.code == code]
    return found


def test_a_good_asset_has_no_findings(tmp_path: Path) -> None:
    assert asset_findings(written(tmp_path)) == []


def test_the_test_asset_itself_has_no_findings() -> None:
    assert list(scene_findings(simple_asset())) == []


def test_an_unknown_class_is_an_error_and_named(tmp_path: Path) -> None:
    finding = only(asset_findings(written(tmp_path, renamed("building-1", "house-1"))), "no-class")
    assert (finding.severity, finding.where) == (Severity.ERROR, "scene.house-1")
    assert "'house' is not a known class" in finding.message


def test_a_plain_name_without_class_is_named(tmp_path: Path) -> None:
    finding = only(asset_findings(written(tmp_path, renamed("building-1", "Cube"))), "no-class")
    assert (finding.where, finding.value, finding.limit) == ("scene.Cube", "Cube", "e.g. building-3")


def test_no_person_is_an_error(tmp_path: Path) -> None:
    nodes = {path: node for path, node in BASE.nodes.items() if "person" not in path}
    findings = asset_findings(written(tmp_path, nodes, persons=[], movable=[], grounded=[], parameters=[]))
    assert only(findings, "no-person").severity is Severity.ERROR


def test_a_manifest_without_persons_is_an_error(tmp_path: Path) -> None:
    finding = only(asset_findings(written(tmp_path, persons=[])), "no-person")
    assert "nobody is under test" in finding.message


def test_a_missing_person_is_reported_with_nodes_to_rename_and_hides_no_other_finding(tmp_path: Path) -> None:
    nodes = {path: node for path, node in renamed("person-1", "Person_01").items() if "person-2" not in path}
    nodes["scene.Cube"] = replace(BASE.nodes["scene.building-1"], path="scene.Cube", transform=place(-14, 30))
    nodes["scene.car-1"] = replace(nodes["scene.car-1"], transform=place(2, 8) @ np.diag([100.0, 100.0, 100.0, 1.0]))
    findings = asset_findings(written(tmp_path, nodes, cameras=["camera-1", "camera-2", "camera-3"]))
    missing = {f.where: f for f in findings if f.code == "no-person"}
    assert list(missing) == ["scene.person-1", "scene.person-2"]
    assert "no such person in the files" in missing["scene.person-1"].message
    assert "under persons, movable, parameters;" in missing["scene.person-1"].message
    assert missing["scene.person-1"].message.endswith("; scene.Person_01 looks like it: call it person-1")
    classless = {f.where: f.message for f in findings if f.code == "no-class"}
    assert list(classless) == ["scene.Person_01", "scene.Cube"]
    assert classless["scene.Person_01"].endswith("; call it person-1?")
    assert "camera-3" in only(findings, "declared").message
    assert only(findings, "size").where == "scene.car-1"


def test_a_missing_person_is_suspected_in_a_nameless_node_of_its_height(tmp_path: Path) -> None:
    nodes = renamed("person-1", "node_7")
    message = only(asset_findings(written(tmp_path, nodes)), "no-person").message
    assert message.endswith(
        "scene.node_7 has no class and the height of a person (1.80 m): call it person-1 if it is one"
    )


def test_a_missing_person_is_suspected_in_a_person_that_the_manifest_does_not_name(tmp_path: Path) -> None:
    message = only(asset_findings(written(tmp_path, renamed("person-1", "person-9"))), "no-person").message
    assert message.endswith("; scene.person-9 is a person: name that in the manifest, or call it person-1")


def test_nothing_else_is_taken_for_a_missing_person(tmp_path: Path) -> None:
    nodes = {path: node for path, node in BASE.nodes.items() if "person-1" not in path}
    finding = only(asset_findings(written(tmp_path, nodes)), "no-person")
    assert finding.where == "scene.person-1"
    assert finding.message.endswith("; nothing looks like it: call its node person-1, or take it out of the manifest")


def test_a_missing_node_is_reported_once_for_all_fields_that_name_it(tmp_path: Path) -> None:
    changes = {"movable": [*simple_asset().manifest.movable, "scene.car-2"], "grounded": ["scene.car-2"]}
    finding = only(asset_findings(written(tmp_path, **changes)), "declared")
    assert finding.where == "scene.car-2"
    assert "no such car in the files, and the manifest names it under movable, grounded;" in finding.message
    assert "scene.car-1 is a car" in finding.message


def test_parameters_that_the_scene_cannot_take_are_all_listed_and_hide_nothing(tmp_path: Path) -> None:
    parameters = [
        {"path": "scene.car-1.light.intensity_cd", "minimum": 0, "maximum": 10, "default": 1},
        {"path": "scene.building-1.light.intensity_cd", "minimum": 0, "maximum": 10, "default": 1},
    ]
    findings = asset_findings(written(tmp_path, parameters=parameters, extent=[3000, 3000, 4000, 4000]))
    assert [f.where for f in findings if f.code == "declared"] == [parameter["path"] for parameter in parameters]
    assert only(findings, "extent").severity is Severity.WARNING


def test_a_person_that_is_a_building_is_an_error(tmp_path: Path) -> None:
    finding = only(asset_findings(written(tmp_path, persons=["scene.person-1", "scene.building-1"])), "no-person")
    assert (finding.where, finding.value, finding.limit) == ("scene.building-1", "building", "person")


def test_a_person_that_varies_without_being_movable_is_suspected(tmp_path: Path) -> None:
    finding = only(asset_findings(written(tmp_path, movable=["scene.person-2", "scene.car-1"])), "not-movable")
    assert finding.where == "scene.person-1"


def test_a_mesh_in_centimetres_is_suspected_with_its_height(tmp_path: Path) -> None:
    nodes = dict(BASE.nodes)
    for path in ("scene.person-1", "scene.car-1"):
        nodes[path] = replace(nodes[path], transform=nodes[path].transform @ np.diag([100.0, 100.0, 100.0, 1.0]))
    sizes = {f.where: f for f in asset_findings(written(tmp_path, nodes)) if f.code == "size"}
    assert (sizes["scene.person-1"].value, sizes["scene.person-1"].limit) == ("180 m", "0.4…2.6 m")
    assert sizes["scene.car-1"].value == "120 m"


def test_an_origin_at_the_hips_is_suspected(tmp_path: Path) -> None:
    nodes = dict(BASE.nodes)
    for path in [path for path in nodes if path.startswith("scene.person-1.")]:
        lowered = nodes[path].transform.copy()
        lowered[2, 3] -= 0.9
        nodes[path] = replace(nodes[path], transform=lowered)
    finding = only(asset_findings(written(tmp_path, nodes)), "origin")
    assert (finding.where, finding.value) == ("scene.person-1", "lowest point at -0.90 m")


def test_an_origin_beside_the_body_is_suspected(tmp_path: Path) -> None:
    nodes = dict(BASE.nodes)
    for path in [path for path in nodes if path.startswith("scene.person-1.")]:
        moved = nodes[path].transform.copy()
        moved[0, 3] += 2.0
        nodes[path] = replace(nodes[path], transform=moved)
    assert only(asset_findings(written(tmp_path, nodes)), "origin").value == "2.00 m aside"


def test_a_flat_node_is_suspected_and_a_mirrored_one_is_not(tmp_path: Path) -> None:
    def scaled(across: float) -> list[str]:
        nodes = dict(BASE.nodes)
        nodes["scene.building-1"] = replace(nodes["scene.building-1"], transform=np.diag([across, 1.0, 1.0, 1.0]))
        findings = asset_findings(written(tmp_path, nodes))
        return [finding.where for finding in findings if finding.code in {"flat", "mirrored"}]

    assert scaled(0.0) == ["scene.building-1"]
    assert scaled(-1.0) == []


def test_an_object_of_very_many_triangles_is_suspected_with_those_of_all_its_meshes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Of boxes of 12 triangles each, the person that is shown has three, the car two, everything else one.
    monkeypatch.setattr(shapes, "MAX_TRIANGLES", 35)
    finding = only(asset_findings(written(tmp_path)), "huge-mesh")
    assert (finding.where, finding.value, finding.limit) == ("scene.person-1", "36 triangles", "35")


def test_a_scene_of_very_many_triangles_is_suspected_with_its_heaviest_objects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shapes, "MAX_TRIANGLES", 95)
    (found,) = asset_findings(written(tmp_path))
    assert (found.severity, found.code, found.value, found.limit) == (
        Severity.WARNING, "huge-scene", "96 triangles", "95",
    )  # fmt: skip
    assert "most are in scene.person-1, scene.car-1, scene.road-1" in found.message


def test_a_scene_with_one_heavy_object_is_reported_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    road = BASE.nodes["scene.road-1"]
    heavy = replace(road.meshes[0], faces=np.resize(road.meshes[0].faces, (100, 3)))
    monkeypatch.setattr(shapes, "MAX_TRIANGLES", 99)
    nodes = {**BASE.nodes, "scene.road-1": replace(road, meshes=(heavy,))}
    assert [(f.code, f.where) for f in asset_findings(written(tmp_path, nodes))] == [("huge-mesh", "scene.road-1")]


def test_a_texture_without_coordinates_is_suspected(tmp_path: Path) -> None:
    nodes = dict(BASE.nodes)
    road = nodes["scene.road-1"]
    bare = replace(road.meshes[0], uvs=np.zeros_like(road.meshes[0].uvs))
    nodes["scene.road-1"] = replace(road, meshes=(bare,))
    finding = only(asset_findings(written(tmp_path, nodes)), "no-texture-coordinates")
    assert "paving" in finding.message


def test_a_scene_in_another_unit_than_its_extent_is_suspected(tmp_path: Path) -> None:
    finding = only(asset_findings(written(tmp_path, extent=[3000, 3000, 4000, 4000])), "extent")
    assert finding.limit == "(3000, 3000) to (4000, 4000) m"


def test_a_street_that_lies_elsewhere_leaves_nothing_to_stand_on(tmp_path: Path) -> None:
    nodes = dict(BASE.nodes)
    for path in ("scene.road-1", "scene.sidewalk-1"):
        sunk = nodes[path].transform.copy()
        sunk[2, 3] -= 86.0
        nodes[path] = replace(nodes[path], transform=sunk)
    assert only(asset_findings(written(tmp_path, nodes)), "no-ground").limit == "z within 1 m of 0 m"


def test_a_file_without_sun_is_noted(tmp_path: Path) -> None:
    placed = {"file": "simple.glb", "node": "static-1"}
    findings = asset_findings(
        written(
            tmp_path,
            files=[],
            placed_files=[placed],
            persons=[],
            movable=[],
            grounded=[],
            parameters=[],
            obstacles=[],
            cameras=["camera-1"],
            placed_cameras=[{"name": "camera-1", "position": [0, -5, 1.5]}],
        )
    )
    assert only(findings, "no-light").severity is Severity.NOTE


def test_a_person_in_a_wall_by_default_is_suspected(tmp_path: Path) -> None:
    wall = {"path": "scene.building-1", "polygon": [[-1, 9], [1, 9], [1, 11], [-1, 11]]}
    (found,) = asset_findings(written(tmp_path, obstacles=[wall]))
    assert "person-1 stands inside building-1" in found.message


def test_a_footprint_that_crosses_itself_is_an_error(tmp_path: Path) -> None:
    crossed = {"path": "scene.building-1", "polygon": [[-9, 9], [-7, 11], [-7, 9], [-9, 11]]}
    assert only(asset_findings(written(tmp_path, obstacles=[crossed])), "outline").where == "obstacles.0"


def test_a_car_that_moves_without_an_outline_is_noted(tmp_path: Path) -> None:
    place = [
        {"path": f"scene.car-1.pos.{axis}", "minimum": -10, "maximum": 40, "default": value}
        for axis, value in (("x", 2.0), ("y", 8.0))
    ]
    parameters = [*simple_asset().manifest.model_dump(mode="json")["parameters"], *place]
    assert asset_findings(written(tmp_path, parameters=parameters)) == []
    finding = only(asset_findings(written(tmp_path, parameters=parameters, obstacles=[])), "no-outline")
    assert (finding.severity, finding.where) == (Severity.NOTE, "scene.car-1")


def test_a_parameter_of_something_that_the_scene_lacks_is_an_error(tmp_path: Path) -> None:
    findings = asset_findings(written(tmp_path, cameras=["camera-1", "camera-2", "camera-3"]))
    assert "camera-3" in only(findings, "declared").message


def test_overlapping_instance_ids_name_both_nodes(tmp_path: Path) -> None:
    nodes = {**BASE.nodes, "scene.static-1": replace(BASE.nodes["scene.car-1"], path="scene.static-1", meshes=())}
    nodes["scene.car-01"] = replace(BASE.nodes["scene.car-1"], path="scene.car-01")
    finding = only(asset_findings(written(tmp_path, nodes)), "scene")
    assert "scene.car-1 and scene.car-01 are the same car (instance id 26001)" in finding.message


def test_a_broken_file_is_reported_and_not_raised(tmp_path: Path) -> None:
    written(tmp_path)
    (tmp_path / "simple.glb").write_bytes((tmp_path / "simple.glb").read_bytes()[:5000])
    finding = only(asset_findings(tmp_path), "file")
    assert finding.where == "simple.glb"
    assert "truncated" in finding.message


def test_a_broken_manifest_is_reported_field_by_field(tmp_path: Path) -> None:
    findings = asset_findings(written(tmp_path, bearing_deg="north", person_radius_m=-1))
    assert {f.where for f in findings} == {"manifest.yaml.bearing_deg", "manifest.yaml.person_radius_m"}


def test_every_missing_texture_is_listed(tmp_path: Path) -> None:
    textures = [{"uri": f"textures/{name}.png"} for name in ("bark", "leaves")]
    document = {"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "images": textures}
    folder = written(tmp_path, files=["simple.glb", "tree.gltf"])
    (folder / "tree.gltf").write_text(json.dumps(document))
    findings = asset_findings(folder)
    assert [(f.where, f.message, f.value) for f in findings] == [
        ("tree.gltf: images.0.uri", "there is no such file", "textures/bark.png"),
        ("tree.gltf: images.1.uri", "there is no such file", "textures/leaves.png"),
    ]


def test_a_finding_shows_severity_place_value_and_limit() -> None:
    doubt = Doubt(Severity.WARNING, "size", "scene.person-1", "too high", "18 m", "0.4…2.6 m")
    assert str(doubt) == "warning: scene.person-1: too high; got 18 m; limit: 0.4…2.6 m"
    assert doubt.document()["value"] == "18 m"


def test_a_folder_with_findings_that_are_no_errors_still_loads(tmp_path: Path) -> None:
    folder = written(tmp_path, extent=[3000, 3000, 4000, 4000])
    assert all(f.severity is not Severity.ERROR for f in asset_findings(folder))
    assert load_asset(str(folder)).manifest.extent[0] == 3000
