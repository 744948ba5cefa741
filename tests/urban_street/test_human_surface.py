"""Test surface operations against shapes with known answers."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from urban_street.human import surface

CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def ball() -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def test_catmull_clark_moves_a_cubes_corner_to_five_ninths() -> None:
    finer = surface.subdivide(QUADS, 8)
    points = finer.matrix @ CUBE
    np.testing.assert_allclose(points[:8], CUBE * 5.0 / 9.0, atol=1e-12)
    assert len(points) == 8 + 12 + 6
    assert len(finer.faces) == 24


def test_subdivided_faces_look_outwards() -> None:
    finer = surface.subdivide(QUADS, 8)
    points = finer.matrix @ CUBE
    normals = np.cross(
        points[finer.faces[:, 2]] - points[finer.faces[:, 0]], points[finer.faces[:, 3]] - points[finer.faces[:, 1]]
    )
    assert (np.einsum("ij,ij->i", normals, points[finer.faces].mean(axis=1)) > 0.0).all()


def test_an_open_edge_follows_the_cubic_spline() -> None:
    points = np.array([[x, y, 0.0] for y in (0.0, 1.0) for x in (0.0, 1.0, 2.0)])
    finer = surface.subdivide(np.array([[0, 1, 4, 3], [1, 2, 5, 4]]), 6)
    moved = finer.matrix @ points
    np.testing.assert_allclose(moved[1], [1.0, 0.0, 0.0], atol=1e-12)  # on a straight edge
    np.testing.assert_allclose(moved[0], [0.125, 0.125, 0.0], atol=1e-12)  # (6·P + A + B) / 8 at the corner


def test_rows_of_the_subdivision_average() -> None:
    np.testing.assert_allclose(surface.subdivide(QUADS, 8).matrix.sum(axis=1), 1.0)


def test_a_cut_through_a_ball_leaves_half_its_area() -> None:
    points, faces = ball()
    half = surface.clip(faces, points[:, 2] - 0.03)
    kept = half.matrix @ points
    mesh = trimesh.Trimesh(kept, half.faces, process=False)
    expected = 2.0 * np.pi * (1.0 + 0.03)  # a cap's area is 2·pi·r·h
    # Flat faces have less area than the sphere, by 0.5 % in the mean. That goes with the squares of their edges, which are 0.138
    # to 0.165 long: no part of the ball lacks more or less than its share by more than a fifth of it.
    assert mesh.area == pytest.approx(expected * trimesh.Trimesh(points, faces).area / (4.0 * np.pi), rel=1e-3)


def test_the_edge_of_a_cut_lies_on_the_cut() -> None:
    points, faces = ball()
    half = surface.clip(faces, points[:, 2] - 0.03)
    kept = half.matrix @ points
    (loop,) = surface.boundary_loops(half.faces)
    np.testing.assert_allclose(kept[loop, 2], 0.03, atol=1e-9)


def test_a_cut_leaves_no_slivers() -> None:
    points, faces = ball()
    snap = 0.3
    half = surface.clip(faces, points[:, 2] - 0.03, snap=snap)
    kept = half.matrix @ points
    edges, _ = surface.edges_of(half.faces)
    lengths = np.linalg.norm(kept[edges[:, 0]] - kept[edges[:, 1]], axis=1)
    whole, _ = surface.edges_of(faces)
    shortest = np.linalg.norm(points[whole[:, 0]] - points[whole[:, 1]], axis=1).min()
    # Both ends of an edge along the cut lie at least that share of an edge away from the corner that is cut off.
    narrowest = trimesh.Trimesh(points, faces).face_angles.min()
    assert lengths.min() > snap * np.sin(narrowest) * shortest


def test_a_field_below_zero_everywhere_cuts_nothing() -> None:
    points, faces = ball()
    same = surface.clip(faces, np.full(len(points), -1.0))
    assert len(same.faces) == len(faces)
    np.testing.assert_array_equal(same.matrix @ points, points)


def test_a_boundary_loop_runs_with_its_faces() -> None:
    points, faces = ball()
    half = surface.clip(faces, points[:, 2])
    kept = half.matrix @ points
    (loop,) = surface.boundary_loops(half.faces)
    ring = kept[loop]
    # Seen from outside, the lower half lies left of an edge that runs clockwise seen from above.
    turn = np.cross(ring, np.roll(ring, -1, axis=0))[:, 2].sum()
    assert turn < 0.0


def test_a_strip_continues_the_surface_outwards() -> None:
    points, faces = ball()
    half = surface.clip(faces, points[:, 2])
    kept = half.matrix @ points
    (loop,) = surface.boundary_loops(half.faces)
    both = np.concatenate([kept, kept[loop] + [0.0, 0.0, 0.5]])
    strip = surface.strip(loop, np.arange(len(kept), len(both)))
    tube = trimesh.Trimesh(both, np.concatenate([half.faces, strip]), process=False)
    assert tube.is_winding_consistent
    outward = np.einsum("ij,ij->i", tube.face_normals, tube.triangles_center)
    assert (outward > 0.0).all()


def test_vertex_normals_of_a_ball_are_its_radii() -> None:
    points, faces = ball()
    # Normals of faces lie 0.1 off the radius of a corner, an edge over √3; around it they cancel but for a fifth, by which edges
    # differ.
    assert (np.einsum("ij,ij->i", surface.vertex_normals(points, faces), points) > np.cos(0.02)).all()


def test_simplifying_a_ball_keeps_its_shape_and_closedness() -> None:
    points, faces = ball()
    slim = surface.simplify(points, faces, 800)
    assert len(slim.faces) == 800
    kept = slim.matrix @ points
    mesh = trimesh.Trimesh(kept, slim.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    # What flat faces lack goes with their area, and the middle of an edge, where it collapses to, lies inside by as much again.
    lacking = 1.0 - trimesh.Trimesh(points, faces).volume / (4.0 / 3.0 * np.pi)
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi, rel=2.0 * lacking * len(faces) / 800)


def test_simplifying_keeps_every_vertex_of_an_open_edge() -> None:
    points, faces = ball()
    half = surface.clip(faces, points[:, 2])
    kept = half.matrix @ points
    (before,) = surface.boundary_loops(half.faces)
    slim = surface.simplify(kept, half.faces, 300)
    (after,) = surface.boundary_loops(slim.faces)
    ordered = [np.array(sorted(map(tuple, np.round(p, 9)))) for p in (kept[before], (slim.matrix @ kept)[after])]
    np.testing.assert_array_equal(*ordered)


def test_locked_vertices_survive_simplification() -> None:
    points, faces = ball()
    locked = points[:, 2] > 0.5
    slim = surface.simplify(points, faces, 600, locked=locked)
    kept = {tuple(row) for row in np.round(slim.matrix @ points, 9)}
    assert {tuple(row) for row in np.round(points[locked], 9)} <= kept


def test_unwelding_doubles_vertices_at_the_seam_only() -> None:
    angle = np.arange(8) / 8.0
    ids = np.arange(16).reshape(2, 8)
    faces = surface.strip(ids[0], ids[1])
    uvs = np.stack([np.tile(angle, 2), np.repeat([0.0, 1.0], 8)], axis=1)
    old, new, split = surface.unweld(faces, uvs[faces])
    assert len(old) == 18
    np.testing.assert_array_equal(old[split], faces)
    assert np.ptp(new[split][..., 0], axis=1).max() == pytest.approx(1.0 / 8.0)


def test_evening_an_edge_takes_its_zigzag_out_and_leaves_the_rest() -> None:
    points, faces = ball()
    half = surface.clip(faces, points[:, 2])
    kept = half.matrix @ points
    (loop,) = surface.boundary_loops(half.faces)
    jagged = kept.copy()
    jagged[loop[::2], 2] += 0.02
    even = surface.even_edges(jagged, half.faces)
    # A mean that weighs a vertex as much as its two neighbours has no zigzag left.
    assert np.ptp(even[loop, 2]) == pytest.approx(0.0, abs=1e-12)
    inner = np.setdiff1d(np.arange(len(kept)), loop)
    np.testing.assert_array_equal(even[inner], jagged[inner])
