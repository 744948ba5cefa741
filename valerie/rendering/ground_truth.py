"""The truth pass: class, instance, depth and amodal masks of one geometry, for all engines.

Labels are point samples at pixel centres. They use the same vertex shader, matrices and depth rounding as the raster engine's
images. The pass caches the labels of the statics per camera and draws the movables over a copy. The difference is a layer.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import ClassVar, Final

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.labels import PERSON, SKY
from valerie.rendering.annotations.flow import FlowMap
from valerie.rendering.annotations.normals import Normals
from valerie.rendering.base import GroundTruth, PersonTruth, Rectangle, TruthLayer, View, bounds
from valerie.rendering.projection import clip_from_view, drawing_matrices, view_from_world
from valerie.rendering.raster.flow_pass import FlowPass
from valerie.rendering.raster.gl.bounds import covered_rectangle
from valerie.rendering.raster.gl.cache import LeastRecentlyUsed
from valerie.rendering.raster.gl.targets import RenderTarget, ScreenPass, area_of
from valerie.rendering.raster.normals_pass import NormalsPass
from valerie.rendering.raster.upload.context import GraphicsContext, process_context
from valerie.rendering.raster.upload.drawing import SurfaceDrawer, table_texture
from valerie.rendering.raster.upload.movable_geometry import PlacedMesh
from valerie.rendering.raster.upload.scenes import Prepared
from valerie.rendering.scene_reading import camera_key, camera_of, draw_items
from valerie.scene.graph.model import Camera, Scene

#: Part of every truth's digest. Raise it by hand whenever the truth of some geometry changes, or what
#: `valerie.rendering.visibility` measures on it, which is stored with it.
REVISION: Final = 2

_CAMERAS: Final = 4


class TruthPass:
    """The `valerie.rendering.truth.TruthMaker` that draws with OpenGL. It shares uploaded scenes with the raster engine.

    Args:
        context: GL context; by default that of the process.
    """

    revision: ClassVar[int] = REVISION

    def __init__(self, context: GraphicsContext | None = None) -> None:
        self._context = context if context is not None else process_context()
        self._labels = SurfaceDrawer(self._context, "truth.frag")
        self._mask = SurfaceDrawer(self._context, "mask.frag", keeps="last")
        with self._context.current() as gl:
            self._sky = ScreenPass(gl, self._context.program("screen.vert", "truth_fill.frag"))
            self._copy = ScreenPass(gl, self._context.program("screen.vert", "truth_fill.frag", FROM_STATICS=1))
        self._statics: LeastRecentlyUsed[_StaticLabels] = LeastRecentlyUsed(_CAMERAS)
        self._work: LeastRecentlyUsed[_Labels] = LeastRecentlyUsed(1)
        self._canvas: LeastRecentlyUsed[RenderTarget] = LeastRecentlyUsed(1)
        self._normals: NormalsPass | None = None
        self._flows: FlowPass | None = None

    @property
    def numeric_class(self) -> str:
        """Name of the driver's arithmetic, which decides on which side of a pixel centre an edge falls."""
        return self._context.numeric_class

    def truth(self, scene: Scene, view: View) -> GroundTruth:
        """Return the ground truth of a scene seen by a camera.

        Raises:
            UnknownName: the scene has no such camera.
        """
        statics, layer = self.parts(scene, view)
        return layer.over(statics)

    def parts(self, scene: Scene, view: View) -> tuple[GroundTruth, TruthLayer]:
        """Return statics and layer of the ground truth; see `valerie.rendering.truth.TruthMaker.parts`.

        Raises:
            UnknownName: the scene has no such camera.
        """
        with self._frame(scene, view) as frame:
            rectangle, part = self._with_movables(frame)
            statics = frame.statics.truth
            instance_map = _InstanceMap(statics.instance_map, rectangle, part[1])
            persons = tuple(
                self._person(frame, number, meshes, instance_map) for number, meshes in _bodies(frame).items()
            )
            return statics, _layer(statics, rectangle, part, persons)

    def part(self, scene: Scene, view: View, window: Rectangle) -> GroundTruth:
        """Return the ground truth of a rectangle; see `valerie.rendering.truth.TruthMaker.part`.

        Raises:
            UnknownName: the scene has no such camera.
        """
        with self._frame(scene, view, window) as frame:
            classes, instances, depth = self._drawn(frame, window)
            visible = _InstanceMap(np.zeros((view.height, view.width), np.uint16), window, instances)
            persons = tuple(
                self._person(frame, number, meshes, visible, window) for number, meshes in _bodies(frame).items()
            )
        return GroundTruth(classes, instances, depth, persons)

    def normals(self, scene: Scene, view: View) -> Normals:
        """Return the surface normals; see `valerie.rendering.truth.TruthMaker.normals`.

        Raises:
            UnknownName: the scene has no such camera.
        """
        if self._normals is None:
            self._normals = NormalsPass(self._context)
        return self._normals.normals(scene, view)

    def flow(self, now: Scene, then: Scene, view: View, truth: GroundTruth) -> FlowMap:
        """Return the optical flow from ``now`` to ``then``; see `FlowPass.flow`."""
        return FlowMap(self._flow_pass().flow(now, then, view, truth))

    def velocity(self, now: Scene, after: Scene, view: View, truth: GroundTruth, seconds: float) -> FlowMap:
        """Return the image velocity, measured by the flow to ``after``; see `FlowPass.velocity`."""
        return FlowMap(self._flow_pass().velocity(now, after, view, truth, seconds))

    def _flow_pass(self) -> FlowPass:
        if self._flows is None:
            self._flows = FlowPass(self._context)
        return self._flows

    def close(self) -> None:
        """Free the resources of this pass. The context stays open, since its creator owns it."""
        for pass_ in (self._normals, self._flows):
            if pass_ is not None:
                pass_.close()
        if not self._context.closed:
            with self._context.current():
                self._statics.clear()
                self._work.clear()
                self._canvas.clear()
                self._sky.release()
                self._copy.release()

    @contextmanager
    def _frame(self, scene: Scene, view: View, window: Rectangle | None = None) -> Iterator[_Frame]:
        """Prepare a scene and a view. With a window, the statics are drawn only there unless the whole is in the cache."""
        camera = camera_of(scene, view)
        with self._context.current() as gl:
            prepared = self._context.scenes.prepare(scene)
            materials = list(prepared.materials)
            people = draw_items(scene, movable=False, label_id=PERSON.id)
            standing = self._context.scenes.place(scene, people, prepared.statics, materials)
            table = table_texture(gl, Prepared(scene, prepared.statics, (), tuple(materials)).table())
            key: tuple[Hashable, ...] = (prepared.statics.key, *camera_key(camera, view))
            extent = Rectangle(0, 0, view.width, view.height)
            if window is not None and key not in self._statics:
                key, extent = (*key, window), window
            try:
                statics = self._statics.get(key, lambda: self._draw_statics(prepared, camera, view, table, extent))
                yield _Frame(prepared, standing, camera, view, table, statics)
            finally:
                table.release()

    def _draw_statics(
        self, prepared: Prepared, camera: Camera, view: View, table: moderngl.Texture, extent: Rectangle
    ) -> _StaticLabels:
        labels, area = _Labels(self._context.gl, view), area_of(extent, view)
        self._sky.run(
            labels.target,
            area.span,
            {},
            {"sky_label": SKY.id, "nothing": float("inf")},
            depth="written",
        )
        labels.target.use(area)
        self._labels.statics(prepared.statics, table, drawing_matrices(camera, view))
        return _StaticLabels(labels, GroundTruth(*labels.read(extent, view), ()))

    def _with_movables(self, frame: _Frame) -> tuple[Rectangle, Maps]:
        """Return a rectangle that bounds the pixels of the movables, and its labels with movables."""
        rectangle = covered_rectangle([mesh.corners for mesh in frame.prepared.placed], frame.camera, frame.view)
        if rectangle.empty:
            return rectangle, (np.zeros((0, 0), np.uint8), np.zeros((0, 0), np.uint16), np.zeros((0, 0), np.float32))
        return rectangle, self._drawn(frame, rectangle)

    def _drawn(self, frame: _Frame, rectangle: Rectangle) -> Maps:
        """Return the labels of a rectangle, with movables."""
        prepared, view = frame.prepared, frame.view
        work = self._work.get((view.width, view.height), lambda: _Labels(self._context.gl, view))
        area, statics = area_of(rectangle, view), frame.statics.labels.target
        assert statics.depth is not None
        sources = {
            "from_ids": statics.colors[0],
            "from_axis_depth": statics.colors[1],
            "from_depth": statics.depth,
        }
        self._copy.run(work.target, area.span, sources, {}, depth="written")
        work.target.use(area)
        values = drawing_matrices(frame.camera, view)
        self._labels.movables(prepared.placed, prepared.statics.textures, frame.table, values)
        return work.read(rectangle, view)

    def _person(
        self,
        frame: _Frame,
        instance_id: int,
        meshes: Sequence[PlacedMesh],
        instance_map: _InstanceMap,
        window: Rectangle | None = None,
    ) -> PersonTruth:
        """Draw one person alone, on a canvas padded by half an image on each side, or only in a window of the image."""
        camera, view = frame.camera, frame.view
        pad_x, pad_y = (view.width + 1) // 2, (view.height + 1) // 2
        canvas = View(view.camera, view.width + 2 * pad_x, view.height + 2 * pad_y)
        rectangle = covered_rectangle([mesh.corners for mesh in meshes], camera, view, pad_x, pad_y)
        if window is not None:
            rectangle = rectangle.common(Rectangle(window.x + pad_x, window.y + pad_y, window.width, window.height))
        if rectangle.empty:
            rectangle = Rectangle(0, 0, 0, 0)
            return PersonTruth(instance_id, rectangle, np.zeros((0, 0), np.bool_), 0, (view.height, view.width))
        target = self._canvas.get(
            (canvas.width, canvas.height),
            lambda: RenderTarget(self._context.gl, (canvas.width, canvas.height), ((1, "f1"),), depth=False),
        )
        area = area_of(rectangle, canvas)
        target.use(area)
        target.clear()
        matrix = clip_from_view(camera, view.width, view.height, pad_x, pad_y) @ view_from_world(camera)
        self._mask.movables(meshes, frame.prepared.statics.textures, frame.table, {"clip_from_world": matrix})
        data = target.framebuffer.read(viewport=area, components=1, alignment=1)
        mask = np.frombuffer(data, np.uint8).reshape(rectangle.height, rectangle.width)[::-1] > 0
        padded = int(np.count_nonzero(mask))
        left, top = rectangle.x - pad_x, rectangle.y - pad_y
        inside = Rectangle(left, top, rectangle.width, rectangle.height).clipped(view.width, view.height)
        amodal = mask[Rectangle(inside.x - left, inside.y - top, inside.width, inside.height).slices]
        # The canvas may round an edge to the other side of a pixel centre. Visible pixels always belong to the amodal mask.
        visible = instance_map.part(inside) == instance_id
        padded += int(np.count_nonzero(visible & ~amodal))
        amodal = amodal | visible
        box = bounds(amodal)
        whole = Rectangle(inside.x + box.x, inside.y + box.y, box.width, box.height) if not box.empty else box
        return PersonTruth(instance_id, whole, amodal[box.slices].copy(), padded, (view.height, view.width))


def _bodies(frame: _Frame) -> dict[int, list[PlacedMesh]]:
    """Return the meshes of each person, by ascending instance id."""
    bodies: dict[int, list[PlacedMesh]] = {}
    for mesh in (*frame.standing, *frame.prepared.placed):
        if mesh.item.node.label_id == PERSON.id:
            bodies.setdefault(mesh.item.node.instance_id, []).append(mesh)
    return dict(sorted(bodies.items()))


#: Class, instance and depth maps of a rectangle.
Maps = tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.float32]]


class _Labels:
    """A framebuffer of label ids, instance ids and depths."""

    def __init__(self, gl: moderngl.Context, view: View) -> None:
        self.target = RenderTarget(gl, (view.width, view.height), ((2, "u2"), (1, "f4")), depth=True)

    def read(self, rectangle: Rectangle, view: View) -> Maps:
        """Read class, instance and depth of a rectangle, first row at the top."""
        area, shape = area_of(rectangle, view), (rectangle.height, rectangle.width)
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


@dataclass(frozen=True, slots=True, eq=False)
class _StaticLabels:
    """The labels of the statics seen by one camera: on the GPU, where movables are drawn over them, and as arrays."""

    labels: _Labels
    truth: GroundTruth

    def release(self) -> None:
        """Free the framebuffer."""
        self.labels.release()


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """One scene seen by one camera. ``standing`` holds the meshes of static persons, so that each can be drawn alone."""

    prepared: Prepared
    standing: tuple[PlacedMesh, ...]
    camera: Camera
    view: View
    table: moderngl.Texture
    statics: _StaticLabels


@dataclass(frozen=True, slots=True, eq=False)
class _InstanceMap:
    """The instance map with movables, composed only where it is read."""

    statics: NDArray[np.uint16]
    #: Bound of the movables, and the instance ids in it.
    rectangle: Rectangle
    movables: NDArray[np.uint16]

    def part(self, area: Rectangle) -> NDArray[np.uint16]:
        """Return the instance ids in a rectangle of the image, (area.height, area.width)."""
        instances = self.statics[area.slices].copy()
        x0, y0 = max(area.x, self.rectangle.x), max(area.y, self.rectangle.y)
        x1 = min(area.x + area.width, self.rectangle.x + self.rectangle.width)
        y1 = min(area.y + area.height, self.rectangle.y + self.rectangle.height)
        if x0 < x1 and y0 < y1:
            target, source = (
                Rectangle(x0 - frame.x, y0 - frame.y, x1 - x0, y1 - y0).slices for frame in (area, self.rectangle)
            )
            instances[target] = self.movables[source]
        return instances


def _layer(statics: GroundTruth, rectangle: Rectangle, part: Maps, persons: tuple[PersonTruth, ...]) -> TruthLayer:
    """Return the pixels of ``part`` that differ from the statics."""
    classes, instances, depth = part
    inside = rectangle.slices
    differs = (classes != statics.class_map[inside]) | (instances != statics.instance_map[inside])
    differs |= depth.view(np.uint32) != statics.depth[inside].view(np.uint32)
    box = bounds(differs)
    crop = box.slices
    mask = differs[crop].copy()
    area = box if box.empty else Rectangle(rectangle.x + box.x, rectangle.y + box.y, box.width, box.height)
    height, width = statics.class_map.shape
    return TruthLayer(
        area, mask, classes[crop][mask], instances[crop][mask], depth[crop][mask], persons, (height, width)
    )
