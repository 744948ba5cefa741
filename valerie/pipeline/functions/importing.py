"""From a file that somebody brought to a function that can be registered: recognised, converted, tried out, never trusted.

A child process with bounded memory and time, and without the environment's secrets, opens checkpoints and networks
(`valerie.pipeline.functions.import_child`): a file that makes a parser run away ends a child and nothing else.
Files that run code when they are loaded are refused, but for programs of torch where the operator allows them. The original of
a converted file is not kept.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import valerie
from valerie.errors import InvalidInput, MissingDependency, ValerieError
from valerie.loading import load_document
from valerie.perception.documents.function import PAYLOADS, FunctionDocument, Payload, parse_function
from valerie.perception.importing.onnx_files import check_onnx
from valerie.settings import Settings
from valerie.spelling import plain_name

#: Programs of torch: taken where an operator allows it, and turned into ONNX.
_PROGRAMS: Final = {".pt2": "an exported program of torch", ".torchscript": "a TorchScript archive"}
#: What loading executes code from, and people might bring all the same.
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
#: Endings of what people bring as a function, also where it is refused.
SUFFIXES: Final = frozenset((_ONNX, *_CHECKPOINTS, *_RUNS_CODE))
#: Variables that a converter needs; whatever else the environment holds is no business of a stranger's file.
_ENVIRONMENT: Final = ("PATH", "HOME", "LANG", "LC_ALL", "TMPDIR", "LD_LIBRARY_PATH", "OMP_NUM_THREADS", "PYTHONPATH")


@dataclass(frozen=True, slots=True)
class Brought:
    """What somebody brought.

    Attributes:
        path: the file; None for functions without one.
        filename: what they call it; its suffix says what it should be.
        document: YAML or JSON, whole or only what the file cannot say; empty for none.
        name, engine, precision: win over the document.
    """

    path: Path | None
    filename: str = ""
    document: str | bytes = ""
    name: str | None = None
    engine: str | None = None
    precision: str | None = None


@dataclass(frozen=True, slots=True)
class Imported:
    """A function that is ready to be registered.

    Attributes:
        document: complete.
        payload: its file, in the folder that `import_function` was given or where it was brought.
        check: what trying it out said: engine, numeric class, CPU seconds; or why it was not tried out here.
    """

    document: FunctionDocument
    payload: Path | None
    check: dict[str, Any]


def import_function(brought: Brought, folder: Path, settings: Settings) -> Imported:
    """Recognise, convert and try out; registers nothing.

    Args:
        brought: the file and what is said about it.
        folder: for the converted file; the caller's to remove.
        settings: bounds, and the engine's threads and device.

    Raises:
        InvalidInput: what is wrong with file or document, with field, value and limit.
        MissingDependency: converting needs a library that is not installed here.
    """
    entries = _entries(brought)
    suffix = Path(brought.filename).suffix.lower()
    if brought.path is None:
        document = parse_function(entries)
        if document.kind in PAYLOADS:
            raise InvalidInput(f"kind {document.kind} needs a file", field="payload", limit=PAYLOADS[document.kind])
        return Imported(document, None, {"skipped": f"nothing to open: kind {document.kind}"})
    if "kind" in entries and entries["kind"] not in PAYLOADS:
        raise InvalidInput(f"kind {entries['kind']} takes no file", field="payload", value=brought.filename)
    limit = settings.max_function_mb << 20
    size = brought.path.stat().st_size
    if size > limit:
        raise InvalidInput("the file is too large", field="payload", value=f"{size} bytes", limit=f"{limit} bytes")
    if suffix in _PROGRAMS and settings.import_programs:
        entries = {
            "kind": "onnx",
            **entries,
            "provenance": {"program": brought.filename, **entries.get("provenance", {})},
        }
        return _tried(entries, brought.path, folder, settings, convert="program")
    if suffix in _RUNS_CODE:
        switch = (
            "; who operates this deployment can allow it with VALERIE_IMPORT_PROGRAMS" if suffix in _PROGRAMS else ""
        )
        raise InvalidInput(
            f"{_RUNS_CODE[suffix]} runs code when it is loaded and is not accepted; export the network as ONNX{switch}",
            field="payload",
            value=brought.filename,
            limit=", ".join((_ONNX, *_CHECKPOINTS)),
        )
    if suffix == _ONNX:
        summary = check_onnx(brought.path, max_bytes=limit)
        told = {"source": brought.filename, "producer": summary.producer, "opset": str(summary.opset)}
        entries = {"kind": "onnx", **entries, "provenance": {**told, **entries.get("provenance", {})}}
        return _tried(entries, brought.path, folder, settings, convert="")
    if suffix not in _CHECKPOINTS:
        raise InvalidInput(
            "not a kind of file that is known",
            field="payload",
            value=brought.filename,
            limit=", ".join((_ONNX, *_CHECKPOINTS)),
        )
    as_it_is = entries.get("kind") == "huggingface"
    entries["provenance"] = {"file": brought.filename, **entries.get("provenance", {})}
    return _tried(entries, brought.path, folder, settings, convert="" if as_it_is else "checkpoint")


def payload_of(path: Path, file_format: str) -> Payload:
    """The entry of a document for a file."""
    with path.open("rb") as stream:
        sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
    return Payload.model_validate({"sha256": sha256, "bytes": path.stat().st_size, "format": file_format})


def _entries(brought: Brought) -> dict[str, Any]:
    """The document as far as it was given."""
    entries: dict[str, Any] = load_document(brought.document) if brought.document else {}
    if "payload" in entries and brought.path is not None:
        del entries["payload"]  # of a document that was exported: the file speaks for itself
    for field in ("name", "engine", "precision"):
        if getattr(brought, field) is not None:
            entries[field] = getattr(brought, field)
    if not isinstance(entries.get("provenance", {}), dict):
        raise InvalidInput("not a mapping", field="provenance", value=entries["provenance"])
    if "name" not in entries and brought.filename:
        entries["name"] = plain_name(Path(brought.filename).stem.lower(), also="_.", longest=64)
    return entries


def _tried(entries: dict[str, Any], path: Path, folder: Path, settings: Settings, *, convert: str) -> Imported:
    """Let the child convert the file, if need be, and open and run the function."""
    if not convert:
        payload = payload_of(path, PAYLOADS[str(entries["kind"])])
        entries = parse_function(entries, payload=payload.model_dump()).model_dump(mode="json")
    job = {
        "entries": entries,
        "path": str(path.absolute()),
        "folder": str(folder),
        "convert": convert,
        "max_bytes": settings.max_function_mb << 20,
        "memory_mb": settings.import_memory_mb,
        "seconds": settings.import_seconds,
        "device": settings.infer_device,
    }
    answer = _run_child(job, folder, settings)
    if "error" in answer:
        kind = MissingDependency if answer["kind"] == "MissingDependency" else InvalidInput
        raise kind(answer["error"])
    document = FunctionDocument.model_validate(answer["document"])
    return Imported(document, folder / answer["payload"] if convert else path, answer["check"])


def _run_child(job: dict[str, Any], folder: Path, settings: Settings) -> dict[str, Any]:
    result = folder / "result.json"
    source = str(Path(valerie.__path__[0]).parent)
    environment = {name: os.environ[name] for name in _ENVIRONMENT if name in os.environ}
    environment |= {
        "PYTHONPATH": os.pathsep.join(filter(None, [source, environment.get("PYTHONPATH")])),
        "HF_HUB_OFFLINE": "1",
        "ORT_DISABLE_TELEMETRY": "1",
    }
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "valerie.pipeline.functions.import_child", str(result)],
            input=json.dumps(job),
            capture_output=True,
            text=True,
            errors="replace",
            timeout=settings.import_seconds + 30,
            env=environment,
            cwd=folder,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise _too_much(settings) from None
    try:
        answer: dict[str, Any] = json.loads(result.read_bytes())
    except (OSError, ValueError):
        if done.returncode < 0 or done.returncode in (124, 137):
            raise _too_much(settings) from None
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise InvalidInput(f"the process that converts and checks it ended ({last[:300]})", field="payload") from None
    return answer


def _too_much(settings: Settings) -> ValerieError:
    return InvalidInput(
        "converting and checking it took too much memory or time",
        field="payload",
        limit=f"{settings.import_memory_mb} MB, {settings.import_seconds:g} s (VALERIE_IMPORT_MEMORY_MB, VALERIE_IMPORT_SECONDS)",
    )
