"""Meshes and textures whose arrays are computed when they are first read.

A scene may hold many people that a run never shows. All of them are in its scene graph, with names, materials and places. Their
shapes are computed only if needed. Threads may read different textures at once; each image is computed by one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from threading import Lock
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from valerie.scene.graph.model import Mesh, Texture, freeze

Value = TypeVar("Value")


class _Once(Generic[Value]):
    """A function without arguments that is computed in its first call, while other threads that call it wait."""

    def __init__(self, make: Callable[[], Value]) -> None:
        self._make, self._values, self._lock = make, list[Value](), Lock()

    def __call__(self) -> Value:
        with self._lock:
            if not self._values:
                self._values.append(self._make())
        return self._values[0]


class DeferredMesh(Mesh):
    """A mesh with the name of its material, whose arrays are computed when they are first read.

    Args:
        make: returns the mesh; called at most once.
        material: the name of this mesh's material, instead of that of the returned mesh.
    """

    if not TYPE_CHECKING:  # type checkers see the fields of `Mesh`
        positions = property(lambda self: self._made.positions)
        normals = property(lambda self: self._made.normals)
        uvs = property(lambda self: self._made.uvs)
        faces = property(lambda self: self._made.faces)

    def __init__(self, make: Callable[[], Mesh], material: str) -> None:
        object.__setattr__(self, "_make", make)
        object.__setattr__(self, "material", material)

    @cached_property
    def _made(self) -> Mesh:
        make: Callable[[], Mesh] = self.__dict__["_make"]
        return make()

    def with_material(self, name: str) -> Mesh:
        return DeferredMesh(lambda: self._made, name)


def deferred_textures(names: Sequence[str], make: Callable[[], Sequence[NDArray[np.uint8]]]) -> dict[str, Texture]:
    """Return textures whose images are all computed once, when the first of them is read.

    Args:
        make: returns their images in the same order, each (H, W, 3 or 4) uint8.
    """
    images = _Once(make)
    return {name: DeferredTexture(name, lambda index=index: images()[index]) for index, name in enumerate(names)}  # type: ignore[misc]


class DeferredTexture(Texture):
    """A texture with a name, whose image is computed when it is first read.

    Args:
        name: see `Texture`.
        make: returns (H, W, 3 or 4) uint8; called at most once.
    """

    if not TYPE_CHECKING:
        image = property(lambda self: self._image())

    def __init__(self, name: str, make: Callable[[], NDArray[np.uint8]]) -> None:
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "_image", _Once(lambda: freeze(np.asarray(make(), np.uint8))))
