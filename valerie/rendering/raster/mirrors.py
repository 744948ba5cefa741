"""What smooth surfaces mirror under the light of a frame, with its caches."""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import Final

import moderngl

from valerie.rendering.raster.canvas import Canvas
from valerie.rendering.raster.gl.cache import LeastRecentlyUsed
from valerie.rendering.raster.gl.targets import RenderTarget
from valerie.rendering.raster.light.lamplight import LampLight
from valerie.rendering.raster.light.lighting import Daylight, Lighting, LitFrame, Surfaces, Viewpoint
from valerie.rendering.raster.light.pane_image import PaneImage
from valerie.rendering.raster.light.panorama import Panorama
from valerie.rendering.raster.panes import Panes, PaneView
from valerie.rendering.raster.spots import Spot, spot_of
from valerie.rendering.raster.upload.drawing import SurfaceDrawer
from valerie.rendering.raster.upload.scenes import Statics
from valerie.rendering.scene_reading import camera_key

_CAMERAS: Final = 4
_LIGHTS: Final = 4


class Mirrors:
    """The panorama around each camera, and the picture in large panes.

    Args:
        gl: the context; it must be current in every call.
        drawer: draws the G-buffer of surfaces.
        lighting: the screen passes.
    """

    def __init__(self, gl: moderngl.Context, drawer: SurfaceDrawer, lighting: Lighting) -> None:
        self._gl, self._drawer, self._lighting = gl, drawer, lighting
        self._spots: LeastRecentlyUsed[Spot] = LeastRecentlyUsed(_CAMERAS)
        self._panoramas: LeastRecentlyUsed[Panorama] = LeastRecentlyUsed(_LIGHTS)
        self._panes: LeastRecentlyUsed[Panes] = LeastRecentlyUsed(2)
        self._pane_views: LeastRecentlyUsed[PaneView] = LeastRecentlyUsed(_CAMERAS)
        self._pane_images: LeastRecentlyUsed[PaneImage] = LeastRecentlyUsed(_LIGHTS)

    def clear(self) -> None:
        """Free all that is cached."""
        for cache in (self._spots, self._panoramas, self._panes, self._pane_views, self._pane_images):
            cache.clear()

    def seen_from(
        self,
        viewpoint: Viewpoint,
        statics: Statics,
        target: RenderTarget,
        table: moderngl.Texture,
        day: Daylight,
        lamps: Callable[[], LampLight | None],
        light_key: Hashable,
    ) -> Surfaces:
        """Return the surfaces of a frame with what they mirror.

        Args:
            viewpoint: the camera and the size of its image.
            statics: the statics.
            target: their G-buffer in the frame.
            table: their material table.
            day: sun and sky.
            lamps: returns the light of the lamps that are not on movables; None if no lamp is on.
            light_key: key of the light on the statics.
        """
        gl, place = self._gl, spot_of(viewpoint.camera.position)
        # Drops and flakes belong to the camera's own air: in the coarse pictures they would be a veil.
        day = replace(day, sky=replace(day.sky, drops=0.0, flakes=0.0))
        spot_key = (statics.key, place.tobytes())
        view_key = (statics.key, camera_key(viewpoint.camera, viewpoint.view))
        lamps = functools.cache(lamps)  # the panorama and the panes share it

        def lit_in(panorama: Panorama) -> Callable[[Canvas, Viewpoint], LitFrame]:
            def bind(canvas: Canvas, seen_by: Viewpoint) -> LitFrame:
                surfaces = Surfaces(canvas.targets.surfaces, table, panorama)
                return self._lighting.bind(canvas.targets, surfaces, seen_by, day, None, lamps())

            return bind

        def all_around() -> Panorama:
            spot = self._spots.get(spot_key, lambda: Spot(gl, self._drawer, statics, table, place))
            panorama, light = Panorama(gl, place), lamps()
            ground = day.light.ground if light is None else day.light.ground + light.bounce
            spot.photograph(panorama, lit_in(panorama), ground)
            return panorama

        def in_panes() -> PaneView:
            panes = self._panes.get(statics.key, lambda: Panes.of(statics))
            return PaneView(gl, self._drawer, statics, table, viewpoint, panes)

        panorama = self._panoramas.get((spot_key, light_key), all_around)
        view = self._pane_views.get(view_key, in_panes)
        if (mirror := view.mirror) is None:
            return Surfaces(target, table, panorama)
        picture = self._pane_images.get((view_key, light_key), lambda: mirror.photograph(gl, lit_in(panorama)))
        return Surfaces(target, table, panorama, picture)
