"""Comparison of scenes bit for bit."""

from __future__ import annotations

import numpy as np

from valerie.scene.graph.model import Scene


def assert_same_scene(scene: Scene, other: Scene) -> None:
    """Fail unless two scenes have the same values in the same order, bit for bit. The message names the first difference."""
    assert list(scene.nodes) == list(other.nodes), "other nodes, or another order"
    for path, node in scene.nodes.items():
        twin = other.nodes[path]
        assert node.transform.tobytes() == twin.transform.tobytes(), f"{path}: another transform"
        for field in ("label_id", "instance_id", "movable", "visible"):
            assert getattr(node, field) == getattr(twin, field), f"{path}: another {field}"
        assert len(node.meshes) == len(twin.meshes), f"{path}: another number of meshes"
        for mesh, twin_mesh in zip(node.meshes, twin.meshes, strict=True):
            assert mesh.material == twin_mesh.material, f"{path}: another material"
            for field in ("positions", "normals", "uvs", "faces"):
                array, twin_array = getattr(mesh, field), getattr(twin_mesh, field)
                assert array.dtype == twin_array.dtype, f"{path}: another type of {field}"
                assert array.shape == twin_array.shape, f"{path}: another shape of {field}"
                assert array.tobytes() == twin_array.tobytes(), f"{path}: other {field}"
    assert dict(scene.materials) == dict(other.materials), "other materials"
    assert list(scene.textures) == list(other.textures), "other textures"
    for name, texture in scene.textures.items():
        assert np.array_equal(texture.image, other.textures[name].image), f"texture {name}: other texels"
    assert list(scene.cameras) == list(other.cameras), "other cameras"
    for name, camera in scene.cameras.items():
        twin_camera = other.cameras[name]
        assert camera.transform.tobytes() == twin_camera.transform.tobytes(), f"{name}: another transform"
        for field in ("path", "focal_length_mm", "sensor_width_mm", "near", "far"):
            assert getattr(camera, field) == getattr(twin_camera, field), f"{name}: another {field}"
    assert scene.sun == other.sun, "another sun"
    assert scene.environment == other.environment, "another environment"
