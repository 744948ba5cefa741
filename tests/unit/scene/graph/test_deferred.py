"""Meshes and textures that are made when they are first read."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Event

import numpy as np
import pytest

from valerie.scene.graph.deferred import DeferredMesh, DeferredTexture, deferred_textures
from valerie.scene.graph.model import Mesh


def triangle() -> Mesh:
    corners = np.eye(3, dtype=np.float32)
    return Mesh(corners, corners.copy(), np.zeros((3, 2), np.float32), np.array([[0, 1, 2]], np.uint32), "own")


def test_a_mesh_knows_its_material_before_it_is_made_and_is_made_once() -> None:
    calls: list[int] = []
    mesh = DeferredMesh(lambda: calls.append(1) or triangle(), "red")
    assert (mesh.material, calls) == ("red", [])
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.positions.shape == mesh.normals.shape == (3, 3)
    assert mesh.uvs.shape == (3, 2)
    assert calls == [1]


def test_a_deferred_mesh_with_another_material_shares_its_arrays_and_is_not_made_yet() -> None:
    calls: list[int] = []
    mesh = DeferredMesh(lambda: calls.append(1) or triangle(), "red")
    other = mesh.with_material("blue")
    assert (other.material, calls) == ("blue", [])
    assert other.positions is mesh.positions
    assert calls == [1]


def test_a_plain_mesh_takes_another_material_too() -> None:
    mesh = triangle()
    other = mesh.with_material("blue")
    assert (mesh.material, other.material) == ("own", "blue")
    assert other.positions is mesh.positions


def test_a_texture_is_painted_once_and_read_only() -> None:
    calls: list[int] = []
    texture = DeferredTexture("bark", lambda: calls.append(1) or np.zeros((2, 2, 3), np.uint8))
    assert (texture.name, calls) == ("bark", [])
    assert texture.image is texture.image
    assert calls == [1]
    with pytest.raises(ValueError, match="read-only"):
        texture.image[0, 0] = 1


def test_textures_made_together_are_made_once_when_one_is_read() -> None:
    calls: list[int] = []

    def make() -> list[np.ndarray]:
        calls.append(1)
        return [np.full((2, 2, 3), value, np.uint8) for value in (3, 7)]

    textures = deferred_textures(("light", "dark"), make)
    assert calls == []
    assert int(textures["dark"].image[0, 0, 0]) == 7
    assert int(textures["light"].image[0, 0, 0]) == 3
    assert (calls, [t.name for t in textures.values()]) == ([1], ["light", "dark"])


def test_a_thread_waits_for_textures_that_another_thread_makes() -> None:
    calls, made, go_on = list[int](), Event(), Event()

    def make() -> list[np.ndarray]:
        calls.append(1)
        made.set()
        assert go_on.wait(timeout=10)
        return [np.full((2, 2, 3), value, np.uint8) for value in (3, 7)]

    textures = deferred_textures(("light", "dark"), make)
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(lambda: textures["light"].image)
        assert made.wait(timeout=10)
        second = pool.submit(lambda: textures["dark"].image)
        with pytest.raises(TimeoutError):
            second.result(timeout=0.2)
        go_on.set()
        assert (int(first.result()[0, 0, 0]), int(second.result()[0, 0, 0]), calls) == (3, 7, [1])


def test_textures_that_another_one_follows_from_are_read_at_the_same_time() -> None:
    base = DeferredTexture("base", lambda: np.full((2, 2, 3), 3, np.uint8))
    twice = DeferredTexture("twice", lambda: base.image * 2)
    with ThreadPoolExecutor(2) as pool:
        images = list(pool.map(lambda texture: texture.image, (twice, base)))
    assert [int(image[0, 0, 0]) for image in images] == [6, 3]
