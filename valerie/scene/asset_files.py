"""Users' assets on disk: one folder with ``manifest.yaml`` and the glTF files that it lists."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Final

from valerie.errors import InvalidInput
from valerie.loading import load_document
from valerie.parameters.assignment import digest
from valerie.scene.manifest import Manifest, parse_manifest
from valerie.scene.model import Scene

MANIFEST_FILE: Final = "manifest.yaml"
MAX_MANIFEST_BYTES: Final = 4 * 1024 * 1024
#: Largest glTF file that is opened.
MAX_FILE_BYTES: Final = 1024**3


def read_manifest(folder: Path) -> tuple[Manifest, str, Mapping[str, Path]]:
    """Read and validate a folder's manifest and digest its files.

    Returns:
        The manifest, the digest over the bytes of all files of the asset, and the glTF files by name.

    Raises:
        InvalidInput: no or no valid manifest, a file that is missing, too large or outside the folder.
    """
    path = _inside(folder, MANIFEST_FILE, limit=MAX_MANIFEST_BYTES, field=MANIFEST_FILE)
    try:
        data = load_document(path.read_bytes(), max_bytes=MAX_MANIFEST_BYTES)
    except InvalidInput as error:
        place = f"{MANIFEST_FILE}.{error.field}" if error.field else MANIFEST_FILE
        raise InvalidInput(error.message, field=place, value=error.value, limit=error.limit) from None
    data.setdefault("name", folder.resolve().name)
    manifest = parse_manifest(data, source=MANIFEST_FILE)
    if not manifest.files:
        raise InvalidInput("an asset has at least one glTF file", field=f"{MANIFEST_FILE}.files")
    files = {
        name: _inside(folder, name, limit=MAX_FILE_BYTES, field=f"{MANIFEST_FILE}.files.{index}")
        for index, name in enumerate(manifest.files)
    }
    hashes = {name: _file_digest(file) for name, file in files.items()}
    return manifest, digest("asset-files", manifest.model_dump(mode="json"), hashes), files


def read_scene(manifest: Manifest, files: Mapping[str, Path]) -> Scene:
    """Read the glTF files of an asset into one scene, labelled as the manifest says.

    Raises:
        InvalidInput: a file is broken, or two files contradict each other.
    """
    from valerie.scene.gltf import merge, read_gltf

    return merge({name: read_gltf(path) for name, path in files.items()}, manifest)


def _inside(folder: Path, name: str, *, limit: int, field: str) -> Path:
    """The file ``name`` of ``folder``, if it is a regular file inside of it (links followed) and not too large."""
    root = folder.resolve()
    path = (root / name).resolve()
    if not path.is_relative_to(root):
        raise InvalidInput("the file lies outside the asset's folder", field=field, value=name)
    if not path.is_file():
        raise InvalidInput("the asset has no such file", field=field, value=name)
    size = path.stat().st_size
    if size > limit:
        raise InvalidInput("the file is too large", field=field, value=f"{size} bytes", limit=f"{limit} bytes")
    return path


def _file_digest(path: Path) -> str:
    """SHA-256; read again only when the file's identity, size or time of change says so (a request asks for it each time)."""
    state = path.stat()
    return _sha256(path, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns)


@lru_cache(maxsize=256)
def _sha256(path: Path, *_state: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
