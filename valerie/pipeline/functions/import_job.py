"""The documents that `guarded_import` and its child process exchange: a job as JSON on standard input, an answer in a file."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, JsonValue

from valerie.perception.documents.function import FunctionDocument, Payload

#: What the child does with the file before it opens the function: nothing, check ONNX, or make another file of it.
Conversion = Literal["none", "onnx", "checkpoint", "program"]


class _Document(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ImportJob(_Document):
    """One file to open.

    Attributes:
        entries: of the function's document; complete for the conversions ``none`` and ``onnx``.
        path: the file.
        folder: where a converted file goes.
        conversion: what to do with the file.
        max_bytes: of a checkpoint or an ONNX file.
        memory_mb: private memory of the child; 0 sets no limit.
        seconds: wall time of the child; 0 sets no limit.
        device: of the engine torch.
        choose_engine: the owner states no engine: take the fastest that agrees with the reference.
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


class Trial(_Document):
    """The outcome of running a function twice on one small picture.

    Attributes:
        numeric_class: of the engine that ran it.
        precision: that the engine ran in.
        picture: width and height, pixels.
        cpu_seconds: of one prediction.
        skipped: the reason why the function was not run here; None if it was.
    """

    numeric_class: str | None = None
    precision: str | None = None
    picture: tuple[int, int] | None = None
    cpu_seconds: float | None = None
    skipped: str | None = None


class ImportedFile(_Document):
    """The child's answer if all went well.

    Attributes:
        document: complete.
        payload: name of the function's file: in the job's folder if it was converted, else the job's own.
        trial: of the function.
    """

    document: FunctionDocument
    payload: str
    trial: Trial


class ImportFailure(_Document):
    """The child's answer if the file or its document is refused.

    Attributes:
        message: for the user.
        missing_dependency: a library is missing here; the file may be good.
    """

    message: str
    missing_dependency: bool = False


class ImportAnswer(_Document):
    """Answer of the child."""

    outcome: ImportedFile | ImportFailure


def payload_of(path: Path, file_format: str) -> Payload:
    """Return a document's entry for a file."""
    with path.open("rb") as stream:
        sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
    return Payload.model_validate({"sha256": sha256, "bytes": path.stat().st_size, "format": file_format})
