"""glTF: lossless round trips, an independent reader, and broken files."""

import base64
import json
import math
import struct
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from valerie.errors import InvalidInput
from valerie.scene.assets.gltf_scene import load_gltf
from valerie.scene.gltf.common import EXTRAS_KEY
from valerie.scene.gltf.meshes import unrolled, with_face_normals
from valerie.scene.gltf.reader import read_gltf
from valerie.scene.gltf.writer import save_gltf
from valerie.scene.graph.model import Environment, Light, Material, Mesh, Node, Rooms, Scene
from valerie.scene.graph.transforms import Pose
from valerie.scene.variation.variant import apply
from valerie.testing.assets import simple_asset
from valerie.testing.scenes import assert_same_scene


@pytest.fixture
def written(tmp_path: Path) -> Path:
    path = tmp_path / "simple.glb"
    save_gltf(simple_asset().base, path)
    return path


def chunks_of(path: Path) -> tuple[dict[str, Any], bytes]:
    raw = path.read_bytes()
    length = struct.unpack_from("<I", raw, 12)[0]
    return json.loads(raw[20 : 20 + length]), raw[20 + length + 8 :]


def embedded(path: Path, document: dict[str, Any], binary: bytes) -> Path:
    """A .gltf with its buffer as a data URI."""
    if document.get("buffers"):
        uri = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
        document["buffers"] = [{"byteLength": len(binary), "uri": uri}]
    target = path.with_suffix(".gltf")
    target.write_text(json.dumps(document))
    return target


def test_a_scene_written_and_read_again_is_the_same_to_the_bit(written: Path) -> None:
    assert_same_scene(load_gltf(written), simple_asset().base)


def test_a_changed_scene_keeps_odd_poses_hidden_nodes_and_light(tmp_path: Path) -> None:
    changed = apply(
        {
            "scene.person-1.heading": 37.3,
            "scene.person-1.pos.x": 7.77,
            "scene.person-1.character": "blue-coat",
            "scene.person-1.cloth.metallic": 0.1,
            "scene.sun-1.azimuth": 211.7,
            "scene.camera-1.pos.x": 0.123456789,
        },
        simple_asset(),
    )
    save_gltf(changed, tmp_path / "changed.glb")
    assert_same_scene(load_gltf(tmp_path / "changed.glb"), changed)


LAMP = Light(
    color=(1.0, 0.7, 0.4), intensity=1500.0, inner=0.6, outer=1.3, radius=0.18, switch="street", glowing=("paint",),
    luminance=12_000.0,
)  # fmt: skip


def with_lamp(light: Light) -> Scene:
    base = simple_asset().base
    building = base.nodes["scene.building-1"]
    lamp = Node(
        "scene.building-1.lamp", Pose((1, 2, 3), (270, 0, 30)).matrix(), light=light, label_id=building.label_id,
        instance_id=building.instance_id,
    )  # fmt: skip
    return replace(base, nodes=dict(base.nodes) | {lamp.path: lamp}, environment=Environment(street_lamps="off"))


@pytest.mark.parametrize(
    "light", [LAMP, Light(), replace(LAMP, outer=2.0, switch=""), replace(LAMP, inner=1.3, beam="dipped")]
)
def test_lamps_and_switches_survive(tmp_path: Path, light: Light) -> None:
    scene = with_lamp(light)
    save_gltf(scene, tmp_path / "lamp.glb")
    read = load_gltf(tmp_path / "lamp.glb")
    assert_same_scene(read, scene)
    assert read.nodes["scene.building-1.lamp"].light == light
    assert read.environment == scene.environment


def test_a_switch_in_a_position_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    save_gltf(with_lamp(LAMP), tmp_path / "lamp.glb")
    document, binary = chunks_of(tmp_path / "lamp.glb")
    document["scenes"][0]["extras"][EXTRAS_KEY]["environment"]["car_lamps"] = "dim"
    with pytest.raises(InvalidInput, match=r"environment\.car_lamps: unknown position of a switch; got dim"):
        load_gltf(embedded(tmp_path / "lamp.glb", document, binary))


def test_a_lamp_of_another_program_shines_where_its_minus_z_points(tmp_path: Path) -> None:
    save_gltf(with_lamp(LAMP), tmp_path / "lamp.glb")
    document, binary = chunks_of(tmp_path / "lamp.glb")
    lights = document["extensions"]["KHR_lights_punctual"]["lights"]
    assert [light["type"] for light in lights] == ["directional", "spot"]
    assert lights[1]["intensity"] == 1500.0
    assert lights[1]["spot"] == {"innerConeAngle": 0.6, "outerConeAngle": 1.3}
    del lights[1]["extras"]
    node = next(node for node in document["nodes"] if node["name"] == "lamp")
    # A quarter turn about glTF's x takes −z to −y, which is down.
    node.pop("matrix")
    node.update(rotation=[-math.sqrt(0.5), 0, 0, math.sqrt(0.5)])
    scene = load_gltf(embedded(tmp_path / "lamp.glb", document, binary))
    light = scene.nodes["scene.building-1.lamp"].light
    assert light == Light(color=LAMP.color, intensity=1500.0, inner=0.6, outer=1.3)
    axis = scene.world_transform("scene.building-1.lamp")[:3, 1]
    np.testing.assert_allclose(axis, [0, 0, -1], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"type": "area"}, "unknown kind of light"),
        ({"intensity": -1.0}, "not a valid light"),
        ({"extras": {"valerie": {"beam": "main"}}}, "unknown beam"),
        ({"extras": {"valerie": {"beam": "dipped", "outer": 3.0}}}, "a dipped beam needs a cone"),
        ({"spot": {"innerConeAngle": 1.0, "outerConeAngle": 0.5}, "extras": {}}, "inner ≤ outer"),
    ],
)
def test_a_lamp_that_cannot_be_is_refused(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    save_gltf(with_lamp(LAMP), tmp_path / "lamp.glb")
    document, binary = chunks_of(tmp_path / "lamp.glb")
    document["extensions"]["KHR_lights_punctual"]["lights"][1] |= change
    with pytest.raises(InvalidInput, match=message):
        load_gltf(embedded(tmp_path / "lamp.glb", document, binary))


def test_every_field_of_a_material_survives(tmp_path: Path) -> None:
    base = simple_asset().base
    odd = Material(
        "paving", (0.1, 0.2, 0.3), "paving", "paving", "paving", 0.4, 0.55, specular=1.7, specular_tint=0.6,
        emissive=(3.5, 0.1, 0.0), alpha_cutoff=0.3, double_sided=True, transmission=0.4, traffic=0.7, soaks=0.6,
        rooms=Rooms("paving", 3.6, 4.0, 9.0), translucency=0.0, signal=True,
    )  # fmt: skip
    assert not [field.name for field in fields(Material) if getattr(odd, field.name) == field.default], "add it above"
    scene = Scene(
        base.nodes,
        {**base.materials, "paving": odd},
        base.textures,
        base.cameras,
        base.sun,
        Environment(1.1, 5.0, 0.5, snow_depth=0.1),
    )
    save_gltf(scene, tmp_path / "odd.glb")
    assert_same_scene(load_gltf(tmp_path / "odd.glb"), scene)


def test_meshes_that_nodes_share_are_shared_again(tmp_path: Path) -> None:
    base = simple_asset().base
    shared = base.nodes["scene.car-1"].meshes
    nodes = {path: node for path, node in base.nodes.items() if path.startswith("scene.car-1")}
    nodes["scene.car-1.door-1"] = type(nodes["scene.car-1"])(
        "scene.car-1.door-1", np.eye(4), shared, nodes["scene.car-1"].label_id, nodes["scene.car-1"].instance_id
    )
    scene = Scene(nodes, base.materials, base.textures, base.cameras, base.sun)
    save_gltf(scene, tmp_path / "shared.glb")
    read = load_gltf(tmp_path / "shared.glb")
    assert read.nodes["scene.car-1"].meshes[0] is read.nodes["scene.car-1.door-1"].meshes[0]


def test_another_program_reads_the_same_triangles_with_y_up(written: Path) -> None:
    other = trimesh.load_scene(written)
    differences = [
        trimesh.transform_points(other.geometry[name].vertices, transform)
        for name, transform in ((other.graph[n][1], other.graph[n][0]) for n in other.graph.nodes_geometry)
    ]
    theirs = np.vstack(differences)
    base = simple_asset().base
    ours = np.vstack(
        [
            mesh.positions @ base.world_transform(path)[:3, :3].T + base.world_transform(path)[:3, 3]
            for path, node in base.nodes.items()
            for mesh in node.meshes
        ]
    )
    turned = np.column_stack([ours[:, 0], ours[:, 2], -ours[:, 1]])
    assert len(theirs) == len(turned)
    # Positions of up to 60 m in float32.
    np.testing.assert_allclose(theirs[np.lexsort(theirs.round(4).T)], turned[np.lexsort(turned.round(4).T)], atol=1e-5)


def test_a_camera_of_another_program_keeps_its_view(written: Path) -> None:
    document, binary = chunks_of(written)
    for camera in document["cameras"]:
        del camera["extras"]
    camera = load_gltf(embedded(written, document, binary)).cameras["camera-1"]
    assert camera.focal_length_mm == pytest.approx(35.0)
    assert camera.focal_length_px(1920) == pytest.approx(35.0 / 36.0 * 1920)


@pytest.mark.parametrize(("near", "far"), [(0.0, 100.0), (-1.0, 100.0), (5.0, 5.0), (10.0, 2.0)])
def test_a_camera_that_sees_nothing_is_refused(written: Path, near: float, far: float) -> None:
    document, binary = chunks_of(written)
    document["cameras"][0]["perspective"] |= {"znear": near, "zfar": far}
    with pytest.raises(InvalidInput, match=r"camera-\d.*got znear.*limit: 0 < znear < zfar"):
        load_gltf(embedded(written, document, binary))


def test_the_sun_of_another_program_comes_from_the_same_side(written: Path) -> None:
    document, binary = chunks_of(written)
    del document["extensions"]["KHR_lights_punctual"]["lights"][0]["extras"]
    sun, expected = load_gltf(embedded(written, document, binary)).sun, simple_asset().base.sun
    assert (sun.azimuth, sun.elevation) == pytest.approx((expected.azimuth, expected.elevation))


def test_translation_rotation_and_scale_are_read_as_a_matrix(written: Path) -> None:
    document, binary = chunks_of(written)
    node = next(node for node in document["nodes"] if node["name"] == "building-1")
    del node["matrix"]
    half = math.sqrt(0.5)
    node.update(translation=[1, 2, 3], rotation=[0, half, 0, half], scale=[2, 2, 2])  # a quarter turn about y (up)
    matrix = load_gltf(embedded(written, document, binary)).nodes["scene.building-1"].transform
    np.testing.assert_allclose(matrix[:3, 3], [1, -3, 2])
    np.testing.assert_allclose(matrix[:3, :3], [[0, -2, 0], [2, 0, 0], [0, 0, 2]], atol=1e-12)


def test_missing_normals_are_computed_per_face(written: Path) -> None:
    document, binary = chunks_of(written)
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            del primitive["attributes"]["NORMAL"]
    path = embedded(written, document, binary)
    mesh = load_gltf(path).nodes["scene.building-1"].meshes[0]
    original = simple_asset().base.nodes["scene.building-1"].meshes[0]
    np.testing.assert_allclose(mesh.normals, original.normals[original.faces.reshape(-1)], atol=1e-6)
    assert any("normals" in note for note in read_gltf(path).notes)


@pytest.mark.parametrize("broken", [(0.0, 0.0, 0.0), (math.nan, 0.0, 1.0), (math.inf, 0.0, 0.0)])
def test_normals_of_no_length_or_not_finite_are_those_of_the_faces(
    written: Path, broken: tuple[float, float, float]
) -> None:
    document, binary = chunks_of(written)
    (house,) = [node for node in document["nodes"] if node["name"] == "building-1"]
    (primitive,) = document["meshes"][house["mesh"]]["primitives"]
    accessor = document["accessors"][primitive["attributes"]["NORMAL"]]
    start = document["bufferViews"][accessor["bufferView"]]["byteOffset"]
    data = bytearray(binary)
    data[start : start + 12 * accessor["count"]] = struct.pack("<3f", *broken) * accessor["count"]
    path = embedded(written, document, bytes(data))
    original = simple_asset().base.nodes["scene.building-1"].meshes[0]
    mesh = load_gltf(path).nodes["scene.building-1"].meshes[0]
    corners = original.faces.reshape(-1)
    np.testing.assert_array_equal(mesh.positions[mesh.faces.reshape(-1)], original.positions[corners])
    np.testing.assert_array_equal(mesh.uvs[mesh.faces.reshape(-1)], original.uvs[corners])
    np.testing.assert_allclose(mesh.normals[mesh.faces.reshape(-1)], original.normals[corners], atol=1e-6)
    (note,) = [note for note in read_gltf(path).notes if "normals" in note]
    assert note.endswith(": building-1")


def test_one_normal_of_no_length_leaves_the_others_as_they_are() -> None:
    # Two triangles of a tent share an edge with smooth normals; the corner at the far left has none.
    positions = np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 1], [1, 0, 0]], np.float32)
    normals = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 1], [0.6, 0, 0.8]], np.float32)
    faces = np.array([[0, 1, 2], [1, 3, 2]], np.uint32)
    mesh = with_face_normals(Mesh(positions, normals, np.zeros((4, 2), np.float32), faces, "tent"))
    np.testing.assert_array_equal(mesh.positions[mesh.faces], positions[faces])
    half = math.sqrt(0.5)
    np.testing.assert_allclose(mesh.normals[mesh.faces[0]], [[-half, 0, half], [0, 0, 1], [0, 0, 1]], atol=1e-6)
    np.testing.assert_array_equal(mesh.normals[mesh.faces[1]], normals[faces[1]])


def test_interleaved_vertices_are_read(written: Path) -> None:
    document, _ = chunks_of(written)
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 0, -1]], "<f4")
    block = np.hstack([positions, np.tile(np.array([[0, 1, 0]], "<f4"), (3, 1))]).tobytes()
    document["bufferViews"] = [{"buffer": 0, "byteLength": len(block), "byteStride": 24}]
    document["accessors"] = [
        {"bufferView": 0, "byteOffset": offset, "componentType": 5126, "count": 3, "type": "VEC3"} for offset in (0, 12)
    ]
    document["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}}]}]
    document["nodes"] = [{"name": "road-1", "mesh": 0}]
    document["scenes"] = [{"nodes": [0]}]
    document["extensions"] = {}
    for key in ("images", "textures", "materials", "cameras"):
        document.pop(key)
    mesh = load_gltf(embedded(written, document, block)).nodes["scene.road-1"].meshes[0]
    assert mesh.positions.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert mesh.normals.tolist() == [[0, 0, 1]] * 3
    assert mesh.faces.tolist() == [[0, 1, 2]]


def test_a_blended_material_is_cut_and_the_file_says_so(written: Path) -> None:
    document, binary = chunks_of(written)
    document["materials"][0]["alphaMode"] = "BLEND"
    part = read_gltf(embedded(written, document, binary))
    assert part.materials["paving"].alpha_cutoff == 0.5
    assert any("blending" in note for note in part.notes)


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.01, 0.5, 0.9, 0.9999])
def test_a_truncated_file_is_a_clear_error(written: Path, share: float) -> None:
    raw = written.read_bytes()
    written.write_bytes(raw[: int(len(raw) * share)])
    with pytest.raises(InvalidInput, match=r"truncated|not a binary glTF"):
        load_gltf(written)


def test_a_file_that_says_it_is_shorter_than_its_chunks_is_refused(written: Path) -> None:
    raw = bytearray(written.read_bytes())
    raw[8:12] = struct.pack("<I", len(raw) - 100)
    written.write_bytes(bytes(raw))
    with pytest.raises(InvalidInput, match="truncated"):
        load_gltf(written)


def beside(path: Path, document: dict[str, Any], binary: bytes) -> Path:
    """A .gltf with its buffer and its image in files beside it, as other programs export."""
    view = document["bufferViews"][document["images"][0].pop("bufferView")]
    start = view.get("byteOffset", 0)
    folder = path.parent / "textures"
    folder.mkdir()
    (folder / "the paving.png").write_bytes(binary[start : start + view["byteLength"]])
    document["images"][0]["uri"] = "textures/the%20paving.png"
    (path.parent / "street.bin").write_bytes(binary)
    document["buffers"] = [{"byteLength": len(binary), "uri": "street.bin"}]
    target = path.with_suffix(".gltf")
    target.write_text(json.dumps(document))
    return target


def test_buffers_and_images_beside_the_file_are_read(written: Path) -> None:
    assert_same_scene(load_gltf(beside(written, *chunks_of(written))), simple_asset().base)


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        ("street.bin", "there is no such file"),
        ("textures", "there is no such file"),
        ("../secret.bin", "outside the asset's folder"),
        ("..%2Fsecret.bin", "outside the asset's folder"),
        ("link.bin", "outside the asset's folder"),
        ("/etc/passwd", "only files in this file"),
        ("http://127.0.0.1/x", "only files in this file"),
        ("file:///x", "only files in this file"),
        ("C:\\\\x", "only files in this file"),
        ("data:text/plain,abcd", "not a supported data URI"),
        ("", "only files in this file"),
    ],
)
def test_a_buffer_that_is_elsewhere_or_missing_is_refused(tmp_path: Path, uri: str, message: str) -> None:
    folder = tmp_path / "asset"
    (folder / "textures").mkdir(parents=True)
    save_gltf(simple_asset().base, folder / "simple.glb")
    (tmp_path / "secret.bin").write_bytes(b"abcd")
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    document, _ = chunks_of(folder / "simple.glb")
    document["buffers"] = [{"byteLength": 4, "uri": uri}]
    target = folder / "simple.gltf"
    target.write_text(json.dumps(document))
    with pytest.raises(InvalidInput, match=message):
        load_gltf(target)


def test_an_image_that_is_missing_is_named(written: Path) -> None:
    document, binary = chunks_of(written)
    document["images"][0] = {"uri": "paving.png"}
    with pytest.raises(InvalidInput, match=r"images\.0\.uri: there is no such file; got paving.png"):
        load_gltf(embedded(written, document, binary))


@pytest.mark.parametrize("mode", [5, 6])
def test_a_strip_or_fan_is_the_same_surface_as_its_triangles(mode: int) -> None:
    # A regular hexagon, counter-clockwise: as a fan around its first corner, and as a strip from side to side.
    angles = np.arange(6) * math.pi / 3
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    indices = np.array([0, 1, 2, 3, 4, 5] if mode == 6 else [0, 1, 5, 2, 4, 3], np.uint32)
    faces = unrolled(indices, fan=mode == 6)
    sides = corners[faces[:, 1:]] - corners[faces[:, :1]]
    areas = (sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2
    assert len(faces) == 4
    assert (areas > 0).all()  # all turn the same way
    assert areas.sum() == pytest.approx(1.5 * math.sqrt(3))


def test_the_transmission_that_others_write_is_read(written: Path) -> None:
    document, binary = chunks_of(written)
    name = document["materials"][0]["name"]
    document["materials"][0].setdefault("extensions", {})["KHR_materials_transmission"] = {
        "transmissionFactor": 0.6, "transmissionTexture": {"index": 0},
    }  # fmt: skip
    document["extensionsRequired"] = ["KHR_materials_transmission"]
    part = read_gltf(embedded(written, document, binary))
    assert part.materials[name].transmission == 0.6
    assert f"material {name}: its transmission texture is ignored" in part.notes


def test_the_diffuse_transmission_that_others_write_is_read(written: Path) -> None:
    document, binary = chunks_of(written)
    name = document["materials"][0]["name"]
    document["materials"][0].setdefault("extensions", {})["KHR_materials_diffuse_transmission"] = {
        "diffuseTransmissionFactor": 0.4, "diffuseTransmissionColorFactor": [0.5, 0.9, 0.1],
    }  # fmt: skip
    document["extensionsRequired"] = ["KHR_materials_diffuse_transmission"]
    part = read_gltf(embedded(written, document, binary))
    assert part.materials[name].translucency == 0.4
    assert f"material {name}: textures and colour of its diffuse transmission are ignored" in part.notes


def test_a_diffuse_transmission_without_factor_is_none_at_all(written: Path) -> None:
    document, binary = chunks_of(written)
    name = document["materials"][0]["name"]
    document["materials"][0].setdefault("extensions", {})["KHR_materials_diffuse_transmission"] = {}
    document["materials"][0]["doubleSided"] = True
    assert read_gltf(embedded(written, document, binary)).materials[name].light_through == 0.0


def test_lines_are_left_out_and_noted(written: Path) -> None:
    document, binary = chunks_of(written)
    document["meshes"][0]["primitives"][0]["mode"] = 1
    part = read_gltf(embedded(written, document, binary))
    assert "lines and points are ignored" in part.notes


def test_extensions_that_are_not_read_are_named(written: Path) -> None:
    document, binary = chunks_of(written)
    document["extensionsUsed"] = ["KHR_lights_punctual", "KHR_materials_sheen", "EXT_other"]
    assert any(
        "EXT_other, KHR_materials_sheen" in note for note in read_gltf(embedded(written, document, binary)).notes
    )


def test_nodes_without_name_are_noted_in_one_line(written: Path) -> None:
    document, binary = chunks_of(written)
    for node in document["nodes"]:
        node.pop("name", None)
    notes = [note for note in read_gltf(embedded(written, document, binary)).notes if "without a name" in note]
    assert len(notes) == 1
    assert "node_0, node_1" in notes[0]


#: Ways to break a good document.
BREAKS: dict[str, Any] = {
    "view beyond the buffer": lambda d: d["bufferViews"][0].update(byteLength=10**9),
    "negative offset": lambda d: d["bufferViews"][0].update(byteOffset=-4),
    "accessor beyond its view": lambda d: d["accessors"][0].update(count=10**6),
    "huge accessor": lambda d: d["accessors"][0].update(count=10**12),
    "count is a word": lambda d: d["accessors"][0].update(count="many"),
    "sparse accessor": lambda d: d["accessors"][0].update(sparse={"count": 1, "indices": {}, "values": {}}),
    "no such mesh": lambda d: d["nodes"][0].update(mesh=99),
    "no such material": lambda d: d["meshes"][0]["primitives"][0].update(material=99),
    "no such accessor": lambda d: d["meshes"][0]["primitives"][0]["attributes"].update(POSITION=10**6),
    "no such camera": lambda d: next(n for n in d["nodes"] if "camera" in n).update(camera=7),
    "no such image": lambda d: d["textures"][0].update(source=5),
    "circle of nodes": lambda d: d["nodes"][0].update(children=[0]),
    "two parents": lambda d: [node.update(children=[3]) for node in d["nodes"][:2]],
    "child out of range": lambda d: d["nodes"][0].update(children=[10**6]),
    "transform of three numbers": lambda d: d["nodes"][0].update(matrix=[1, 2, 3]),
    "transform with infinity": lambda d: d["nodes"][0].update(matrix=[1e400] + [0] * 14 + [1]),
    "roughness of two": lambda d: d["materials"][0]["pbrMetallicRoughness"].update(roughnessFactor=2),
    "roughness is a word": lambda d: d["materials"][0]["pbrMetallicRoughness"].update(roughnessFactor="very"),
    "nodes are no list": lambda d: d.update(nodes={"a": 1}),
    "version 1": lambda d: d.update(asset={"version": "1.0"}),
    "unknown required extension": lambda d: d.update(extensionsRequired=["KHR_draco_mesh_compression"]),
    "same name twice": lambda d: d["nodes"][1].update(name=d["nodes"][0]["name"]),
}


@pytest.mark.parametrize("how", BREAKS)
def test_a_broken_document_is_a_clear_error(written: Path, how: str) -> None:
    document, binary = chunks_of(written)
    BREAKS[how](document)
    with pytest.raises(InvalidInput):
        load_gltf(embedded(written, document, binary))


def _color_texture(index: int) -> Any:
    return lambda d: d["materials"][0]["pbrMetallicRoughness"].update(baseColorTexture={"index": index})


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (_color_texture(5), r"material paving: baseColorTexture: textures: .* got 5; limit: 0…0"),
        (_color_texture(-1), r"material paving: baseColorTexture: textures: .* got -1; limit: 0…0"),
        (BREAKS["no such image"], r"textures\.0\.source: images: .* got 5; limit: 0…0"),
        (BREAKS["no such material"], r"meshes\.0\.primitives\.0: materials: .* got 99; limit: 0…7"),
        (BREAKS["no such mesh"], r"meshes: .* got 99; limit: 0…8"),
        (BREAKS["no such camera"], r"cameras: .* got 7; limit: 0…1"),
        (lambda d: d.update(scene=3), r"scenes: .* got 3; limit: 0…0"),
        (
            lambda d: d["extensions"]["KHR_lights_punctual"].update(lights=[]),
            r"lights: .* got 0; limit: there are none",
        ),
    ],
)
def test_an_index_out_of_range_is_reported_with_its_place_and_the_valid_range(
    written: Path, edit: Any, said: str
) -> None:
    document, binary = chunks_of(written)
    edit(document)
    with pytest.raises(InvalidInput, match=said) as error:
        load_gltf(embedded(written, document, binary))
    assert "refers to something that is not there" in str(error.value)


def test_an_image_that_claims_to_be_huge_is_refused_before_it_is_decoded(written: Path) -> None:
    document, _ = chunks_of(written)
    png = bytearray(b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 60_000, 60_000) + b"\0" * 20)
    document["images"][0] = {"uri": "data:image/png;base64," + base64.b64encode(png).decode()}
    _, binary = chunks_of(written)
    with pytest.raises(InvalidInput, match="60000 × 60000"):
        load_gltf(embedded(written, document, binary))


def test_a_node_name_with_dots_becomes_a_path_part_and_is_noted(written: Path) -> None:
    document, binary = chunks_of(written)
    document["nodes"][0]["name"] = "road.001"
    part = read_gltf(embedded(written, document, binary))
    assert part.nodes[0].path == "scene.road_001"
    assert any("road_001" in note for note in part.notes)


def test_extras_of_other_programs_do_no_harm(written: Path) -> None:
    document, binary = chunks_of(written)
    document["nodes"][0]["extras"] = {"artist": "someone", EXTRAS_KEY: "not a mapping"}
    assert load_gltf(embedded(written, document, binary)).nodes["scene.road-1"].visible
