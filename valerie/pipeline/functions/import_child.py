"""``python -m valerie.pipeline.functions.import_child RESULT < JOB``: opens one file that somebody brought, within bounds.

Started by `valerie.pipeline.functions.importing`. The job says what to do as JSON; what came of it is written to RESULT.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from valerie.errors import InvalidInput, MissingDependency, ValerieError
from valerie.perception.documents.function import FunctionDocument, InputDocument, parse_function
from valerie.perception.importing.onnx_files import check_onnx
from valerie.perception.running.limits import limit_memory, time_limit
from valerie.perception.running.opening import open_function
from valerie.pipeline.functions.importing import payload_of

_PAYLOAD: Final = "payload.safetensors"
#: Of the picture that a function is tried out on.
_HEIGHT, _WIDTH = 128, 256


def main(arguments: list[str]) -> int:
    """Do the job of standard input."""
    job = json.load(sys.stdin)
    _bound(job)
    with time_limit(job["seconds"], what="the import"):
        answer = _answer(job)
    Path(arguments[0]).write_text(json.dumps(answer))
    return 0


def _bound(job: Mapping[str, Any]) -> None:
    limit_memory(job["memory_mb"])
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # What is written is a payload (fp32 of an fp16 file at most) and the result.
    largest = 4 * job["max_bytes"] + (1 << 20)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))


def _answer(job: Mapping[str, Any]) -> dict[str, Any]:
    try:
        if job["convert"] == "checkpoint":
            document, path = _convert(job)
        elif job["convert"] == "program":
            document, path = _export(job)
        else:
            document, path = FunctionDocument.model_validate(job["entries"]), Path(job["path"])
        check = _try_out(document, path, device=job["device"])
    except ValerieError as error:
        return {"error": str(error), "kind": type(error).__name__}
    except MemoryError:
        limit = f"{job['memory_mb']} MB (VALERIE_IMPORT_MEMORY_MB)"
        return {"error": f"payload: it needs too much memory; limit: {limit}", "kind": "InvalidInput"}
    # What the layout of a checkpoint was checked by says more, and a document that was exported has its own.
    provenance = {"checked": "not opened" if "skipped" in check else "opened and run", **document.provenance}
    return {
        "document": document.model_copy(update={"provenance": provenance}).model_dump(mode="json"),
        "payload": path.name,
        "check": check,
    }


def _convert(job: Mapping[str, Any]) -> tuple[FunctionDocument, Path]:
    with _required():
        from valerie.perception.importing.checkpoints.importing import import_checkpoint
    entries = dict(job["entries"])
    output = entries.get("output") or {}
    classes = output.get("classes") if isinstance(output, dict) else None
    imported = import_checkpoint(
        Path(job["path"]),
        architecture=entries.get("architecture"),
        classes=classes if isinstance(classes, list) else None,
        max_bytes=job["max_bytes"],
    )
    path = Path(job["folder"]) / _PAYLOAD
    path.write_bytes(imported.payload())
    payload = payload_of(path, "safetensors")
    return parse_function(_merged(imported.document_fields(), entries), payload=payload.model_dump()), path


def _export(job: Mapping[str, Any]) -> tuple[FunctionDocument, Path]:
    """A program of torch, which runs here, as ONNX."""
    with _required():
        from valerie.perception.importing.programs import program_to_onnx
    part = job["entries"].get("input") or {}
    size = InputDocument.model_validate({"size": part.get("size")}).size if isinstance(part, dict) else None
    path = Path(job["folder"]) / "payload.onnx"
    path.write_bytes(program_to_onnx(Path(job["path"]), size))
    check_onnx(path, max_bytes=job["max_bytes"])
    return parse_function(job["entries"], payload=payload_of(path, "onnx").model_dump()), path


@contextmanager
def _required() -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingDependency(
            f"converting needs {error.name}, which is not installed here; install it with: pip install 'valerie[infer]', "
            "or convert where it is and register the exported function"
        ) from error


def _merged(found: Mapping[str, Any], told: Mapping[str, Any]) -> dict[str, Any]:
    """What the file says, with what its owner says on top; parts are merged entry by entry."""
    merged = {**found, **told}
    for part in ("input", "output", "provenance"):
        if isinstance(told.get(part), dict) and isinstance(found.get(part), dict):
            merged[part] = {**found[part], **told[part]}
    return merged


def _try_out(document: FunctionDocument, path: Path, *, device: str) -> dict[str, Any]:
    """Two predictions of one picture: the right size, and equal."""
    try:
        function = open_function(document, path, threads=1, device=device)
    except MissingDependency as error:
        return {"skipped": str(error)}
    picture = np.random.default_rng(0).integers(0, 256, (_HEIGHT, _WIDTH, 3), np.uint8)
    started = time.process_time()
    try:
        first, second = function.predict(picture), function.predict(picture)
    except ValerieError as error:
        raise InvalidInput(f"it does not run: {error}", field="payload") from error
    seconds = (time.process_time() - started) / 2
    if first.shape != (_HEIGHT, _WIDTH):
        raise InvalidInput(f"it answers {first.shape} for a picture of {(_HEIGHT, _WIDTH)}", field="payload")
    if not np.array_equal(first, second):
        raise InvalidInput("two predictions of one picture differ", field="payload")
    return {
        "numeric_class": function.numeric_class,
        "precision": function.card.precision,
        "picture": [_WIDTH, _HEIGHT],
        "cpu_seconds": round(seconds, 4),
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
