"""Shading of a G-buffer over parts of the image: sky light, ambient occlusion, sun, reflections, haze and antialiasing."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import View
from valerie.rendering.beams import DIPPED
from valerie.rendering.raster.gl.bounds import Reach
from valerie.rendering.raster.gl.targets import (
    SAMPLES,
    SKYLIGHT_CELL,
    ImageTargets,
    RenderTarget,
    ScreenPass,
)
from valerie.rendering.raster.gl.tiles import Spans
from valerie.rendering.raster.gl.uniforms import Sampled, Uniform, Uniforms
from valerie.rendering.raster.light.lamp_reach import LAMP_MAP, LAMP_TILES, MOVING_TILES
from valerie.rendering.raster.light.lamplight import LAMP_ACROSS, LampLight
from valerie.rendering.raster.light.pane_image import PaneImage
from valerie.rendering.raster.light.panorama import Panorama
from valerie.rendering.raster.light.shadows import (
    LARGEST_PENUMBRA,
    NO_COLUMN,
    SHADOW_DISTANCE,
    SKY_TILES,
    MovableShadows,
    ShadowMap,
    SkyMaps,
)
from valerie.rendering.raster.upload.drawing import table_texture
from valerie.rendering.raster.upload.nearby import nearby
from valerie.rendering.raster.upload.surroundings import from_below, reflected, sky_weights, snowed
from valerie.rendering.sky import Sky
from valerie.rendering.snowfall import FLAKE_VIEW, chance
from valerie.scene.graph.model import Camera, Sun

if TYPE_CHECKING:
    from valerie.rendering.raster.upload.context import GraphicsContext
    from valerie.rendering.raster.upload.scenes import Statics

#: Features of the shading pass besides sun and sky, as symbols of its shader.
Need = Literal["LAMPS", "DIPPED", "MOVING_LAMPS", "MOVABLES", "RAIN", "SNOW", "LEAVES", "FLAKES", "RECEIVED", "PLAIN"]
#: Features that change materials or the air, not the light that arrives.
_WEATHER: Final[frozenset[Need]] = frozenset({"RAIN", "SNOW", "LEAVES", "FLAKES"})


class SkyLight:
    """The light of one sky and its sun, with the light that a scene's statics reflect.

    Attributes:
        table: the sky's radiance, for `lighting.frag`.
        hidden, weights: see `sky_weights`.
        near, near_values: table of `nearby`, its layers one above the other, and the uniforms that place it.
        hiding: radiance of the surfaces that hide the sky in each direction, for `lighting.frag`.
        ground: (3,) radiance of the ground.
        on_walls: (3,) see `Reflected`.
    """

    def __init__(self, gl: moderngl.Context, statics: Statics, sky_maps: SkyMaps, sky: Sky) -> None:
        self.table = gl.texture((sky.table.shape[1], sky.table.shape[0]), 3, sky.table.tobytes(), dtype="f4")
        self.table.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.table.repeat_x = self.table.repeat_y = False
        directions, sample = sky_maps.directions, statics.geometry.sample
        light = reflected(
            sample,
            sky_maps.openness,
            sky_maps.prominence,
            directions,
            snowed(statics.albedo[sample.rows], sample.normals[:, 2], statics.table[sample.rows, 4, 3], sky.snow_depth),
            statics.share,
            sky,
        )
        self.hidden, self.weights = sky_weights(sky, directions, light.hidden, light.ground)
        self.hiding = gl.texture((len(directions), 1), 3, light.hidden.astype(np.float32).tobytes(), dtype="f4")
        self.hiding.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.ground, self.on_walls = light.ground, light.on_walls
        geometry = statics.geometry
        shares = statics.share[sample.rows] * sky_maps.openness.any(axis=1)
        near = nearby(sample, shares, light, directions, np.stack([geometry.core_low, geometry.core_high]))
        layers, up, along, across, _ = near.table.shape
        self.near = gl.texture3d((across, along, layers * up), 4, near.table.tobytes(), dtype="f4")
        self.near.repeat_x = self.near.repeat_y = self.near.repeat_z = False
        self.near_values: Uniforms = {"near_low": near.low, "near_size": near.size}

    def release(self) -> None:
        """Free the textures."""
        for texture in (self.table, self.hiding, self.near):
            texture.release()


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """The surfaces to light.

    Attributes:
        statics: G-buffer of the scene without its movables.
        materials: material table of the scene.
        panorama: what smooth surfaces mirror; None if no image is made.
        pane: what the largest plane of panes mirrors; None if it mirrors the panorama.
    """

    statics: RenderTarget
    materials: moderngl.Texture
    panorama: Panorama | None
    pane: PaneImage | None = None


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """The camera of a frame and the size of its image."""

    camera: Camera
    view: View

    @property
    def ray_basis(self) -> NDArray[np.float64]:
        """Right and up at the image's edge, and forward, at depth 1: the columns of a (3, 3) matrix."""
        focal = self.camera.focal_length_px(self.view.width)
        right, up, back = self.camera.transform[:3, :3].T
        return np.stack([right * self.view.width / 2 / focal, up * self.view.height / 2 / focal, -back], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Daylight:
    """Sun and sky of a frame.

    Attributes:
        sun: the scene's sun.
        sky: radiance of sun and sky.
        maps: visibility of the sky from each place.
        light: light of this sky, with the light that the statics reflect.
        shadow: shadow map of the statics.
    """

    sun: Sun
    sky: Sky
    maps: SkyMaps
    light: SkyLight
    shadow: ShadowMap


class Lighting:
    """The screen passes.

    Args:
        context: the GL context; it must be current in every call.
        reach: reach of ambient occlusion. The bound of a layer's rectangle must use the same numbers.
    """

    def __init__(self, context: GraphicsContext, reach: Reach) -> None:
        gl = context.gl
        self._gl = gl
        self._reach = reach
        directions = SKY_TILES[0] * SKY_TILES[1]
        sky = {"DIRECTIONS": directions, "SKYLIGHT_CELL": SKYLIGHT_CELL}
        movables = {"MOVABLES": 1, "NO_COLUMN": NO_COLUMN}
        self.openness, self.cover, self.skylight, self.occlusion, self.contact = (
            ScreenPass(gl, context.program("screen.vert", f"{name}.frag", **defines))
            for name, defines in (
                ("openness", sky),
                ("openness", sky | movables),
                ("skylight", sky),
                ("occlusion", {}),
                ("occlusion", movables),
            )
        )
        self.blur = ScreenPass(gl, context.program("screen.vert", "blur.frag"))
        self.plain = ScreenPass(gl, context.program("screen.vert", "plain.frag"))
        self.detail = ScreenPass(gl, context.program("screen.vert", "detail.frag"))
        self.resolve = ScreenPass(gl, context.program("screen.vert", "resolve.frag"))
        self._context = context
        self._shading: dict[tuple[str, ...], ScreenPass] = {}

    def _shade(self, kind: Set[Need]) -> ScreenPass:
        """Return the shading pass with these features. It is compiled at first use.

        There is a program per set of features, since a CPU rasteriser executes unused branches too.
        """
        key = tuple(sorted(kind))
        if key not in self._shading:
            defines: dict[str, int] = {
                "SKYLIGHT_CELL": SKYLIGHT_CELL,
                **dict.fromkeys(key, 1),
            }
            if "LAMPS" in kind:
                defines |= {"LAMP_TILES": LAMP_TILES, "MOVING_TILES": MOVING_TILES}
                defines |= {"LAMP_MAP": LAMP_MAP, "LAMP_ACROSS": LAMP_ACROSS}
            program = self._context.program("screen.vert", "lighting.frag", **defines)
            self._shading[key] = ScreenPass(self._gl, program)
        return self._shading[key]

    def receive(self, frame: LitFrame, target: RenderTarget, parts: Spans) -> None:
        """Compute the light that arrives on surfaces, before materials, over parts of ``target``, one sample per pixel.

        The inputs of `LitFrame.shade` must be valid around these parts, except those of plain pixels.
        """
        shade = frame.shade_detail
        self._shade(frame.needs - _WEATHER | {"RECEIVED"}).run(target, parts, shade.textures, shade.values)

    def bind(
        self,
        targets: ImageTargets,
        surfaces: Surfaces,
        viewpoint: Viewpoint,
        day: Daylight,
        movables: MovableShadows | None = None,
        lamps: LampLight | None = None,
    ) -> LitFrame:
        """Bind the passes to their inputs for one frame.

        Args:
            targets: the targets of the image; `ImageTargets.surfaces` holds the G-buffer with the movables.
            surfaces: the surfaces to light.
            viewpoint: the camera and the size of its image.
            day: sun and sky.
            movables: shadow maps of the movables; None without movables.
            lamps: light of the lamps; None if no lamp is on.
        """
        camera = _sample_values(viewpoint)
        movable_shadow, columns = (None, None) if movables is None else (movables.sun, movables.columns)
        textures = _shading_textures(targets, surfaces, day, movable_shadow)
        values: dict[str, Uniform] = {
            **camera,
            **_shading_values(viewpoint, day, movable_shadow),
            "screen_basis": np.linalg.inv(viewpoint.ray_basis),
        }
        if surfaces.panorama is not None:
            textures["panorama"] = surfaces.panorama.texture
            values["panorama_spot"] = surfaces.panorama.spot
            values["panorama_known"] = float(surfaces.panorama.known)
            # A sampler needs a texture of its type even if it is not read.
            textures["pane_image"] = surfaces.materials if surfaces.pane is None else surfaces.pane.texture
            values |= {"pane_near": 0.0} if surfaces.pane is None else surfaces.pane.values
        owned: tuple[moderngl.Texture, ...] = ()
        bounce: NDArray[np.float64] | None = None
        if lamps is not None:
            table = table_texture(self._gl, lamps.table())
            owned = (table,)
            textures |= _lamp_textures(lamps, table)
            values.update(_lamp_values(lamps))
            bounce = lamps.bounce
        values["below"] = day.light.ground if bounce is None else day.light.ground + bounce
        values["flake_light"] = day.sky.haze if lamps is None else day.sky.haze + FLAKE_VIEW * lamps.falling
        needs = _needs(day.sky, movables, lamps)
        samples = _sample_textures(targets)
        geometry = {name: samples[name] for name in ("depth_map", "normals_map")}
        standing: Mapping[str, Sampled] = geometry
        placed: Uniforms = {}
        if columns is not None:
            standing = {**geometry, "columns": columns.texture, "mirror_depth": textures["mirror_depth"]}
            placed = columns.values
        depth = {"depth_map": samples["depth_map"]}
        first, second = targets.openness.colors
        plain_names = ("albedo_map", "normals_map", "material_map", "plain_depth")
        plain = dict(zip(plain_names, targets.plain.colors, strict=True))
        radiance = {"radiance": targets.radiance.colors[0], "plain_radiance": targets.plain_radiance.colors[0]}
        return LitFrame(
            occlusion=_Step(
                self.occlusion if columns is None else self.contact,
                targets.occlusion,
                standing,
                {**camera, **self._occlusion_values(viewpoint), **placed},
            ),
            smooth=_Step(self.blur, targets.smooth_occlusion, depth | {"noisy": targets.occlusion.colors[0]}, camera),
            openness=_Step(
                self.openness if columns is None else self.cover,
                targets.openness,
                {**standing, "atlas": day.maps.texture},
                {**camera, **_openness_values(day.maps), **placed},
            ),
            skylight=_Step(
                self.skylight,
                targets.skylight,
                geometry | {"first": first, "second": second, "near": day.light.near},
                {**camera, **_skylight_values(day.light, bounce)},
            ),
            plain=_Step(self.plain, targets.plain, samples, camera),
            detail=_Step(
                self.detail, targets.detail, {"plain_albedo": plain["albedo_map"]}, {}, samples=SAMPLES, depth="written"
            ),
            shade_plain=_Step(self._shade(needs | {"PLAIN"}), targets.plain_radiance, textures | plain, values),
            shade_detail=_Step(self._shade(needs), targets.radiance, textures, values, samples=SAMPLES, depth="tested"),
            resolve=_Step(self.resolve, targets.pixels, radiance, {}),
            owned=owned,
            movable_shadow=movable_shadow,
            needs=needs,
        )

    def _occlusion_values(self, viewpoint: Viewpoint) -> Uniforms:
        return {
            "radius": self._reach.occlusion_radius,
            "largest_radius": self._reach.largest_occlusion,
            "focal": viewpoint.camera.focal_length_px(viewpoint.view.width),
            "contact_reach": (self._reach.contact_radius, self._reach.contact_rise),
        }

    def release(self) -> None:
        """Free the passes."""
        for screen_pass in (
            self.openness, self.cover, self.skylight, self.occlusion, self.contact, self.blur, self.plain, self.detail,
            self.resolve, *self._shading.values(),
        ):  # fmt: skip
            screen_pass.release()


@dataclass(frozen=True, slots=True)
class _Step:
    """A pass with its target and inputs. ``samples`` is the number of texels per pixel and direction. See `ScreenPass.run`."""

    screen_pass: ScreenPass
    target: RenderTarget
    textures: Mapping[str, Sampled]
    values: Uniforms
    samples: int = 1
    depth: Literal["ignored", "written", "tested"] = "ignored"

    def run(self, parts: Spans) -> None:
        self.screen_pass.run(self.target, parts * self.samples, self.textures, self.values, depth=self.depth)


@dataclass(frozen=True, slots=True)
class LitFrame:
    """The passes of one frame in their order. Each runs over parts of the image (`Spans`).

    A pixel depends on its position in the image and its neighbourhood, never on the parts. A pass reads the results of earlier
    passes within 2 pixels.
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
        """Compute the visibility of the sky in the cells that touch the parts."""
        self.openness.run(_cells(parts))

    def light_sky(self, parts: Spans) -> None:
        """Compute the sky light of the cells that touch the parts."""
        self.skylight.run(_cells(parts))

    def classify(self, parts: Spans) -> None:
        """Separate plain pixels from the others."""
        self.plain.run(parts)
        self.detail.run(parts)

    def shade(self, parts: Spans) -> None:
        """Compute the radiance of plain pixels, and of each sample of the other pixels."""
        self.shade_plain.run(parts)
        self.shade_detail.run(parts)

    def release(self) -> None:
        """Free the textures that only this frame uses."""
        for texture in self.owned:
            texture.release()


def _cells(parts: Spans) -> Spans:
    samples = parts * SAMPLES
    return np.concatenate([samples[:, :2] // SKYLIGHT_CELL, -(-samples[:, 2:] // SKYLIGHT_CELL)], axis=1)


def _sample_values(viewpoint: Viewpoint) -> Uniforms:
    """Return the uniforms of ``sample.glsl``."""
    camera, view = viewpoint.camera, viewpoint.view
    return {
        "sample_size": (view.width * SAMPLES, view.height * SAMPLES),
        "near_far": (camera.near, camera.far),
        "eye": camera.position,
        "ray_basis": viewpoint.ray_basis,
    }


def _sample_textures(targets: ImageTargets) -> dict[str, moderngl.Texture]:
    surfaces = targets.surfaces
    assert surfaces.depth is not None
    albedo, normals, material = surfaces.colors
    return {"depth_map": surfaces.depth, "normals_map": normals, "albedo_map": albedo, "material_map": material}


def _openness_values(maps: SkyMaps) -> Uniforms:
    return {"tiles": SKY_TILES, "tile_rows": maps.rows.reshape(-1), "tile_extents": maps.extents.reshape(-1)}


def _skylight_values(light: SkyLight, bounce: NDArray[np.float64] | None) -> Uniforms:
    """Return the uniforms of the sky light. ``bounce`` is the radiance of the ground by lamps."""
    hidden = light.hidden.copy()
    if bounce is not None:
        hidden[:3] += from_below(bounce)
    return {"hidden": hidden.reshape(-1), "weights": light.weights.reshape(-1), **light.near_values}


def _shading_textures(
    targets: ImageTargets, surfaces: Surfaces, day: Daylight, movable_shadow: ShadowMap | None
) -> dict[str, Sampled]:
    statics = surfaces.statics
    assert statics.depth is not None
    assert day.shadow.casters is not None
    first, second = targets.openness.colors
    red, green, blue, zonal = targets.skylight.colors
    return {
        **_sample_textures(targets),
        "material_table": surfaces.materials,
        "sky_table": day.light.table,
        "skylight_red": red,
        "skylight_green": green,
        "skylight_blue": blue,
        "skylight_zonal": zonal,
        "openness_first": first,
        "openness_second": second,
        "nearest_directions": day.maps.nearest,
        "direction_shares": day.maps.shares,
        "hiding": day.light.hiding,
        "occlusion_map": targets.smooth_occlusion.colors[0],
        "static_shadow": day.shadow.texture,
        "static_casters": day.shadow.casters,
        "movable_shadow": (movable_shadow or day.shadow).texture,
        "moving_albedo": targets.surfaces.colors[0],
        "moving_material": targets.surfaces.colors[2],
        "mirror_albedo": statics.colors[0],
        "mirror_material": statics.colors[2],
        "mirror_depth": statics.depth,
    }


def _shading_values(viewpoint: Viewpoint, day: Daylight, movable_shadow: ShadowMap | None) -> Uniforms:
    sky, static, movable = day.sky, day.shadow.light, (movable_shadow or day.shadow).light
    return {
        "light_rows": static.rows,
        "static_origin": static.origin,
        "static_extent": static.extent,
        "movable_origin": movable.origin,
        "movable_extent": movable.extent,
        "sun_spread": float(np.tan(day.sun.angular_diameter / 2)),
        "sun_angle": day.sun.angular_diameter / 2,
        "largest_penumbra": LARGEST_PENUMBRA,
        "shadow_distance": SHADOW_DISTANCE,
        "toward_sun": sky.sun_direction,
        "sun": sky.sun,
        "haze": sky.haze,
        "ground": sky.ground,
        "mirrored_light": day.light.on_walls,
        "extinction": sky.extinction,
        "wetness": sky.wetness,
        "drops": sky.drops,
        "flakes": chance(sky.flakes),
        "focal": viewpoint.camera.focal_length_px(viewpoint.view.width) * SAMPLES,
        "snow_depth": sky.snow_depth,
        "leaf_litter": sky.leaf_litter,
        "pixel_height": viewpoint.view.height,
    }


def _lamp_textures(lamps: LampLight, table: moderngl.Texture) -> dict[str, moderngl.Texture]:
    return {
        "lamp_table": table,
        "static_lamps": lamps.static.texture,
        "moving_lamps": (lamps.moving or lamps.static).texture,
        "movable_lamps": (lamps.movable or lamps.static).texture,
    }


def _lamp_values(lamps: LampLight) -> Uniforms:
    return {
        "lamp_count": len(lamps.lamps),
        "lamp_clip": lamps.matrices(),
        "dipped_spread": DIPPED.spread,
        "dipped_cut_off": (DIPPED.rise, DIPPED.edge, DIPPED.stray),
    }


def _needs(sky: Sky, movables: MovableShadows | None, lamps: LampLight | None) -> frozenset[Need]:
    """Return the features of the shading pass that a frame needs."""
    features: dict[Need, bool] = {
        "LAMPS": lamps is not None,
        "DIPPED": lamps is not None and lamps.dipped,
        "MOVING_LAMPS": lamps is not None and lamps.moving is not None,
        "MOVABLES": movables is not None,
        "RAIN": sky.wetness > 0 or sky.drops > 0,
        "SNOW": sky.snow_depth > 0,
        "LEAVES": sky.leaf_litter > 0,
        "FLAKES": sky.flakes > 0,
    }
    return frozenset(feature for feature, needed in features.items() if needed)
