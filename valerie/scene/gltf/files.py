"""glTF files on disk: header, chunks, JSON, and the files that they refer to. Needs no glTF library.

References may lead to buffers and images in the asset's own folder, and nowhere else.
"""

from __future__ import annotations

import base64
import binascii
import json
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from valerie.errors import InvalidInput
from valerie.plain import JsonObject

#: Size of the largest file of an asset.
MAX_FILE_BYTES: Final = 1024**3

_JSON_CHUNK: Final = 0x4E4F534A
_BINARY_CHUNK: Final = 0x004E4942
#: ``http:``, ``file:`` … (RFC 3986, section 3.1), and roots of other systems.
_NOT_RELATIVE: Final = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:|[/\\]")


class Resources:
    """The data behind the URIs of one glTF file.

    Args:
        path: the glTF file. Relative URIs start at its folder.
        root: folder that no URI may lead out of, links followed; by default the file's own.
    """

    def __init__(self, path: Path, root: Path | None = None) -> None:
        self._folder = path.parent
        self._root = (root or path.parent).resolve()

    def read(self, uri: str, *, field: str) -> bytes:
        """Return the bytes of a ``data:…;base64,…`` URI or of a file.

        Raises:
            InvalidInput: the data is not base64; or as `find`.
        """
        if not uri.startswith("data:"):
            return self.find(uri, field=field).read_bytes()
        head, comma, body = uri.partition(",")
        if not comma or not head.endswith(";base64"):
            raise InvalidInput("not a supported data URI", field=field, value=uri[:40], limit="data:…;base64,…")
        try:
            return base64.b64decode(body, validate=True)
        except binascii.Error:
            raise InvalidInput("not valid base64", field=field) from None

    def find(self, uri: str, *, field: str) -> Path:
        """Return the file that a relative URI names.

        Raises:
            InvalidInput: the URI is not a relative path, or leads out of the asset's folder; or the file is missing or too
                large.
        """
        relative = unquote(uri)
        if not relative or _NOT_RELATIVE.match(relative) or "\0" in relative:
            raise InvalidInput(
                "only files in this file's folder are read",
                field=field,
                value=uri[:80],
                limit="a relative path, or data:…",
            )
        path = (self._folder / relative).resolve()
        if not path.is_relative_to(self._root):
            raise InvalidInput("the file is outside the asset's folder", field=field, value=uri[:80])
        if not path.is_file():
            raise InvalidInput("there is no such file", field=field, value=uri[:80])
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InvalidInput("the file is too large", field=field, value=uri[:80], limit=f"{MAX_FILE_BYTES} bytes")
        return path


def open_document(path: Path) -> tuple[JsonObject, bytes | None]:
    """Return the JSON of a .glb or .gltf, and the binary chunk if there is one.

    Raises:
        InvalidInput: the file is too large, truncated, or not glTF 2.0.
    """
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise InvalidInput("the file is too large", field=path.name, value=f"{size} bytes", limit=MAX_FILE_BYTES)
    raw = path.read_bytes()
    text, binary = _chunks(raw, path.name) if path.suffix.lower() == ".glb" else (raw, None)
    return _plain(text, path.name), binary


def _chunks(raw: bytes, name: str) -> tuple[bytes, bytes | None]:
    """Return JSON and binary chunk of a .glb (glTF 2.0, section 4.4)."""
    if len(raw) < 20 or raw[:4] != b"glTF":
        raise InvalidInput("not a binary glTF file", field=name, value=f"{len(raw)} bytes", limit="starts with glTF")
    version, length = struct.unpack_from("<II", raw, 4)
    if version != 2:
        raise InvalidInput("not a supported version of glTF", field=name, value=version, limit=2)
    if length > len(raw):
        raise InvalidInput(
            "the file is truncated", field=name, value=f"{len(raw)} bytes", limit=f"{length} bytes by its header"
        )
    chunks: dict[int, bytes] = {}
    position = 12
    while position + 8 <= length:
        size, kind = struct.unpack_from("<II", raw, position)
        position += 8
        if position + size > length:
            raise InvalidInput(
                "the file is truncated inside a chunk",
                field=name,
                value=f"{length - position} bytes",
                limit=f"{size} bytes by its header",
            )
        chunks.setdefault(kind, raw[position : position + size])
        position += size
    if _JSON_CHUNK not in chunks:
        raise InvalidInput("no JSON chunk", field=name)
    return chunks[_JSON_CHUNK], chunks.get(_BINARY_CHUNK)


def _plain(text: bytes, name: str) -> JsonObject:
    try:
        plain = json.loads(text.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"not readable as JSON: {error}", field=name) from None
    header = plain.get("asset") if isinstance(plain, dict) else None
    version = header.get("version") if isinstance(header, dict) else None
    if not isinstance(version, str) or not version.startswith("2."):
        raise InvalidInput("not glTF 2.0", field=f"{name}: asset.version", value=version)
    assert isinstance(plain, dict)
    return plain


def external_uris(path: Path, name: str) -> tuple[tuple[str, str], ...]:
    """Return field and URI of everything that a glTF file keeps in other files.

    Return nothing for a file that is not glTF; reading it reports the problem.

    Args:
        name: its name in fields.
    """
    try:
        document, _ = open_document(path)
    except InvalidInput:
        return ()
    return tuple(_external_uris(document, name))


def _external_uris(document: JsonObject, name: str) -> Iterator[tuple[str, str]]:
    for kind in ("buffers", "images"):
        entries = document.get(kind)
        for index, entry in enumerate(entries if isinstance(entries, list) else ()):
            uri = entry.get("uri") if isinstance(entry, dict) else None
            if isinstance(uri, str) and not uri.startswith("data:"):
                yield f"{name}: {kind}.{index}.uri", uri
