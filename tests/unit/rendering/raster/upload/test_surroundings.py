"""The light that a street reflects, against simple streets with a known answer."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.sampling import enough_to_show
from valerie.rendering.raster.light.shadows import even_directions
from valerie.rendering.raster.upload.surroundings import (
    SAMPLE,
    Reflected,
    SurfaceSample,
    prominence,
    reflected,
    sample_surfaces,
    sky_weights,
    snowed,
)
from valerie.rendering.sky import AZIMUTHS, ELEVATIONS, Sky, sky_of
from valerie.testing.assets import simple_asset

DIRECTIONS = even_directions(32)
LOW, HIGH = np.array([-10.0, -10.0, 0.0]), np.array([10.0, 10.0, 10.0])
GREY = np.array([0.3, 0.4, 0.5])


def even_sky(radiance: float = 1.0, *, sun: float = 0.0, toward: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Sky:
    """Return a sky with the same radiance everywhere, and a sun."""
    direction = np.array(toward) / np.linalg.norm(toward)
    return replace(
        sky_of(simple_asset().base),
        table=np.full((ELEVATIONS, AZIMUTHS, 3), radiance, np.float32),
        sky_irradiance=np.full(3, radiance),
        sun=np.full(3, sun),
        sun_direction=direction,
    )


def places(*normals: tuple[float, float, float], heights: tuple[float, ...] = ()) -> SurfaceSample:
    """Return a place for each normal, each with its own material."""
    count = len(normals)
    points = np.zeros((count, 3))
    points[:, 2] = heights or np.zeros(count)
    return SurfaceSample(points, np.array(normals), np.arange(count), 0.0, 1.0)


def open_to_all(sample: SurfaceSample) -> NDArray[np.bool_]:
    return np.ones((len(sample.points), len(DIRECTIONS)), np.bool_)


def light_of(
    sample: SurfaceSample,
    openness: NDArray[np.bool_],
    albedo: NDArray[np.float64],
    share: NDArray[np.float64],
    sky: Sky,
) -> Reflected:
    return reflected(sample, openness, prominence(sample, openness), DIRECTIONS, albedo[sample.rows], share, sky)


class TestReflected:
    def test_open_ground_reflects_its_albedo_of_sky_and_sun(self) -> None:
        ground, sky = places((0, 0, 1)), even_sky(0.8, sun=2.0, toward=(0, 1, 1))
        light = light_of(ground, open_to_all(ground), GREY[None], np.ones(1), sky)
        assert light.ground == pytest.approx(GREY * (0.8 + 2.0 * np.sqrt(0.5)), rel=1e-6)

    def test_ground_without_an_open_direction_counts_for_nothing(self) -> None:
        ground = places((0, 0, 1), (0, 0, 1))
        openness = open_to_all(ground)
        openness[1] = False
        light = light_of(ground, openness, np.stack([GREY, np.ones(3)]), np.ones(2), even_sky())
        assert light.ground == pytest.approx(GREY, rel=1e-6)

    def test_a_roof_is_no_ground(self) -> None:
        both = places((0, 0, 1), (0, 0, 1), heights=(0.1, 8.0))
        light = light_of(both, open_to_all(both), np.stack([GREY, np.ones(3)]), np.ones(2), even_sky())
        assert light.ground == pytest.approx(GREY, rel=1e-6)

    def test_without_ground_in_the_sample_it_is_the_skys_own(self) -> None:
        sky, wall = even_sky(), places((1, 0, 0), heights=(3.0,))
        light = light_of(wall, open_to_all(wall), GREY[None], np.ones(1), sky)
        np.testing.assert_array_equal(light.ground, sky.ground)

    def test_a_wall_receives_half_of_sky_and_ground_and_is_visible_from_its_front(self) -> None:
        sample, albedo = places((0, 0, 1), (1, 0, 0), heights=(0.0, 3.0)), np.stack([GREY, np.full(3, 0.7)])
        light = light_of(sample, open_to_all(sample), albedo, np.ones(2), even_sky())
        # Sums over the 32 directions differ from the integral by −3.4 to +5.4 % on vertical faces; it is 2.5 % for this one.
        assert light.on_walls == pytest.approx(0.5 + 0.5 * GREY, rel=0.05)
        front = DIRECTIONS[:, 0] < -1e-6
        assert light.hidden[front] == pytest.approx(np.broadcast_to(0.7 * light.on_walls, (front.sum(), 3)))
        np.testing.assert_array_equal(light.hidden[~front], 0)

    def test_sun_brightens_the_wall_that_faces_it(self) -> None:
        walls = places((1, 0, 0), (-1, 0, 0), heights=(3.0, 3.0))
        sky = even_sky(sun=2.0, toward=(1, 0, 1))
        light = light_of(walls, open_to_all(walls), np.ones((2, 3)), np.ones(2), sky)
        sunny, shady = light.hidden[DIRECTIONS[:, 0] < -0.1], light.hidden[DIRECTIONS[:, 0] > 0.1]
        # Sums over the 32 directions differ from the integral by −3.4 to +5.4 % on vertical faces; it is 2.5 % for this one.
        assert sunny - shady.mean() == pytest.approx(2.0 * np.sqrt(0.5), rel=0.05)

    def test_in_its_own_shadow_a_wall_has_no_sun(self) -> None:
        wall = places((1, 0, 0), heights=(3.0,))
        openness = open_to_all(wall)
        sky = even_sky(sun=2.0, toward=(1, 0, 1))
        openness[0, np.array(DIRECTIONS @ sky.sun_direction) > 0.9] = False
        sunless = light_of(wall, openness, np.ones((1, 3)), np.ones(1), replace(sky, sun=np.zeros(3)))
        light = light_of(wall, openness, np.ones((1, 3)), np.ones(1), sky)
        np.testing.assert_allclose(light.on_walls, sunless.on_walls)

    def test_surfaces_with_holes_count_for_less(self) -> None:
        walls = places((1, 0, 0), (1, 0, 0), heights=(3.0, 3.0))
        albedo = np.stack([np.zeros(3), np.ones(3)])
        share = np.array([1.0, 0.25])
        light = light_of(walls, open_to_all(walls), albedo, share, even_sky())
        front = DIRECTIONS[:, 0] < -1e-6
        assert light.hidden[front] == pytest.approx(
            np.broadcast_to(0.2 * light.on_walls, (front.sum(), 3))
        )  # 0.25 of 1.25

    def test_light_bounces_between_walls(self) -> None:
        # Two white walls that see only each other, dark ground and a slit of sky.
        walls = places((1, 0, 0), (-1, 0, 0), heights=(3.0, 3.0))
        openness = np.broadcast_to(DIRECTIONS[:, 2] > 0.8, (2, 32))
        sky = replace(even_sky(), ground=np.zeros(3))
        white, black = (light_of(walls, openness, np.full((2, 3), albedo), np.ones(2), sky) for albedo in (1.0, 0.0))
        whole = light_of(walls, open_to_all(walls), np.zeros((2, 3)), np.ones(2), sky)
        share = whole.on_walls - black.on_walls  # the share of its view in which a wall sees the other
        # More than one reflection, and less than the sum of all.
        assert (white.on_walls > black.on_walls * (1 + share)).all()
        assert (white.on_walls < black.on_walls / (1 - share)).all()
        # The upper hemisphere is walls or sky, and neither is brighter than the sky.
        assert (white.on_walls < 0.5).all()

    def test_an_empty_sample_reflects_nothing(self) -> None:
        empty, sky = SurfaceSample.empty(0.0), even_sky()
        light = light_of(empty, np.zeros((0, 32), np.bool_), np.zeros((0, 3)), np.zeros(0), sky)
        np.testing.assert_array_equal(light.hidden, 0)
        np.testing.assert_array_equal(light.ground, sky.ground)
        np.testing.assert_array_equal(light.on_walls, 0)


def square(origin: tuple[float, float, float], side: float) -> NDArray[np.float32]:
    """Return the corners, (4, 3), of a level square that faces up."""
    corners = np.array([[0, 0, 0], [side, 0, 0], [side, side, 0], [0, side, 0]], np.float32)
    return corners + np.array(origin, np.float32)


def sampled(*squares: NDArray[np.float32], two_sided: bool = False) -> SurfaceSample:
    """Return a sample of squares, each with its own row of the material table."""
    count = len(squares)
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]], np.uint32) + np.uint32(4 * i) for i in range(count)])
    rows = np.repeat(np.arange(count, dtype=np.uint32), 2)
    return sample_surfaces(np.concatenate(squares), faces, rows, np.full(2 * count, two_sided), LOW, HIGH)


class TestProminence:
    def test_two_squares_see_each_other_by_their_form_factor(self) -> None:
        # Two parallel squares of 10 × 10 m, 10 m apart: each fills 0.1998 of the other's view (Howell's catalogue, C-11).
        below, above = square((-5, -5, 0), 10.0), square((-5, -5, 10), 10.0)
        faces = np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]], np.uint32)  # the upper one faces down
        sample = sample_surfaces(
            np.concatenate([below, above]), faces, np.zeros(4, np.uint32), np.zeros(4, np.bool_), LOW, HIGH
        )
        weights = prominence(sample, open_to_all(sample))
        # 256 of the places stand for all. Between two places the form factor varies by about a third of its mean (it falls
        # with the fourth power of the cosine, to 1/9 in the corners), so the mean is known to a third of 1/√256: 2 %.
        assert weights.mean() == pytest.approx(0.1998 + 0.01, rel=0.03)

    def test_walls_towards_a_street_count_for_more_than_their_backs(self) -> None:
        # Two walls of 40 × 10 m, 10 m apart, each with a front towards the street and a back, and ground between and behind them.
        wall = np.array([[0, -20, 0], [0, 20, 0], [0, 20, 10], [0, -20, 10]], np.float32)
        front, back = np.array([[0, 1, 2], [0, 2, 3]], np.uint32), np.array([[0, 2, 1], [0, 3, 2]], np.uint32)
        shifts = (-5.0, -5.3, 5.0, 5.3)
        parts = [wall + np.array([shift, 0, 0], np.float32) for shift in shifts]
        ground = np.array([[-15, -20, 0], [15, -20, 0], [15, 20, 0], [-15, 20, 0]], np.float32)
        turned = (front, back, back, front)
        faces = np.concatenate([corners + np.uint32(4 * k) for k, corners in enumerate((*turned, front))])
        rows = np.repeat(np.arange(5, dtype=np.uint32), 2)
        low, high = np.array([-15.0, -20.0, 0.0]), np.array([15.0, 20.0, 10.0])
        sample = sample_surfaces(np.concatenate([*parts, ground]), faces, rows, np.zeros(10, np.bool_), low, high)
        fronts = [sample.normals[sample.rows == row][0, 0] for row in range(4)]
        assert fronts == [1, -1, -1, 1]
        weights = prominence(sample, open_to_all(sample))
        to_street, behind = (np.mean([weights[sample.rows == row].mean() for row in rows]) for rows in ((0, 2), (1, 3)))
        # Form factors of Howell's catalogue. A front sees the opposite one (C-11: 0.346) and, since nothing hides anything here,
        # 20 m of ground (C-14: 0.334); a back sees 9.7 m of ground (0.262). The 256 places that stand for all halve as often on
        # each: an error of a twentieth.
        assert to_street == pytest.approx(0.346 + 0.334 + 0.01, rel=0.05)
        assert behind == pytest.approx(0.262 + 0.01, rel=0.05)

    def test_places_without_sky_count_for_nothing_and_lone_places_for_little(self) -> None:
        sample = sampled(square((0, 0, 0), 4.0), square((5, 5, 0), 4.0))
        openness = open_to_all(sample)
        openness[sample.rows == 1] = False
        weights = prominence(sample, openness)
        assert (weights[sample.rows == 1] == 0).all()
        assert weights[sample.rows == 0] == pytest.approx(0.01, abs=1e-6)


class TestSample:
    def test_places_are_spread_by_area(self) -> None:
        sample = sampled(square((0, 0, 0), 6.0), square((-9, -9, 0), 3.0))
        assert len(sample.points) == SAMPLE
        assert (sample.rows == 0).mean() == pytest.approx(0.8, abs=1 / SAMPLE)

    def test_they_lie_on_the_surfaces_evenly(self) -> None:
        sample = sampled(square((1, 2, 3), 4.0))
        np.testing.assert_allclose(sample.points[:, 2], 3.0)
        np.testing.assert_allclose(sample.normals, np.broadcast_to([0, 0, 1], (SAMPLE, 3)))
        cells, _, _ = np.histogram2d(sample.points[:, 0], sample.points[:, 1], bins=4, range=[(1, 5), (2, 6)])
        assert cells.sum() == SAMPLE
        # 256 places are expected in each; independent ones would spread by 16, and 0.7 is nearly five times that below.
        assert cells.min() > 0.7 * SAMPLE / 16

    def test_a_thin_sheet_has_two_sides(self) -> None:
        sample = sampled(square((0, 0, 0), 4.0), two_sided=True)
        assert len(sample.points) == 2 * SAMPLE
        assert sample.normals[:, 2].sum() == 0

    def test_of_ground_that_reaches_to_the_horizon_only_the_street_counts(self) -> None:
        # A level square as large as the street's ground, and ground of 400 × 400 m around it.
        sample = sampled(square((-10, -10, 1), 20.0), square((-200, -200, 0), 400.0))
        # Up to a metre beside it.
        assert (np.abs(sample.points[:, :2]) <= 11).all()
        # At most as much as the 22 × 22 m of the ground among both.
        far = (sample.rows == 1).sum()
        assert enough_to_show(0.01) <= far <= SAMPLE * 22**2 / (22**2 + 20**2)

    def test_surfaces_outside_the_street_count_for_nothing(self) -> None:
        sample = sampled(square((0, 0, 0), 4.0), square((50, 50, 0), 40.0))
        assert (sample.rows == 0).all()

    def test_without_triangles_it_is_empty(self) -> None:
        positions, faces = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32)
        sample = sample_surfaces(positions, faces, np.zeros(0, np.uint32), np.zeros(0, np.bool_), LOW, HIGH)
        assert len(sample.points) == 0

    def test_without_area_it_is_empty(self) -> None:
        assert len(sampled(square((0, 0, 0), 0.0)).points) == 0

    @settings(max_examples=20, deadline=None)
    @given(st.integers(0, 2**31))
    def test_it_is_the_same_each_time(self, seed: int) -> None:
        corners = np.random.default_rng(seed).uniform(-12, 12, (5, 4, 3)).astype(np.float32)
        first, second = sampled(*corners), sampled(*corners)
        assert first.points.tobytes() == second.points.tobytes()
        np.testing.assert_allclose(np.linalg.norm(first.normals, axis=1), 1.0, rtol=1e-5)


def test_sky_weights_add_up_to_the_mean_light_of_all_directions() -> None:
    sky, random = sky_of(simple_asset().base), np.random.default_rng(0)
    street, ground, steps = random.random((32, 3)), np.array([0.1, 0.2, 0.1]), random.integers(0, 256, 32)
    hidden, weights = sky_weights(sky, DIRECTIONS, street, ground)
    sums = hidden + np.tensordot(steps, weights, 1)

    # Direction by direction, as light that arrives from the upper hemisphere and a uniform lower one.
    expected = np.zeros((7, 4))
    radiances = zip(DIRECTIONS, sky.radiance(DIRECTIONS), street, steps, strict=True)
    for direction, radiance, instead, step in radiances:
        share = step / 255
        light = radiance * share + instead * (1 - share)
        expected[:3] += np.outer(light, [1, *(3 * direction)]) / 64
        expected[3, :3] += light * 5 * (1.5 * direction[2] ** 2 - 0.5) / 64
        x, y, z = direction
        products = [[1, x, y, z], [x * x, x * y, x * z, y * y], [y * z, x * z * z, y * z * z, z**3]]
        expected[4:] += (1 - share) * np.array(products) / 64
    expected[:3] += np.outer(ground, [0.5, 0, 0, -0.75])
    np.testing.assert_allclose(sums, expected, rtol=1e-12, atol=1e-12)


def test_snow_whitens_level_ground_and_not_walls() -> None:
    upward, traffic = np.array([1.0, 1.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0, 0.0])
    black = np.zeros((4, 3))
    ground, driven, wall, ceiling = snowed(black, upward, traffic, 0.03)[:, 1]
    # tanh(30 / 25) of an albedo of 0.82; traffic leaves a third of the depth.
    assert ground == pytest.approx(0.82 * np.tanh(1.2))
    assert driven == pytest.approx(0.82 * np.tanh(0.4))
    assert (wall, ceiling) == (0.0, 0.0)
    assert snowed(black, upward, traffic, 0.0) is black
