"""Textures of a glTF file, decoded once and named."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.scene.gltf.common import MAX_TEXELS
from valerie.scene.gltf.container import Container, item
from valerie.scene.gltf.images import decode_image
from valerie.scene.graph.model import Texture


class TextureReader:
    """The textures of a glTF file. Textures with the same image become one."""

    def __init__(self, container: Container) -> None:
        self._container, self._document = container, container.document
        self._names = unique_names([image.name for image in self._document.images], "image")
        self._images: dict[int, NDArray[np.uint8]] = {}
        self._texels = 0

    def name(self, texture: int, reference: str) -> str:
        """Return the name of a glTF texture in the scene.

        Args:
            texture: the texture's index.
            reference: the reference to it, e.g. ``material brick: baseColorTexture``; for errors.

        Raises:
            InvalidInput: there is no such texture, or it has no PNG or JPEG image.
        """
        return self._names[self._source(texture, reference)]

    def all_textures(self) -> dict[str, Texture]:
        """Return every image of the file as a texture, by name."""
        return {name: Texture(name, self._image(index)) for index, name in enumerate(self._names)}

    def _source(self, texture: int, reference: str) -> int:
        file = self._container.name
        source = item(self._document.textures, texture, f"{file}: {reference}: textures").source
        field = f"{file}: textures.{texture}"
        if source is None:
            raise InvalidInput("the texture has no PNG or JPEG image", field=field)
        item(self._document.images, source, f"{field}.source: images")
        return int(source)

    def _image(self, index: int) -> NDArray[np.uint8]:
        if index not in self._images:
            image, field = self._document.images[index], f"{self._container.name}: images.{index}"
            if image.bufferView is not None:
                data = self._container.view(image.bufferView)
            else:
                data = self._container.resource(image.uri or "", field=f"{field}.uri")
            texels = decode_image(data, field=field)
            texels.setflags(write=False)
            self._texels += texels.shape[0] * texels.shape[1]
            if self._texels > MAX_TEXELS:
                raise InvalidInput("too many texels in one file", field=field, value=self._texels, limit=MAX_TEXELS)
            self._images[index] = texels
        return self._images[index]


def unique_names(names: list[str | None], kind: str) -> list[str]:
    """Return unique names: each item's own name if that is free, else ``kind_index`` or ``name_index``."""
    unique: list[str] = []
    for index, name in enumerate(names):
        candidate = name or f"{kind}_{index}"
        while candidate in unique:
            candidate = f"{candidate}_{index}"
        unique.append(candidate)
    return unique
