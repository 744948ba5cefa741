"""Settings of the engine `cycles`: samples, denoiser, light transport."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import Field

from valerie.parameters.definitions import Value
from valerie.rendering.engine import EngineSettings

Quality = Literal["draft", "standard", "high", "paper"]


class Preset(NamedTuple):
    """Samples per pixel, and True if Open Image Denoise runs."""

    samples: int
    denoise: bool


#: Presets; docs/benchmarks.md has their errors and costs. ``paper``: 1024 samples as in the paper, section 6.
PRESETS: Final[Mapping[Quality, Preset]] = {
    "draft": Preset(16, denoise=True),
    "standard": Preset(64, denoise=True),
    "high": Preset(256, denoise=True),
    "paper": Preset(1024, denoise=False),
}


class CyclesSettings(EngineSettings):
    """Settings of Blender's Cycles.

    Attributes:
        quality: preset of samples and denoise: draft 16, standard 64, high 256 samples, denoised; paper 1024, not denoised.
        samples: light paths per pixel; overrides the preset.
        denoise: True if Open Image Denoise removes the noise; overrides the preset.
        max_bounces: largest number of bounces of a light path after the first surface.
        light_tree: sample lamps by their importance, for less noise with many lamps.
        clamp_indirect: upper limit of light after a bounce, in the image's unit; 0 for none. Suppresses single bright pixels.
        seed: seed of the noise.
    """

    quality: Quality = "standard"
    samples: Annotated[int, Field(ge=1, le=65_536)] | None = None
    denoise: bool | None = None
    max_bounces: Annotated[int, Field(ge=0, le=64)] = 8
    light_tree: bool = True
    clamp_indirect: Annotated[float, Field(ge=0, le=1e6)] = 10.0
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0

    def inputs(self) -> dict[str, Value]:
        """Return every value that the pixels depend on, with the preset resolved."""
        preset = PRESETS[self.quality]
        return {
            **self.model_dump(exclude={"quality"}),
            "samples": preset.samples if self.samples is None else self.samples,
            "denoise": preset.denoise if self.denoise is None else self.denoise,
        }

    def cost(self) -> float:
        """Return the approximate CPU time of an image relative to the default settings: the ratio of their samples."""
        return float(self.inputs()["samples"]) / PRESETS["standard"].samples
