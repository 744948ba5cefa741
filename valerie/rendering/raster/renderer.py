"""The default engine: deferred shading in OpenGL, on a GPU or on the CPU (llvmpipe), by the same code."""

from __future__ import annotations

from typing import Any, ClassVar, Final

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import Layer, LinearImage, Rectangle, View, require_image
from valerie.rendering.raster.bounds import Reach, changed_rectangle, grown
from valerie.rendering.raster.cache import LeastRecentlyUsed
from valerie.rendering.raster.camera_math import clip_from_view, view_from_world
from valerie.rendering.raster.context import GraphicsContext, process_context
from valerie.rendering.raster.drawing import SurfaceDrawer, table_texture
from valerie.rendering.raster.lighting import Lighting
from valerie.rendering.raster.scenes import Prepared
from valerie.rendering.raster.shadows import LARGEST_PENUMBRA, ShadowMap, Shadows, SkyMaps
from valerie.rendering.raster.targets import (
    SAMPLES,
    ImageTargets,
    ScreenPass,
    Target,
    gl_rectangle,
    surface_target,
)
from valerie.rendering.scene_reading import camera_key, camera_of
from valerie.rendering.sky import sky_of
from valerie.scene.model import Camera, Scene

#: Metres and pixels of near occlusion. Filters: the place of the sky light that a sample takes (4 pixels away at most; the
#: blur of near occlusion and its neighbours take 3), the tent filter (1) and rounding (1).
REACH: Final = Reach(occlusion_radius=0.7, largest_occlusion=48.0, penumbra=LARGEST_PENUMBRA + 0.1, filters=7)
_CAMERAS: Final = 4
_SUNS: Final = 4


class RasterRenderer:
    """Scene-referred images by deferred shading; see `valerie.rendering.base.Renderer` for the contract.

    What does not move is cached: geometry per asset, its G-buffer per camera, its shadow map per camera and sun. A layer
    draws the movables over a copy of the G-buffer and lights only the rectangle that they change. `full` uses no cache of
    these, and lights everything.

    Args:
        context: the process's context if not given.
    """

    name: ClassVar[str] = "raster"
    revision: ClassVar[int] = 1

    def __init__(self, context: GraphicsContext | None = None) -> None:
        self._context = context if context is not None else process_context()
        self._shadows = Shadows(self._context)
        self._surfaces = SurfaceDrawer(self._context, "surface.frag", colors=True)
        with self._context.current() as gl:
            self._copy = ScreenPass(gl, self._context.program("screen.vert", "copy.frag"))
            self._lighting = Lighting(self._context, REACH)
        self._static_surfaces: LeastRecentlyUsed[Target] = LeastRecentlyUsed(_CAMERAS)
        self._static_shadows: LeastRecentlyUsed[ShadowMap] = LeastRecentlyUsed(_SUNS)
        self._sky_maps: LeastRecentlyUsed[SkyMaps] = LeastRecentlyUsed(2)
        self._targets: LeastRecentlyUsed[ImageTargets] = LeastRecentlyUsed(2)

    @property
    def numeric_class(self) -> str:
        """See `valerie.rendering.base.Renderer`."""
        return self._context.numeric_class

    def background(self, scene: Scene, view: View) -> LinearImage:
        """The frame without movables; raises `RenderingError` if it is constant or not finite."""
        with self._context.current():
            prepared = self._context.scenes.prepare(scene, movables=False)
            pixels = self._render(prepared, view, Rectangle(0, 0, view.width, view.height))
        require_image(pixels, engine=self.name)
        return LinearImage(pixels)

    def layer(self, scene: Scene, view: View) -> Layer:
        """The rectangle that movables change; empty where they reach nothing of the image."""
        camera = camera_of(scene, view)
        with self._context.current():
            prepared = self._context.scenes.prepare(scene)
            lowest = float(prepared.statics.geometry.low[2])
            boxes = [mesh.corners for mesh in prepared.placed]
            rectangle = changed_rectangle(boxes, camera, view, scene.sun_direction(), lowest, REACH)
            if rectangle.empty:
                return Layer(rectangle, np.zeros((0, 0, 3), np.float16))
            return Layer(rectangle, self._render(prepared, view, rectangle))

    def full(self, scene: Scene, view: View) -> LinearImage:
        """The frame from scratch: nothing cached but uploaded meshes and textures, everything lit."""
        with self._context.current():
            self._forget()
            prepared = self._context.scenes.prepare(scene)
            pixels = self._render(prepared, view, Rectangle(0, 0, view.width, view.height))
        require_image(pixels, engine=self.name)
        return LinearImage(pixels)

    def close(self) -> None:
        """Free what this engine holds; the context stays with who made it (the process, by default)."""
        if not self._context.closed:
            with self._context.current():
                self._forget()
                self._targets.clear()
                self._shadows.release()
                self._lighting.release()
                self._copy.release()

    def _forget(self) -> None:
        for cache in (self._static_surfaces, self._static_shadows, self._sky_maps):
            cache.clear()

    def _render(self, prepared: Prepared, view: View, rectangle: Rectangle) -> NDArray[np.float16]:
        """(rectangle.height, rectangle.width, 3) pixels of the rectangle."""
        gl, scene, statics = self._context.gl, prepared.scene, prepared.statics
        camera = camera_of(scene, view)
        table = table_texture(gl, prepared.table())
        try:
            key = (statics.key, *camera_key(camera, view))
            targets = self._targets.get((view.width, view.height), lambda: ImageTargets(gl, view))
            surfaces = self._static_surfaces.get(key, lambda: self._draw_statics(prepared, camera, view, table))
            sun = scene.sun_direction()
            shadow = self._static_shadows.get(
                (*key, sun.tobytes()), lambda: self._shadows.static(statics, camera, view, sun, table)
            )
            sky_maps = self._sky_maps.get(statics.key, lambda: self._shadows.sky(statics, table))
            self._draw_movables(prepared, camera, view, rectangle, surfaces, targets, table)
            movable_shadow = self._shadows.movable(prepared, shadow.light, table) if prepared.placed else None
            return self._lighting.light(
                targets, table, camera, view, rectangle, scene, sky_of(scene), sky_maps, shadow, movable_shadow
            )
        finally:
            table.release()

    def _draw_statics(self, prepared: Prepared, camera: Camera, view: View, table: moderngl.Texture) -> Target:
        target = surface_target(self._context.gl, view)
        target.use()
        target.clear()
        self._surfaces.statics(prepared.statics, table, _camera_values(camera, view))
        return target

    def _draw_movables(
        self,
        prepared: Prepared,
        camera: Camera,
        view: View,
        rectangle: Rectangle,
        surfaces: Target,
        targets: ImageTargets,
        table: moderngl.Texture,
    ) -> None:
        """Fill the G-buffer of ``targets``, around the rectangle as far as near occlusion looks.

        A background goes through this copy too: on its way a depth may be rounded to a neighbouring value, and must be for all.
        """
        around = grown(rectangle, int(REACH.largest_occlusion) + 2 * REACH.filters, view)
        area = gl_rectangle(around, view, SAMPLES)
        assert surfaces.depth is not None
        sources = {
            "from_albedo": surfaces.colors[0],
            "from_normals": surfaces.colors[1],
            "from_material": surfaces.colors[2],
            "from_depth": surfaces.depth,
        }
        self._copy.run(targets.surfaces, area, sources, {}, writes_depth=True)
        targets.surfaces.use(area)
        values = _camera_values(camera, view)
        self._surfaces.movables(prepared.placed, prepared.statics.textures, table, values)


def _camera_values(camera: Camera, view: View) -> dict[str, Any]:
    matrix = view_from_world(camera)
    return {
        "clip_from_world": clip_from_view(camera, view.width, view.height) @ matrix,
        "depth_row": -matrix[2],
    }
