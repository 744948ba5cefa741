"""Verify an evidence folder, without data folder or server and without executing anything from the folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from valerie.errors import InvalidInput
from valerie.pipeline.base.progress import Count
from valerie.pipeline.evidence.evidence_manifest import (
    MANIFEST,
    SIGNED,
    Refused,
    plain_files,
    read_document,
    read_evidence_manifest,
    sha256_of,
)
from valerie.pipeline.evidence.signing import read_public_key, require_envelope, require_signature

#: What follows from a missing signature.
UNSIGNED: Final = (
    "The folder is not signed: nothing shows where it came from; anyone can change files and list them anew. Ask its maker "
    "for one that `valerie evidence export --key` signed, or compare the root with one that you trust"
)


@dataclass(frozen=True, slots=True)
class Verified:
    """A folder whose files are those of its manifest.

    Attributes:
        files: number of files that the manifest covers.
        root: Merkle root over them, hex.
        signed: True if there is a signature.
        signer: id of the key that signed; None without a key to check with.
    """

    files: int
    root: str
    signed: bool
    signer: str | None


def verify(folder: Path, *, key: Path | None = None, progress: Count = lambda *_: None) -> Verified:
    """Check names, sizes and digests of all files, and with ``key`` the signature.

    Without a key, the origin of the folder remains unknown.

    Args:
        folder: the folder.
        key: public key of the signer.
        progress: is told how many files were checked, of how many.

    Raises:
        InvalidInput: no such folder, or not a public key.
        Refused: a file is missing, changed, not listed, a link, or beyond the limits; or the signature is not valid.
    """
    public = None if key is None else read_public_key(key)
    if not folder.is_dir():
        raise InvalidInput("not a folder", field="FOLDER", value=str(folder))
    present = set(plain_files(folder))
    if MANIFEST not in present:
        raise Refused([f"{MANIFEST}: missing"])
    data = read_document(folder, MANIFEST)
    manifest = read_evidence_manifest(data)
    expected = manifest.digests
    problems = [f"{name}: missing" for name in expected if name not in present]
    problems += [f"{name}: not in the manifest" for name in sorted(present - {*expected, MANIFEST, SIGNED})]
    for number, (name, digest) in enumerate(expected.items(), start=1):
        if name in present and sha256_of(folder / name) != digest:
            problems.append(f"{name}: changed")
        progress(number, len(expected))
    if problems:
        raise Refused(problems)
    signer = None
    if SIGNED in present:
        envelope = require_envelope(read_document(folder, SIGNED), data)
        if public is not None:
            signer = require_signature(envelope, public)
    elif public is not None:
        raise Refused([f"{SIGNED}: missing. {UNSIGNED}"])
    return Verified(len(expected), manifest.predicate.root, SIGNED in present, signer)
