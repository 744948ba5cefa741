"""Users' assets on disk: a folder with ``manifest.yaml`` and the glTF files that it lists."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Final

from valerie.errors import InvalidInput, InvalidInputs
from valerie.loading import load_document
from valerie.parameters.assignment import digest
from valerie.scene.assets.manifest import Manifest, parse_manifest
from valerie.scene.gltf.files import MAX_FILE_BYTES, Resources, external_uris
from valerie.scene.graph.model import Scene

MANIFEST_FILE: Final = "manifest.yaml"
MAX_MANIFEST_BYTES: Final = 4 * 1024 * 1024
#: Part of the digest of every such asset. Raise it by hand whenever the same files give another scene.
REVISION: Final = 2


def read_manifest(folder: Path) -> tuple[Manifest, str, Mapping[str, Path]]:
    """Read and validate a folder's manifest and digest its files.

    Returns:
        The manifest, the digest over the bytes of all files of the asset, and the glTF files by name.

    Raises:
        InvalidInput: the manifest is missing or invalid; a file is missing, too large or outside the folder.
    """
    path = _inside(folder, MANIFEST_FILE, limit=MAX_MANIFEST_BYTES, field=MANIFEST_FILE)
    manifest = _parsed(path.read_bytes(), folder.resolve().name)
    files: dict[str, Path] = {}
    hashes: dict[str, str] = {}
    problems: list[InvalidInput] = []
    for name in manifest.all_files:
        try:
            files[name] = _inside(folder, name, limit=MAX_FILE_BYTES, field=f"{MANIFEST_FILE}.files")
        except InvalidInput as problem:
            problems.append(problem)
            continue
        hashes[name] = _file_digest(files[name])
        external, gaps = _references(files[name], folder, name)
        problems += gaps
        hashes |= {f"{name}:{uri}": _file_digest(file) for uri, file in external.items()}
    if problems:
        raise problems[0] if len(problems) == 1 else InvalidInputs(problems)
    # Attributes of an operational design domain and sources of ranges do not affect the scene.
    document = manifest.model_dump(mode="json", exclude={"parameters": {"__all__": {"odd", "source"}}})
    return manifest, digest("asset-files", document, hashes, REVISION), files


@lru_cache(maxsize=64)
def _parsed(data: bytes, name: str) -> Manifest:
    """Return the manifest of a file. Equal files give one object, by whose identity others find what they cache for it."""
    try:
        document = load_document(data, max_bytes=MAX_MANIFEST_BYTES)
    except InvalidInput as error:
        place = f"{MANIFEST_FILE}.{error.field}" if error.field else MANIFEST_FILE
        raise InvalidInput(error.message, field=place, value=error.value, limit=error.limit) from None
    document.setdefault("name", name)
    manifest = parse_manifest(document, source=MANIFEST_FILE)
    if not manifest.all_files:
        raise InvalidInput("an asset needs at least one glTF file", field=f"{MANIFEST_FILE}.files")
    return manifest


def read_scene(manifest: Manifest, files: Mapping[str, Path], folder: Path) -> Scene:
    """Read the glTF files of an asset into one scene, with the labels of the manifest.

    Args:
        files: glTF files by name, from `read_manifest`.
        folder: the asset's folder. No file may refer to anything outside it.

    Raises:
        InvalidInput: a file is broken, or two files contradict each other.
    """
    from valerie.scene.assets.gltf_scene import merge
    from valerie.scene.gltf.reader import read_gltf

    return merge({name: read_gltf(path, folder) for name, path in files.items()}, manifest)


def _references(path: Path, folder: Path, name: str) -> tuple[Mapping[str, Path], list[InvalidInput]]:
    """Return the files that a glTF file refers to, and the problems with them. Caches the references of unchanged files."""
    state = path.stat()
    uris = _uris(path, name, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns)
    resources = Resources(path, folder)
    external: dict[str, Path] = {}
    problems = []
    for field, uri in uris:
        try:
            external[uri] = resources.find(uri, field=field)
        except InvalidInput as problem:
            problems.append(problem)
    return external, problems


@lru_cache(maxsize=256)
def _uris(path: Path, name: str, *_state: int) -> tuple[tuple[str, str], ...]:
    return external_uris(path, name)


def _inside(folder: Path, name: str, *, limit: int, field: str) -> Path:
    """Return a regular file inside ``folder``; links are followed."""
    root = folder.resolve()
    path = (root / name).resolve()
    if not path.is_relative_to(root):
        raise InvalidInput("the file is outside the asset's folder", field=field, value=name)
    if not path.is_file():
        raise InvalidInput("the asset has no such file", field=field, value=name)
    size = path.stat().st_size
    if size > limit:
        raise InvalidInput("the file is too large", field=field, value=f"{size} bytes", limit=f"{limit} bytes")
    return path


def _file_digest(path: Path) -> str:
    """Return the SHA-256 of a file. The file is read again only if its identity, size or time has changed."""
    state = path.stat()
    return _sha256(path, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns)


@lru_cache(maxsize=256)
def _sha256(path: Path, *_state: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
