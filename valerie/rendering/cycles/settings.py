"""Settings of the engine `cycles`: samples, denoiser, light transport."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import Field

from valerie.parameters.definitions import Value
from valerie.rendering.engine import EngineSettings

Sky = Literal["nishita", "scene"]
Quality = Literal["draft", "standard", "high", "paper"]


class Preset(NamedTuple):
    """Samples per pixel, and the use of Open Image Denoise."""

    samples: int
    denoise: bool


#: Presets; docs/cycles.md has their errors and costs. ``paper``: 1024 samples as in the paper, section 6.
PRESETS: Final[Mapping[Quality, Preset]] = {
    "draft": Preset(16, denoise=True),
    "standard": Preset(64, denoise=True),
    "high": Preset(256, denoise=True),
    "paper": Preset(1024, denoise=False),
}


class CyclesSettings(EngineSettings):
    """Settings of Blender's Cycles.

    Attributes:
        quality: a preset of samples and denoise: draft 16, standard 64, high 256 samples, denoised; paper 1024, not denoised.
        samples: light paths per pixel; overrides the preset's.
        denoise: whether Open Image Denoise cleans the picture; overrides the preset's.
        max_bounces: surfaces that a light path meets at most after the first.
        light_tree: sample lamps by their importance (many lamps: less noise).
        clamp_indirect: largest value of light after a bounce, in the image's unit; 0 for none. Keeps single bright pixels away.
        sky: nishita: Blender's parametric sky, as bright on the ground as the raster engine's; scene: the raster engine's itself,
            as always under clouds and in fog.
        seed: of the noise.
    """

    quality: Quality = "standard"
    samples: Annotated[int, Field(ge=1, le=65_536)] | None = None
    denoise: bool | None = None
    max_bounces: Annotated[int, Field(ge=0, le=64)] = 8
    light_tree: bool = True
    clamp_indirect: Annotated[float, Field(ge=0, le=1e6)] = 10.0
    sky: Sky = "nishita"
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0

    def inputs(self) -> dict[str, Value]:
        """Return every value that the pixels depend on, with the preset resolved. Equal inputs give equal pixels."""
        preset = PRESETS[self.quality]
        return {
            **self.model_dump(exclude={"quality"}),
            "samples": preset.samples if self.samples is None else self.samples,
            "denoise": preset.denoise if self.denoise is None else self.denoise,
        }

    def cost(self) -> float:
        """Return roughly the CPU time of an image relative to the default settings. It is proportional to the samples."""
        return float(self.inputs()["samples"]) / PRESETS["standard"].samples
