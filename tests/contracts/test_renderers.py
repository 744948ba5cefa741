"""Both engines, and both in one process: each makes its own context current and leaves the other's alone."""

import gc
from collections.abc import Iterator

import pytest

from valerie.rendering.base import Renderer
from valerie.rendering.pyrender_engine import PyrenderRenderer
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.testing.rendering import RendererContract

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def raster() -> Iterator[Renderer]:
    engine = RasterRenderer()
    yield engine
    engine.close()


@pytest.fixture(scope="module")
def pyrender() -> Iterator[Renderer]:
    engine = PyrenderRenderer()
    yield engine
    engine.close()


def test_an_engine_that_was_collected_leaves_the_others_working() -> None:
    # pyrender's own renderer ends the whole EGL display when it is collected
    raster = RasterRenderer()
    engine = PyrenderRenderer()
    engine.close()
    del engine
    gc.collect()
    raster.close()
    RasterRenderer().close()


class TestRaster(RendererContract):
    @pytest.fixture
    def renderer(self, raster: Renderer, pyrender: Renderer) -> Renderer:  # type: ignore[override]
        return raster


class TestPyrender(RendererContract):
    @pytest.fixture
    def renderer(self, raster: Renderer, pyrender: Renderer) -> Renderer:  # type: ignore[override]
        return pyrender
