"""From a G-buffer to pixels: sky light, near occlusion, sun, reflections, air, antialiasing; inside a rectangle."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import Rectangle, View
from valerie.rendering.raster.bounds import Reach, grown
from valerie.rendering.raster.shadows import LARGEST_PENUMBRA, SHADOW_DISTANCE, SKY_TILES, ShadowMap, SkyMaps
from valerie.rendering.raster.targets import (
    SAMPLES,
    SKYLIGHT_CELL,
    ImageTargets,
    ScreenPass,
    coarse_rectangle,
    gl_rectangle,
)
from valerie.rendering.sky import Sky
from valerie.scene.model import Camera, Scene

if TYPE_CHECKING:
    from valerie.rendering.raster.context import GraphicsContext

#: Linear albedo of an average street surface: plaster, brick, asphalt.
_STREET_ALBEDO = np.array([0.26, 0.23, 0.20])


class Lighting:
    """The passes over the screen.

    Args:
        context: current in every call.
        reach: of near occlusion; the rectangle's bound is made from the same numbers.
    """

    def __init__(self, context: GraphicsContext, reach: Reach) -> None:
        gl = context.gl
        self._gl = gl
        self._reach = reach
        directions = SKY_TILES[0] * SKY_TILES[1]
        self._skylight = ScreenPass(
            gl, context.program("screen.vert", "skylight.frag", DIRECTIONS=directions, SKYLIGHT_CELL=SKYLIGHT_CELL)
        )
        self._occlusion = ScreenPass(gl, context.program("screen.vert", "occlusion.frag"))
        self._blur = ScreenPass(gl, context.program("screen.vert", "blur.frag"))
        self._shade = ScreenPass(gl, context.program("screen.vert", "lighting.frag", SKYLIGHT_CELL=SKYLIGHT_CELL))
        self._resolve = ScreenPass(gl, context.program("screen.vert", "resolve.frag"))

    def light(
        self,
        targets: ImageTargets,
        table: moderngl.Texture,
        camera: Camera,
        view: View,
        rectangle: Rectangle,
        scene: Scene,
        sky: Sky,
        sky_maps: SkyMaps,
        static_shadow: ShadowMap,
        movable_shadow: ShadowMap | None,
    ) -> NDArray[np.float16]:
        """(height, width, 3) linear pixels of ``rectangle``, first row at the top.

        The G-buffer of ``targets`` must be valid around the rectangle as far as near occlusion and filters look. Each
        pixel is a function of its place in the image and of what lies around it, never of the rectangle.
        """
        surfaces = targets.surfaces
        assert surfaces.depth is not None
        common = _sample_values(camera, view)
        depth = {"depth_map": surfaces.depth}
        normals = {"normals_map": surfaces.colors[1]}
        near = gl_rectangle(grown(rectangle, 2, view), view)
        street_by_sky = _STREET_ALBEDO * sky.sky_irradiance * 0.7
        # Of the surfaces that face the sun, about half lie in the shadow of others.
        street_by_sun = _STREET_ALBEDO * sky.sun * 0.6
        self._skylight.run(
            targets.skylight,
            coarse_rectangle(grown(rectangle, 6, view), view),
            {**depth, **normals, "atlas": sky_maps.texture},
            common
            | {
                "tiles": SKY_TILES,
                "tile_rows": sky_maps.rows.reshape(-1),
                "directions": sky_maps.directions.reshape(-1),
                "sky_radiance": sky.radiance(sky_maps.directions).reshape(-1),
                "toward_sun": sky.sun_direction,
                "surface_by_sky": street_by_sky,
                "surface_by_sun": street_by_sun,
                "ground": sky.ground * 0.8,
            },
        )
        occlusion = {
            "radius": self._reach.occlusion_radius,
            "largest_radius": self._reach.largest_occlusion,
            "focal": camera.focal_length_px(view.width),
        }
        around = gl_rectangle(grown(rectangle, 5, view), view)
        self._occlusion.run(targets.occlusion, around, depth | normals, common | occlusion)
        self._blur.run(targets.smooth_occlusion, near, depth | {"noisy": targets.occlusion.colors[0]}, common)
        sky_table = self._gl.texture((sky.table.shape[1], sky.table.shape[0]), 3, sky.table.tobytes(), dtype="f4")
        sky_table.filter = (moderngl.LINEAR, moderngl.LINEAR)
        sky_table.repeat_x = sky_table.repeat_y = False
        caster = movable_shadow or static_shadow
        red, green, blue, open_sky = targets.skylight.colors
        self._shade.run(
            targets.radiance,
            gl_rectangle(grown(rectangle, 1, view), view, SAMPLES),
            {
                **depth,
                **normals,
                "albedo_map": surfaces.colors[0],
                "material_map": surfaces.colors[2],
                "material_table": table,
                "sky_table": sky_table,
                "skylight_red": red,
                "skylight_green": green,
                "skylight_blue": blue,
                "skylight_open": open_sky,
                "occlusion_map": targets.smooth_occlusion.colors[0],
                "static_shadow": static_shadow.texture,
                "movable_shadow": caster.texture,
            },
            common
            | {
                "light_rows": static_shadow.light.rows,
                "static_origin": static_shadow.light.origin,
                "static_extent": static_shadow.light.extent,
                "movable_origin": caster.light.origin,
                "movable_extent": caster.light.extent,
                "has_movables": movable_shadow is not None,
                "sun_spread": float(np.tan(scene.sun.angular_diameter / 2)),
                "sun_angle": scene.sun.angular_diameter / 2,
                "largest_penumbra": LARGEST_PENUMBRA,
                "shadow_distance": SHADOW_DISTANCE,
                "toward_sun": sky.sun_direction,
                "sun": sky.sun,
                "haze": sky.haze,
                "ground": sky.ground,
                "street": street_by_sky + street_by_sun * 0.4,
                "extinction": sky.extinction,
            },
        )
        sky_table.release()
        area = gl_rectangle(rectangle, view)
        self._resolve.run(targets.pixels, area, {"radiance": targets.radiance.colors[0]}, {})
        data = targets.pixels.framebuffer.read(viewport=area, components=3, dtype="f2", alignment=1)
        rows = np.frombuffer(data, np.float16).reshape(rectangle.height, rectangle.width, 3)
        return np.ascontiguousarray(rows[::-1])

    def release(self) -> None:
        """Free the passes."""
        for screen_pass in (self._skylight, self._occlusion, self._blur, self._shade, self._resolve):
            screen_pass.release()


def _sample_values(camera: Camera, view: View) -> dict[str, Any]:
    """Uniforms of ``sample.glsl``."""
    focal = camera.focal_length_px(view.width)
    axes = camera.transform[:3, :3]
    basis = np.stack([axes[:, 0] * view.width / 2 / focal, axes[:, 1] * view.height / 2 / focal, -axes[:, 2]], axis=1)
    return {
        "sample_size": (view.width * SAMPLES, view.height * SAMPLES),
        "near_far": (camera.near, camera.far),
        "eye": camera.position,
        "ray_basis": basis,
    }
