"""Uploaded forms, written to disk; `services.api.protection` limits their size."""

from __future__ import annotations

import re
import shutil
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Final

from fastapi import Depends, Request
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException

from valerie.errors import InvalidInput, UnknownName
from valerie.loading import MAX_BYTES

_TEXTS: Final = ("name", "engine", "precision", "document")
_FILE: Final = "payload"


@dataclass(frozen=True, slots=True)
class Form:
    """The parts of a form with one file.

    Attributes:
        texts: name to text, for the parts in `_TEXTS` that the form has.
        payload: path of the file under a safe name; None without a file.
        folder: folder for files made from it; removed with the request.
    """

    texts: dict[str, str]
    payload: Path | None
    folder: Path


async def _form(request: Request) -> AsyncIterator[Form]:
    if not request.headers.get("content-type", "").lower().startswith("multipart/form-data"):
        limit = "multipart/form-data"
        raise InvalidInput("not a form", field="body", value=request.headers.get("content-type", ""), limit=limit)
    try:
        parts = await request.form(max_files=2, max_fields=len(_TEXTS), max_part_size=MAX_BYTES)
    except HTTPException as error:
        if error.status_code != HTTPStatus.BAD_REQUEST:
            raise
        raise InvalidInput(f"not a readable form ({error.detail})", field="body") from None
    with TemporaryDirectory(prefix="valerie-upload-") as folder:
        try:
            texts: dict[str, str] = {}
            payload: Path | None = None
            for name, part in parts.multi_items():
                if name in texts or (name == _FILE and payload is not None):
                    raise InvalidInput("given twice", field=name)
                if name == _FILE and isinstance(part, UploadFile):
                    payload = Path(folder) / _safe(part.filename)
                    with payload.open("xb") as stream:
                        shutil.copyfileobj(part.file, stream)
                elif name in _TEXTS:
                    texts[name] = await _text(name, part)
                else:
                    raise UnknownName("part of the form", name, (*_TEXTS, _FILE), field="body")
            yield Form(texts, payload, Path(folder))
        finally:
            with suppress(OSError):
                await parts.close()


FormDependency = Annotated[Form, Depends(_form)]


async def _text(name: str, part: UploadFile | str) -> str:
    if isinstance(part, str):
        return part
    data = await part.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise InvalidInput("too large", field=name, limit=f"{MAX_BYTES} bytes")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise InvalidInput(f"not UTF-8 text ({error.reason})", field=name) from None


def _safe(filename: str | None) -> str:
    """Return the last part of a file name, reduced to letters, digits, dots, underscores and hyphens."""
    last = re.split(r"[/\\]", filename or "")[-1]
    return re.sub(r"[^A-Za-z0-9._-]+", "-", last).lstrip(".-")[-100:] or "payload"
