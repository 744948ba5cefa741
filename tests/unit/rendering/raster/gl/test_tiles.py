import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valerie.rendering.base import View
from valerie.rendering.raster.gl.tiles import TILE, Area, TileGrid, widened

#: Sides that are no multiples of a tile: the last column and row are cut off.
GRID = TileGrid(View("camera-1", 5 * TILE + 3, 3 * TILE + 1))

#: A seed, and a part that begins anywhere and may reach beyond the grid.
SOMEWHERE = given(
    seed=st.integers(0, 2**32 - 1),
    x=st.integers(0, GRID.width - 1),
    y=st.integers(0, GRID.height - 1),
    width=st.integers(1, GRID.width),
    height=st.integers(1, GRID.height),
)


@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0, 1))
def test_spans_cover_the_pixels_of_the_tiles_once_and_no_others(seed: int, share: float) -> None:
    mask = np.random.default_rng(seed).random(GRID.shape) < share
    painted = np.zeros((GRID.height, GRID.width), int)
    for x0, y0, x1, y1 in GRID.spans(mask):
        painted[y0:y1, x0:x1] += 1
    assert painted.max() <= 1
    np.testing.assert_array_equal(painted == 1, GRID.pixels(mask, Area(0, 0, GRID.width, GRID.height)))


@SOMEWHERE
def test_the_tiles_that_hold_a_true_pixel_are_found_wherever_the_part_begins(
    seed: int, x: int, y: int, width: int, height: int
) -> None:
    part = np.random.default_rng(seed).random((min(height, GRID.height - y), min(width, GRID.width - x))) < 0.05
    expected = GRID.none()
    for row, column in np.argwhere(part):
        expected[(y + row) // TILE, (x + column) // TILE] = True
    np.testing.assert_array_equal(GRID.holding(part, x, y), expected)


@SOMEWHERE
def test_a_copy_takes_the_bits_of_the_pixels_in_tiles_of_the_mask_and_no_others(
    seed: int, x: int, y: int, width: int, height: int
) -> None:
    random = np.random.default_rng(seed)
    whole = random.integers(0, 2**16, (2, GRID.height, GRID.width, 3), np.uint16).view(np.float16)
    area = Area(x, y, min(width, GRID.width - x), min(height, GRID.height - y))
    mask = random.random(GRID.shape) < 0.5
    expected = whole[1].view(np.uint16).copy()
    for row in range(area.y, area.y + area.height):
        for column in range(area.x, area.x + area.width):
            if mask[row // TILE, column // TILE]:
                expected[row, column] = whole[0].view(np.uint16)[row, column]
    GRID.copy(whole[0][area.slices], whole[1][area.slices], mask, area)
    np.testing.assert_array_equal(whole[1].view(np.uint16), expected)


def test_an_area_touches_every_tile_that_it_shares_a_pixel_with() -> None:
    assert GRID.touching(Area(TILE - 1, 0, 2, 1)).sum() == 2
    assert GRID.touching(Area(0, 0, TILE, TILE)).sum() == 1
    assert GRID.touching(Area(0, 0, GRID.width, GRID.height)).all()
    assert not GRID.touching(Area(3, 3, 0, 5)).any()


def test_the_area_around_a_mask_ends_with_the_image() -> None:
    mask = GRID.none()
    mask[-1, -1] = True
    assert GRID.around(mask) == (5 * TILE, 3 * TILE, 3, 1)


def test_values_are_reduced_tile_by_tile_even_at_the_cut_off_border() -> None:
    values = np.arange(GRID.height * GRID.width, dtype=np.float32).reshape(GRID.height, GRID.width)
    least, largest = (TileGrid.reduced(values, largest=flag) for flag in (False, True))
    assert least.shape == largest.shape == GRID.shape
    assert least[1, 1] == values[TILE, TILE]
    assert largest[-1, -1] == values[-1, -1]
    assert largest[0, 0] == values[TILE - 1, TILE - 1]


@pytest.mark.parametrize("by", [0, 1, 2])
def test_a_mask_spreads_by_the_same_distance_in_all_directions(by: int) -> None:
    mask = np.zeros((7, 7), np.bool_)
    mask[3, 3] = True
    wide = widened(mask, by)
    rows, columns = np.nonzero(wide)
    assert wide.sum() == (2 * by + 1) ** 2
    assert rows.min() == columns.min() == 3 - by
    assert not widened(np.zeros((7, 7), np.bool_), by).any()
