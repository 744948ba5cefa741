"""Draw surfaces with the program and the GL state that each kind of surface needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, Literal

import moderngl
import numpy as np

from valerie.rendering.raster.gl.uniforms import Sampled, Uniforms, bind, set_uniforms
from valerie.rendering.raster.upload.materials import SurfaceKind
from valerie.scene.graph.model import ROOM_CELLS

if TYPE_CHECKING:
    from valerie.rendering.raster.upload.context import GraphicsContext
    from valerie.rendering.raster.upload.movable_geometry import MeshBuffers, PlacedMesh
    from valerie.rendering.raster.upload.scenes import Statics
    from valerie.rendering.raster.upload.textures import TextureSet


#: ``GL_CLIP_DISTANCE0``.
_CLIP_DISTANCE: Final = 0x3000


class SurfaceDrawer:
    """Draws statics and movables with one fragment shader.

    Args:
        context: owns the programs; it must be current in every call.
        fragment: name of the shader, e.g. ``surface.frag``.
        textures: use of textures apart from the alpha of cut surfaces: ``ignored``, ``known`` (the shader gets texture
            coordinates and tangent frames but no texture) or ``read``.
        keeps: the ``nearest`` surface, the ``last`` drawn, or the ``largest`` of each colour component of all.
        all_faces: if True, draw back faces of single-sided surfaces too, as shadow casters need.
        panes: treatment of `Material.transmission`: draw a pane ``whole`` (for labels), ``sampled`` (some samples show the
            background) or ``not`` at all (a pane casts no shadow).
        sampler: replaces the texture filters of surfaces that are not cut.
    """

    def __init__(
        self,
        context: GraphicsContext,
        fragment: str,
        *,
        textures: Literal["ignored", "known", "read"] = "ignored",
        keeps: Literal["nearest", "last", "largest"] = "nearest",
        all_faces: bool = False,
        panes: Literal["whole", "sampled", "not"] = "whole",
        sampler: moderngl.Sampler | None = None,
    ) -> None:
        self._context = context
        self._fragment = fragment
        self._textures = textures
        self._keeps = keeps
        self._all_faces = all_faces
        self._panes = panes
        self._sampler = sampler

    def statics(self, statics: Statics, table: moderngl.Texture, values: Uniforms, *, least: float = 0.0) -> None:
        """Draw the statics into the target in use, without meshes outside the clip volume of ``values``.

        Args:
            values: uniforms of ``geometry.vert``; with ``beyond``, (4,), only what lies on this plane's positive side is drawn.
            least: leaves out meshes too small for a coarse picture, see `StaticGeometry.appearing`.
        """
        geometry, gl, cut = statics.geometry, self._context.gl, "beyond" in values
        drawn = geometry.within(np.asarray(values["clip_from_world"]))
        if cut:
            drawn &= geometry.beyond(np.asarray(values["beyond"]))
            gl.enable_direct(_CLIP_DISTANCE)
        if least > 0:
            drawn &= geometry.appearing(np.asarray(values["eye"]), least)
        for batch in geometry.batches if self._textures == "read" else geometry.whole:
            if batch.kind.clear and self._panes == "not":
                continue
            parts = geometry.parts(batch, drawn)
            if not parts:
                continue
            array = geometry.array(self._ready(batch.kind, statics.textures, table, values, movable=False, cut=cut))
            for part in parts:
                array.render(moderngl.TRIANGLES, vertices=part.count, first=part.first)
        if cut:
            gl.disable_direct(_CLIP_DISTANCE)
        if self._sampler is not None:
            gl.clear_samplers()

    def movables(
        self, placed: Sequence[PlacedMesh], textures: TextureSet, table: moderngl.Texture, values: Uniforms
    ) -> None:
        """Draw placed meshes into the target in use."""
        program, ready = None, None
        for mesh in placed:
            if mesh.kind.clear and self._panes == "not":
                continue
            kind = self._kind(mesh.kind)
            if program is None or kind != ready:
                program, ready = self._ready(kind, textures, table, values, movable=True), kind
            mesh.draw(program)

    def _kind(self, kind: SurfaceKind) -> SurfaceKind:
        """Return the kind without the details that this drawer ignores, so that more meshes share a program."""
        if self._textures != "ignored" or kind.cut:
            return kind
        return kind._replace(color_side=0, normal_side=0, roughness_side=0, room_side=0)

    def moved(
        self,
        placed: Sequence[tuple[PlacedMesh, MeshBuffers, Uniforms]],
        textures: TextureSet,
        table: moderngl.Texture,
        values: Uniforms,
    ) -> None:
        """Draw meshes into the target in use, each with its positions at another moment and its own uniforms."""
        for mesh, elsewhere, own in placed:
            program = self._ready(mesh.kind, textures, table, {**values, **own}, movable=True, elsewhere=True)
            mesh.draw(program, elsewhere)

    def _ready(
        self,
        kind: SurfaceKind,
        textures: TextureSet,
        table: moderngl.Texture,
        values: Uniforms,
        *,
        movable: bool,
        elsewhere: bool = False,
        cut: bool = False,
    ) -> moderngl.Program:
        """Return the program for a kind of surface, with textures, uniforms and GL state set."""
        gl, read = self._context.gl, self._textures == "read"
        defines = {"MOVABLE": 1} if movable else {}
        if elsewhere:
            defines["ELSEWHERE"] = 1
        if cut:
            # A program of its own, so that no state of this one reaches the image or the truth.
            defines["BEYOND"] = 1
        samplers: dict[str, Sampled] = {"material_table": table}
        if kind.color_side and (read or kind.cut):
            defines["COLOR_TEXTURE"] = 1
            samplers["color_textures"] = textures.arrays[kind.color_side]
        if kind.normal_side and read:
            defines["NORMAL_TEXTURE"] = 1
            samplers["normal_textures"] = textures.arrays[kind.normal_side]
        if kind.roughness_side and read:
            defines["ROUGHNESS_TEXTURE"] = 1
            samplers["roughness_textures"] = textures.arrays[kind.roughness_side]
        if kind.room_side and read:
            defines["ROOM_CELLS"] = ROOM_CELLS
            samplers["room_textures"] = textures.arrays[kind.room_side]
        if self._textures == "known" and (kind.color_side or kind.normal_side or kind.roughness_side):
            defines["TEXTURED"] = 1
            if kind.normal_side:
                defines["NORMAL_TEXTURE"] = 1
        if kind.cut:
            defines["CUT"] = 1
        if kind.clear and self._panes == "sampled":
            defines["CLEAR"] = 1
        program = self._context.program("geometry.vert", self._fragment, **defines)
        flags = {"nearest": moderngl.DEPTH_TEST, "last": moderngl.NOTHING, "largest": moderngl.BLEND}[self._keeps]
        if not (kind.double_sided or self._all_faces):
            flags |= moderngl.CULL_FACE
        gl.enable_only(flags)
        gl.blend_equation = moderngl.MAX, moderngl.MAX
        if self._sampler is not None:
            gl.clear_samplers()
        bind(program, samplers, None if kind.cut else self._sampler)
        set_uniforms(program, values)
        return program


def table_texture(gl: moderngl.Context, table: Any) -> moderngl.Texture:
    """Upload a table, (N, K, 4) float32, as a texture of N rows."""
    texture = gl.texture((table.shape[1], table.shape[0]), 4, table.tobytes(), dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture
