"""Quantisation of a run's function on frames of the run, with the change of its scores on all of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from valerie.analysis.comparison.before_after import VersionComparison
from valerie.analysis.comparison.wording import difference_text
from valerie.db.archives import reading_run
from valerie.db.functions import SHORT, FunctionRow
from valerie.db.links import StoredFrame
from valerie.errors import Conflict
from valerie.perception.documents.function import parse_function
from valerie.perception.running.choice import REASON
from valerie.perception.running.opening import open_function
from valerie.perception.running.quantizing import quantize
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.progress import Pace
from valerie.pipeline.base.resolved_runs import StoredRun, read_run
from valerie.pipeline.functions.bounded import open_bounded
from valerie.pipeline.functions.references import pinned_payload
from valerie.pipeline.functions.registry import register, require_free
from valerie.pipeline.reading.capture import capture_of
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.selection import finished_frames, function_index
from valerie.pipeline.retraining.comparison import compare_on_run

#: Entries of the provenance: the function before, the frames that gave the ranges, and the change of pACC.
BEFORE: Final = "quantized from"
FRAMES: Final = "calibrated on"
CHANGE: Final = "change of pACC by int8"


@dataclass(frozen=True, slots=True, eq=False)
class QuantizedVersion:
    """A registered int8 version of a function.

    Attributes:
        registered: the version.
        new: False if the same one was registered before.
        comparison: the run's function and this version on the run's frames.
    """

    registered: FunctionRow
    new: bool
    comparison: VersionComparison


def quantize_function(
    context: Context,
    run_id: str,
    function: str,
    name: str,
    *,
    frames: int,
    threads: int | None = None,
    progress: Pace = lambda *_: None,
) -> QuantizedVersion:
    """Quantise a function as a run pinned it, compare both on the run's frames, and register the result.

    Args:
        context: context of the deployment.
        run_id: id of the run.
        function: name of the function in the run's spec.
        name: name to register under.
        frames: number of frames, spread evenly over the run, that give the ranges of activations.
        threads: CPU threads of the inference engine; None: as many as this deployment's workers have.
        progress: see `compare_on_run`.

    Raises:
        NotFound, UnknownName: no such run or function.
        InvalidInput: the function has no network that can be quantised.
        Conflict: the run has no finished frames, or the name belongs to an installed function.
        MissingDependency: OpenVINO has no int8 on this processor.
    """
    require_free(name)
    run = read_run(context, run_id)
    function_index(function, run.resolved)
    document, payload = pinned_payload(function, run.pins.functions[function], context=context)
    sample = _spread(context, run, frames)
    reader = ProductReader(context.store)
    pictures = (capture_of(run.resolved, frame, 0).picture(reader) for frame in sample)
    quantized, data = quantize(document, payload, pictures)
    provenance = {
        **{entry: text for entry, text in document.provenance.items() if entry != REASON},
        BEFORE: f"{function}, {document.file.sha256[:SHORT]}",
        FRAMES: f"{len(sample)} frames of run {run_id}",
    }
    with TemporaryDirectory(prefix="valerie-quantize-") as folder:
        file = Path(folder, f"{name}.onnx")
        file.write_bytes(data)
        unnamed = quantized.model_copy(update={"name": name, "provenance": provenance})
        settings = context.settings
        comparison = compare_on_run(
            context,
            run_id,
            [function, name],
            open_function=lambda _: open_bounded(
                lambda: open_function(unnamed, file, threads=threads or settings.inference_threads),
                settings,
                name=name,
            ),
            mixed=True,
            progress=progress,
        )
        stated = {**provenance, CHANGE: _change(comparison, run_id)}
        final = parse_function(unnamed.model_copy(update={"provenance": stated}).model_dump(mode="json"))
        registered, new = register(context, final, file)
    return QuantizedVersion(registered, new, comparison)


def _spread(context: Context, run: StoredRun, count: int) -> list[StoredFrame]:
    with reading_run(context.engine, run.id) as connection:
        finished = [frame.stored for frame in finished_frames(connection, run)]
    if not finished:
        raise Conflict(f"run {run.id} has no finished frames yet")
    count = min(count, len(finished))
    return [finished[number * len(finished) // count] for number in range(count)]


def _change(comparison: VersionComparison, run_id: str) -> str:
    everyone = comparison.groups[0]
    (difference,) = everyone.differences
    return f"{difference_text(difference)}, {everyone.persons:,} persons of run {run_id}"
