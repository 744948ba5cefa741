"""Keys of stored objects; no other module builds one.

Products are addressed by content and sharded by the first two characters of their digest, so that folders remain small enough
to list.
"""

from __future__ import annotations

import re
from typing import Final

from valerie.errors import InvalidInput

PRODUCTS: Final = "products/"
RUNS: Final = "runs/"
FUNCTIONS: Final = "functions/"

_ARCHIVE: Final = "archive."
_KIND = re.compile(r"[a-z][a-z-]{0,30}")
_DIGEST = re.compile(r"[0-9a-f]{32}")
_SHA256 = re.compile(r"[0-9a-f]{64}")
_FORMAT = re.compile(r"[a-z][a-z0-9]{0,15}")
_RUN = re.compile(r"[0-9A-Za-z][0-9A-Za-z_-]{0,63}")
_NAME = re.compile(r"[0-9A-Za-z][0-9A-Za-z_-]*(\.[0-9A-Za-z_-]+)*")


def product_key(kind: str, digest: str) -> str:
    """Return the key of a product: ``products/layer/ab/abcd….zst``.

    Args:
        kind: ``background``, ``layer``, ``truth``, ``prediction`` …
        digest: 32 lower-case hexadecimal characters (`valerie.parameters.assignment.digest`).

    Raises:
        InvalidInput: not a kind or not a digest.
    """
    if not _KIND.fullmatch(kind):
        raise InvalidInput("not a kind of product", field="kind", value=kind, limit="lower-case letters and hyphens")
    if not _DIGEST.fullmatch(digest):
        raise InvalidInput("not a digest", field="digest", value=digest, limit="32 lower-case hexadecimal characters")
    return f"{PRODUCTS}{kind}/{digest[:2]}/{digest}.zst"


def parse_product_key(key: str) -> tuple[str, str] | None:
    """Return kind and digest of a product's key; None for any other key."""
    parts = key.removeprefix(PRODUCTS).split("/")
    if not key.startswith(PRODUCTS) or len(parts) != 3:
        return None
    kind, digest = parts[0], parts[2].removesuffix(".zst")
    if not _KIND.fullmatch(kind) or not _DIGEST.fullmatch(digest) or key != product_key(kind, digest):
        return None
    return kind, digest


def run_key(run_id: str, name: str) -> str:
    """Return the key of a run's own artifact, e.g. ``runs/0192…/report.html``; unlike products, these may be replaced.

    Raises:
        InvalidInput: not a run id or not a plain file name.
    """
    if not _NAME.fullmatch(name) or len(name) > 100:
        raise InvalidInput("not a plain file name", field="name", value=name, limit="letters, digits, . _ -")
    return run_prefix(run_id) + name


def archive_key(run_id: str, table: str, sha256: str) -> str:
    """Return the key of the rows of a table of an archived run: ``runs/0192…/archive.frames.abcd….parquet``.

    The digest is that of the file, so that two processes that archive a run do not replace each other's files.
    """
    return run_key(run_id, f"{_ARCHIVE}{table}.{sha256[:16]}.parquet")


def is_archive_key(key: str) -> bool:
    """Return True if a key of a run's own artifact is one of `archive_key`."""
    return key.rpartition("/")[2].startswith(_ARCHIVE)


def run_prefix(run_id: str) -> str:
    """Return the prefix of all keys of a run.

    Raises:
        InvalidInput: not a run id.
    """
    if not _RUN.fullmatch(run_id):
        raise InvalidInput("not a run id", field="run", value=run_id, limit="letters, digits, _ and -")
    return f"{RUNS}{run_id}/"


def function_key(sha256: str, file_format: str) -> str:
    """Return the key of the file of a function under test: ``functions/ab/abcd….onnx``.

    Raises:
        InvalidInput: not a SHA-256 in lower-case hexadecimal characters, or not a format.
    """
    if not _SHA256.fullmatch(sha256):
        raise InvalidInput("not a SHA-256", field="sha256", value=sha256, limit="64 lower-case hexadecimal characters")
    if not _FORMAT.fullmatch(file_format):
        raise InvalidInput("not a format", field="format", value=file_format, limit="lower-case letters and digits")
    return f"{FUNCTIONS}{sha256[:2]}/{sha256}.{file_format}"


def parse_function_key(key: str) -> str | None:
    """Return the SHA-256 in the key of a function's file; None for any other key."""
    parts = key.removeprefix(FUNCTIONS).split("/")
    sha256, _, file_format = parts[-1].partition(".")
    if not key.startswith(FUNCTIONS) or not _SHA256.fullmatch(sha256) or not _FORMAT.fullmatch(file_format):
        return None
    return sha256 if key == function_key(sha256, file_format) else None
