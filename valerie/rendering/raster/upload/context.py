"""The OpenGL context of this process, and the programs compiled in it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib.resources import files
from typing import Final

import moderngl

from valerie.errors import MissingDependency, RenderingError
from valerie.rendering.numeric import numeric_class
from valerie.rendering.raster.upload.scenes import SceneStore
from valerie.rendering.surface_constants import glsl_constants

_SHADERS: Final = files("valerie.rendering.raster") / "shaders"
_INCLUDE: Final = re.compile(r'^#include "([a-z_]+\.glsl)"$', re.MULTILINE)


def shader_source(name: str, defines: Mapping[str, int] | None = None) -> str:
    """Return the source of a shader, with its includes, ``defines`` and the constants of surfaces, ready to compile.

    Args:
        name: file name in ``shaders/`` without ``.glsl``, e.g. ``lighting.frag``.
        defines: preprocessor symbols and their values.
    """
    text = (_SHADERS / f"{name}.glsl").read_text("utf-8")
    text = _INCLUDE.sub(lambda match: (_SHADERS / match.group(1)).read_text("utf-8"), text)
    head = "".join(f"#define {symbol} {value}\n" for symbol, value in (defines or {}).items())
    return f"#version 430 core\n{head}{glsl_constants()}{text}"


class GraphicsContext:
    """A headless OpenGL 4.3 context (EGL), on the vendor's driver with a GPU and on llvmpipe without one.

    `RasterRenderer` and `TruthPass` share uploaded scenes if they share a context; `process_context` is the process's own. All
    drawing happens inside `current`, so that it does not disturb another library's context.

    Raises:
        MissingDependency: there is no EGL library, or no driver for OpenGL 4.3.
    """

    def __init__(self) -> None:
        try:
            self.gl: moderngl.Context = moderngl.create_context(standalone=True, backend="egl", require=430)  # type: ignore[arg-type]
        except Exception as error:
            raise MissingDependency(
                f"no OpenGL 4.3 context through EGL ({error}); on Debian or Ubuntu: "
                "apt-get install libegl1 libgl1 libgl1-mesa-dri libegl-mesa0"
            ) from error
        self.numeric_class = numeric_class(self.gl.info["GL_RENDERER"], self.gl.info["GL_VERSION"])
        self._programs: dict[tuple[str, str, tuple[tuple[str, int], ...]], moderngl.Program] = {}
        self.scenes = SceneStore(self.gl)
        self.closed = False

    @contextmanager
    def current(self) -> Iterator[moderngl.Context]:
        """Make this context the thread's current one, and restore the previous one afterwards.

        Raises:
            RenderingError: the driver reports an error, such as a lack of memory.
        """
        with self.gl:
            try:
                yield self.gl
            except moderngl.Error as error:
                raise RenderingError(f"OpenGL ({self.numeric_class}): {error}") from error

    def program(self, vertex: str, fragment: str, **defines: int) -> moderngl.Program:
        """Return the program of two shader files. It is compiled at the first call."""
        key = (vertex, fragment, tuple(sorted(defines.items())))
        program = self._programs.get(key)
        if program is None:
            program = self.gl.program(
                vertex_shader=shader_source(vertex, defines), fragment_shader=shader_source(fragment, defines)
            )
            self._programs[key] = program
        return program

    def close(self) -> None:
        """Free the context and its resources."""
        if not self.closed:
            self.closed = True
            with self.gl:
                self.scenes.release()
                for program in self._programs.values():
                    program.release()
            self._programs.clear()
            self.gl.release()


@cache
def process_context() -> GraphicsContext:
    """Return the context of this process. It is created at the first call."""
    return GraphicsContext()
