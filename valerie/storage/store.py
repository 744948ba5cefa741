"""The artifact store: a folder or an S3-compatible bucket behind one small interface, with the errors of `valerie.errors`.

Products are content-addressed: a key is written once, and concurrent writers are harmless. Readers never see a partial
object: in a folder, a temporary file is linked into place; a bucket uses a conditional put.
"""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

import obstore
from obstore.exceptions import AlreadyExistsError, BaseError, PreconditionError
from obstore.store import LocalStore, ObjectStore, S3Store

from valerie.errors import InvalidInput, NotFound, StorageFull, StorageUnavailable, ValerieError
from valerie.storage import envelope

_FULL: Final = re.compile(r"os error (28|122|27)\b|No space left|StorageFull|QuotaExceeded|status: 507", re.IGNORECASE)
#: Suffix of a file that the folder store is still writing.
_STAGING: Final = re.compile(r"#\d+$")


@dataclass(frozen=True, slots=True)
class ObjectInfo:
    """One stored object.

    Attributes:
        key: its key.
        size: bytes.
        etag: changes with the content; quoted as in HTTP, empty if the store has none.
        modified: time of the last write, UTC.
    """

    key: str
    size: int
    etag: str
    modified: datetime


class ArtifactStore:
    """Stores objects by key; several threads and processes may use it at once.

    Every method may raise `StorageUnavailable` (no connection, no permission, a read-only folder); writing also
    `StorageFull`. Both are transient: the same call may succeed later.
    """

    def __init__(self, store: ObjectStore, *, url: str, folder: Path | None = None) -> None:
        self._store = store
        self._folder = folder
        self.url = url

    def put(self, key: str, data: bytes, *, replace: bool = False) -> bool:
        """Write an object; without ``replace``, an intact one that exists is kept.

        A slow worker that lost its lease may write second, with other bytes if an engine is not deterministic to the bit.
        Results computed from the first object must keep matching the stored one. A compressed object that a power cut damaged
        is replaced.

        Returns:
            True if these bytes were written.

        Raises:
            StorageFull: no space left.
        """
        if replace:
            with _translated(key):
                obstore.put(self._store, key, data)
            return True
        try:
            with _translated(key):
                obstore.put(self._store, key, data, mode="create", use_multipart=False)
        except _Exists:
            present = self.get(key)
            if present == data or not key.endswith(".zst") or envelope.intact(present):
                return False
            return self.put(key, data, replace=True)
        return True

    def get(self, key: str) -> bytes:
        """Read a whole object.

        Raises:
            NotFound: no such object.
        """
        with _translated(key):
            return obstore.get(self._store, key).bytes().to_bytes()

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """Read the bytes ``start`` … ``start + length − 1``; fewer at the end of the object.

        Raises:
            NotFound: no such object.
            InvalidInput: the range is empty or begins outside the object.
        """
        size = self.head(key).size
        if not 0 <= start < size or length < 1:
            raise InvalidInput("the range is outside the object", field=key, value=f"{start}+{length}", limit=size)
        with _translated(key):
            return obstore.get_range(self._store, key, start=start, length=min(length, size - start)).to_bytes()

    def head(self, key: str) -> ObjectInfo:
        """Return size and tag of an object without reading it.

        Raises:
            NotFound: no such object.
        """
        with _translated(key):
            meta = obstore.head(self._store, key)
        return ObjectInfo(key, meta["size"], meta["e_tag"] or "", meta["last_modified"])

    def exists(self, key: str) -> bool:
        """Return True if there is an object with this key."""
        try:
            self.head(key)
        except NotFound:
            return False
        return True

    def delete(self, keys: str | Iterable[str]) -> None:
        """Remove one or several objects; a missing object is no error."""
        for key in (keys,) if isinstance(keys, str) else keys:
            try:
                with _translated(key):
                    obstore.delete(self._store, key)
            except NotFound:
                continue

    def list(self, prefix: str = "") -> Iterator[ObjectInfo]:
        """Return all objects below a prefix (whole path segments), in no particular order."""
        with _translated(prefix):
            for chunk in obstore.list(self._store, prefix or None):
                for meta in chunk:
                    yield ObjectInfo(meta["path"], meta["size"], meta["e_tag"] or "", meta["last_modified"])

    def free_bytes(self) -> int | None:
        """Return the bytes that this user may still write in a folder; None for a bucket, which does not say."""
        if self._folder is None:
            return None
        try:
            return shutil.disk_usage(self._folder).free
        except OSError as error:
            raise StorageUnavailable(f"the artifact folder {self._folder} cannot be read: {error.strerror}") from error

    def check(self) -> None:
        """Write, read and remove a small object, to check that this process can use the store.

        Raises:
            StorageFull: no space left.
            StorageUnavailable: not writable or not reachable; the message says where and why.
        """
        key = f"probe-{os.getpid()}-{time.time_ns()}"
        try:
            self.put(key, b"valerie", replace=True)
            if self.get(key) != b"valerie":
                raise StorageUnavailable("it returned other bytes than were written")
            self.delete(key)
        except NotFound as error:
            raise StorageUnavailable(f"artifacts in {self.url}: what was written is not there") from error
        except (StorageFull, StorageUnavailable) as error:
            raise type(error)(f"artifacts in {self.url}: {error}") from error

    def now(self) -> datetime:
        """Return the time by the store's clock, by which it dates its objects; this process's may be hours apart.

        Raises:
            StorageFull: no space left.
            StorageUnavailable: not writable or not reachable.
        """
        key = f"probe-{os.getpid()}-{time.time_ns()}"
        self.put(key, b"valerie", replace=True)
        modified = self.head(key).modified
        self.delete(key)
        return modified

    def remove_staging(self, *, before: datetime) -> int:
        """Remove the half-written files of killed writers from a folder store that are older; return their number."""
        if self._folder is None:
            return 0
        removed = 0
        for path in self._folder.rglob("*#*"):
            if _STAGING.search(path.name) and path.stat().st_mtime <= before.timestamp():
                path.unlink(missing_ok=True)
                removed += 1
        return removed


def open_store(url: str, *, s3_endpoint: str | None = None) -> ArtifactStore:
    """Open a folder (``/path``, ``file:///path``) or a bucket (``s3://bucket/prefix``).

    Credentials and region of a bucket come from the usual ``AWS_*`` variables.

    Raises:
        InvalidInput: neither a folder nor a bucket.
        StorageUnavailable: the folder cannot be created.
    """
    parts = urlsplit(url)
    if parts.scheme == "s3":
        return _open_bucket(url, parts.netloc, parts.path.strip("/"), s3_endpoint)
    if parts.scheme not in ("", "file") or (parts.scheme == "file" and parts.netloc):
        raise InvalidInput(
            "not a place for artifacts",
            field="VALERIE_ARTIFACTS_URL",
            value=url,
            limit="a folder or s3://bucket/prefix",
        )
    folder = Path(parts.path if parts.scheme else url).expanduser().absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        store = LocalStore(folder)
    except (OSError, BaseError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else _first_line(error)
        raise StorageUnavailable(f"the artifact folder {folder} cannot be used: {reason}") from error
    return ArtifactStore(store, url=str(folder), folder=folder)


def copy_objects(
    source: ArtifactStore, target: ArtifactStore, keys: Iterable[str], *, replace: bool = False
) -> Iterator[int]:
    """Copy objects one by one, and yield the size of each in bytes; one that is missing is left out, and has size 0.

    Args:
        source, target: from and to.
        keys: keys of the objects, the same in both.
        replace: True to replace objects that the target has.
    """
    for key in keys:
        try:
            data = source.get(key)
        except NotFound:  # removed meanwhile
            yield 0
            continue
        target.put(key, data, replace=replace)
        yield len(data)


def _open_bucket(url: str, bucket: str, prefix: str, endpoint: str | None) -> ArtifactStore:
    if not bucket:
        raise InvalidInput("names no bucket", field="VALERIE_ARTIFACTS_URL", value=url, limit="s3://bucket/prefix")
    environ = os.environ
    store = S3Store(
        bucket,
        prefix=prefix or None,
        endpoint=endpoint or environ.get("AWS_ENDPOINT_URL_S3") or environ.get("AWS_ENDPOINT_URL"),
        region=environ.get("AWS_REGION") or environ.get("AWS_DEFAULT_REGION") or "us-east-1",
        client_options={"allow_http": True, "connect_timeout": "5s", "timeout": "60s"},
        # Products are retried after a lost connection, so the library must not hide the loss for minutes.
        retry_config={"max_retries": 3},
    )
    return ArtifactStore(store, url=url)


class _Exists(Exception):  # a signal inside this module
    """A conditional put found an existing object."""


@contextmanager
def _translated(key: str) -> Iterator[None]:
    """Translate the library's errors into those of `valerie.errors`."""
    try:
        yield
    except FileNotFoundError as error:
        raise NotFound("artifact", key) from error
    except (AlreadyExistsError, PreconditionError) as error:
        raise _Exists from error
    except ValueError as error:
        raise InvalidInput("not an object key", field="key", value=key) from error
    except (BaseError, OSError) as error:
        raise _classified(str(error), key) from error


def _classified(text: str, key: str) -> ValerieError:
    line = text.split("\n", 1)[0].strip()
    if _FULL.search(text):
        return StorageFull(f"no space left for artifact {key}: {line}")
    return StorageUnavailable(f"artifact {key}: {line}")


def _first_line(error: Exception) -> str:
    return str(error).split("\n", 1)[0]
