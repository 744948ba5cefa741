"""glTF files of other programs: the test models of the library Assimp, from the Debian package assimp-testmodels.

Without the package they are skipped (tests/allowed_skips.txt), except where VALERIE_TEST_ASSIMP_MODELS says where the models
are, as .ci/run does: then they must be there.
"""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.sampling import enough_to_show
from valerie.errors import InvalidInput
from valerie.scene.assets.gltf_scene import load_gltf
from valerie.scene.checks.shapes import world_points
from valerie.scene.gltf.common import vectors_from_y_up
from valerie.scene.gltf.reader import read_gltf

PROMISED = os.environ.get("VALERIE_TEST_ASSIMP_MODELS")
MODELS = Path(PROMISED or "/usr/share/assimp/models")

pytestmark = pytest.mark.skipif(
    not PROMISED and not (MODELS / "glTF2").is_dir(), reason="no models to read: apt-get install assimp-testmodels"
)


@pytest.mark.parametrize(
    "name",
    [
        "BoxTextured-glTF/BoxTextured.gltf",  # buffer and texture beside it
        "BoxTextured-glTF-Embedded/BoxTextured.gltf",
        "BoxTextured-glTF-Binary/BoxTextured.glb",
        "BoxTexcoords-glTF/boxTexcoords.gltf",
        "2CylinderEngine-glTF-Binary/2CylinderEngine.glb",
        "ClearCoat-glTF/ClearCoatTest.gltf",
        "glTF-Sample-Models/AnimatedMorphCube-glTF/AnimatedMorphCube.gltf",
        "glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_04.gltf",  # a strip
    ],
)
def test_another_reader_finds_the_same_triangles_in_the_same_places(name: str) -> None:
    path = MODELS / "glTF2" / name
    part = read_gltf(path)
    scene = load_gltf(path, node_classes={node.path: "static" for node in part.nodes if node.path.count(".") == 1})
    triangles = np.concatenate(
        [
            world_points(mesh, scene.world_transform(path))[mesh.faces.astype(np.int64)]
            for path, node in scene.nodes.items()
            for mesh in node.meshes
        ]
    )
    other = trimesh.load_scene(path).to_mesh()
    expected = vectors_from_y_up(np.asarray(other.triangles))
    assert len(triangles) == len(expected)
    # Both multiply chains of float32 matrices, whose rounding is 6e-8 each.
    size = np.ptp(expected.reshape(-1, 3), axis=0).max()
    for ours, theirs in ((triangles.min((0, 1)), expected.min((0, 1))), (triangles.max((0, 1)), expected.max((0, 1)))):
        np.testing.assert_allclose(ours, theirs, atol=1e-5 * size)
    areas = (trimesh.triangles.area(corners).sum() for corners in (triangles, expected))
    assert next(areas) == pytest.approx(next(areas), rel=1e-4)


def test_every_file_is_read_or_refused_with_a_message() -> None:
    read, refused = 0, {}
    for path in sorted((*MODELS.glob("glTF*/**/*.gltf"), *MODELS.glob("glTF*/**/*.glb"))):
        try:
            read_gltf(path)
        except InvalidInput as error:
            refused[path] = str(error)
        else:
            read += 1
    assert read >= enough_to_show(0.1)
    assert len(refused) >= enough_to_show(
        0.2
    )  # broken on purpose, of version 1, or compressed in ways that are not read
    assert all(path.name in words or "scene." in words for path, words in refused.items())
