"""Test primitives against closed formulas: volumes by the divergence theorem need correct sizes and outward faces."""

from __future__ import annotations

import numpy as np
import pytest

from urban_street.solids.surfaces import (
    Bag,
    Surface,
    boxes,
    extrude,
    fan,
    lathe,
    merge,
    pose,
    quads,
    repeat,
    sheet,
    tubes,
)


def volume(surface: Surface) -> float:
    """Return the signed volume of a closed surface; positive when faces turn outwards."""
    a, b, c = (surface.positions[surface.faces[:, k]] for k in range(3))
    return float(np.einsum("fk,fk->", a, np.cross(b, c)) / 6.0)


def assert_normals_outward(surface: Surface) -> None:
    corners = surface.positions[surface.faces]
    turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fk,fk->f", turned, surface.normals[surface.faces].mean(axis=1)) > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0)


def test_boxes_have_their_volume_and_outward_normals() -> None:
    surface = boxes([[0, 0, 0], [5, 5, 5]], [[1, 2, 3], [6, 6, 6]])
    assert volume(surface) == pytest.approx(7.0)
    assert_normals_outward(surface)


def test_a_skipped_face_is_missing() -> None:
    surface = boxes([[0, 0, 0]], [[1, 1, 1]], skip=("-z",))
    assert len(surface.faces) == 10
    assert (surface.normals @ [0, 0, -1] <= 0.0).all()


def test_a_lathe_of_a_rectangle_is_a_cylinder() -> None:
    surface = lathe([(0.0, 0.0), (2.0, 0.0), (2.0, 3.0), (0.0, 3.0)], 400)
    # A polygon of n sides has (2π/n)²/6 less area than its circle: 4e-5.
    assert volume(surface) == pytest.approx(np.pi * 4.0 * 3.0, rel=5e-5)


def test_a_moulding_is_closed_up_to_the_wall_behind_it() -> None:
    profile = [(0.0, 0.0), (-0.2, 0.0), (-0.2, 0.5), (0.0, 0.5)]
    back = quads([[(4, 0, 0), (0, 0, 0), (0, 0, 0.5), (4, 0, 0.5)]])
    surface = merge([extrude(profile, 0.0, 4.0), back])
    assert volume(surface) == pytest.approx(0.2 * 0.5 * 4.0)
    assert_normals_outward(surface)


@pytest.mark.parametrize("end", [(0.0, 0.0, 3.0), (3.0, 0.0, 0.0), (1.0, -2.0, 2.0), (0.0, 0.0, -3.0)])
def test_tubes_keep_their_radius_and_look_outwards(end: tuple[float, float, float]) -> None:
    path = np.linspace((0.0, 0.0, 0.0), end, 5)
    surface = tubes(path[None], np.full((1, 5), 0.25), 12)
    axis = np.array(end) / 3.0
    off_axis = surface.positions - (surface.positions @ axis)[:, None] * axis
    np.testing.assert_allclose(np.linalg.norm(off_axis, axis=1), 0.25)
    assert_normals_outward(surface)


def test_a_sheet_is_smooth_and_faces_the_named_side() -> None:
    x, y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 7), indexing="ij")
    surface = sheet(np.stack([x, y, 0.1 * x**2], -1))
    # It rises by at most 0.2 per metre.
    level = np.cos(np.arctan(0.2))
    assert (surface.normals[:, 2] >= level).all()
    below = sheet(np.stack([x, y, 0.1 * x**2], -1), flip=True)
    assert (below.normals[:, 2] <= -level).all()


def test_a_closed_sheet_has_no_visible_seam() -> None:
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    points = np.concatenate([np.repeat(ring[:, None], 2, 1), np.broadcast_to([[[0.0], [1.0]]], (16, 2, 1))], -1)
    surface = sheet(points, closed=True)
    np.testing.assert_array_equal(surface.normals[:2], surface.normals[-2:])
    radial = surface.positions * [1, 1, 0]
    # A vertex has two triangles of one face of 22.5° and one of the other: (2 − 1) / 3 of half a face, 3.75°.
    assert (np.einsum("vk,vk->v", surface.normals, radial) > np.cos(np.radians(3.8))).all()


def test_texture_coordinates_are_metres_over_the_tile_with_v_downwards() -> None:
    surface = quads([[(0, 0, 0), (3, 0, 0), (3, 0, 2), (0, 0, 2)]], tile=0.5)
    u, v = surface.uvs.T
    assert (np.ptp(u), np.ptp(v)) == (6.0, 4.0)
    assert v[surface.positions[:, 2] == 2.0].max() < v[surface.positions[:, 2] == 0.0].min()


def test_a_fan_faces_the_side_from_which_it_is_counter_clockwise() -> None:
    surface = fan([(0, 0, 1), (2, 0, 1), (2, 1, 1), (0, 1, 1)])
    np.testing.assert_allclose(surface.normals, [[0, 0, 1]] * 4)
    assert_normals_outward(surface)


def test_moved_surfaces_turn_their_normals() -> None:
    surface = boxes([[0, 0, 0]], [[1, 1, 1]]).moved(pose(5.0, 0.0, 0.0, np.pi / 2))
    assert volume(surface) == pytest.approx(1.0)
    assert_normals_outward(surface)
    assert surface.positions[:, 0].max() == pytest.approx(5.0)


def test_repeated_surfaces_are_copies_at_the_offsets() -> None:
    surface = repeat(boxes([[0, 0, 0]], [[1, 1, 1]]), [(0, 0, 0), (3, 0, 0), (0, 4, 0)])
    assert volume(surface) == pytest.approx(3.0)


def test_a_bag_gives_one_mesh_per_material_without_empty_ones() -> None:
    bag = Bag()
    bag.add("stone", boxes([[0, 0, 0]], [[1, 1, 1]]), boxes([[2, 0, 0]], [[3, 1, 1]]))
    bag.add("nothing", merge([]))
    meshes = bag.meshes()
    assert [(mesh.material, len(mesh.faces)) for mesh in meshes] == [("stone", 24)]
    assert meshes[0].positions.dtype == np.float32
    assert not meshes[0].positions.flags.writeable
