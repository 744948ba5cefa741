"""The default engine: deferred shading in OpenGL. The same code runs on a GPU and on the CPU (llvmpipe)."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import ClassVar, Final

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import Layer, LinearImage, Rectangle, View, bounds, require_image
from valerie.rendering.lamps import glowing, keeping_hue, lit_lamps, with_lit_rooms
from valerie.rendering.person_light import Received
from valerie.rendering.projection import LightView, drawing_matrices
from valerie.rendering.raster.canvas import Canvas, StaticImage, StaticSurfaces
from valerie.rendering.raster.changes import mirroring_tiles, occluded_tiles, shadowed_tiles, touched_tiles
from valerie.rendering.raster.gl.bounds import Reach, changed_rectangle, covered_rectangle
from valerie.rendering.raster.gl.cache import LeastRecentlyUsed
from valerie.rendering.raster.gl.targets import SAMPLES, ScreenPass, area_of, surface_target
from valerie.rendering.raster.gl.tiles import TILE, Area, Mask, TileGrid, widened
from valerie.rendering.raster.gl.uniforms import Sampled
from valerie.rendering.raster.light.lamp_reach import FrameLamps, LampView, lamp_shadowed_tiles, with_lamps
from valerie.rendering.raster.light.lamplight import LampLight, LampMaps, LampShadows, bounced, falling_light, tiles_of
from valerie.rendering.raster.light.lighting import Daylight, Lighting, LitFrame, SkyLight, Surfaces, Viewpoint
from valerie.rendering.raster.light.shadows import LARGEST_PENUMBRA, ShadowMap, Shadows, SkyMaps, static_view
from valerie.rendering.raster.mirrors import Mirrors
from valerie.rendering.raster.upload.context import GraphicsContext, process_context
from valerie.rendering.raster.upload.drawing import SurfaceDrawer, table_texture
from valerie.rendering.raster.upload.materials import SurfaceKind
from valerie.rendering.raster.upload.scenes import Prepared
from valerie.rendering.scene_reading import camera_key, camera_of
from valerie.rendering.sky import EXPOSURE, sky_of
from valerie.scene.graph.model import Camera, Scene

#: Reach of the engine's effects. The filters add up: the cell of sky light that a sample takes is at most 4 pixels away (the
#: blur of ambient occlusion and its neighbours reach 3), the tent filter reaches 1, and rounding 1.
REACH: Final = Reach(
    occlusion_radius=0.7,
    largest_occlusion=48.0,
    penumbra=LARGEST_PENUMBRA + 0.1,
    filters=7,
    contact_radius=1.25,
    contact_rise=1.5,
    mirrored=1.2,
)
#: Reach of a changed sample of the G-buffer, and of a changed value of ambient occlusion, pixels (see above).
_SURFACE_REACH: Final = 6
_OCCLUSION_REACH: Final = 3
_CAMERAS: Final = 4
_SUNS: Final = 4


class RasterRenderer:
    """Scene-referred images by deferred shading; see `valerie.rendering.base.Renderer` for the contract.

    The engine caches the statics: geometry per asset, G-buffer and sky visibility per camera, shadow map per sun, and image per
    camera and light. A layer draws the movables over the G-buffer and recomputes only the tiles that they may change. `full`
    uses none of these caches.

    Args:
        context: GL context; by default that of the process.
    """

    name: ClassVar[str] = "raster"
    revision: ClassVar[int] = 23

    def __init__(self, context: GraphicsContext | None = None) -> None:
        self._context = context if context is not None else process_context()
        self._shadows = Shadows(self._context)
        self._shapes = SurfaceDrawer(self._context, "shape.frag", panes="sampled")
        self._moving = SurfaceDrawer(self._context, "moving.frag", textures="known", panes="sampled")
        with self._context.current() as gl:
            self._copy = ScreenPass(gl, self._context.program("screen.vert", "copy.frag"))
            self._lighting = Lighting(self._context, REACH)
            # No anisotropic filter: with explicit mip levels, each read would take milliseconds in llvmpipe.
            self._sampler = gl.sampler(filter=(moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR), anisotropy=1.0)
        self._surfaces = SurfaceDrawer(
            self._context, "surface.frag", textures="read", panes="sampled", sampler=self._sampler
        )
        self._texture_passes: dict[tuple[int, int, int], ScreenPass] = {}
        self._static_surfaces: LeastRecentlyUsed[StaticSurfaces] = LeastRecentlyUsed(_CAMERAS)
        self._light_views: LeastRecentlyUsed[LightView] = LeastRecentlyUsed(_CAMERAS * _SUNS)
        self._static_shadows: LeastRecentlyUsed[ShadowMap] = LeastRecentlyUsed(_SUNS)
        self._static_images: LeastRecentlyUsed[StaticImage] = LeastRecentlyUsed(_SUNS)
        self._sky_maps: LeastRecentlyUsed[SkyMaps] = LeastRecentlyUsed(2)
        self._sky_lights: LeastRecentlyUsed[SkyLight] = LeastRecentlyUsed(_SUNS)
        self._lamp_shadows = LampShadows(self._context)
        self._lamp_maps: LeastRecentlyUsed[LampMaps] = LeastRecentlyUsed(2)
        self._moving_lamp_maps: LeastRecentlyUsed[LampMaps] = LeastRecentlyUsed(2)
        self._mirrors = Mirrors(self._context.gl, self._surfaces, self._lighting)
        self._canvases: LeastRecentlyUsed[Canvas] = LeastRecentlyUsed(2)

    @property
    def numeric_class(self) -> str:
        """Name of the arithmetic; see `valerie.rendering.base.Renderer`."""
        return self._context.numeric_class

    def background(self, scene: Scene, view: View) -> LinearImage:
        """Render the frame without movables.

        Raises:
            RenderingError: the image is constant or not finite.
        """
        with self._frame(scene, view, movables=False) as frame:
            self._learn(frame, ~frame.canvas.grid.none())
            pixels = np.ascontiguousarray(frame.image.pixels[::-1])
        require_image(pixels, engine=self.name)
        return LinearImage(pixels)

    def layer(self, scene: Scene, view: View) -> Layer:
        """Render the pixels that movables change. The layer is empty if they change none."""
        nothing = Layer(Rectangle(0, 0, 0, 0), np.zeros((0, 0, 3), np.float16))
        with self._frame(scene, view) as frame:
            lowest = self._lowest(frame)
            boxes = [mesh.corners for mesh in frame.prepared.placed]
            rectangle = changed_rectangle(
                boxes, frame.camera, view, scene.sun_direction(), lowest, REACH, wet=frame.day.sky.wetness > 0
            )
            rectangle = with_lamps(rectangle, boxes, frame.camera, view, lowest, frame.lamps)
            if rectangle.empty:
                return nothing
            area = area_of(rectangle, view)
            self._learn(frame, frame.canvas.grid.touching(area))
            part, after = self._with_movables(frame, area)
            before = frame.image.pixels[part.slices]
            differs = before.view(np.uint16) != after.view(np.uint16)
        box = bounds((differs[..., 0] | differs[..., 1] | differs[..., 2])[::-1])
        if box.empty:
            return nothing
        pixels = np.ascontiguousarray(after[::-1][box.slices])
        top = view.height - part.y - part.height
        return Layer(Rectangle(part.x + box.x, top + box.y, box.width, box.height), pixels)

    def part(self, scene: Scene, view: View, window: Rectangle) -> NDArray[np.float16]:
        """Render a rectangle of the frame; see `valerie.rendering.base.Renderer`.

        If the background of the view is in the cache, only the movables are drawn.
        """
        # The filters mix neighbouring tiles, and movables may change these too.
        wide = window.widened(3 * TILE).clipped(view.width, view.height)
        with self._frame(scene, view, window=wide) as frame:
            area = area_of(wide, view)
            self._learn(frame, frame.canvas.grid.touching(area))
            pixels = frame.image.pixels[area.slices].copy()
            if frame.prepared.placed:
                part, after = self._with_movables(frame, area)
                pixels[part.inside(area)] = after
        top, left = window.y - wide.y, window.x - wide.x
        return np.ascontiguousarray(pixels[::-1][top : top + window.height, left : left + window.width])

    def full(self, scene: Scene, view: View) -> LinearImage:
        """Render the whole frame at once. Of all caches, it uses only uploaded meshes and textures."""
        with self._context.current():
            self._forget()
        with self._frame(scene, view) as frame:
            canvas, everything = frame.canvas, Area(0, 0, view.width, view.height)
            self._draw(frame, everything)
            with self._lit(frame, movables=True) as lit:
                canvas.light(lit, ~canvas.grid.none())
            pixels = np.ascontiguousarray(canvas.read_pixels(everything)[::-1])
            canvas.forget()
        require_image(pixels, engine=self.name)
        return LinearImage(pixels)

    def received(self, scene: Scene, view: View, rectangles: Sequence[Rectangle]) -> list[Received]:
        """Measure the light that arrives on surfaces; see `valerie.rendering.person_light.LightPass`."""
        with self._frame(scene, view) as frame:
            meshes = frame.prepared.placed
            box = covered_rectangle([mesh.corners for mesh in meshes], frame.camera, view)
            self._draw(frame, area_of(box, view))
            areas = [area_of(rectangle, view) for rectangle in rectangles]
            with self._lit(frame, movables=True, mirrors=False) as lit:
                received = frame.canvas.receive(lit, self._lighting, areas)
            sunny = bool(frame.day.sky.sun.max() > 0)
        return [
            Received(rectangle, np.ascontiguousarray(samples[::-1]), EXPOSURE, sunny)
            for rectangle, samples in zip(rectangles, received, strict=True)
        ]

    def close(self) -> None:
        """Free the resources of this engine. The context stays open, since its creator owns it."""
        if not self._context.closed:
            with self._context.current():
                self._forget()
                self._canvases.clear()
                self._shadows.release()
                self._lamp_shadows.release()
                self._lighting.release()
                self._sampler.release()
                for screen_pass in (self._copy, *self._texture_passes.values()):
                    screen_pass.release()

    def _forget(self) -> None:
        for cache in (
            self._static_surfaces, self._light_views, self._static_shadows, self._static_images, self._sky_maps, self._sky_lights,
            self._lamp_maps, self._moving_lamp_maps, self._mirrors,
        ):  # fmt: skip
            cache.clear()
        for canvas in self._canvases:
            canvas.forget()

    @contextmanager
    def _frame(
        self, scene: Scene, view: View, *, movables: bool = True, window: Rectangle | None = None
    ) -> Iterator[_Frame]:
        """Prepare a scene and a view with the caches of their statics. An error leaves no half-finished result in a cache.

        With a window, the statics are drawn only around it, unless the cache has all of them.
        """
        camera, sky = camera_of(scene, view), sky_of(scene)
        lamps, scene = lit_lamps(scene, sky), with_lit_rooms(keeping_hue(glowing(scene, sky), sky), sky)
        with self._context.current() as gl:
            prepared = self._context.scenes.prepare(scene, movables=movables)
            statics, sun = prepared.statics, scene.sun_direction()
            frame_lamps = FrameLamps.seen_by(lamps, camera, view)
            canvas = self._canvases.get((view.width, view.height), lambda: Canvas(gl, view))
            table = table_texture(gl, prepared.table())
            sight: Hashable = (statics.key, *camera_key(camera, view))
            day: tuple[Hashable, ...] = (scene.sun, scene.environment, statics.materials)
            extent = Rectangle(0, 0, view.width, view.height)
            if window is not None and sight not in self._static_surfaces:
                extent = window.widened(int(REACH.largest_occlusion) + 5 * TILE).clipped(view.width, view.height)
                sight = (sight, extent)
            lit: Hashable = (sight, *day, frame_lamps.still)
            try:
                surfaces = self._static_surfaces.get(
                    sight,
                    lambda: self._draw_statics(prepared, camera, view, table, canvas.grid, area_of(extent, view)),
                )
                light = self._light_views.get(
                    (sight, sun.tobytes()), lambda: static_view(statics.geometry, camera, view, sun)
                )
                shadow = self._static_shadows.get(
                    (statics.shape_key, light.key), lambda: self._shadows.static(statics, light, table)
                )
                sky_maps = self._sky_maps.get(statics.shape_key, lambda: self._shadows.sky(statics, table))
                sky_light = self._sky_lights.get((statics.key, *day), lambda: SkyLight(gl, statics, sky_maps, sky))
                image = self._static_images.get(lit, lambda: StaticImage(canvas.grid))
                canvas.take(sight, lit, area_of(extent, view))
                daylight = Daylight(scene.sun, sky, sky_maps, sky_light, shadow)
                light_key = (*day, light.key, frame_lamps.still, frame_lamps.shadowed)
                yield _Frame(prepared, view, camera, canvas, table, surfaces, image, daylight, frame_lamps, light_key)
            except BaseException:
                canvas.forget()
                raise
            finally:
                table.release()

    @contextmanager
    def _lit(self, frame: _Frame, *, movables: bool, mirrors: bool = True) -> Iterator[LitFrame]:
        shadows = None
        if movables and frame.prepared.placed:
            sunlight = frame.day.shadow.light if frame.day.sky.sun.max() > 0 else None
            shadows = self._shadows.movable(frame.prepared, sunlight, frame.table)
        lit = self._lighting.bind(
            frame.canvas.targets,
            self._mirroring(frame) if mirrors else Surfaces(frame.surfaces.target, frame.table, None),
            Viewpoint(frame.camera, frame.view),
            frame.day,
            shadows,
            self._lamplight(frame, movables=movables),
        )
        try:
            yield lit
        finally:
            lit.release()

    def _mirroring(self, frame: _Frame) -> Surfaces:
        """Return the frame's surfaces with what they mirror: the statics by the frame's light, without lamps on movables."""
        return self._mirrors.seen_from(
            Viewpoint(frame.camera, frame.view),
            frame.prepared.statics,
            frame.surfaces.target,
            frame.table,
            frame.day,
            lambda: self._lamplight(frame, movables=False),
            frame.light_key,
        )

    def _lamplight(self, frame: _Frame, *, movables: bool) -> LampLight | None:
        """Return the light of the lamps, without those on movables if ``movables`` is False; None if no lamp is on."""
        lamps, prepared = frame.lamps, frame.prepared
        lit = lamps.lit if movables else lamps.still
        if not lit:
            return None

        def maps(cache: LeastRecentlyUsed[LampMaps], views: Sequence[LampView]) -> LampMaps:
            key = (prepared.statics.key, tuple(lamp_view.lamp for lamp_view in views))
            return cache.get(key, lambda: self._lamp_shadows.static(prepared.statics, views, frame.table))

        static = maps(self._lamp_maps, lamps.shadowed)
        moving = maps(self._moving_lamp_maps, lamps.moving_shadowed) if movables and lamps.moving_shadowed else None
        casters = self._lamp_shadows.movable(prepared, lamps, frame.table) if movables and prepared.placed else None
        geometry = prepared.statics.geometry
        falling = falling_light(lamps.still, geometry.core_low, geometry.core_high)
        bounce = bounced(falling, frame.day.sky.snow_depth)
        return LampLight(lit, tiles_of(lamps, movable=movables), static, moving, casters, falling, bounce)

    def _learn(self, frame: _Frame, tiles: Mask) -> None:
        """Render the tiles of the statics' image among ``tiles`` that are not cached yet."""
        gaps = tiles & ~frame.image.known
        if not gaps.any():
            return
        canvas = frame.canvas
        self._copy_statics(frame)
        with self._lit(frame, movables=False) as lit:
            canvas.occlude(lit, gaps)
            canvas.light(lit, gaps)
        frame.surfaces.learn(gaps, canvas.targets, frame.camera.near, frame.camera.far)
        area = canvas.grid.around(gaps)
        canvas.grid.copy(canvas.read_pixels(area), frame.image.pixels[area.slices], gaps, area)
        frame.image.known |= gaps

    def _with_movables(self, frame: _Frame, area: Area) -> tuple[Area, NDArray[np.float16]]:
        """Return the part of the area in which movables may change pixels, and its pixels. The statics must be cached there."""
        canvas, surfaces, grid = frame.canvas, frame.surfaces, frame.canvas.grid
        meshes, camera, view = frame.prepared.placed, frame.camera, frame.view
        bodies = [mesh.corners for mesh in meshes]
        box = covered_rectangle(bodies, camera, view)
        region = grid.touching(area)
        surface, body = self._draw(frame, area_of(box, view))
        occluded: Mask = occluded_tiles(body, bodies, surfaces, camera, view, REACH)
        occluded |= touched_tiles(bodies, surfaces, camera, view, REACH)
        occluded &= region
        smoothed: Mask = widened(occluded) & region
        with self._lit(frame, movables=True) as lit:
            canvas.occluded &= ~occluded
            canvas.smoothed &= ~smoothed
            canvas.occlude(lit, smoothed)
            dirty: Mask = self._reached(canvas, surface, body, smoothed, surfaces)
            if lit.movable_shadow is not None and float(frame.day.sky.sun_direction[2]) > 0:
                dirty |= shadowed_tiles(region & ~dirty, bodies, surfaces, camera, view, lit.movable_shadow)
            if frame.day.sky.wetness > 0:
                dirty |= widened(mirroring_tiles(bodies, surfaces, camera, view, self._lowest(frame), REACH))
            dirty |= lamp_shadowed_tiles(grid, bodies, camera, view, self._lowest(frame), frame.lamps)
            dirty &= region
            canvas.cover(body)
            canvas.shaded &= ~dirty
            canvas.light(lit, dirty)
        part, pixels = Area(area.x, area.y, 0, 0), np.zeros((0, 0, 3), np.float16)
        if dirty.any():
            part = grid.around(dirty).common(area)
            pixels = frame.image.pixels[part.slices].copy()
            grid.copy(canvas.read_pixels(part), pixels, dirty, part)
        # These tiles no longer hold the statics' values.
        canvas.occluded &= ~occluded
        canvas.smoothed &= ~smoothed
        canvas.cover(body)
        canvas.shaded &= ~dirty
        return part, pixels

    @staticmethod
    def _lowest(frame: _Frame) -> float:
        """Return the height, metres, below which no surface receives a shadow or mirrors."""
        return float(frame.prepared.statics.geometry.low[2])

    def _reached(self, canvas: Canvas, surface: Mask, body: Mask, smoothed: Mask, surfaces: StaticSurfaces) -> Mask:
        """Return the tiles that visible movables, or the ambient occlusion that they change, may affect."""
        grid = canvas.grid
        dirty: Mask = body | _spread(grid, surface, canvas.drawn, _SURFACE_REACH)
        if smoothed.any():
            area = grid.around(smoothed)
            differs: Mask = np.not_equal(canvas.read_smooth(area), surfaces.smooth[area.slices])
            differs &= grid.pixels(smoothed, area)
            dirty |= _spread(grid, differs, area, _OCCLUSION_REACH)
        return dirty

    def _draw_statics(
        self, prepared: Prepared, camera: Camera, view: View, table: moderngl.Texture, grid: TileGrid, area: Area
    ) -> StaticSurfaces:
        target = surface_target(self._context.gl, view)
        target.use(area.scaled(SAMPLES))
        target.clear()
        values = drawing_matrices(camera, view)
        # The depth pre-pass reduces texture reads to one per sample.
        self._shapes.statics(prepared.statics, table, values)
        self._context.gl.depth_func = "<="
        self._surfaces.statics(prepared.statics, table, values)
        self._context.gl.depth_func = "<"
        return StaticSurfaces(target, grid)

    def _draw(self, frame: _Frame, area: Area) -> tuple[Mask, Mask]:
        """Draw the G-buffer of statics and movables. All movables lie inside the area.

        Returns:
            A mask of the area's pixels, (height, width), True where a sample shows a movable; and the tiles with such pixels.
        """
        self._copy_statics(frame)
        canvas, targets = frame.canvas, frame.canvas.targets
        canvas.drawn = area
        if not area.width or not area.height:
            return np.zeros((0, 0), np.bool_), canvas.grid.none()
        moving, textures = targets.moving, frame.prepared.statics.textures
        moving.use(area.scaled(SAMPLES))
        moving.clear_colors()
        self._moving.movables(frame.prepared.placed, textures, frame.table, drawing_matrices(frame.camera, frame.view))
        pixels = canvas.read_moving(area)
        body = canvas.grid.holding(pixels, area.x, area.y)
        sources: dict[str, Sampled] = {
            "uv_map": moving.colors[0],
            "frame_map": moving.colors[1],
            "row_map": moving.colors[2],
            "material_table": frame.table,
            **{f"textures_{side}": array for side, array in textures.arrays.items()},
        }
        # Outside the area, the target may hold material rows of an earlier frame.
        spans = canvas.grid.spans(body)
        ((x0, y0, x1, y1),) = area.span
        spans[:, :2] = np.maximum(spans[:, :2], (x0, y0))
        spans[:, 2:] = np.minimum(spans[:, 2:], (x1, y1))
        self._texturing([mesh.kind for mesh in frame.prepared.placed]).run(
            targets.surfaces, spans * SAMPLES, sources, {}, sampler=self._sampler
        )
        return pixels, body

    def _texturing(self, kinds: Sequence[SurfaceKind]) -> ScreenPass:
        """Return the pass that reads the textures of movables of these kinds."""
        color = sum({kind.color_side for kind in kinds})
        normal = sum({kind.normal_side for kind in kinds})
        roughness = sum({kind.roughness_side for kind in kinds})
        sides = color, normal, roughness
        if sides not in self._texture_passes:
            program = self._context.program(
                "screen.vert", "texturing.frag", COLOR_SIDES=color, NORMAL_SIDES=normal, ROUGHNESS_SIDES=roughness
            )
            self._texture_passes[sides] = ScreenPass(self._context.gl, program)
        return self._texture_passes[sides]

    def _copy_statics(self, frame: _Frame) -> None:
        """Restore the statics where movables were drawn, or everywhere on a canvas of another scene or view.

        Backgrounds pass through this copy too: it may round a depth to a neighbouring value, so all frames must share it.
        """
        canvas, surfaces = frame.canvas, frame.surfaces.target
        assert surfaces.depth is not None
        sources = {
            "from_albedo": surfaces.colors[0],
            "from_normals": surfaces.colors[1],
            "from_material": surfaces.colors[2],
            "from_depth": surfaces.depth,
        }
        if canvas.drawn.width and canvas.drawn.height:
            self._copy.run(canvas.targets.surfaces, canvas.drawn.scaled(SAMPLES).span, sources, {}, depth="written")
        canvas.drawn = Area(0, 0, 0, 0)


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """The scene, view and caches of one frame. ``light_key`` is the key of the light on the statics."""

    prepared: Prepared
    view: View
    camera: Camera
    canvas: Canvas
    table: moderngl.Texture
    surfaces: StaticSurfaces
    image: StaticImage
    day: Daylight
    lamps: FrameLamps
    light_key: Hashable


def _spread(grid: TileGrid, pixels: Mask, area: Area, by: int) -> Mask:
    """Return the tiles within ``by`` pixels of a true pixel of an area."""
    x, y, width, height = area
    left, bottom = max(x - by, 0), max(y - by, 0)
    right, top = min(x + width + by, grid.width), min(y + height + by, grid.height)
    wide = np.zeros((top - bottom, right - left), np.bool_)
    wide[y - bottom : y - bottom + height, x - left : x - left + width] = pixels
    return grid.holding(widened(wide, by), left, bottom)
