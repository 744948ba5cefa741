"""The truth pass: class, instance, depth and amodal masks of one geometry, for all engines.

Labels are point samples at pixel centres, drawn with the same vertex shader, matrices and rounding of depth as the raster
engine's images. Movables are drawn over a copy of the statics, which are kept per camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Final

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.labels import PERSON, SKY
from valerie.rendering.annotations.normals import Normals
from valerie.rendering.base import GroundTruth, PersonTruth, Rectangle, View
from valerie.rendering.raster.bounds import covered_rectangle
from valerie.rendering.raster.cache import LeastRecentlyUsed
from valerie.rendering.raster.camera_math import clip_from_view, view_from_world
from valerie.rendering.raster.context import GraphicsContext, process_context
from valerie.rendering.raster.drawing import SurfaceDrawer, table_texture
from valerie.rendering.raster.movable_geometry import PlacedMesh
from valerie.rendering.raster.normals_pass import NormalsPass
from valerie.rendering.raster.scenes import Prepared
from valerie.rendering.raster.targets import ScreenPass, Target, gl_rectangle, one_span
from valerie.rendering.scene_reading import camera_key, camera_of, draw_items
from valerie.scene.model import Camera, Scene, freeze

#: Raised by hand whenever the truth of some geometry changes; part of every truth's digest.
REVISION: Final = 1

_CAMERAS: Final = 4


class TruthPass:
    """Draws ground truth. One per process; shares the uploaded scenes with the raster engine.

    Args:
        context: the process's context if not given.
    """

    revision: ClassVar[int] = REVISION

    def __init__(self, context: GraphicsContext | None = None) -> None:
        self._context = context if context is not None else process_context()
        self._labels = SurfaceDrawer(self._context, "truth.frag")
        self._mask = SurfaceDrawer(self._context, "mask.frag", depth_test=False)
        with self._context.current() as gl:
            self._sky = ScreenPass(gl, self._context.program("screen.vert", "truth_fill.frag"))
            self._copy = ScreenPass(gl, self._context.program("screen.vert", "truth_fill.frag", FROM_STATICS=1))
        self._statics: LeastRecentlyUsed[_Labels] = LeastRecentlyUsed(_CAMERAS)
        self._work: LeastRecentlyUsed[_Labels] = LeastRecentlyUsed(1)
        self._canvas: LeastRecentlyUsed[Target] = LeastRecentlyUsed(1)
        self._normals: NormalsPass | None = None

    @property
    def numeric_class(self) -> str:
        """The driver's arithmetic, which decides on which side of a pixel centre an edge falls."""
        return self._context.numeric_class

    def truth(self, scene: Scene, view: View) -> GroundTruth:
        """The truth of a scene seen by a camera; arrays are read-only.

        Raises:
            UnknownName: the scene has no such camera.
        """
        camera = camera_of(scene, view)
        with self._context.current() as gl:
            prepared = self._context.scenes.prepare(scene)
            materials = list(prepared.materials)
            standing = [item for item in draw_items(scene, movable=False) if item.node.label_id == PERSON.id]
            placed = self._context.scenes.place(scene, standing, prepared.statics, materials)
            table = table_texture(gl, Prepared(scene, prepared.statics, (), tuple(materials)).table())
            try:
                labels = self._static_labels(prepared, camera, view, table)
                maps = self._with_movables(prepared, labels, camera, view, table)
                persons: dict[int, list[PlacedMesh]] = {}
                for mesh in (*placed, *prepared.placed):
                    if mesh.item.node.label_id == PERSON.id:
                        persons.setdefault(mesh.item.node.instance_id, []).append(mesh)
                return GroundTruth(
                    *maps,
                    tuple(
                        self._person(number, meshes, prepared, maps[1], camera, view, table)
                        for number, meshes in sorted(persons.items())
                    ),
                )
            finally:
                table.release()

    def normals(self, scene: Scene, view: View) -> Normals:
        """Which way the surface in each pixel faces, in step with `truth`.

        Raises:
            UnknownName: the scene has no such camera.
        """
        if self._normals is None:
            self._normals = NormalsPass(self._context)
        return self._normals.normals(scene, view)

    def close(self) -> None:
        """Free what this pass holds; the context stays with who made it (the process, by default)."""
        if self._normals is not None:
            self._normals.close()
        if not self._context.closed:
            with self._context.current():
                self._statics.clear()
                self._work.clear()
                self._canvas.clear()
                self._sky.release()
                self._copy.release()

    def _static_labels(self, prepared: Prepared, camera: Camera, view: View, table: moderngl.Texture) -> _Labels:
        def draw() -> _Labels:
            labels = _Labels(self._context.gl, view)
            everything = Rectangle(0, 0, view.width, view.height)
            self._sky.run(
                labels.target,
                one_span(gl_rectangle(everything, view)),
                {},
                {"sky_label": SKY.id, "nothing": float("inf")},
                writes_depth=True,
            )
            labels.target.use()
            self._labels.statics(prepared.statics, table, _camera_values(camera, view))
            labels.read(everything, view)
            return labels

        return self._statics.get((prepared.statics.key, *camera_key(camera, view)), draw)

    def _with_movables(
        self, prepared: Prepared, statics: _Labels, camera: Camera, view: View, table: moderngl.Texture
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.float32]]:
        rectangle = covered_rectangle([mesh.corners for mesh in prepared.placed], camera, view)
        if rectangle.empty:
            return statics.maps
        work = self._work.get((view.width, view.height), lambda: _Labels(self._context.gl, view))
        area = gl_rectangle(rectangle, view)
        assert statics.target.depth is not None
        sources = {
            "from_ids": statics.target.colors[0],
            "from_axis_depth": statics.target.colors[1],
            "from_depth": statics.target.depth,
        }
        self._copy.run(work.target, one_span(area), sources, {}, writes_depth=True)
        work.target.use(area)
        values = _camera_values(camera, view)
        self._labels.movables(prepared.placed, prepared.statics.textures, table, values)
        classes, instances, depth = statics.maps[0].copy(), statics.maps[1].copy(), statics.maps[2].copy()
        part = work.read_part(rectangle, view)
        classes[rectangle.slices], instances[rectangle.slices], depth[rectangle.slices] = part
        return freeze(classes), freeze(instances), freeze(depth)

    def _person(
        self,
        instance_id: int,
        meshes: Sequence[PlacedMesh],
        prepared: Prepared,
        instance_map: NDArray[np.uint16],
        camera: Camera,
        view: View,
        table: moderngl.Texture,
    ) -> PersonTruth:
        """Draw one person alone, on a canvas half an image wider on each side."""
        pad_x, pad_y = (view.width + 1) // 2, (view.height + 1) // 2
        canvas = View(view.camera, view.width + 2 * pad_x, view.height + 2 * pad_y)
        amodal = np.zeros((view.height, view.width), np.bool_)
        rectangle = covered_rectangle([mesh.corners for mesh in meshes], camera, view, pad_x, pad_y)
        padded = 0
        if not rectangle.empty:
            target = self._canvas.get(
                (canvas.width, canvas.height),
                lambda: Target(self._context.gl, (canvas.width, canvas.height), ((1, "f1"),), depth=False),
            )
            area = gl_rectangle(rectangle, canvas)
            target.use(area)
            target.clear()
            matrix = clip_from_view(camera, view.width, view.height, pad_x, pad_y) @ view_from_world(camera)
            self._mask.movables(meshes, prepared.statics.textures, table, {"clip_from_world": matrix})
            data = target.framebuffer.read(viewport=area, components=1, alignment=1)
            mask = np.frombuffer(data, np.uint8).reshape(rectangle.height, rectangle.width)[::-1] > 0
            padded = int(np.count_nonzero(mask))
            left, top = rectangle.x - pad_x, rectangle.y - pad_y
            inside = Rectangle(left, top, rectangle.width, rectangle.height).clipped(view.width, view.height)
            if not inside.empty:
                shifted = Rectangle(inside.x - left, inside.y - top, inside.width, inside.height)
                amodal[inside.slices] = mask[shifted.slices]
        # What is seen belongs to the whole, also where the canvas rounds an edge to the other side of a pixel centre.
        seen = instance_map == instance_id
        padded += int(np.count_nonzero(seen & ~amodal))
        return PersonTruth(instance_id, freeze(amodal | seen), padded)


class _Labels:
    """A framebuffer of ids and depths, and (for statics) its contents."""

    def __init__(self, gl: moderngl.Context, view: View) -> None:
        self.target = Target(gl, (view.width, view.height), ((2, "u2"), (1, "f4")), depth=True)
        self.maps: tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.float32]] = (
            np.zeros((0, 0), np.uint8), np.zeros((0, 0), np.uint16), np.zeros((0, 0), np.float32),
        )  # fmt: skip

    def read(self, rectangle: Rectangle, view: View) -> None:
        """Fetch a rectangle and keep it."""
        classes, instances, depth = self.read_part(rectangle, view)
        self.maps = (freeze(classes), freeze(instances), freeze(depth))

    def read_part(
        self, rectangle: Rectangle, view: View
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.float32]]:
        """Fetch class, instance and depth of a rectangle, first row at the top."""
        area, shape = gl_rectangle(rectangle, view), (rectangle.height, rectangle.width)
        read = self.target.framebuffer.read
        ids = np.frombuffer(read(viewport=area, components=2, attachment=0, dtype="u2", alignment=1), np.uint16)
        depth = np.frombuffer(read(viewport=area, components=1, attachment=1, dtype="f4", alignment=1), np.float32)
        ids = ids.reshape(*shape, 2)[::-1]
        return (
            ids[..., 0].astype(np.uint8),
            np.ascontiguousarray(ids[..., 1]),
            np.ascontiguousarray(depth.reshape(shape)[::-1]),
        )

    def release(self) -> None:
        """Free the framebuffer."""
        self.target.release()


def _camera_values(camera: Camera, view: View) -> dict[str, NDArray[np.float64]]:
    matrix = view_from_world(camera)
    return {"clip_from_world": clip_from_view(camera, view.width, view.height) @ matrix, "depth_row": -matrix[2]}
