from collections.abc import Iterator

import pytest

from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.renderer import RasterRenderer


@pytest.fixture(scope="session")
def truth_pass() -> Iterator[TruthPass]:
    found = TruthPass()
    yield found
    found.close()


@pytest.fixture(scope="session")
def raster() -> Iterator[RasterRenderer]:
    found = RasterRenderer()
    yield found
    found.close()
