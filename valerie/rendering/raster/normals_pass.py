"""The normals pass: surface normals at pixel centres, for the surfaces of the truth pass."""

from __future__ import annotations

from typing import Final

import moderngl
import numpy as np

from valerie.rendering.annotations.normals import Normals
from valerie.rendering.base import Rectangle, View
from valerie.rendering.projection import drawing_matrices
from valerie.rendering.raster.gl.bounds import covered_rectangle
from valerie.rendering.raster.gl.cache import LeastRecentlyUsed
from valerie.rendering.raster.gl.targets import RenderTarget, ScreenPass, area_of
from valerie.rendering.raster.gl.tiles import Area
from valerie.rendering.raster.upload.context import GraphicsContext
from valerie.rendering.raster.upload.drawing import SurfaceDrawer, table_texture
from valerie.rendering.raster.upload.scenes import Prepared
from valerie.rendering.scene_reading import camera_key, camera_of
from valerie.scene.graph.model import Camera, Scene

_CAMERAS: Final = 2


class NormalsPass:
    """Draws normals with the truth pass's vertex shader and matrices. Caches the normals of the statics per camera."""

    def __init__(self, context: GraphicsContext) -> None:
        self._context = context
        self._surfaces = SurfaceDrawer(context, "normals.frag")
        with context.current() as gl:
            self._nothing = ScreenPass(gl, context.program("screen.vert", "normals_fill.frag"))
            self._copy = ScreenPass(gl, context.program("screen.vert", "normals_fill.frag", FROM_STATICS=1))
        self._statics: LeastRecentlyUsed[RenderTarget] = LeastRecentlyUsed(_CAMERAS)
        self._work: LeastRecentlyUsed[RenderTarget] = LeastRecentlyUsed(1)

    def normals(self, scene: Scene, view: View) -> Normals:
        """Return the normals of a scene seen by a camera.

        Raises:
            UnknownName: the scene has no such camera.
        """
        camera = camera_of(scene, view)
        with self._context.current() as gl:
            prepared = self._context.scenes.prepare(scene)
            table = table_texture(gl, prepared.table())
            everything = Rectangle(0, 0, view.width, view.height)
            try:
                statics = self._statics.get(
                    (prepared.statics.key, *camera_key(camera, view)),
                    lambda: self._draw_statics(prepared, camera, view, table),
                )
                work = self._work.get((view.width, view.height), lambda: _target(gl, view))
                assert statics.depth is not None
                sources = {"from_normals": statics.colors[0], "from_depth": statics.depth}
                self._copy.run(work, area_of(everything, view).span, sources, {}, depth="written")
                rectangle = covered_rectangle([mesh.corners for mesh in prepared.placed], camera, view)
                if not rectangle.empty:
                    work.use(area_of(rectangle, view))
                    values = drawing_matrices(camera, view)
                    self._surfaces.movables(prepared.placed, prepared.statics.textures, table, values)
                data = work.framebuffer.read(components=2, dtype="i2", alignment=1)
            finally:
                table.release()
        pixels = np.frombuffer(data, np.int16).reshape(view.height, view.width, 2)
        return Normals(np.ascontiguousarray(pixels[::-1]))

    def close(self) -> None:
        """Free the resources of this pass."""
        if not self._context.closed:
            with self._context.current():
                self._statics.clear()
                self._work.clear()
                self._nothing.release()
                self._copy.release()

    def _draw_statics(self, prepared: Prepared, camera: Camera, view: View, table: moderngl.Texture) -> RenderTarget:
        target = _target(self._context.gl, view)
        everything = Area(0, 0, view.width, view.height).span
        self._nothing.run(target, everything, {}, {}, depth="written")
        target.use()
        self._surfaces.statics(prepared.statics, table, drawing_matrices(camera, view))
        return target


def _target(gl: moderngl.Context, view: View) -> RenderTarget:
    return RenderTarget(gl, (view.width, view.height), ((2, "i2"),), depth=True)
