import moderngl
import pytest

from valerie.errors import RenderingError
from valerie.rendering.raster.upload.context import process_context, shader_source

pytestmark = pytest.mark.gl


def test_a_process_has_one_context() -> None:
    assert process_context() is process_context()


def test_programs_are_compiled_once_per_set_of_switches() -> None:
    context = process_context()
    with context.current():
        plain = context.program("geometry.vert", "truth.frag")
        assert context.program("geometry.vert", "truth.frag") is plain
        assert context.program("geometry.vert", "truth.frag", MOVABLE=1) is not plain


def test_includes_and_switches_are_put_into_the_source() -> None:
    source = shader_source("surface.frag", {"COLOR_TEXTURE": 1})
    assert source.startswith("#version 430 core\n#define COLOR_TEXTURE 1\n")
    assert "#include" not in source
    assert "octahedron_encode" in source


def test_an_error_of_the_driver_is_a_rendering_error() -> None:
    context = process_context()
    with context.current() as gl:
        # moderngl binds the last framebuffer again, a deleted one too; reading the flag that this leaves clears it.
        _ = gl.error
    with pytest.raises(RenderingError, match="OpenGL"), context.current() as gl:
        gl.program(vertex_shader="no shader", fragment_shader="")
    with context.current() as gl:
        assert isinstance(gl, moderngl.Context)
        assert gl.error == "GL_NO_ERROR"
