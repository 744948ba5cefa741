"""The manifest of an evidence folder: the SHA-256 of each file, and the root of a Merkle tree over them.

The manifest is an in-toto Statement v1 (https://in-toto.io/Statement/v1) whose subjects are the files. The tree is that of
RFC 6962, section 2.1. Its leaves are the lines that ``sha256sum`` prints for the files, in the order of the paths.
"""

from __future__ import annotations

import os
import re
import stat
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from hashlib import file_digest, sha256
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Final, Literal

import orjson
from pydantic import ConfigDict, Field, ValidationError, model_validator

from valerie.document import Document
from valerie.errors import ValerieError

#: The manifest, and its signed copy; the manifest covers every other file.
MANIFEST: Final = "manifest.json"
SIGNED: Final = "manifest.dsse.json"
#: Limits of an accepted folder: files in a manifest, bytes of all files, bytes of a document that is read at once.
MAX_FILES: Final = 10_000
MAX_BYTES: Final = 4 << 30
MAX_DOCUMENT_BYTES: Final = 8 << 20

#: Most files and folders, the manifest and its signed copy included.
_MAX_ENTRIES: Final = 2 * MAX_FILES
_PATH: Final = r"[0-9A-Za-z][0-9A-Za-z._-]{0,99}(/[0-9A-Za-z][0-9A-Za-z._-]{0,99}){0,7}"
_PATH_LIMIT: Final = "not a path of letters, digits, '.', '_' and '-', at most 8 deep"
_SHA256: Final = r"^[0-9a-f]{64}$"
_TREE: Final = "urn:ietf:rfc:6962"


class Refused(ValerieError):
    """Evidence that is not valid; the message names the files.

    Args:
        problems: one sentence for each problem.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))


class _Document(Document):
    model_config = ConfigDict(populate_by_name=True)


class _Digest(_Document):
    sha256: Annotated[str, Field(pattern=_SHA256)]


class SubjectFile(_Document):
    """A file: its path below the folder, with ``/``, and its digest."""

    name: Annotated[str, Field(max_length=500)]
    digest: _Digest


class _Root(_Document):
    tree: Literal["urn:ietf:rfc:6962"]
    root: Annotated[str, Field(pattern=_SHA256)]


class EvidenceManifest(_Document):
    """An in-toto Statement v1 about the files of a folder.

    Attributes:
        type: type of the document.
        subject: the files, sorted by path.
        predicate_type: type of the predicate.
        predicate: the root of the tree over the files.
    """

    type: Literal["https://in-toto.io/Statement/v1"] = Field(alias="_type")
    subject: Annotated[tuple[SubjectFile, ...], Field(min_length=1, max_length=MAX_FILES)]
    predicate_type: Literal["urn:valerie:evidence:1"] = Field(alias="predicateType")
    predicate: _Root

    @model_validator(mode="after")
    def _holds(self) -> EvidenceManifest:
        names = [subject.name for subject in self.subject]
        for name in names:
            if not re.fullmatch(_PATH, name) or name in (MANIFEST, SIGNED):
                raise ValueError(f"{name!r}: {_PATH_LIMIT}")
        if names != sorted(set(names)):
            raise ValueError("the paths are not sorted, or one occurs twice")
        if self.predicate.root != tree_root(self.digests):
            raise ValueError("its digests do not add up to its root")
        return self

    @property
    def digests(self) -> dict[str, str]:
        """Path to SHA-256, hex."""
        return {subject.name: subject.digest.sha256 for subject in self.subject}

    def to_bytes(self) -> bytes:
        """Return the document; equal manifests have equal bytes."""
        return document_bytes(self.model_dump(mode="json", by_alias=True))


def manifest_of(folder: Path) -> EvidenceManifest:
    """Build the manifest of a folder.

    Raises:
        Refused: the folder contains something that a manifest cannot name, or too much.
    """
    digests = {name: sha256_of(folder / name) for name in plain_files(folder) if name not in (MANIFEST, SIGNED)}
    subjects = [{"name": name, "digest": {"sha256": digest}} for name, digest in digests.items()]
    predicate = {"tree": _TREE, "root": tree_root(digests)}
    return _validated(
        {
            "_type": "https://in-toto.io/Statement/v1",
            "subject": subjects,
            "predicateType": "urn:valerie:evidence:1",
            "predicate": predicate,
        }
    )


def read_evidence_manifest(data: bytes) -> EvidenceManifest:
    """Read the bytes of a manifest.

    Raises:
        Refused: `Manifest.to_bytes` would not return them for any manifest.
    """
    try:
        manifest = _validated(orjson.loads(data))
    except orjson.JSONDecodeError as error:
        raise Refused([f"{MANIFEST}: not JSON: {error}"]) from None
    if manifest.to_bytes() != data:
        raise Refused([f"{MANIFEST}: not spelled as VALERIE writes it"])
    return manifest


def _validated(document: Any) -> EvidenceManifest:
    try:
        return EvidenceManifest.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, first["loc"]))
        text = first["msg"].removeprefix("Value error, ")
        raise Refused([f"{MANIFEST}: {place + ': ' if place else ''}{text}"]) from None


def tree_root(digests: Mapping[str, str]) -> str:
    """Return the Merkle root over files, hex.

    Args:
        digests: path to SHA-256, hex, sorted by path.
    """
    return merkle_root([f"{digest}  {name}\n".encode() for name, digest in digests.items()]).hex()


def merkle_root(leaves: Sequence[bytes]) -> bytes:
    """Return the Merkle Tree Hash of RFC 6962, section 2.1, over SHA-256."""
    if not leaves:
        return sha256().digest()
    if len(leaves) == 1:
        return sha256(b"\x00" + leaves[0]).digest()
    left = 1 << (len(leaves) - 1).bit_length() - 1
    return sha256(b"\x01" + merkle_root(leaves[:left]) + merkle_root(leaves[left:])).digest()


def document_bytes(document: Any) -> bytes:
    """Return JSON with sorted keys, indented, so that equal documents have equal bytes."""
    return orjson.dumps(document, option=orjson.OPT_SORT_KEYS | orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)


def plain_files(folder: Path) -> list[str]:
    """Return the paths of all files below a folder, sorted, with ``/``; nothing is opened.

    Raises:
        Refused: something is neither a file nor a folder, an empty folder, has a name that no manifest allows, or exceeds the
            limits.
    """
    problems: list[str] = []
    sizes: dict[str, int] = {}
    names: list[str] = []
    folders = [""]
    walked: list[str] = []
    while folders:
        above = folders.pop()
        walked.append(above)
        with _scanned(folder, above) as inside:
            for entry in inside:
                name = above + entry.name
                status = entry.stat(follow_symlinks=False)
                if len(names) == _MAX_ENTRIES:
                    raise _too_many(names, f"the first {_MAX_ENTRIES:,} files and folders")
                names.append(name)
                if not re.fullmatch(_PATH, name):
                    problems.append(f"{name!r}: {_PATH_LIMIT}")
                elif stat.S_ISDIR(status.st_mode):
                    folders.append(name + "/")
                elif stat.S_ISREG(status.st_mode):
                    sizes[name] = status.st_size
                else:
                    kind = "a symbolic link" if stat.S_ISLNK(status.st_mode) else "neither a file nor a folder"
                    problems.append(f"{name}: {kind}")
    if len(sizes) > MAX_FILES + len((MANIFEST, SIGNED)):
        raise _too_many(sizes, f"{len(sizes):,} files")
    filled = {f"{parent}/" for name in sizes for parent in PurePosixPath(name).parents}
    if not problems:  # what is refused fills its folder, too
        problems += [f"{name[:-1]}: an empty folder" for name in walked[1:] if name not in filled]
    if (total := sum(sizes.values())) > MAX_BYTES:
        largest = max(sizes, key=lambda name: sizes[name])
        problems.append(f"{largest}: {sizes[largest]:,} of {total:,} bytes in all files; limit: {MAX_BYTES:,}")
    if problems:
        raise Refused(problems)
    return sorted(sizes)


def _too_many(names: Iterable[str], of: str) -> Refused:
    folder, count = Counter(str(PurePosixPath(name).parent) for name in names).most_common(1)[0]
    return Refused([f"{folder}: holds {count:,} of {of}, more than any other folder; limit: {MAX_FILES:,} files"])


def _scanned(folder: Path, name: str) -> AbstractContextManager[Iterator[os.DirEntry[str]]]:
    try:
        return os.scandir(folder / name)
    except OSError as error:
        raise Refused([f"{name or folder}: {error.strerror}"]) from None


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, hex; a symbolic link is not followed.

    Raises:
        Refused: the file cannot be read.
    """
    try:
        with open(_plain(path), "rb") as stream:
            return file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise Refused([f"{path.name}: {error.strerror}"]) from None


def read_document(folder: Path, name: str, *, max_bytes: int = MAX_DOCUMENT_BYTES) -> bytes:
    """Return the bytes of a document; a symbolic link is not followed.

    Raises:
        Refused: the file is missing or too large.
    """
    try:
        with open(_plain(folder / name), "rb") as stream:
            data = stream.read(max_bytes + 1)
    except OSError as error:
        raise Refused([f"{name}: {error.strerror}"]) from None
    if len(data) > max_bytes:
        raise Refused([f"{name}: larger than {max_bytes:,} bytes"])
    return data


def _plain(path: Path) -> int:
    return os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
