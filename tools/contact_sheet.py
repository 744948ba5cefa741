"""Build contact sheets for the documentation: captioned tiles of equal size, in rows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from PIL import Image, ImageDraw, ImageFont

_FONT_SIZE: Final = 14
_CAPTION: Final = 22
_GAP: Final = 4
#: Largest size of a saved sheet in bytes.
LARGEST: Final = 300_000


def captioned(content: Image.Image | str, size: tuple[int, int], caption: str) -> Image.Image:
    """Return a tile with a caption below a picture of ``size`` (width, height), or below the reason why it is missing."""
    width, height = size
    font = ImageFont.load_default(size=_FONT_SIZE)
    tile = Image.new("RGB", (width, height + _CAPTION), "white")
    draw = ImageDraw.Draw(tile)
    if isinstance(content, str):
        draw.rectangle((0, 0, width, height), fill=(232, 232, 232))
        draw.text((width / 2, height / 2), content, fill=(90, 90, 90), font=font, anchor="mm")
    else:
        tile.paste(content)
    draw.text((4, height + 2), caption, fill=(30, 30, 30), font=font)
    return tile


def contact_sheet(tiles: Sequence[Image.Image], columns: int) -> Image.Image:
    """Return a sheet of the tiles, row by row."""
    width, height = tiles[0].size
    rows = -(-len(tiles) // columns)
    sheet = Image.new("RGB", (columns * (width + _GAP) - _GAP, rows * (height + _GAP) - _GAP), "white")
    for number, tile in enumerate(tiles):
        sheet.paste(tile, (number % columns * (width + _GAP), number // columns * (height + _GAP)))
    return sheet


def save_sheet(sheet: Image.Image, path: Path) -> None:
    """Write a sheet in the best quality within `LARGEST`."""
    for quality in range(90, 40, -5):
        sheet.save(path, quality=quality, optimize=True, progressive=True)
        if path.stat().st_size <= LARGEST:
            return
