"""``python -m valerie.pipeline.functions.import_child ANSWER < JOB``: open one untrusted file, within bounds.

`valerie.pipeline.functions.guarded_import` starts this process. See `valerie.pipeline.functions.import_job` for job and answer.
"""

from __future__ import annotations

import resource
import signal
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from valerie.errors import InvalidInput, MissingDependency, ValerieError
from valerie.perception.documents.function import FunctionDocument, parse_function
from valerie.perception.running.choice import agreeing_choice
from valerie.perception.running.limits import limit_memory
from valerie.perception.running.opening import open_function
from valerie.pipeline.functions.import_job import (
    ImportAnswer,
    ImportedFile,
    ImportFailure,
    ImportJob,
    Trial,
    payload_of,
)
from valerie.plain import Json, JsonObject

#: Height and width of the picture of a trial.
_SIZE: Final = (128, 256)


def main(arguments: list[str]) -> int:
    """Do the job on standard input and write the answer to the named file."""
    job = ImportJob.model_validate_json(sys.stdin.read())
    _bound(job)
    answer = ImportAnswer(outcome=_outcome(job))
    Path(arguments[0]).write_text(answer.model_dump_json())
    return 0


def _bound(job: ImportJob) -> None:
    limit_memory(job.memory_mb)
    signal.setitimer(signal.ITIMER_REAL, job.seconds)  # the kernel ends this process, also within compiled code
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # This process writes a payload (at most fp32 of an fp16 file) and the answer.
    largest = 4 * job.max_bytes + (1 << 20)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))


def _outcome(job: ImportJob) -> ImportedFile | ImportFailure:
    try:
        document, path = _function(job)
        if job.choose_engine:
            document = _with_fastest_engine(document, path, device=job.device)
        trial = _try_out(document, path, device=job.device)
    except ValerieError as error:
        return ImportFailure(message=str(error), missing_dependency=isinstance(error, MissingDependency))
    except MemoryError:
        limit = f"{job.memory_mb} MB (VALERIE_IMPORT_MEMORY_MB)"
        return ImportFailure(message=f"payload: it needs too much memory; limit: {limit}")
    # The document's own entry takes precedence: the check of a checkpoint's layout says more, and exports keep theirs.
    provenance = {"checked": "opened and run" if trial.skipped is None else "not opened", **document.provenance}
    return ImportedFile(document=document.model_copy(update={"provenance": provenance}), payload=path.name, trial=trial)


def _with_fastest_engine(document: FunctionDocument, path: Path, *, device: str) -> FunctionDocument:
    try:
        return agreeing_choice(document, path, device=device).applied(document)
    except ValerieError:
        return document  # the trial says why


def _function(job: ImportJob) -> tuple[FunctionDocument, Path]:
    match job.conversion:
        case "checkpoint":
            return _from_checkpoint(job)
        case "program":
            return _from_program(job)
        case "onnx":
            return _from_onnx(job), job.path
        case "none":
            return FunctionDocument.model_validate(job.entries), job.path


def _from_onnx(job: ImportJob) -> FunctionDocument:
    """Check the file; return the document with the facts that the file states."""
    with _required():
        from valerie.perception.importing.onnx_facts import with_stated_facts
        from valerie.perception.importing.onnx_files import operator_set, read_onnx
    model = read_onnx(job.path, max_bytes=job.max_bytes)
    producer = f"{model.producer_name} {model.producer_version}".strip()[:200]
    document = parse_function(with_stated_facts(job.entries, model))
    provenance = {"producer": producer, "opset": str(operator_set(model)), **document.provenance}
    return document.model_copy(update={"provenance": provenance})


def _from_checkpoint(job: ImportJob) -> tuple[FunctionDocument, Path]:
    """Convert a checkpoint of another program to a file of VALERIE's own format."""
    with _required():
        from valerie.perception.importing.checkpoints.network_conversion import import_checkpoint
    output, architecture = job.entries.get("output"), job.entries.get("architecture")
    classes = output.get("classes") if isinstance(output, dict) else None
    imported = import_checkpoint(
        job.path,
        architecture=None if architecture is None else str(architecture),
        classes=[str(name) for name in classes] if isinstance(classes, list) else None,
        max_bytes=job.max_bytes,
    )
    path = job.folder / "payload.safetensors"
    path.write_bytes(imported.payload())
    payload = payload_of(path, "safetensors")
    return parse_function(_merged(imported.document_fields(), job.entries), payload=payload.model_dump()), path


def _from_program(job: ImportJob) -> tuple[FunctionDocument, Path]:
    """Convert a program of torch to ONNX; this runs the program."""
    with _required():
        from valerie.perception.importing.onnx_files import read_onnx
        from valerie.perception.importing.torch_programs import program_to_onnx
    entries = dict(job.entries)
    # The payload is not there yet, but a document with problems must not start the program.
    expected = parse_function(entries, payload={"sha256": "0" * 64, "bytes": 1, "format": "onnx"})
    path = job.folder / "payload.onnx"
    path.write_bytes(program_to_onnx(job.path, expected.input.size))
    read_onnx(path, max_bytes=job.max_bytes)
    return parse_function(entries, payload=payload_of(path, "onnx").model_dump()), path


@contextmanager
def _required() -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingDependency(
            f"converting needs {error.name}, which is not installed here; install it with: pip install 'valerie[infer]', "
            "or convert where it is and register the exported function"
        ) from error


def _merged(stated: Mapping[str, Json], entries: Mapping[str, Json]) -> JsonObject:
    """Return the entries that a file states, overridden by its owner's; parts are merged entry by entry."""
    merged = {**stated, **entries}
    for part in ("input", "output", "provenance"):
        own, of_file = entries.get(part), stated.get(part)
        if isinstance(own, dict) and isinstance(of_file, dict):
            merged[part] = {**of_file, **own}
    return merged


def _try_out(document: FunctionDocument, path: Path, *, device: str) -> Trial:
    """Predict one picture twice: the answers must have its size and be equal."""
    try:
        function = open_function(document, path, threads=1, device=device)
    except MissingDependency as error:
        return Trial(skipped=str(error))
    picture = np.random.default_rng(0).integers(0, 256, (*_SIZE, 3), np.uint8)
    started = time.process_time()
    try:
        first, second = function.predict(picture), function.predict(picture)
    except ValerieError as error:
        raise InvalidInput(f"it does not run: {error}", field="payload") from error
    seconds = (time.process_time() - started) / 2
    if first.shape != _SIZE:
        raise InvalidInput(f"the network returns shape {first.shape} for a picture of {_SIZE}", field="payload")
    if not np.array_equal(first, second):
        raise InvalidInput("two predictions of one picture differ", field="payload")
    return Trial(
        numeric_class=function.numeric_class,
        precision=function.card.precision,
        picture=(_SIZE[1], _SIZE[0]),
        cpu_seconds=round(seconds, 4),
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
