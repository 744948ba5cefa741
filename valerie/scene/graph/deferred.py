"""Meshes and textures whose arrays are made when they are first looked at.

A street has many people that a run never shows. They are all in its scene graph, with names, materials and places, but
nobody waits for their shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from valerie.scene.graph.model import Mesh, Texture, freeze


class DeferredMesh(Mesh):
    """A mesh that knows its material's name and how to get the rest.

    Args:
        make: gives the finished mesh; called once at most by this object.
        material: the name of this mesh's material; the finished mesh's own is not looked at.
    """

    if not TYPE_CHECKING:  # to a type checker the fields stay what they are in `Mesh`
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
    """Textures that are made together, once, when the first of them is looked at.

    Args:
        names: of the textures.
        make: gives their images in the same order, each (H, W, 3 or 4) uint8.
    """
    made = cache(make)
    return {name: DeferredTexture(name, lambda index=index: made()[index]) for index, name in enumerate(names)}  # type: ignore[misc]


class DeferredTexture(Texture):
    """A texture that knows its name and how to get its image.

    Args:
        name: see `Texture`.
        make: gives (H, W, 3 or 4) uint8; called once at most.
    """

    if not TYPE_CHECKING:
        image = property(lambda self: self._image)

    def __init__(self, name: str, make: Callable[[], NDArray[np.uint8]]) -> None:
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "_make", make)

    @cached_property
    def _image(self) -> NDArray[np.uint8]:
        make: Callable[[], NDArray[Any]] = self.__dict__["_make"]
        return freeze(np.asarray(make(), np.uint8))
