"""Samplers: the designs that draw a specified number of variants."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from valerie.parameters.samplers.base import Sampler, SamplerFactory, UnitPoints
from valerie.parameters.samplers.latin_hypercube import LatinHypercubeSampler
from valerie.parameters.samplers.quasi_monte_carlo import HaltonSampler, SobolSampler
from valerie.parameters.samplers.random import RandomSampler
from valerie.parameters.samplers.replicated import Replicated

__all__ = ["SAMPLERS", "Sampler", "SamplerFactory", "UnitPoints"]

#: Name to sampler of the built-in designs; ``grid`` and ``points`` need none.
SAMPLERS: Final = MappingProxyType[str, SamplerFactory](
    {
        "latin_hypercube": Replicated(LatinHypercubeSampler),
        "sobol": Replicated(SobolSampler),
        "halton": Replicated(HaltonSampler),
        "random": RandomSampler,
    }
)
