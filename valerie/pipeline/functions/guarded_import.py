"""Convert an untrusted file of a user to a function that can be registered: recognise, convert, try out.

A child process opens checkpoints and networks (`valerie.pipeline.functions.import_child`). Its memory and time are bounded and
it does not see the environment's secrets, so a file that makes a parser run away only ends a child. Files that run code when
they are loaded are refused, except programs of torch where the operator allows them. The original of a converted file is not
kept.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from valerie.errors import InvalidInput, MissingDependency
from valerie.loading import load_document
from valerie.parent import module_command, module_environment
from valerie.perception.documents.function import PAYLOADS, FunctionDocument, parse_function
from valerie.pipeline.functions.import_job import (
    Conversion,
    ImportAnswer,
    ImportedFile,
    ImportFailure,
    ImportJob,
    Trial,
    payload_of,
)
from valerie.plain import JsonObject
from valerie.settings import Settings
from valerie.spelling import plain_name

#: Programs of torch: accepted if the operator allows them, and converted to ONNX.
_PROGRAMS: Final = {".pt2": "an exported program of torch", ".torchscript": "a TorchScript archive"}
#: Formats that run code when they are loaded, which users might try.
_RUNS_CODE: Final = {
    **_PROGRAMS,
    ".py": "a Python program",
    ".whl": "a Python package",
    ".so": "a library",
    ".joblib": "a pickle of any class",
    ".mar": "an archive with a program",
    ".keras": "an archive that may hold programs",
}
_CHECKPOINTS: Final = (".safetensors", ".pth", ".pt", ".pkl", ".ckpt", ".bin")
_ONNX: Final = ".onnx"
#: Suffixes of files that users may bring as functions, refused ones included.
SUFFIXES: Final = frozenset((_ONNX, *_CHECKPOINTS, *_RUNS_CODE))
_ACCEPTED: Final = ", ".join((_ONNX, *_CHECKPOINTS))


@dataclass(frozen=True, slots=True)
class ImportRequest:
    """A file with its owner's statements about it.

    Attributes:
        path: the file; None for functions without one.
        filename: its name on the owner's machine; the suffix determines its format.
        document: YAML or JSON, complete or only what the file does not state; may be empty.
        name, engine, precision: override the document.
    """

    path: Path | None
    filename: str = ""
    document: str | bytes = ""
    name: str | None = None
    engine: str | None = None
    precision: str | None = None


@dataclass(frozen=True, slots=True)
class ImportedFunction:
    """A function that is ready to be registered.

    Attributes:
        document: complete document.
        payload: its file: the converted one in `import_function`'s folder, or the user's own.
        trial: outcome of running it here.
    """

    document: FunctionDocument
    payload: Path | None
    trial: Trial


def import_function(request: ImportRequest, folder: Path, settings: Settings) -> ImportedFunction:
    """Recognise, convert and try out a function; nothing is registered.

    Args:
        request: the file and its owner's statements.
        folder: folder for the converted file; the caller removes it.
        settings: bounds, and the engine's device.

    Raises:
        InvalidInput: file or document are refused; names field, value and limit.
        MissingDependency: converting needs a library that is not installed here.
    """
    entries = _entries(request)
    if request.path is None:
        document = parse_function(entries)
        if document.kind in PAYLOADS:
            raise InvalidInput(f"kind {document.kind} needs a file", field="payload", limit=PAYLOADS[document.kind])
        return ImportedFunction(document, None, Trial(skipped=f"nothing to open: kind {document.kind}"))
    if "kind" in entries and entries["kind"] not in PAYLOADS:
        raise InvalidInput(f"kind {entries['kind']} takes no file", field="payload", value=request.filename)
    choose = "engine" not in entries and "precision" not in entries  # a requested one is kept
    limit = settings.max_function_mb << 20
    size = request.path.stat().st_size
    if size > limit:
        raise InvalidInput("the file is too large", field="payload", value=f"{size} bytes", limit=f"{limit} bytes")
    conversion = _conversion(request.filename, str(entries.get("kind", "")), programs=settings.import_programs)
    key = {"onnx": "source", "program": "program"}.get(conversion, "file")
    provenance = entries.get("provenance", {})
    assert isinstance(provenance, dict), "checked with the other entries"
    entries["provenance"] = {key: request.filename, **provenance}
    if conversion in ("onnx", "program"):
        entries = {"kind": "onnx", **entries}
    if conversion in ("onnx", "none"):
        entries["payload"] = payload_of(request.path, PAYLOADS[str(entries["kind"])]).model_dump()
    if conversion == "none":
        entries = parse_function(entries).model_dump(mode="json")
    job = ImportJob(
        entries=entries,
        path=request.path.absolute(),
        folder=folder,
        conversion=conversion,
        max_bytes=limit,
        memory_mb=settings.import_memory_mb,
        seconds=settings.import_seconds,
        device=settings.infer_device,
        choose_engine=choose,
    )
    imported = _run_child(job, settings)
    converted = conversion in ("checkpoint", "program")
    return ImportedFunction(imported.document, folder / imported.payload if converted else request.path, imported.trial)


def _conversion(filename: str, kind: str, *, programs: bool) -> Conversion:
    """Return the conversion of a file, by its suffix."""
    suffix = Path(filename).suffix.lower()
    if suffix == _ONNX:
        return "onnx"
    if suffix in _CHECKPOINTS:
        return "none" if kind == "huggingface" else "checkpoint"
    if suffix in _PROGRAMS and programs:
        return "program"
    if suffix not in _RUNS_CODE:
        raise InvalidInput("not a known kind of file", field="payload", value=filename, limit=_ACCEPTED)
    switch = (
        "; the operator of this deployment can allow it with VALERIE_IMPORT_PROGRAMS" if suffix in _PROGRAMS else ""
    )
    raise InvalidInput(
        f"{_RUNS_CODE[suffix]} runs code when it is loaded and is not accepted; export the network as ONNX{switch}",
        field="payload",
        value=filename,
        limit=_ACCEPTED,
    )


def _entries(request: ImportRequest) -> JsonObject:
    """Return the entries of the document that the owner states."""
    entries: JsonObject = load_document(request.document) if request.document else {}
    if "payload" in entries and request.path is not None:
        del entries["payload"]  # from an exported document; the file itself counts
    for field in ("name", "engine", "precision"):
        if getattr(request, field) is not None:
            entries[field] = getattr(request, field)
    if not isinstance(entries.get("provenance", {}), dict):
        raise InvalidInput("not a mapping", field="provenance", value=entries["provenance"])
    if "name" not in entries and request.filename:
        entries["name"] = plain_name(Path(request.filename).stem.lower(), also="_.", longest=64)
    return entries


def _run_child(job: ImportJob, settings: Settings) -> ImportedFile:
    """Run the job in a child process.

    Raises:
        InvalidInput: the file is refused, or opening it took too much memory or time.
        MissingDependency: a library is not installed here.
    """
    answer_file = job.folder / "answer.json"
    try:
        process = subprocess.run(
            module_command("valerie.pipeline.functions.import_child", str(answer_file)),
            input=job.model_dump_json(),
            capture_output=True,
            text=True,
            errors="replace",
            timeout=settings.import_seconds + 30,
            env={**module_environment(), "HF_HUB_OFFLINE": "1", "ORT_DISABLE_TELEMETRY": "1"},
            cwd=job.folder,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise _out_of_bounds(settings) from None
    try:
        outcome = ImportAnswer.model_validate_json(answer_file.read_bytes()).outcome
    except (OSError, ValidationError):
        if process.returncode < 0:  # ended by a signal: its timer, or the system for lack of memory
            raise _out_of_bounds(settings) from None
        last = (process.stderr.strip().splitlines() or ["no message"])[-1]
        raise InvalidInput(f"the process that converts and checks it ended ({last[:300]})", field="payload") from None
    if isinstance(outcome, ImportFailure):
        raise (MissingDependency if outcome.missing_dependency else InvalidInput)(outcome.message)
    return outcome


def _out_of_bounds(settings: Settings) -> InvalidInput:
    return InvalidInput(
        "converting and checking it took too much memory or time",
        field="payload",
        limit=f"{settings.import_memory_mb} MB, {settings.import_seconds:g} s (VALERIE_IMPORT_MEMORY_MB, VALERIE_IMPORT_SECONDS)",
    )
