"""Set the uniforms and textures of a program, except those that the compiler has removed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import moderngl
import numpy as np
from numpy.typing import NDArray

from valerie.rendering.projection import Points

#: Value of a uniform: a number, a tuple of numbers or an array of floats.
Uniform: TypeAlias = float | Sequence[float] | NDArray[np.floating[Any]]
#: Texture that a shader reads.
Sampled: TypeAlias = moderngl.Texture | moderngl.TextureArray | moderngl.Texture3D
#: Values of uniforms by their names in GLSL.
Uniforms: TypeAlias = Mapping[str, Uniform]


def set_uniforms(program: moderngl.Program, values: Uniforms) -> None:
    """Set uniforms by name.

    Args:
        values: numbers and tuples, which are set as they are; float arrays, which are set as float32. Matrices are row-major here
            and column-major in GLSL.
    """
    for name, value in values.items():
        uniform: Any = program.get(name, None)
        if uniform is None:
            continue
        if isinstance(value, np.ndarray):
            floats: Points = np.asarray(value, np.float64)
            ordered = floats.T if floats.ndim == 2 else floats
            uniform.write(np.ascontiguousarray(ordered, np.float32).tobytes())
        else:
            uniform.value = value


def bind(
    program: moderngl.Program,
    textures: Mapping[str, Sampled],
    sampler: moderngl.Sampler | None = None,
) -> list[int]:
    """Bind the textures that a program reads to texture units.

    Returns:
        The units on which ``sampler`` filters texture arrays. The caller clears them.
    """
    unit = 0
    sampled: list[int] = []
    for name, texture in textures.items():
        uniform: Any = program.get(name, None)  # ``in`` would look at all names of the program
        if uniform is not None:
            texture.use(unit)
            if sampler is not None and isinstance(texture, moderngl.TextureArray):
                sampler.use(unit)
                sampled.append(unit)
            uniform.value = unit
            unit += 1
    return sampled
