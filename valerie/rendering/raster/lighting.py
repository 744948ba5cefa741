"""From a G-buffer to pixels: sky light, near occlusion, sun, reflections, air, antialiasing; over parts of the image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import moderngl
import numpy as np

from valerie.rendering.base import View
from valerie.rendering.raster.bounds import Reach
from valerie.rendering.raster.drawing import table_texture
from valerie.rendering.raster.lamp_reach import LAMP_MAP, LAMP_TILES
from valerie.rendering.raster.lamplight import ATLAS, LampLight
from valerie.rendering.raster.shadows import LARGEST_PENUMBRA, SHADOW_DISTANCE, SKY_TILES, ShadowMap, SkyMaps
from valerie.rendering.raster.targets import (
    SAMPLES,
    SKYLIGHT_CELL,
    ImageTargets,
    ScreenPass,
    Target,
)
from valerie.rendering.raster.tiles import Spans
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
        self.skylight = ScreenPass(
            gl, context.program("screen.vert", "skylight.frag", DIRECTIONS=directions, SKYLIGHT_CELL=SKYLIGHT_CELL)
        )
        self.occlusion = ScreenPass(gl, context.program("screen.vert", "occlusion.frag"))
        self.blur = ScreenPass(gl, context.program("screen.vert", "blur.frag"))
        self.resolve = ScreenPass(gl, context.program("screen.vert", "resolve.frag"))
        self._context = context
        self._shading: dict[tuple[bool, bool], ScreenPass] = {}

    def _shade(self, *, lamps: bool, received: bool = False) -> ScreenPass:
        """The shading pass; each of its kinds is compiled when it is first needed.

        Args:
            lamps: with lamplight, which costs too much to be carried along by day.
            received: light before materials instead of the picture.
        """
        if (lamps, received) not in self._shading:
            defines = {"SKYLIGHT_CELL": SKYLIGHT_CELL}
            if lamps:
                defines |= {"LAMPS": 1, "LAMP_TILES": LAMP_TILES, "LAMP_MAP": LAMP_MAP, "LAMP_ACROSS": ATLAS[0]}
            if received:
                defines["RECEIVED"] = 1
            program = self._context.program("screen.vert", "lighting.frag", **defines)
            self._shading[lamps, received] = ScreenPass(self._gl, program)
        return self._shading[lamps, received]

    def receive(self, frame: LitFrame, target: Target, parts: Spans) -> None:
        """Light before materials instead of the picture, over parts of ``target``, one sample per pixel.

        Needs what `LitFrame.shade` needs around these parts.
        """
        shade = frame.shade
        self._shade(lamps="lamp_table" in shade.textures, received=True).run(
            target, parts, shade.textures, shade.values
        )

    def inputs(
        self,
        targets: ImageTargets,
        table: moderngl.Texture,
        camera: Camera,
        view: View,
        scene: Scene,
        sky: Sky,
        sky_maps: SkyMaps,
        static_shadow: ShadowMap,
        movable_shadow: ShadowMap | None,
        lamps: LampLight | None = None,
    ) -> LitFrame:
        """The passes with everything they read bound to them, for one frame."""
        surfaces = targets.surfaces
        assert surfaces.depth is not None
        common = _sample_values(camera, view)
        depth = {"depth_map": surfaces.depth}
        normals = {"normals_map": surfaces.colors[1]}
        street_by_sky = _STREET_ALBEDO * sky.sky_irradiance * 0.7
        # Of the surfaces that face the sun, about half lie in the shadow of others.
        street_by_sun = _STREET_ALBEDO * sky.sun * 0.6
        skylight = common | {
            "tiles": SKY_TILES,
            "tile_rows": sky_maps.rows.reshape(-1),
            "directions": sky_maps.directions.reshape(-1),
            "sky_radiance": sky.radiance(sky_maps.directions).reshape(-1),
            "toward_sun": sky.sun_direction,
            "surface_by_sky": street_by_sky,
            "surface_by_sun": street_by_sun,
            "ground": sky.ground * 0.8 if lamps is None else sky.ground * 0.8 + lamps.bounce,
        }
        occlusion = common | {
            "radius": self._reach.occlusion_radius,
            "largest_radius": self._reach.largest_occlusion,
            "focal": camera.focal_length_px(view.width),
        }
        sky_table = self._gl.texture((sky.table.shape[1], sky.table.shape[0]), 3, sky.table.tobytes(), dtype="f4")
        sky_table.filter = (moderngl.LINEAR, moderngl.LINEAR)
        sky_table.repeat_x = sky_table.repeat_y = False
        caster = movable_shadow or static_shadow
        red, green, blue, open_sky = targets.skylight.colors
        shade_textures = {
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
        }
        shade = common | {
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
            "wetness": sky.wetness,
            "drops": sky.drops,
            "pixel_height": view.height,
        }
        owned = [sky_table]
        if lamps is not None:
            owned.append(table_texture(self._gl, lamps.table()))
            moving = lamps.movable or lamps.static
            shade_textures |= {
                "lamp_table": owned[-1],
                "static_lamps": lamps.static.texture,
                "movable_lamps": moving.texture,
            }
            shade |= {"lamp_count": len(lamps.lamps), "lamp_clip": lamps.matrices()}
        return LitFrame(
            occlusion=_Step(self.occlusion, targets.occlusion, depth | normals, occlusion),
            smooth=_Step(self.blur, targets.smooth_occlusion, depth | {"noisy": targets.occlusion.colors[0]}, common),
            skylight=_Step(self.skylight, targets.skylight, {**depth, **normals, "atlas": sky_maps.texture}, skylight),
            shade=_Step(self._shade(lamps=lamps is not None), targets.radiance, shade_textures, shade, samples=SAMPLES),
            resolve=_Step(self.resolve, targets.pixels, {"radiance": targets.radiance.colors[0]}, {}),
            owned=tuple(owned),
            movable_shadow=movable_shadow,
        )

    def release(self) -> None:
        """Free the passes."""
        for screen_pass in (self.skylight, self.occlusion, self.blur, self.resolve, *self._shading.values()):
            screen_pass.release()


@dataclass(frozen=True, slots=True)
class _Step:
    """One pass with its target and inputs; ``samples`` texels of the target per pixel and direction."""

    screen_pass: ScreenPass
    target: Target
    textures: Mapping[str, moderngl.Texture]
    values: Mapping[str, Any]
    samples: int = 1

    def run(self, parts: Spans) -> None:
        self.screen_pass.run(self.target, parts * self.samples, self.textures, self.values)


@dataclass(frozen=True, slots=True)
class LitFrame:
    """The passes of one frame, in order; each runs over parts of the image (`Spans`).

    Each pixel is a function of its place in the image and of what lies around it, never of the parts. A pass reads of the ones
    before what lies within 2 pixels of its own.
    """

    occlusion: _Step
    smooth: _Step
    skylight: _Step
    shade: _Step
    resolve: _Step
    owned: tuple[moderngl.Texture, ...]
    movable_shadow: ShadowMap | None

    def light_sky(self, parts: Spans) -> None:
        """Sky light of the cells that touch the parts."""
        cells = parts * SAMPLES
        cells = np.concatenate([cells[:, :2] // SKYLIGHT_CELL, -(-cells[:, 2:] // SKYLIGHT_CELL)], axis=1)
        self.skylight.run(cells)

    def release(self) -> None:
        """Free what belongs to this frame alone."""
        for texture in self.owned:
            texture.release()


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
