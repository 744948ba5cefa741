"""What a render engine declares about itself, in a module that imports none of the engine's libraries."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from pydantic import BaseModel, ConfigDict


class Ability(StrEnum):
    """Something that not every engine can show; the first five are attributes of the scene's environment."""

    CLOUDS = "cloud_cover"
    FOG = "visibility"
    RAIN = "rain"
    STREET_LAMPS = "street_lamps"
    CAR_LAMPS = "car_lamps"
    #: Scenes with the sun below the horizon.
    NIGHT = "night"
    #: Textures with holes, such as leaves and fences; an engine without it draws the whole card.
    CUT_OUTS = "cut-outs"


EVERYTHING: Final = frozenset(Ability)


class EngineSettings(BaseModel):
    """What a spec may say of an engine, as ``renderer: {name: …, samples: 64}``. An engine with settings derives from it."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    def inputs(self) -> dict[str, Any]:
        """Return all that the pixels depend on, with nothing left to defaults: part of every digest of the engine's products."""
        return self.model_dump()

    def cost(self) -> float:
        """Return the CPU seconds of a picture relative to the default settings, roughly."""
        return 1.0


@dataclass(frozen=True, slots=True)
class Engine:
    """The declaration of a render engine.

    Attributes:
        renderer: ``module:class`` of its `valerie.rendering.base.Renderer`. The class is made without arguments, or with the
            settings where the engine has any.
        settings: the model of its settings; the base class has none.
        shows: its abilities. A spec that asks for others is refused, or warned where the image merely looks worse.
        install_hint: what people are told who wait for the engine, for example how to install it.
    """

    renderer: str
    settings: type[EngineSettings] = EngineSettings
    shows: frozenset[Ability] = EVERYTHING
    install_hint: str = ""

    @property
    def has_settings(self) -> bool:
        """True where a spec may say more than the name."""
        return bool(self.settings.model_fields)
