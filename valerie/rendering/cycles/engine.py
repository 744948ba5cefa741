"""The declaration of the engine ``cycles``: everything but fallen leaves."""

from __future__ import annotations

from typing import Final

from valerie.rendering.cycles.settings import CyclesSettings
from valerie.rendering.engine import EVERYTHING, Ability, Engine

ENGINE: Final = Engine(
    "valerie.rendering.cycles.renderer:CyclesRenderer",
    settings=CyclesSettings,
    shows=EVERYTHING - {Ability.LEAVES},
    draft={"samples": 8, "denoise": True},
    install_hint="`make cycles` installs it",
)
