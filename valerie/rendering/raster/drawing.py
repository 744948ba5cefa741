"""Drawing surfaces: which program and which state each kind of surface needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import moderngl

from valerie.rendering.raster.materials import SurfaceKind
from valerie.rendering.raster.uniforms import bind, set_uniforms

if TYPE_CHECKING:
    from valerie.rendering.raster.context import GraphicsContext
    from valerie.rendering.raster.movable_geometry import MeshBuffers, PlacedMesh
    from valerie.rendering.raster.scenes import Statics
    from valerie.rendering.raster.textures import TextureSet


class SurfaceDrawer:
    """Draws statics and movables with one fragment shader.

    Args:
        context: owns programs; current in every call.
        fragment: the shader file, e.g. ``surface.frag``.
        colors: whether it reads textures (else only the alpha of cut surfaces).
        frames: whether it wants to know of textures, without reading them.
        depth_test: False draws over everything.
        all_faces: True draws back faces of single-sided surfaces too, as shadow casters need.
        panes: what becomes of `Material.transmission`: a pane is drawn ``whole`` (for labels), ``sampled`` (some of the samples
            show what is behind it) or ``not`` at all (it casts no shadow).
        elsewhere: whether it wants to know where the vertices are at another moment (`moved` alone).
        sampler: replaces the filters of the textures of surfaces that are not cut.
    """

    def __init__(
        self,
        context: GraphicsContext,
        fragment: str,
        *,
        colors: bool = False,
        frames: bool = False,
        depth_test: bool = True,
        all_faces: bool = False,
        panes: Literal["whole", "sampled", "not"] = "whole",
        elsewhere: bool = False,
        sampler: moderngl.Sampler | None = None,
    ) -> None:
        self._context = context
        self._fragment = fragment
        self._colors = colors
        self._frames = frames
        self._depth_test = depth_test
        self._all_faces = all_faces
        self._panes = panes
        self._elsewhere = elsewhere
        self._sampler = sampler

    def statics(self, statics: Statics, table: moderngl.Texture, values: Mapping[str, Any]) -> None:
        """Draw all statics into the target in use."""
        geometry = statics.geometry
        for batch in geometry.batches if self._colors else geometry.whole:
            if batch.kind.clear and self._panes == "not":
                continue
            program = self._ready(batch.kind, statics.textures, table, values, movable=False)
            geometry.array(program).render(moderngl.TRIANGLES, vertices=batch.count, first=batch.first)
        if self._sampler is not None:
            self._context.gl.clear_samplers()

    def movables(
        self, placed: Sequence[PlacedMesh], textures: TextureSet, table: moderngl.Texture, values: Mapping[str, Any]
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
        """As much of a kind as makes a difference here."""
        if self._colors or self._frames or kind.cut:
            return kind
        return kind._replace(color_side=0, normal_side=0, roughness_side=0)

    def moved(
        self,
        placed: Sequence[tuple[PlacedMesh, MeshBuffers, Mapping[str, Any]]],
        textures: TextureSet,
        table: moderngl.Texture,
        values: Mapping[str, Any],
    ) -> None:
        """Draw meshes, each with what it is at another moment and with values of its own, into the target in use."""
        for mesh, elsewhere, own in placed:
            mesh.draw(self._ready(mesh.kind, textures, table, {**values, **own}, movable=True), elsewhere)

    def _ready(
        self,
        kind: SurfaceKind,
        textures: TextureSet,
        table: moderngl.Texture,
        values: Mapping[str, Any],
        *,
        movable: bool,
    ) -> moderngl.Program:
        gl = self._context.gl
        defines = {"MOVABLE": 1} if movable else {}
        if self._elsewhere:
            defines["ELSEWHERE"] = 1
        bound: dict[str, Any] = {"material_table": table}
        if kind.color_side and (self._colors or kind.cut):
            defines["COLOR_TEXTURE"] = 1
            bound["color_textures"] = textures.arrays[kind.color_side]
        if kind.normal_side and self._colors:
            defines["NORMAL_TEXTURE"] = 1
            bound["normal_textures"] = textures.arrays[kind.normal_side]
        if kind.roughness_side and self._colors:
            defines["ROUGHNESS_TEXTURE"] = 1
            bound["roughness_textures"] = textures.arrays[kind.roughness_side]
        if self._frames and (kind.color_side or kind.normal_side or kind.roughness_side):
            defines["TEXTURED"] = 1
            if kind.normal_side:
                defines["NORMAL_TEXTURE"] = 1
        if kind.cut:
            defines["CUT"] = 1
        if kind.clear and self._panes == "sampled":
            defines["CLEAR"] = 1
        program = self._context.program("geometry.vert", self._fragment, **defines)
        flags = moderngl.DEPTH_TEST if self._depth_test else moderngl.NOTHING
        if not (kind.double_sided or self._all_faces):
            flags |= moderngl.CULL_FACE
        gl.enable_only(flags)
        if self._sampler is not None:
            gl.clear_samplers()
        bind(program, bound, None if kind.cut else self._sampler)
        set_uniforms(program, values)
        return program


def table_texture(gl: moderngl.Context, table: Any) -> moderngl.Texture:
    """The material table, (N, 5, 4) float32, as a texture of N rows."""
    texture = gl.texture((table.shape[1], table.shape[0]), 4, table.tobytes(), dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture
