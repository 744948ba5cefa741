"""The declaration of the engine ``pyrender``: clear weather by day, and solid shadows of textures with holes."""

from __future__ import annotations

from typing import Final

from valerie.rendering.engine import Engine

ENGINE: Final = Engine("valerie.rendering.pyrender.renderer:PyrenderRenderer", shows=frozenset())
