"""Render targets (textures and framebuffers), and screen passes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

import moderngl
import numpy as np

from valerie.rendering.base import Rectangle, View
from valerie.rendering.raster.gl.tiles import Area, Spans
from valerie.rendering.raster.gl.uniforms import Sampled, Uniforms, bind, set_uniforms

#: Samples per pixel and direction of the image. The truth has one sample, at the pixel's centre.
SAMPLES: Final = 2
#: Samples per direction that share one value of sky light, which varies slowly.
SKYLIGHT_CELL: Final = 4


class RenderTarget:
    """A framebuffer with its textures.

    Args:
        gl: the current context.
        size: (width, height) in texels.
        formats: (components, dtype) per colour attachment, in moderngl's notation.
        depth: True for a depth texture of its own, False for none, or the depth texture of another target to share.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        size: tuple[int, int],
        formats: tuple[tuple[int, str], ...],
        *,
        depth: bool | moderngl.Texture,
    ) -> None:
        self.size = size
        self.colors: list[moderngl.Texture] = []
        for components, dtype in formats:
            texture = gl.texture(size, components, dtype=dtype)
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            self.colors.append(texture)
        self._owns_depth = depth is True
        self.depth: moderngl.Texture | None = None
        if isinstance(depth, moderngl.Texture):
            self.depth = depth
        elif depth:
            self.depth = gl.depth_texture(size)
            self.depth.compare_func = ""
            self.depth.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.framebuffer: moderngl.Framebuffer = gl.framebuffer(self.colors, self.depth)

    def use(self, rectangle: tuple[int, int, int, int] | None = None) -> None:
        """Draw into this target from now on, and only inside ``rectangle`` (x, y, width, height from the bottom left) if any."""
        self.framebuffer.scissor = rectangle  # type: ignore[assignment]  # the stubs lack None, which means the whole
        self.framebuffer.use()

    def clear(self, depth: float = 1.0) -> None:
        """Set all colours to zero and the depth to ``depth`` inside the scissor rectangle."""
        self.framebuffer.clear(depth=depth)

    def clear_colors(self) -> None:
        """Set all colours to zero inside the scissor rectangle, and keep the depth."""
        self.framebuffer.depth_mask = False
        self.framebuffer.clear()
        self.framebuffer.depth_mask = True

    def release(self) -> None:
        """Free framebuffer and textures."""
        self.framebuffer.release()
        for texture in self.colors:
            texture.release()
        if self.depth is not None and self._owns_depth:
            self.depth.release()


class ImageTargets:
    """The targets of one image size: G-buffer with movables, openness, sky light, occlusion, radiance, pixels.

    ``moving`` holds the movables' samples before texturing and shares the depth of the G-buffer. ``plain`` is the G-buffer of
    plain pixels. ``detail`` is the depth that masks their samples in ``radiance``.
    """

    def __init__(self, gl: moderngl.Context, view: View) -> None:
        size = (view.width, view.height)
        fine = (view.width * SAMPLES, view.height * SAMPLES)
        self.surfaces = surface_target(gl, view)
        assert self.surfaces.depth is not None
        self.moving = RenderTarget(gl, fine, ((2, "f4"), (4, "nu2"), (2, "u2")), depth=self.surfaces.depth)
        coarse = (-(-fine[0] // SKYLIGHT_CELL), -(-fine[1] // SKYLIGHT_CELL))
        self.openness = RenderTarget(gl, coarse, ((4, "u4"),) * 2, depth=False)
        self.skylight = RenderTarget(gl, coarse, ((4, "f2"),) * 4, depth=False)
        self.occlusion = RenderTarget(gl, size, ((1, "f1"),), depth=False)
        self.smooth_occlusion = RenderTarget(gl, size, ((1, "f1"),), depth=False)
        self.plain = RenderTarget(gl, size, ((4, "f1"), (4, "nu2"), (2, "u2"), (1, "f4")), depth=False)
        self.plain_radiance = RenderTarget(gl, size, ((4, "f2"),), depth=False)
        self.detail = RenderTarget(gl, fine, (), depth=True)
        self.radiance = RenderTarget(gl, fine, ((4, "f2"),), depth=self.detail.depth or False)
        self.pixels = RenderTarget(gl, size, ((4, "f2"),), depth=False)

    def release(self) -> None:
        """Free all targets."""
        for target in (
            self.moving, self.surfaces, self.openness, self.skylight, self.occlusion, self.smooth_occlusion, self.plain,
            self.plain_radiance, self.radiance, self.detail, self.pixels,
        ):  # fmt: skip
            target.release()


def surface_target(gl: moderngl.Context, view: View) -> RenderTarget:
    """Create a G-buffer: albedo, normals, material row with the factors of its roughness texture, depth."""
    fine = (view.width * SAMPLES, view.height * SAMPLES)
    return RenderTarget(gl, fine, ((4, "f1"), (4, "nu2"), (2, "u2")), depth=True)


def area_of(rectangle: Rectangle, view: View, samples: int = 1) -> Area:
    """Return the area of a rectangle of the image, in samples."""
    bottom = view.height - rectangle.y - rectangle.height
    return Area(rectangle.x, bottom, rectangle.width, rectangle.height).scaled(samples)


class ScreenPass:
    """A fragment shader that runs over parts of a target."""

    def __init__(self, gl: moderngl.Context, program: moderngl.Program) -> None:
        self.program = program
        self._gl = gl
        self._corners = gl.buffer(reserve=48, dynamic=True)
        self._array: moderngl.VertexArray = gl.vertex_array(program, [(self._corners, "2f4", "corner")])

    def run(
        self,
        target: RenderTarget,
        parts: Spans,
        textures: Mapping[str, Sampled],
        values: Uniforms,
        *,
        depth: Literal["ignored", "written", "tested"] = "ignored",
        sampler: moderngl.Sampler | None = None,
    ) -> None:
        """Run the shader over parts of a target.

        Args:
            parts: (N, 4) x0, y0, x1, y1 in the target's texels from the bottom left.
            textures, values: textures and uniforms by name.
            depth: use of the target's depth: ``ignored``, ``written`` by the shader, or ``tested``: texels with depth 0 are
                skipped, and the depth stays as it is.
            sampler: replaces the filters of texture arrays.
        """
        if not len(parts):
            return
        clip = parts * (2 / np.array([*target.size, *target.size])) - 1
        data = clip[:, [0, 1, 2, 1, 2, 3, 0, 1, 2, 3, 0, 3]].astype(np.float32).tobytes()
        if len(data) > self._corners.size:
            self._corners.orphan(len(data))
        self._corners.write(data)
        target.use()
        self._gl.enable_only(moderngl.NOTHING if depth == "ignored" else moderngl.DEPTH_TEST)
        self._gl.depth_func = "1" if depth == "written" else "<"
        target.framebuffer.depth_mask = depth == "written"
        sampled = bind(self.program, textures, sampler)
        set_uniforms(self.program, values)
        self._array.render(moderngl.TRIANGLES, vertices=6 * len(parts))
        for unit in sampled:
            sampler.clear(unit)  # type: ignore[union-attr]  # units imply a sampler
        self._gl.depth_func = "<"
        target.framebuffer.depth_mask = True

    def release(self) -> None:
        """Free the vertex array."""
        self._array.release()
        self._corners.release()
