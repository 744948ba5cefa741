"""The declaration of a render engine, in a module that imports none of the engine's libraries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from pydantic import ConfigDict

from valerie.document import Document
from valerie.parameters.definitions import Value


class Ability(StrEnum):
    """An effect that some engines cannot show. The first eight are attributes of the scene's environment."""

    CLOUDS = "cloud_cover"
    FOG = "visibility"
    RAIN = "rain"
    SNOWFALL = "snowfall"
    SNOW = "snow_depth"
    LEAVES = "leaf_litter"
    STREET_LAMPS = "street_lamps"
    CAR_LAMPS = "car_lamps"
    #: Scenes with the sun below the horizon.
    NIGHT = "night"
    #: Textures with holes, such as leaves and fences, in pictures and shadows. An engine without this ability may draw the
    #: shadows solid.
    CUT_OUTS = "cut-outs"


EVERYTHING: Final = frozenset(Ability)


class EngineSettings(Document):
    """Base class of an engine's settings. A spec sets them as ``renderer: {name: …, samples: 64}``."""

    model_config = ConfigDict(strict=True)

    def inputs(self) -> dict[str, Value]:
        """Return every setting that the pixels depend on, defaults included; part of the digest of the engine's products."""
        return self.model_dump()

    def cost(self) -> float:
        """Return the approximate CPU time of an image relative to the default settings."""
        return 1.0


@dataclass(frozen=True, slots=True)
class Engine:
    """The declaration of a render engine.

    Attributes:
        renderer: ``module:class`` of its `valerie.rendering.base.Renderer`. The class takes the settings if the engine has any,
            else no argument.
        settings: the model of its settings; the base class has none.
        shows: its abilities. A spec that needs another one is refused, or gets a warning if the image merely looks worse.
        draft: settings of previews, which replace those of a spec: few seconds for a small image.
        install_hint: advice for users whose runs wait for the engine, for example how to install it.
    """

    renderer: str
    settings: type[EngineSettings] = EngineSettings
    shows: frozenset[Ability] = EVERYTHING
    draft: Mapping[str, Value] = field(default_factory=dict)
    install_hint: str = ""

    @property
    def has_settings(self) -> bool:
        """True if a spec may give the engine more than its name."""
        return bool(self.settings.model_fields)
