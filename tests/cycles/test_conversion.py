"""A .blend file as an asset: shapes, names and lights are converted, and none of the file's code is run."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from valerie.errors import InvalidInput
from valerie.rendering.cycles.blender import blender_environment
from valerie.rendering.cycles.conversion import convert_blend
from valerie.scene.assets.asset import load_asset
from valerie.scene.checks import Severity, asset_findings
from valerie.scene.checks.manifest_draft import draft_manifest
from valerie.scene.checks.shapes import object_boxes
from valerie.settings import Settings

#: Builds a small street with a text block that registers itself and a driver with Python. Each writes a file if it is run.
AUTHOR = """
import math, os, sys, bpy
path, marker = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
def cube(name, size, at, origin_z):
    bpy.ops.mesh.primitive_cube_add(size=1)
    thing = bpy.context.object
    thing.name, thing.scale, thing.location = name, size, (0, 0, size[2] / 2 - origin_z)
    bpy.ops.object.transform_apply()
    thing.location = (at[0], at[1], origin_z)
    return thing
cube("road-1", (20, 60, 0.1), (0, 20), -0.1)
house = cube("building-1", (4, 6, 8), (-8, 20), 0)
cube("person-1", (0.5, 0.4, 1.8), (0, 10), 0)
bpy.ops.object.camera_add(location=(0, 0, 1.6), rotation=(math.pi / 2, 0, 0))
bpy.context.object.name = "camera-1"
bpy.ops.object.light_add(type="SUN", rotation=(0, math.radians(50), 0))  # shines from +x, 40 degrees high
material = bpy.data.materials.new("paint")
material.use_nodes = True
noise = material.node_tree.nodes.new("ShaderNodeTexNoise")
material.node_tree.links.new(noise.outputs["Color"], material.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
house.data.materials.append(material)
stranger = bpy.data.images.new("stranger", 2, 2)
stranger.filepath, stranger.source = "/somewhere/else.png", "FILE"
stranger.use_fake_user = True
text = bpy.data.texts.new("payload.py")
text.write(f"open({marker + '.text'!r}, 'w').close()\\n")
text.use_module = True
driver = cube("pole-1", (0.1, 0.1, 3), (5, 5), 0).driver_add("location", 2).driver
driver.type, driver.expression = "SCRIPTED", f"len(open({marker + '.driver'!r}, 'w').name) * 0"
bpy.ops.wm.save_as_mainfile(filepath=path)
os._exit(0)
"""
TRUSTING = """
import os, sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1], load_ui=False, use_scripts=True)
bpy.context.view_layer.update()
os._exit(0)
"""


def run(deployment: Settings, program: str, *arguments: Path) -> None:
    command = [str(deployment.cycles_python), "-I", "-c", program, *map(str, arguments)]
    subprocess.run(
        command,
        check=True,
        timeout=120,
        env=blender_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("blend")


@pytest.fixture(scope="module")
def blend(deployment: Settings, place: Path) -> Path:
    path = place / "street.blend"
    run(deployment, AUTHOR, path, place / "ran-while-made")
    return path


def ran(place: Path, name: str) -> set[str]:
    return {path.suffix for path in place.glob(f"{name}.*")}


@pytest.fixture(scope="module")
def converted(deployment: Settings, blend: Path, place: Path) -> tuple[Path, tuple[str, ...]]:
    for path in place.glob("ran-while-made.*"):
        path.unlink()
    folder = place / "street"
    folder.mkdir()
    return folder, convert_blend(blend, folder / "street.glb", deployment).notes


def test_no_script_of_the_file_is_run(
    converted: tuple[Path, tuple[str, ...]], deployment: Settings, blend: Path, place: Path
) -> None:
    assert ran(place, "ran-while-made") == set()
    assert any("scripts of the file are not run" in note for note in converted[1])
    # The same file runs both if its scripts are trusted, so the markers would show it.
    run(deployment, TRUSTING, blend)
    assert ran(place, "ran-while-made") == {".text", ".driver"}


def test_parts_that_gltf_cannot_hold_and_outside_images_are_named(converted: tuple[Path, tuple[str, ...]]) -> None:
    assert any("material paint: its procedural colour" in note for note in converted[1])
    assert any("/somewhere/else.png is outside" in note for note in converted[1])


def test_the_converted_file_is_an_asset_as_it_was_modelled(converted: tuple[Path, tuple[str, ...]]) -> None:
    folder = converted[0]
    draft_manifest(folder)
    assert [f for f in asset_findings(folder) if f.severity is not Severity.NOTE] == []
    asset = load_asset(str(folder))
    boxes = object_boxes(asset.base)
    np.testing.assert_allclose(boxes["scene.building-1"], [[-10, 17, 0], [-6, 23, 8]], atol=1e-5)
    np.testing.assert_allclose(boxes["scene.person-1"], [[-0.25, 9.8, 0], [0.25, 10.2, 1.8]], atol=1e-5)
    assert asset.manifest.persons == ("scene.person-1",)
    camera = asset.base.cameras["camera-1"]
    np.testing.assert_allclose(camera.position, [0, 0, 1.6], atol=1e-6)
    np.testing.assert_allclose(-camera.transform[:3, 2], [0, 1, 0], atol=1e-6)
    angle = np.radians(40.0)
    np.testing.assert_allclose(asset.base.sun_direction(), [np.cos(angle), 0, np.sin(angle)], atol=1e-5)


def test_a_file_that_blender_cannot_read_is_a_clear_error(deployment: Settings, tmp_path: Path) -> None:
    broken = tmp_path / "broken.blend"
    broken.write_bytes(b"BLENDER-v405" + b"\0" * 100)
    with pytest.raises(InvalidInput, match=r"broken\.blend: Blender cannot convert the file"):
        convert_blend(broken, tmp_path / "broken.glb", deployment)
    assert not (tmp_path / "broken.glb").exists()
