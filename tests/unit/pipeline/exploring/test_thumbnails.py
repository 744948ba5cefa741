"""Thumbnails are parts of the pictures that the frame's page shows, whatever is painted for them."""

from __future__ import annotations

import io

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.world.drawn import FUNCTIONS, DrawnWorld, spec
from tests.world.world import settings_of
from valerie.db import frames, measured
from valerie.db.engine import reading
from valerie.pipeline.exploring.thumbnails import Tile, Tiles
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.runs.products.frame_keys import FrameKey

WIDTH = 64
SENSORS = [
    {"distortion": {"k1": -0.2}},
    {"name": "noisy", "auto_exposure": True, "gain_db": 20, "noise": {"shot": True}},
]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[DrawnWorld, str]:
    world = DrawnWorld(settings_of(tmp_path_factory.mktemp("tiles")))
    return world, world.work(spec("tiles", width=320, height=180, sensors=SENSORS))


def expected(world: DrawnWorld, tile: Tile, kind: str, *, crop: bool) -> Image.Image:
    """The whole picture, cut and resized: in crops a square of 1.6 times the person's height, inside the picture."""
    source = find_picture(world.context, tile.frame, kind=kind, function=tile.function, sensor=tile.sensor)
    whole = Image.fromarray(paint_picture(world.context, source))
    if not crop:
        return whole.resize((WIDTH, WIDTH * 9 // 16), Image.Resampling.BILINEAR)
    with reading(world.context.engine) as connection:
        views = measured.person_views(connection, frames.get(connection, tile.frame).products.truth)
    x0, y0, x1, y1 = next(view.amodal_box for view in views if view.instance_id == tile.instance_id) or [0] * 4
    side = min(max(1.6 * max(x1 - x0, y1 - y0), 24.0), whole.height)
    left = min(max((x0 + x1 - side) / 2, 0.0), whole.width - side)
    top = min(max((y0 + y1 - side) / 2, 0.0), whole.height - side)
    return whole.resize((WIDTH, WIDTH), Image.Resampling.BILINEAR, box=(left, top, left + side, top + side))


def jpeg(picture: Image.Image) -> bytes:
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=82)
    return file.getvalue()


def pixels(file: bytes) -> NDArray[np.int64]:
    return np.asarray(Image.open(io.BytesIO(file)), np.int64)


@pytest.mark.parametrize("crop", [True, False])
@pytest.mark.parametrize("kind", ["picture", "errors", "overlay", "truth-overlay", "prediction", "depth"])
def test_a_thumbnail_is_a_part_of_the_whole_picture(drawn: tuple[DrawnWorld, str], kind: str, *, crop: bool) -> None:
    world, run = drawn
    tiles = [
        Tile(FrameKey(run, variant, 0), 24_001, function, "default") for variant in (0, 3, 6) for function in FUNCTIONS
    ]
    height = WIDTH if crop else WIDTH * 9 // 16
    sprite = Image.new("RGB", (len(tiles) * WIDTH, height))
    for k, tile in enumerate(tiles):
        sprite.paste(expected(world, tile, kind, crop=crop), (k * WIDTH, 0))
    shown = Tiles(world.context).sheet(tiles, kind=kind, crop=crop, width=WIDTH)
    # Pillow keeps the edges of a box in single precision. Whole pictures are shrunk from every third row and column.
    assert np.abs(pixels(shown) - pixels(jpeg(sprite))).mean() < (0.1 if crop else 4.0)


def test_a_thumbnail_has_noise_of_its_own(drawn: tuple[DrawnWorld, str]) -> None:
    world, run = drawn
    tile = Tile(FrameKey(run, 3, 0), 24_001, FUNCTIONS[0], "noisy")
    shown = pixels(Tiles(world.context).sheet([tile], kind="picture", crop=True, width=WIDTH))
    difference = shown - pixels(jpeg(expected(world, tile, "picture", crop=True)))
    assert 0.5 < np.abs(difference).mean() < 8.0
    assert abs(difference.mean()) < 0.5
