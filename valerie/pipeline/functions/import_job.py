"""The documents that `guarded_import` and its child process exchange: a job as JSON on standard input, an answer in a file."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Literal

from pydantic import JsonValue

from valerie.document import Document
from valerie.perception.documents.function import FunctionDocument, Payload

#: The child's action before it opens the function: none, check ONNX, or convert the file.
Conversion = Literal["none", "onnx", "checkpoint", "program"]


class ImportJob(Document):
    """One file to open.

    Attributes:
        entries: entries of the function's document; complete for the conversions ``none`` and ``onnx``.
        path: the file.
        folder: folder for a converted file.
        conversion: conversion of the file.
        max_bytes: largest checkpoint or ONNX file.
        memory_mb: limit of the child's private memory; 0 sets no limit.
        seconds: limit of the child's wall time; 0 sets no limit.
        device: device of the engine torch.
        choose_engine: choose the fastest engine that agrees with the reference, since the owner states none.
    """

    entries: dict[str, JsonValue]
    path: Path
    folder: Path
    conversion: Conversion
    max_bytes: int
    memory_mb: int
    seconds: float
    device: str
    choose_engine: bool


class Trial(Document):
    """The outcome of running a function twice on one small picture.

    Attributes:
        numeric_class: numeric class of the engine.
        precision: precision of the engine.
        picture: width and height in pixels.
        cpu_seconds: CPU time of one prediction.
        skipped: the reason why the function was not run here; None if it was.
    """

    numeric_class: str | None = None
    precision: str | None = None
    picture: tuple[int, int] | None = None
    cpu_seconds: float | None = None
    skipped: str | None = None


class ImportedFile(Document):
    """The child's answer on success.

    Attributes:
        document: complete document.
        payload: name of the function's file: in the job's folder if it was converted, otherwise the job's own.
        trial: trial of the function.
    """

    document: FunctionDocument
    payload: str
    trial: Trial


class ImportFailure(Document):
    """The child's answer if the file or its document is refused.

    Attributes:
        message: message for the user.
        missing_dependency: True if a library is missing here; the file may be valid.
    """

    message: str
    missing_dependency: bool = False


class ImportAnswer(Document):
    """Answer of the child."""

    outcome: ImportedFile | ImportFailure


def payload_of(path: Path, file_format: str) -> Payload:
    """Return a document's entry about a file."""
    with path.open("rb") as stream:
        sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
    return Payload.model_validate({"sha256": sha256, "bytes": path.stat().st_size, "format": file_format})
