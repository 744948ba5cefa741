"""From a G-buffer to pixels: sky light, near occlusion, sun, reflections, air, antialiasing; over parts of the image."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import moderngl
import numpy as np

from valerie.rendering.base import View
from valerie.rendering.beams import DIPPED
from valerie.rendering.raster.bounds import Reach
from valerie.rendering.raster.drawing import table_texture
from valerie.rendering.raster.lamp_reach import LAMP_MAP, LAMP_TILES, MOVING_TILES
from valerie.rendering.raster.lamplight import LAMP_ACROSS, LampLight
from valerie.rendering.raster.shadows import LARGEST_PENUMBRA, SHADOW_DISTANCE, SKY_TILES, ShadowMap, SkyMaps
from valerie.rendering.raster.surroundings import from_below, reflected, sky_weights
from valerie.rendering.raster.targets import (
    SAMPLES,
    SKYLIGHT_CELL,
    ImageTargets,
    ScreenPass,
    Target,
)
from valerie.rendering.raster.tiles import Spans
from valerie.rendering.sky import Sky
from valerie.scene.graph.model import Camera, Scene

if TYPE_CHECKING:
    from valerie.rendering.raster.context import GraphicsContext
    from valerie.rendering.raster.scenes import Statics

#: What a frame may need of the shading pass beside sun and sky, and what is shaded: symbols of its shader.
Need = Literal["LAMPS", "DIPPED", "MOVING_LAMPS", "MOVABLES", "RAIN", "RECEIVED", "PLAIN"]


class SkyLight:
    """Light of one sky and its sun, and of what a scene's statics give back of it.

    Attributes:
        table: the sky's radiance, for `lighting.frag`.
        hidden, weights: see `sky_weights`.
        hiding: radiance of what hides the sky in each direction, for `lighting.frag`.
        ground: (3,) radiance of the ground.
        on_walls: (3,) see `Reflected`.
    """

    def __init__(self, gl: moderngl.Context, statics: Statics, sky_maps: SkyMaps, sky: Sky) -> None:
        self.table = gl.texture((sky.table.shape[1], sky.table.shape[0]), 3, sky.table.tobytes(), dtype="f4")
        self.table.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.table.repeat_x = self.table.repeat_y = False
        directions, sample = sky_maps.directions, statics.geometry.sample
        back = reflected(sample, sky_maps.openness, sky_maps.prominence, directions, statics.albedo, statics.share, sky)
        self.hidden, self.weights = sky_weights(sky, directions, back.hidden, back.ground)
        self.hiding = gl.texture((len(directions), 1), 3, back.hidden.astype(np.float32).tobytes(), dtype="f4")
        self.hiding.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.ground, self.on_walls = back.ground, back.on_walls

    def release(self) -> None:
        """Free the textures."""
        self.table.release()
        self.hiding.release()


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
        self.openness, self.skylight = (
            ScreenPass(gl, context.program("screen.vert", name, DIRECTIONS=directions, SKYLIGHT_CELL=SKYLIGHT_CELL))
            for name in ("openness.frag", "skylight.frag")
        )
        self.occlusion = ScreenPass(gl, context.program("screen.vert", "occlusion.frag"))
        self.blur = ScreenPass(gl, context.program("screen.vert", "blur.frag"))
        self.plain = ScreenPass(gl, context.program("screen.vert", "plain.frag"))
        self.detail = ScreenPass(gl, context.program("screen.vert", "detail.frag"))
        self.resolve = ScreenPass(gl, context.program("screen.vert", "resolve.frag"))
        self._context = context
        self._shading: dict[tuple[str, ...], ScreenPass] = {}

    def _shade(self, kind: Set[Need]) -> ScreenPass:
        """The shading pass; each of its kinds is compiled when it is first needed.

        Args:
            kind: what it can do. What is not needed would cost nearly as much as what is: a CPU rasteriser leaves nothing out.
        """
        key = tuple(sorted(kind))
        if key not in self._shading:
            defines: dict[str, int] = {"SKYLIGHT_CELL": SKYLIGHT_CELL}
            defines |= dict.fromkeys(key, 1)
            if "LAMPS" in kind:
                defines |= {"LAMP_TILES": LAMP_TILES, "MOVING_TILES": MOVING_TILES}
                defines |= {"LAMP_MAP": LAMP_MAP, "LAMP_ACROSS": LAMP_ACROSS}
            program = self._context.program("screen.vert", "lighting.frag", **defines)
            self._shading[key] = ScreenPass(self._gl, program)
        return self._shading[key]

    def receive(self, frame: LitFrame, target: Target, parts: Spans) -> None:
        """Light before materials instead of the picture, over parts of ``target``, one sample per pixel.

        Needs what `LitFrame.shade` needs around these parts, but no plain pixels.
        """
        shade = frame.shade_detail
        self._shade(frame.needs - {"RAIN"} | {"RECEIVED"}).run(target, parts, shade.textures, shade.values)

    def inputs(
        self,
        targets: ImageTargets,
        statics: Target,
        table: moderngl.Texture,
        camera: Camera,
        view: View,
        scene: Scene,
        sky: Sky,
        sky_maps: SkyMaps,
        sky_light: SkyLight,
        static_shadow: ShadowMap,
        movable_shadow: ShadowMap | None,
        lamps: LampLight | None = None,
    ) -> LitFrame:
        """The passes with everything they read bound to them, for one frame; ``statics`` is the G-buffer without movables."""
        surfaces = targets.surfaces
        assert surfaces.depth is not None
        assert statics.depth is not None
        assert static_shadow.casters is not None
        common = _sample_values(camera, view)
        depth = {"depth_map": surfaces.depth}
        normals = {"normals_map": surfaces.colors[1]}
        samples = depth | normals | {"albedo_map": surfaces.colors[0], "material_map": surfaces.colors[2]}
        plain_maps = ("albedo_map", "normals_map", "material_map", "plain_depth")
        plain = dict(zip(plain_maps, targets.plain.colors, strict=True))
        openness = common | {
            "tiles": SKY_TILES,
            "tile_rows": sky_maps.rows.reshape(-1),
            "tile_extents": sky_maps.extents.reshape(-1),
        }
        hidden, below = sky_light.hidden.copy(), sky_light.ground
        if lamps is not None:
            hidden[:3] += from_below(lamps.bounce)
            below = below + lamps.bounce
        skylight = common | {"hidden": hidden.reshape(-1), "weights": sky_light.weights.reshape(-1)}
        occlusion = common | {
            "radius": self._reach.occlusion_radius,
            "largest_radius": self._reach.largest_occlusion,
            "focal": camera.focal_length_px(view.width),
        }
        caster = movable_shadow or static_shadow
        first, second = targets.openness.colors
        red, green, blue, zonal = targets.skylight.colors
        shade_textures = samples | {
            "material_table": table,
            "sky_table": sky_light.table,
            "skylight_red": red,
            "skylight_green": green,
            "skylight_blue": blue,
            "skylight_zonal": zonal,
            "openness_first": first,
            "openness_second": second,
            "nearest_directions": sky_maps.nearest,
            "direction_shares": sky_maps.shares,
            "hiding": sky_light.hiding,
            "occlusion_map": targets.smooth_occlusion.colors[0],
            "static_shadow": static_shadow.texture,
            "static_casters": static_shadow.casters,
            "movable_shadow": caster.texture,
            "mirror_albedo": statics.colors[0],
            "mirror_material": statics.colors[2],
            "mirror_depth": statics.depth,
        }
        shade = common | {
            "light_rows": static_shadow.light.rows,
            "static_origin": static_shadow.light.origin,
            "static_extent": static_shadow.light.extent,
            "movable_origin": caster.light.origin,
            "movable_extent": caster.light.extent,
            "sun_spread": float(np.tan(scene.sun.angular_diameter / 2)),
            "sun_angle": scene.sun.angular_diameter / 2,
            "largest_penumbra": LARGEST_PENUMBRA,
            "shadow_distance": SHADOW_DISTANCE,
            "toward_sun": sky.sun_direction,
            "sun": sky.sun,
            "haze": sky.haze,
            "ground": sky.ground,
            "below": below,
            "mirrored_light": sky_light.on_walls,
            "screen_basis": np.linalg.inv(common["ray_basis"]),
            "extinction": sky.extinction,
            "wetness": sky.wetness,
            "drops": sky.drops,
            "pixel_height": view.height,
        }
        owned: list[moderngl.Texture] = []
        if lamps is not None:
            owned.append(table_texture(self._gl, lamps.table()))
            shade_textures |= {
                "lamp_table": owned[-1],
                "static_lamps": lamps.static.texture,
                "moving_lamps": (lamps.moving or lamps.static).texture,
                "movable_lamps": (lamps.movable or lamps.static).texture,
            }
            shade |= {
                "lamp_count": len(lamps.lamps),
                "lamp_clip": lamps.matrices(),
                "dipped_spread": DIPPED.spread,
                "dipped_cut_off": (DIPPED.rise, DIPPED.edge, DIPPED.stray),
            }
        wanted: dict[Need, bool] = {
            "LAMPS": lamps is not None,
            "DIPPED": lamps is not None and lamps.dipped,
            "MOVING_LAMPS": lamps is not None and lamps.moving is not None,
            "MOVABLES": movable_shadow is not None,
            "RAIN": sky.wetness > 0 or sky.drops > 0,
        }
        needs = frozenset(need for need, there in wanted.items() if there)
        return LitFrame(
            occlusion=_Step(self.occlusion, targets.occlusion, depth | normals, occlusion),
            smooth=_Step(self.blur, targets.smooth_occlusion, depth | {"noisy": targets.occlusion.colors[0]}, common),
            openness=_Step(self.openness, targets.openness, depth | normals | {"atlas": sky_maps.texture}, openness),
            skylight=_Step(self.skylight, targets.skylight, depth | {"first": first, "second": second}, skylight),
            plain=_Step(self.plain, targets.plain, samples, common),
            detail=_Step(
                self.detail, targets.detail, {"plain_albedo": plain["albedo_map"]}, {}, samples=SAMPLES, depth="written"
            ),
            shade_plain=_Step(self._shade(needs | {"PLAIN"}), targets.plain_radiance, shade_textures | plain, shade),
            shade_detail=_Step(
                self._shade(needs), targets.radiance, shade_textures, shade, samples=SAMPLES, depth="tested"
            ),
            resolve=_Step(
                self.resolve,
                targets.pixels,
                {"radiance": targets.radiance.colors[0], "plain_radiance": targets.plain_radiance.colors[0]},
                {},
            ),
            owned=tuple(owned),
            movable_shadow=movable_shadow,
            needs=needs,
        )

    def release(self) -> None:
        """Free the passes."""
        for screen_pass in (
            self.openness, self.skylight, self.occlusion, self.blur, self.plain, self.detail, self.resolve,
            *self._shading.values(),
        ):  # fmt: skip
            screen_pass.release()


@dataclass(frozen=True, slots=True)
class _Step:
    """One pass with its target and inputs; ``samples`` texels of the target per pixel and direction; see `ScreenPass.run`."""

    screen_pass: ScreenPass
    target: Target
    textures: Mapping[str, moderngl.Texture]
    values: Mapping[str, Any]
    samples: int = 1
    depth: Literal["ignored", "written", "tested"] = "ignored"

    def run(self, parts: Spans) -> None:
        self.screen_pass.run(self.target, parts * self.samples, self.textures, self.values, depth=self.depth)


@dataclass(frozen=True, slots=True)
class LitFrame:
    """The passes of one frame, in order; each runs over parts of the image (`Spans`).

    Each pixel is a function of its place in the image and of what lies around it, never of the parts. A pass reads of the ones
    before what lies within 2 pixels of its own.
    """

    occlusion: _Step
    smooth: _Step
    openness: _Step
    skylight: _Step
    plain: _Step
    detail: _Step
    shade_plain: _Step
    shade_detail: _Step
    resolve: _Step
    owned: tuple[moderngl.Texture, ...]
    movable_shadow: ShadowMap | None
    needs: frozenset[Need]

    def open_sky(self, parts: Spans) -> None:
        """How open the sky is over the cells that touch the parts."""
        self.openness.run(_cells(parts))

    def light_sky(self, parts: Spans) -> None:
        """Sky light of the cells that touch the parts."""
        self.skylight.run(_cells(parts))

    def tell_plain(self, parts: Spans) -> None:
        """Tell plain pixels from the others."""
        self.plain.run(parts)
        self.detail.run(parts)

    def shade(self, parts: Spans) -> None:
        """Radiance of plain pixels, and of each sample of the others."""
        self.shade_plain.run(parts)
        self.shade_detail.run(parts)

    def release(self) -> None:
        """Free what belongs to this frame alone."""
        for texture in self.owned:
            texture.release()


def _cells(parts: Spans) -> Spans:
    samples = parts * SAMPLES
    return np.concatenate([samples[:, :2] // SKYLIGHT_CELL, -(-samples[:, 2:] // SKYLIGHT_CELL)], axis=1)


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
