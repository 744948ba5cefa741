"""Caches between frames: the image of the statics, and the targets in which frames are composed.

A layer differs from the statics' image in few tiles. The targets therefore keep the statics' values from frame to frame, and a
mask per pass marks the tiles that hold them. The tiles that movables change are recomputed, and then marked as invalid. The
cache never affects a pixel: a tile is computed from equal inputs, either now or earlier.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING, Final

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import View
from valerie.rendering.raster.gl.targets import SAMPLES, ImageTargets, RenderTarget
from valerie.rendering.raster.gl.tiles import TILE, Area, Mask, TileGrid, widened

if TYPE_CHECKING:
    from valerie.rendering.raster.light.lighting import Lighting, LitFrame

#: x, y, width, height in pixels from the bottom left.

_NEIGHBOURS: Final = np.ones((3, 3), np.uint8)
#: Rows of tiles that one read covers.
_BAND: Final = 16


class StaticSurfaces:
    """The statics seen by one camera: their G-buffer, and the depths and ambient occlusion that bound the effect of movables.

    Rows count from the bottom. Entries are valid where ``known``.

    Attributes:
        target: the G-buffer.
        nearest, farthest: range of depth of each tile, metres, over all samples of its pixels and of the neighbouring pixels that
            the tent filter blends in.
        open: per tile, True if no pixel has ambient occlusion before the blur.
        smooth: (height, width) uint8, ambient occlusion after the blur; 255 means none.
    """

    def __init__(self, target: RenderTarget, grid: TileGrid) -> None:
        self.target = target
        self.grid = grid
        self.known = grid.none()
        self.nearest = np.zeros(grid.shape, np.float32)
        self.farthest = np.zeros(grid.shape, np.float32)
        self.open = grid.none()
        self.smooth = np.zeros((grid.height, grid.width), np.uint8)

    def learn(self, mask: Mask, targets: ImageTargets, near: float, far: float) -> None:
        """Read the tiles of ``mask`` that are not known yet. ``targets`` holds their ambient occlusion."""
        mask = mask & ~self.known
        # Band by band: the system would allocate a buffer for the whole image anew each time.
        for first in range(0, self.grid.shape[0], _BAND):
            band = self.grid.none()
            band[first : first + _BAND] = mask[first : first + _BAND]
            if band.any():
                self._learn(band, targets, near, far)
        self.known |= mask

    def _learn(self, mask: Mask, targets: ImageTargets, near: float, far: float) -> None:
        area = x, y, width, height = self.grid.around(mask)
        wide = Area(x - 1, y - 1, width + 2, height + 2).common(Area(0, 0, self.grid.width, self.grid.height))
        fine = wide.scaled(SAMPLES)
        window = _read(self.target.framebuffer, fine, 1, "f4", -1).reshape(fine.height, fine.width)
        # Reduce two by two samples to pixels, pixels with their neighbours, then tiles. Depth increases with the buffer's value.
        inner = area.inside(wide)
        nearest = np.minimum.reduce([window[i::2, j::2] for i in (0, 1) for j in (0, 1)])
        low: NDArray[np.float32] = cv2.erode(nearest, _NEIGHBOURS)[inner].astype(np.float32, copy=False)
        # The sky does not count, since movables do not change it.
        window = np.where(window < 1, window, 0)
        farthest = np.maximum.reduce([window[i::2, j::2] for i in (0, 1) for j in (0, 1)])
        high: NDArray[np.float32] = cv2.dilate(farthest, _NEIGHBOURS)[inner].astype(np.float32, copy=False)
        raw = _read(targets.occlusion.framebuffer, area, 1, "f1").reshape(height, width)
        smooth = _read(targets.smooth_occlusion.framebuffer, area, 1, "f1").reshape(height, width)
        rows, columns = slice(y // TILE, -(-(y + height) // TILE)), slice(x // TILE, -(-(x + width) // TILE))
        part = mask[rows, columns]
        for depths, pixels, largest in ((self.nearest, low, False), (self.farthest, high, True)):
            depth = _linear(self.grid.reduced(pixels, largest=largest), near, far)
            depths[rows, columns][part] = depth[part]
        dark = self.grid.holding(raw < 255, x, y)
        self.open[mask] = ~dark[mask]
        np.copyto(self.smooth[area.slices], smooth, where=self.grid.pixels(mask, area))

    def release(self) -> None:
        """Free the G-buffer."""
        self.target.release()


class StaticImage:
    """The statics' image under one light: (height, width, 3) float16, rows from the bottom, valid where ``known``."""

    def __init__(self, grid: TileGrid) -> None:
        self.known = grid.none()
        self.pixels = np.zeros((grid.height, grid.width, 3), np.float16)

    def release(self) -> None:
        """Do nothing: an image holds only memory. Caches call it."""


class Canvas:
    """The targets of one image size, with masks of the tiles that hold the statics' values.

    Attributes:
        targets: the outputs of the passes.
        occluded, smoothed, opened, skylit, classified, shaded: per pass, the tiles that are valid for the statics alone. In
            ``classified`` tiles, plain pixels are separated from the others.
    """

    def __init__(self, gl: moderngl.Context, view: View) -> None:
        self.targets = ImageTargets(gl, view)
        self.grid = TileGrid(view)
        self._gl = gl
        self._received: RenderTarget | None = None
        self.forget()

    def forget(self) -> None:
        """Mark every tile as invalid."""
        self._camera: Hashable = None
        self._light: Hashable = None
        #: Area in which the G-buffer may differ from the statics': at first all of it, later that of the movables.
        self.drawn = Area(0, 0, self.grid.width, self.grid.height)
        none = self.grid.none
        self.occluded, self.smoothed, self.opened, self.skylit, self.classified, self.shaded = (
            none() for _ in range(6)
        )

    def take(self, camera: Hashable, light: Hashable, drawn: Area) -> None:
        """Prepare for the statics seen by this camera under this light, and keep the tiles that are still valid.

        Args:
            camera: key of the inputs of the statics' G-buffer.
            light: key of the inputs of their image.
            drawn: area in which the G-buffer is drawn.
        """
        if camera != self._camera:
            self.forget()
            self._camera, self.drawn = camera, drawn
        if light != self._light:
            self.skylit, self.shaded = self.grid.none(), self.grid.none()
            self._light = light

    def light(self, frame: LitFrame, tiles: Mask) -> None:
        """Compute the pixels of these tiles, and all of their inputs that are not valid."""
        spans = self.grid.spans
        shaded = widened(tiles) & ~self.shaded
        self.occlude(frame, widened(shaded))
        self.light_sky(frame, widened(shaded))
        classified = shaded & ~self.classified
        frame.classify(spans(classified))
        self.classified |= classified
        frame.shade(spans(shaded))
        self.shaded |= shaded
        frame.resolve.run(spans(tiles))

    def light_sky(self, frame: LitFrame, tiles: Mask) -> None:
        """Compute the sky light of these tiles."""
        skylit = tiles & ~self.skylit
        tiles = skylit & ~self.opened
        frame.open_sky(self.grid.spans(tiles))
        self.opened |= tiles
        frame.light_sky(self.grid.spans(skylit))
        self.skylit |= skylit

    def occlude(self, frame: LitFrame, tiles: Mask) -> None:
        """Compute the ambient occlusion of these tiles."""
        smoothed = tiles & ~self.smoothed
        occluded = widened(smoothed) & ~self.occluded
        frame.occlusion.run(self.grid.spans(occluded))
        self.occluded |= occluded
        frame.smooth.run(self.grid.spans(smoothed))
        self.smoothed |= smoothed

    def cover(self, tiles: Mask) -> None:
        """Mark tiles in which movables appear or disappear as invalid. The caller marks the ambient occlusion."""
        self.classified &= ~tiles
        self.opened &= ~tiles
        self.skylit &= ~tiles

    def receive(self, frame: LitFrame, lighting: Lighting, areas: Sequence[Area]) -> list[NDArray[np.float32]]:
        """Return the light that arrives on the surfaces in each area, with movables: (height, width, 4), rows from the bottom.

        The overwritten tiles are invalid afterwards.
        """
        if self._received is None:
            self._received = RenderTarget(self._gl, (self.grid.width, self.grid.height), ((4, "f4"),), depth=False)
        tiles = self.grid.none()
        for area in areas:
            tiles |= self.grid.touching(area)
        near = widened(tiles)
        self.occluded &= ~widened(near)
        self.smoothed &= ~near
        self.occlude(frame, near)
        self.cover(near)
        self.light_sky(frame, near)
        lighting.receive(frame, self._received, self.grid.spans(tiles))
        self.occluded &= ~widened(near)
        self.smoothed &= ~near
        self.cover(near)
        return [_read(self._received.framebuffer, area, 4, "f4").reshape(area.height, area.width, 4) for area in areas]

    def read_pixels(self, area: Area) -> NDArray[np.float16]:
        """Return the pixels of an area, (height, width, 3), rows from the bottom."""
        data = _read(self.targets.pixels.framebuffer, area, 3, "f2")
        return data.view(np.float16).reshape(area.height, area.width, 3)

    def read_depth(self, near: float, far: float) -> NDArray[np.float32]:
        """Return the depth at the first sample of every pixel, (height, width) metres; ``far`` where nothing was drawn."""
        width, height = self.targets.surfaces.size
        window = _read(self.targets.surfaces.framebuffer, Area(0, 0, width, height), 1, "f4", -1).reshape(height, width)
        return _linear(window[::SAMPLES, ::SAMPLES], near, far)

    def read_smooth(self, area: Area) -> NDArray[np.uint8]:
        """Return the ambient occlusion of an area after the blur, (height, width)."""
        return _read(self.targets.smooth_occlusion.framebuffer, area, 1, "f1").reshape(area.height, area.width)

    def read_moving(self, area: Area) -> Mask:
        """Return a mask of an area's pixels, (height, width): True where a sample shows one of the movables drawn last."""
        samples = area.scaled(SAMPLES)
        rows = _read(self.targets.moving.framebuffer, samples, 1, "u2", 2).reshape(samples.height, samples.width)
        across = np.logical_or.reduce([rows[:, i::SAMPLES] for i in range(SAMPLES)])
        pixels: Mask = np.logical_or.reduce([across[i::SAMPLES] for i in range(SAMPLES)])
        return pixels

    def release(self) -> None:
        """Free the targets."""
        self.targets.release()
        if self._received is not None:
            self._received.release()


_TYPES = {"f1": np.uint8, "f2": np.float16, "f4": np.float32, "u2": np.uint16}


def _linear(window: NDArray[np.float32], near: float, far: float) -> NDArray[np.float32]:
    """Return the depth along the optical axis, metres, of depths in the window, as in ``sample.glsl``."""
    return (near * far / (near * window + far * (1 - window))).astype(np.float32, copy=False)


def _read(framebuffer: moderngl.Framebuffer, area: Area, components: int, dtype: str, attachment: int = 0) -> NDArray:  # type: ignore[type-arg]
    data = framebuffer.read(viewport=area, components=components, attachment=attachment, dtype=dtype, alignment=1)
    return np.frombuffer(data, _TYPES[dtype])
