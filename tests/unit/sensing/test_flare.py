"""Lens flare: ghosts by the paraxial model, and the star by the diffraction at a hexagon."""

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.sensing.flare import GHOSTS, STAR, Ghost, flared

WIDTH, HEIGHT = 960, 540
SHARE = 0.02
#: Rows and columns below and right of the centre.
DOWN, RIGHT = -120, 180


def sun(down: int = DOWN, right: int = RIGHT, width: int = WIDTH, height: int = HEIGHT) -> NDArray[np.float32]:
    """Return a black image with a source of about a hundredth of its width and a light of 10,000 in all."""
    image = np.zeros((height, width, 3), np.float32)
    half = width // 240
    rows, columns = (
        slice(side // 2 + at - half, side // 2 + at + half) for side, at in ((height, down), (width, right))
    )
    image[rows, columns] = 1e4 / (2 * half) ** 2
    return image


def test_no_flare_changes_nothing() -> None:
    image = np.random.default_rng(0).random((54, 97, 3), np.float32)
    np.testing.assert_array_equal(flared(image, 0.0), image)


def test_light_is_moved_and_not_made() -> None:
    np.testing.assert_allclose(sum(np.array(ghost.color) for ghost in GHOSTS) + STAR, 1.0)
    image = sun()
    result = flared(image, SHARE).astype(np.float64)
    assert result.min() >= 0.0
    # The source keeps its rest, and next to nothing of the star leaves the image; interpolated samples of a ghost that covers
    # hundreds of cells add up to a per cent.
    np.testing.assert_allclose(result.sum(axis=(0, 1)), image.sum(axis=(0, 1), dtype=np.float64), rtol=0.03 * SHARE)


@pytest.mark.parametrize("ghost", GHOSTS, ids=lambda ghost: f"{ghost.magnification}")
def test_a_ghost_is_an_image_of_the_aperture_on_the_line_through_the_centre(ghost: Ghost) -> None:
    flare = flared(sun(), SHARE)
    at = (HEIGHT // 2 + round(DOWN * ghost.magnification), WIDTH // 2 + round(RIGHT * ghost.magnification))
    radius = ghost.radius * WIDTH
    # The flux over the area of a regular hexagon. The star adds less than a tenth, no other ghost comes as near.
    density = 1e4 * SHARE * np.array(ghost.color) / (1.5 * np.sqrt(3) * radius**2)
    middle = flare[at[0] - 2 : at[0] + 3, at[1] - 2 : at[1] + 3].mean(axis=(0, 1))
    np.testing.assert_allclose(middle, density, rtol=0.1)
    distance = np.hypot(*(np.mgrid[:HEIGHT, :WIDTH] - np.reshape(at, (2, 1, 1))))
    # Edges are as soft as the cells, 4 pixels, and the source, 8.
    inside, outside = distance < 0.86 * radius - 6, (distance > radius + 6) & (distance < radius + 9)
    assert (flare[inside] > 0.8 * density).all()
    assert np.median(flare[outside][:, 1]) < 0.1 * density[1]


def diffraction(side: int = 2048, radius: float = 500.0) -> NDArray[np.float64]:
    """Return the Fraunhofer pattern of a hexagon with a corner on the x-axis, (side, side), the middle at side / 2."""
    y, x = np.mgrid[:side, :side] - side / 2
    angles = np.pi / 6 + np.arange(6) * np.pi / 3
    edges = np.max([x * np.cos(angle) + y * np.sin(angle) for angle in angles], axis=0)
    aperture = np.clip(radius * np.cos(np.pi / 6) - edges + 0.5, 0.0, 1.0)
    pattern: NDArray[np.float64] = np.abs(np.fft.fftshift(np.fft.fft2(np.fft.ifftshift(aperture)))) ** 2
    return pattern


def around(image: NDArray[np.float64], down: float, right: float, low: float, high: float) -> NDArray[np.float64]:
    """Return the light between two distances from a place, by direction in 72 steps of 5°, (72,)."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    y, x = y - down, x - right
    distance, step = np.hypot(y, x), np.round(np.rad2deg(np.arctan2(y, x)) / 5).astype(int) % 72
    ring = (distance >= low) & (distance < high)
    light: NDArray[np.float64] = np.bincount(step[ring], image[ring], 72)
    return light


def test_the_star_has_the_rays_of_a_hexagons_diffraction_and_their_decline() -> None:
    image = sun(0, 0)
    star = flared(image, SHARE)[..., 1].astype(np.float64)
    exact = diffraction()
    # From beyond the ghosts, which all lie around the centre, and the first fringes, to the border.
    rays, expected = around(star, 270, 480, 100, 260), around(exact, 1024, 1024, 60, 240)
    assert np.count_nonzero(rays > 0.5 * rays.max()) == np.count_nonzero(expected > 0.5 * expected.max()) == 6
    for light in (rays, expected):
        peaks = np.flatnonzero(light > 0.5 * light.max())
        np.testing.assert_array_equal(np.diff(peaks), 12)  # steps of 5°: every 60°
        assert light[peaks].sum() > 0.8 * light.sum()
    # Light along a ray falls with the square of the distance: twice as far, rings of equal width hold a quarter.
    for light, middle, near in ((star, (270, 480), 100), (exact, (1024, 1024), 60)):
        rings = [around(light, *middle, distance, 1.2 * distance).sum() / distance for distance in (near, 2 * near)]
        assert rings[0] / rings[1] == pytest.approx(4.0, rel=0.1)


def test_what_hides_half_of_the_sun_takes_half_of_its_flare() -> None:
    whole, half = sun(), sun()
    half[:, : WIDTH // 2 + RIGHT] = 0.0
    at = HEIGHT // 2 - round(0.85 * DOWN), WIDTH // 2 - round(0.85 * RIGHT)
    assert flared(half, SHARE)[at][1] == pytest.approx(flared(whole, SHARE)[at][1] / 2, rel=0.02)


def test_two_lamps_flare_like_both_alone() -> None:
    one, other = sun(), sun(100, -300)
    both = flared(one, SHARE) + flared(other, SHARE)
    np.testing.assert_allclose(flared(one + other, SHARE), both, rtol=1e-4, atol=1e-4)


def test_the_flare_is_the_same_at_every_resolution() -> None:
    small = flared(sun(), SHARE)
    large = flared(sun(2 * DOWN, 2 * RIGHT, 2 * WIDTH, 2 * HEIGHT), SHARE)
    reduced = 4 * large.reshape(HEIGHT, 2, WIDTH, 2, 3).mean(axis=(1, 3))
    # Half a pixel of the finer image shifts soft edges; the typical value is that of a ghost's middle.
    assert np.abs(reduced - small)[:200].mean() < 0.1 * small[:200].mean()


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (16, 16), (17, 301), (301, 17)])
def test_images_of_any_size(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(1).random((*shape, 3), np.float32)
    result = flared(image, 0.2)
    assert result.shape == image.shape
    assert np.isfinite(result).all()
