from __future__ import annotations

import pytest

from valerie.parameters.samplers import SAMPLERS, SamplerFactory
from valerie.testing.samplers import SamplerContract


class TestBuiltInSamplers(SamplerContract):
    @pytest.fixture(params=sorted(SAMPLERS))
    def factory(self, request: pytest.FixtureRequest) -> SamplerFactory:
        return SAMPLERS[request.param]
