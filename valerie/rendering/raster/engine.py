"""The declaration of the engine ``raster``."""

from __future__ import annotations

from typing import Final

from valerie.rendering.engine import Engine

ENGINE: Final = Engine("valerie.rendering.raster.renderer:RasterRenderer")
