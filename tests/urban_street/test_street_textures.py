"""Test noise and textures: they tile, repeat with their seed, and stay in the range of real materials."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from urban_street.street.noise import band_noise, hashed, stretched_noise
from urban_street.street.plan import LANE
from urban_street.street.textures import ground, things, walls
from urban_street.texels import normal_map, srgb8

Image = NDArray[np.uint8]
#: Colour and roughness of two pieces of road.
Surfaces = tuple[tuple[Image, Image], tuple[Image, Image]]


def rng() -> np.random.Generator:
    return np.random.default_rng(11)


@lru_cache
def brick() -> tuple[Image, ...]:
    return walls.brick(rng())


@lru_cache
def render() -> tuple[Image, ...]:
    return walls.render(rng())


TILED: dict[str, Callable[[], Image]] = {
    "brick": lambda: brick()[0],
    "buff brick": lambda: brick()[1],
    "render": lambda: render()[0],
    "brick's roughness": lambda: brick()[3],
    "render's roughness": lambda: render()[2],
    "ashlar": lambda: walls.ashlar(rng())[0],
    "roof": lambda: walls.roof_tiles(rng())[0],
    "granite": lambda: walls.granite(rng()),
    "turf": lambda: ground.turf(rng()),
    "bark": lambda: things.bark(rng()),
    "hedge": lambda: things.hedge(rng()),
}


@pytest.mark.parametrize("name", TILED)
def test_a_tiled_texture_has_no_seam(name: str) -> None:
    image = TILED[name]().astype(np.float64)
    for axis in (0, 1):
        steps = np.abs(np.diff(image, axis=axis)).mean(axis=(1 - axis, 2))
        seam = np.abs(np.take(image, 0, axis) - np.take(image, -1, axis)).mean()
        assert seam <= steps.max() * 1.05  # rounding of a mean step of some grey levels to 8 bits


@pytest.fixture(scope="module")
def surfaces() -> Surfaces:
    """Return colour and roughness of a plain piece of carriageway and of a piece with a crossing."""
    plain, zebra = (ground.asphalt(np.random.default_rng(k), zebra=bool(k), lane=LANE) for k in (0, 1))
    return plain, zebra


@pytest.fixture(scope="module")
def roads(surfaces: Surfaces) -> tuple[Image, Image]:
    """Return only the colours."""
    return surfaces[0][0], surfaces[1][0]


def test_road_pieces_join_in_any_order(roads: tuple[Image, Image]) -> None:
    pieces = [road.astype(np.float64) for road in roads]
    inner = np.abs(np.diff(pieces[0], axis=0)).mean()
    seam = np.abs(pieces[0][-1] - pieces[1][0]).mean()
    assert seam < 4.0 * inner  # a requirement of ours: two stones instead of one and the same


def test_a_crossing_has_bars_across_the_road_and_plain_road_has_none(roads: tuple[Image, Image]) -> None:
    plain, zebra = roads
    middle = slice(480, 544)
    # Bars are as wide as the gaps between them: half of the columns, less where they are worn. White paint reflects 30 % or more,
    # which only lines at the edge do on plain road. The shares are requirements of ours.
    assert (zebra[middle].mean(axis=(0, 2)) > 150).mean() > 0.3
    assert (plain[middle].mean(axis=(0, 2)) > 150).mean() < 0.1


def test_asphalt_is_as_dark_as_asphalt(roads: tuple[Image, Image]) -> None:
    encoded = roads[0].astype(np.float64) / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    assert 0.07 < float(np.median(linear)) < 0.14  # albedo of asphalt in use, from new to worn


def test_tyres_polish_two_bands_of_a_lane(surfaces: Surfaces) -> None:
    roughness = surfaces[0][1][..., 1] / 255.0
    middle = 0.5 * (LANE[0] + LANE[1])

    def at(metres: float) -> float:
        column = round(metres / ground.ROAD_TILE[0] * 512)
        return float(np.median(roughness[:, column - 2 : column + 3]))

    beside = at(1.0)
    # Requirements of ours: a tenth smoother where tyres roll, 0.72 m to each side of the middle (a track of 1.44 m).
    assert at(middle - 0.72) < beside - 0.1
    assert at(middle + 0.72) < beside - 0.1
    assert 0.85 < beside < 1.0


def test_bars_of_a_crossing_are_smoother_than_old_asphalt(surfaces: Surfaces) -> None:
    color, roughness = surfaces[1]
    painted = color[480:544:2, ::2].mean(axis=2) > 150
    middle = roughness[240:272, :, 1]
    assert np.median(middle[painted]) < np.median(middle[~painted]) - 10  # of 255, a requirement of ours


def test_only_ironwork_is_metallic(surfaces: Surfaces) -> None:
    color, rough = surfaces[0]
    iron = rough[..., 2] > 0
    # Within 6.6 × 13.2 m lie a lid of 0.6 m and two gullies of 0.5 × 0.4 m, whose studs and bars, a quarter or more, are bare.
    area = np.pi * 0.3**2 + 2 * 0.5 * 0.4
    assert 0.001 < iron.mean() < area / (6.6 * 13.2)
    tone = color[::2, ::2].mean(axis=2)
    assert np.median(tone[iron]) < np.median(tone[~iron])


def test_pieces_of_road_join_in_roughness_too(surfaces: Surfaces) -> None:
    pieces = [rough[..., 1].astype(np.float64) for _, rough in surfaces]
    inner = np.abs(np.diff(pieces[0], axis=0)).mean()
    assert np.abs(pieces[0][-1] - pieces[1][0]).mean() < 4.0 * inner  # as of the colours


def test_equal_seeds_give_equal_textures_and_others_do_not() -> None:
    assert np.array_equal(walls.render(rng())[0], render()[0])
    assert not np.array_equal(render()[0], walls.render(np.random.default_rng(12))[0])


def test_band_noise_has_zero_mean_unit_variance_and_no_power_outside_its_band() -> None:
    noise = band_noise((256, 256), rng(), longest=32, shortest=8)
    # 65,536 numbers in single precision round to a millionth.
    assert abs(float(noise.mean())) < 1e-6
    assert float(noise.std()) == pytest.approx(1.0, abs=1e-6)
    power = np.abs(np.fft.fft2(noise.astype(np.float64))) ** 2
    frequency = np.hypot(np.fft.fftfreq(256)[:, None], np.fft.fftfreq(256)[None])
    outside = (frequency < 0.99 / 32) | (frequency > 1.01 / 8)
    assert power[outside].sum() < 1e-6 * power.sum()


def test_stretched_noise_varies_slower_along_its_grain() -> None:
    noise = stretched_noise((256, 256), rng(), rows=100, columns=5)
    # Its scales differ by a factor of 20; 3 is a requirement of ours.
    assert np.abs(np.diff(noise, axis=0)).mean() < 0.3 * np.abs(np.diff(noise, axis=1)).mean()


def test_hashed_numbers_are_uniform_and_depend_on_the_seed() -> None:
    cells = np.arange(20000, dtype=np.int64)
    values = hashed(cells, 1)
    # Five standard deviations of a count.
    assert np.abs(np.histogram(values, 10, (0.0, 1.0))[0] - 2000).max() < 5 * np.sqrt(20000 * 0.1 * 0.9)
    assert not np.array_equal(values, hashed(cells, 2))


def test_srgb_encoding_agrees_with_the_standard() -> None:
    assert srgb8(np.array([0.0, 0.0031308, 0.18, 0.5, 1.0, 2.0])).tolist() == [0, 10, 118, 188, 255, 255]


def test_normals_lean_away_from_a_slope() -> None:
    column = np.sin(np.arange(64) / 64 * 2 * np.pi)
    across = normal_map(np.tile(column, (64, 1)), (0.1, 0.1))
    # By 12° or more, a requirement of ours: 28 of 127.5 levels.
    assert across[0, 0, 0] < 128 - 28  # rises to the right: leans left
    down = normal_map(np.tile(column[:, None], (1, 64)), (0.1, 0.1))
    assert down[0, 0, 1] > 128 + 28  # rises downwards: leans up the picture
    flat = normal_map(np.zeros((8, 8)), (0.1, 0.1))
    assert (flat == [128, 128, 255]).all()
