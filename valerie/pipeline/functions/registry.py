"""Registered functions under test: stored once under (name, digest), found by name, kept while a run needs them.

A function is a frozen document and at most one payload file in the artifact store. Specs refer to it as ``name``, its newest
version when the run starts, or as ``name@digest``, where the first characters of the digest suffice.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from sqlalchemy import Connection

from valerie import plugins
from valerie.db import functions
from valerie.db.engine import database_moment, writing
from valerie.db.functions import SHORT, FunctionRow
from valerie.db.rows import required
from valerie.errors import Conflict, CorruptArtifact, InvalidInput, NotFound, UnknownName
from valerie.perception.documents.class_maps import require_person
from valerie.perception.documents.function import FunctionDocument
from valerie.pipeline.base.context import Context
from valerie.storage.keys import function_key

_PREFIX: Final = re.compile(r"[0-9a-f]{6,32}")


def register(context: Context, document: FunctionDocument, payload: Path | None) -> tuple[FunctionRow, bool]:
    """Store a function.

    Returns:
        The registered version, and True if it is new: the same document under the same name changes nothing.

    Raises:
        Conflict: the name belongs to a function that ships with VALERIE or with an installed package.
        InvalidInput: the file is not the one that the document names, or no class of the function maps to a person.
        StorageFull: no space left.
    """
    require_free(document.name)
    require_person(document.output.classes, document.output.class_map)
    if document.payload is not None:
        _store_payload(context, document, payload)
    with writing(context.engine) as connection:
        new = functions.register(connection, document, database_moment(connection))
        return find(connection, f"{document.name}@{document.digest}"), new


def require_free(name: str) -> None:
    """Refuse a name under which nothing can be registered.

    Raises:
        Conflict: it belongs to a function that ships with VALERIE or with an installed package.
    """
    if name in plugins.function_names(testing=True):
        raise Conflict(
            f"the name {name!r} belongs to a function that is installed with VALERIE; register it under another one"
        )


def find(connection: Connection, reference: str, *, field: str = "function") -> FunctionRow:
    """Return the version that ``name`` or ``name@digest`` names.

    Raises:
        UnknownName: no such name; near matches are named.
        NotFound: the name has no version with this digest, or no longer.
        InvalidInput: not the first characters of a digest, or several versions have them.
    """
    name, at, prefix = reference.partition("@")
    if at and not _PREFIX.fullmatch(prefix):
        limit = "6 to 32 lower-case hexadecimal characters"
        raise InvalidInput("not the first characters of a digest", field=field, value=reference, limit=limit)
    versions = functions.versions(connection, name)
    if not versions:
        raise UnknownName("registered function", name, {row.name for row in functions.every(connection)}, field=field)
    candidates = [row for row in versions if row.digest.startswith(prefix)]
    if not candidates:
        raise NotFound("version of the function", reference)
    if prefix and len(candidates) > 1:
        raise InvalidInput(
            "several versions have such a digest",
            field=field,
            value=reference,
            limit=", ".join(row.digest for row in candidates),
        )
    return candidates[0]


def of_digest(connection: Connection, digest: str, name: str) -> FunctionRow:
    """Return the version that a run pinned.

    Args:
        connection: connection to read with.
        digest: complete digest of the document.
        name: name in the run's spec.

    Raises:
        NotFound: it was removed.
    """
    removed = f"{name.partition('@')[0]}@{digest[:SHORT]}: it was removed"
    return required(functions.of_digest(connection, digest), "version of the function", removed)


def known(connection: Connection, references: Iterable[str]) -> dict[str, FunctionDocument]:
    """Return the documents of those references that are registered; others are left out."""
    documents: dict[str, FunctionDocument] = {}
    for reference in references:
        try:
            documents[reference] = find(connection, reference).document
        except (InvalidInput, NotFound):
            continue
    return documents


def names(connection: Connection, registered: Mapping[str, FunctionDocument]) -> set[str]:
    """Return the keys of ``registered`` (see `known`) and all registered names, which allow suggestions."""
    return {*registered, *(row.name for row in functions.every(connection))}


def remove(context: Context, reference: str) -> FunctionRow:
    """Delete one version, and its payload if no other version has the same.

    Raises:
        UnknownName, NotFound, InvalidInput: see `find`; also for a reference without a digest, since a removal is final.
        Conflict: a run that has not ended needs it.
    """
    if "@" not in reference:
        raise InvalidInput(
            "the name alone does not identify a version", field="function", value=reference, limit="NAME@DIGEST"
        )
    with writing(context.engine) as connection:
        version = find(connection, reference)
        needing = [run.id for run in functions.unfinished_runs(connection) if _needs(connection, run, version)]
        if needing:
            names = ", ".join(needing[:3]) + (" …" if len(needing) > 3 else "")
            raise Conflict(f"{version.reference} is needed by runs that have not ended: {names}; cancel them first")
        functions.remove(connection, version.name, version.digest)
        payload = version.document.payload
        orphaned = payload is not None and not functions.known_payloads(connection, [payload.sha256])
    if payload is not None and orphaned:
        context.store.delete(function_key(payload.sha256, payload.format))
    return version


def require_known(connection: Connection, names: Iterable[str]) -> None:
    """Refuse a run whose function was removed before it could start.

    Raises:
        UnknownName, NotFound, InvalidInput: see `find`.
    """
    installed = plugins.function_names(testing=True)
    for name in names:
        if name not in installed:
            find(connection, name)


def read_payload(context: Context, document: FunctionDocument) -> bytes:
    """Return the payload's bytes, verified.

    Raises:
        NotFound: the function has no payload, or it was removed.
        CorruptArtifact: the store has other bytes.
    """
    payload = document.payload
    if payload is None:
        raise NotFound("file of the function", document.name)
    data = context.store.get(function_key(payload.sha256, payload.format))
    sha256 = hashlib.sha256(data).hexdigest()
    if sha256 != payload.sha256:
        raise CorruptArtifact(f"the stored file of {document.name} has digest {sha256[:12]}, not {payload.sha256[:12]}")
    return data


def _needs(connection: Connection, run: functions.UnfinishedRun, version: FunctionRow) -> bool:
    """Return True if an unfinished run pinned this version, or would pin it when it starts."""
    if run.pins is not None:
        return any(pin.digest == version.digest for pin in run.pins.functions.values())
    documents = known(connection, run.spec.functions).values()
    return any((document.name, document.digest) == (version.name, version.digest) for document in documents)


def _store_payload(context: Context, document: FunctionDocument, path: Path | None) -> None:
    file = document.file
    if path is None:
        raise InvalidInput("the file is missing", field="payload", limit=f"{file.bytes} bytes")
    data = path.read_bytes()
    if hashlib.sha256(data).hexdigest() != file.sha256:
        raise InvalidInput("not the file that the document names", field="payload.sha256", value=file.sha256)
    context.store.put(function_key(file.sha256, file.format), data)
