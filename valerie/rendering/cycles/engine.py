"""The declaration of the engine ``cycles``."""

from __future__ import annotations

from typing import Final

from valerie.rendering.cycles.settings import CyclesSettings
from valerie.rendering.engine import Engine

ENGINE: Final = Engine(
    "valerie.rendering.cycles.renderer:CyclesRenderer",
    settings=CyclesSettings,
    draft={"samples": 8, "denoise": True},
    install_hint="`make cycles` installs it",
)
