"""Test trimmed surfaces against closed formulas."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from urban_street.solids.rounded import bar, pillow, rod, rounded_outline, torus, turned
from urban_street.solids.surfaces import Surface
from urban_street.vehicles.bodies import CARS
from urban_street.vehicles.curves import PlanOutline, hermite, smooth
from urban_street.vehicles.hull import Hull
from urban_street.vehicles.shell import Shell, shrunk
from urban_street.vehicles.skin import Master, cut, flange, mirrored

_LINES = np.linspace(0.0, 2.0, 9)


def plane() -> Master:
    """Return z = 0 over [0, 2]², seen from above."""
    return Master(lambda at: np.column_stack([at, np.zeros(len(at))]), (0.0, 0.0), (2.0, 2.0), (_LINES, _LINES))


def tube() -> Master:
    """Return a quarter of a cylinder of radius 1 about z, seen from outside; the domain is (angle, height)."""
    angle = np.linspace(0.0, 0.5 * np.pi, 33)
    return Master(
        lambda at: np.column_stack([np.cos(at[:, 0]), np.sin(at[:, 0]), at[:, 1]]),
        (0.0, 0.0),
        (0.5 * np.pi, 2.0),
        (angle, _LINES),
    )


def area(surface: Surface) -> float:
    corners = surface.positions[surface.faces]
    return float(
        0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    )


def volume(surface: Surface) -> float:
    a, b, c = (surface.positions[surface.faces[:, k]] for k in range(3))
    return float(np.einsum("fk,fk->", a, np.cross(b, c)) / 6.0)


def test_a_cut_has_the_area_of_its_outline_holes_left_out() -> None:
    disc = shapely.Point(1.0, 1.0).buffer(0.7).difference(shapely.box(0.9, 0.9, 1.2, 1.3))
    patch = cut(plane(), disc)
    assert area(patch.surface) == pytest.approx(disc.area, rel=1e-6)
    np.testing.assert_allclose(
        patch.surface.normals, np.broadcast_to([0.0, 0.0, 1.0], patch.surface.normals.shape), atol=1e-6
    )


def test_regions_that_share_an_outline_leave_nothing_between_them() -> None:
    left = shapely.Point(1.0, 1.0).buffer(0.6)
    parts = [cut(tube(), shape).surface for shape in (left, tube().domain.difference(left))]
    assert sum(map(area, parts)) == pytest.approx(area(cut(tube(), tube().domain).surface), rel=1e-3)


def test_an_offset_moves_along_the_normals() -> None:
    outer = cut(tube(), tube().domain, offset=0.1).surface
    np.testing.assert_allclose(np.linalg.norm(outer.positions[:, :2], axis=1), 1.1, atol=1e-6)
    np.testing.assert_allclose(outer.normals[:, :2] * 1.1, outer.positions[:, :2], atol=1e-3)


def test_a_flange_closes_the_sides_of_a_panel() -> None:
    square = cut(plane(), shapely.box(0.5, 0.5, 1.5, 1.5))
    edge = flange(square, 0.2, middle=True)
    assert area(edge) == pytest.approx(4 * 0.2)
    assert edge.positions[:, 2].min() == pytest.approx(-0.2)
    # Each side lies half a metre from the middle.
    outwards = np.einsum("vk,vk->v", edge.normals, edge.positions - [1.0, 1.0, -0.1])
    assert (outwards >= 0.5 - 1e-6).all()


def test_a_mirrored_surface_turns_its_faces_too() -> None:
    patch = cut(tube(), tube().domain).surface
    other = mirrored(patch)
    corners = other.positions[other.faces]
    turned_to = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fk,fk->f", turned_to, other.normals[other.faces].mean(axis=1)) > 0.0).all()


def test_shrinking_spares_the_border_of_the_frame() -> None:
    frame = shapely.box(0.0, 0.0, 2.0, 1.0)
    smaller = shrunk(shapely.box(0.0, 0.2, 1.0, 0.8), 0.05, frame)
    np.testing.assert_allclose(smaller.bounds, (0.0, 0.25, 0.95, 0.75), atol=1e-6)


def test_an_outline_is_found_again_by_y_and_by_x() -> None:
    outline = PlanOutline([(0, -2), (0.6, -1.9), (0.9, -1.3), (0.9, 1.2), (0.6, 1.8), (0, 2)])
    y = np.array([-1.0, 0.0, 1.0])
    np.testing.assert_allclose(outline.at(outline.at_y(y))[0][:, 1], y, atol=1e-6)
    for front, sign in ((True, 1.0), (False, -1.0)):
        place = outline.at(outline.at_x(np.array([0.3]), front=front))[0][0]
        assert place[0] == pytest.approx(0.3, abs=1e-6)
        assert sign * place[1] > 1.5  # on the rounded front or back, which begin at 1.2 and −1.3 and end at 2 and −2


def test_rows_are_interpolated_through_their_knots_and_bend_at_creases() -> None:
    knots, values = np.array([[0.0, 1.0, 3.0, 4.0]]), np.array([[0.0, 1.0, 1.0, 0.0]])
    for place, value in zip(knots[0], values[0], strict=True):
        assert hermite(knots, values, np.array([place]))[0] == pytest.approx(value)
    left, right = (hermite(knots, values, np.array([1.0 + step]), (1, 2))[0] for step in (-1e-4, 1e-4))
    # Second derivatives of about 1 times half the step.
    assert (1.0 - left) / 1e-4 == pytest.approx(1.0, abs=5e-4)
    assert (right - 1.0) / 1e-4 == pytest.approx(0.0, abs=5e-4)


def test_a_smooth_curve_never_overshoots() -> None:
    curve = smooth([0.0, 1.0, 1.2, 3.0], [0.0, 0.0, 1.0, 1.0])
    values = curve(np.linspace(0.0, 3.0, 200))
    # Rounding in double precision.
    assert values.min() >= -1e-12
    assert values.max() <= 1.0 + 1e-12


@pytest.mark.parametrize("kind", CARS)
def test_the_ring_of_a_car_has_its_length_width_and_belt(kind: str) -> None:
    design = CARS[kind]
    points = cut(Shell(design).ring, Shell(design).ring.domain).surface.positions
    assert points[:, 1].max() == pytest.approx(0.5 * design.length, abs=0.02)
    assert points[:, 1].min() == pytest.approx(-0.5 * design.length, abs=0.02)
    assert points[:, 0].max() == pytest.approx(0.5 * design.width, abs=0.03)
    assert points[:, 2].max() == pytest.approx(max(z for _, z in design.belt), abs=0.02)


def test_a_hull_is_a_rounded_box() -> None:
    hull = Hull((-3.0, 3.0), 2.0, (0.5, 2.5), corners=(0.2, 0.3), inset=((0.5, 0.0), (2.5, 0.1)))
    points = cut(hull.master, hull.master.domain).surface.positions
    np.testing.assert_allclose(points.min(axis=0), [0.0, -3.0, 0.5], atol=0.01)
    np.testing.assert_allclose(points.max(axis=0), [1.0, 3.0, 2.5], atol=0.01)
    flank = cut(hull.master, hull.side(-1.0, 1.0, 0.5, 0.6)).surface.positions
    np.testing.assert_allclose([flank[:, 1].min(), flank[:, 1].max()], [-1.0, 1.0], atol=1e-6)


def test_solids_have_their_volumes_and_face_outwards() -> None:
    # A polygon of n sides has (2π/n)²/6 less area than its circle: 0.07 % for 96, 0.29 % for 48, 0.16 % for 64.
    assert volume(pillow((1.0, 2.0, 0.5), squareness=1.0, sides=96, levels=49)) == pytest.approx(
        4 / 3 * np.pi, rel=0.004
    )
    assert volume(torus(1.0, 0.2, 96, 48)) == pytest.approx(2 * np.pi**2 * 0.04, rel=0.004)
    outline = rounded_outline(0.5, 0.25, 0.1, steps=12)
    assert volume(bar(outline, -1.0, 2.0)) == pytest.approx(3.0 * (1.0 * 0.5 - (4 - np.pi) * 0.01), rel=2e-4)
    assert volume(rod([(0, 0, 0), (0, 0, 2)], 0.1, 64, caps=True)) == pytest.approx(2 * np.pi * 0.01, rel=0.002)


@pytest.mark.parametrize(
    ("axis", "start", "end"), [(0, (0, 1, 0), (0, 0, 1)), (1, (0, 0, 1), (1, 0, 0)), (2, (1, 0, 0), (0, 1, 0))]
)
def test_a_turn_is_right_handed(axis: int, start: tuple[float, ...], end: tuple[float, ...]) -> None:
    np.testing.assert_allclose(turned(axis, 90.0)[:3, :3] @ np.array(start, float), end, atol=1e-12)
