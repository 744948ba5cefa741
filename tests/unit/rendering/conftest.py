from collections.abc import Iterator

import pytest

from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.renderer import RasterRenderer


@pytest.fixture(scope="session")
def truth_pass() -> Iterator[TruthPass]:
    truth_pass = TruthPass()
    yield truth_pass
    truth_pass.close()


@pytest.fixture(scope="session")
def raster() -> Iterator[RasterRenderer]:
    engine = RasterRenderer()
    yield engine
    engine.close()
