import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

# The oracle stands beside its tests, which are imported without packages.
sys.path.insert(0, str(Path(__file__).parent))

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
