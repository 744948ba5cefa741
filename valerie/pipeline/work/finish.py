"""The end of a run: its long table, the summary of the paper's section 6.2, the report and the environment are stored."""

from __future__ import annotations

import errno
import io
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Final

import orjson
import structlog

from valerie.analysis.analyze import Analysis, analyze
from valerie.analysis.report import build_report
from valerie.analysis.report_model import Failure, PictureKind, Provenance, ReportInput
from valerie.analysis.table import EvaluationTable
from valerie.analysis.verdicts import RequirementVerdict
from valerie.db import results, runs
from valerie.db.engine import reading, writing
from valerie.db.results import FailedLink
from valerie.db.runs import RunRow
from valerie.errors import NotFound, StorageFull, StorageUnavailable, TransientError, ValerieError
from valerie.perception.base import FunctionCard
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.environment import environment, software
from valerie.pipeline.base.pausing import pause_for_storage
from valerie.pipeline.base.pins import pinned_card
from valerie.pipeline.base.resolved_runs import StoredRun, resolve_stored
from valerie.pipeline.base.run_artifacts import ENVIRONMENT, REPORT, SUMMARY, TABLE_CSV, TABLE_PARQUET
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.pipeline.reading.painting import jpeg
from valerie.pipeline.reading.tables import read_classes, read_table
from valerie.pipeline.reading.verdicts import read_verdicts
from valerie.runs.frames import FrameKey
from valerie.runs.products import Fault
from valerie.runs.spec import ResolvedRun
from valerie.runs.states import RunState
from valerie.storage.keys import run_key

log = structlog.get_logger()

_KIND_OF_PICTURE = {
    PictureKind.PICTURE: "picture",
    PictureKind.TRUTH: "truth-overlay",
    PictureKind.PREDICTION: "overlay",
}


#: Errors of a disk that is full or cannot be written.
_NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
#: Stores the results of a run, with what failed of it.
Writer = Callable[[Context, RunRow, Sequence[FailedLink]], None]


def finish_run(context: Context, run_id: str, *, write: Writer | None = None) -> None:
    """Store table, summary and report of a run whose products are all done or failed, and end it.

    A second call replaces the artifacts by equal ones; one conditional UPDATE ends the run. Where they cannot be stored at
    present, the run pauses as in the middle of its work; after another transient fault the control loop asks again.

    Args:
        context: of this process.
        run_id: of a run; nothing happens unless it is finishing.
        write: stores the results (default: `write_results`).
    """
    with reading(context.engine) as connection:
        try:
            run = runs.get(connection, run_id)
        except NotFound:
            return
        if run.state != RunState.FINISHING:
            return
        failures = results.failures(connection, run_id)
    try:
        (write or write_results)(context, run, failures)
        state, reason = RunState.COMPLETED, None
        if failures:
            roots = [failure for failure in failures if isinstance(failure.error, Fault)]
            state = RunState.COMPLETED_WITH_FAILURES
            products = "product" if len(roots) == 1 else "products"
            reason = f"{len(roots)} {products} failed for good; see the report or `valerie status`"
    except (StorageFull, StorageUnavailable) as error:
        log.warning("finish.storage", run=run_id, error=str(error))
        pause_for_storage(context, error)
        return
    except TransientError as error:
        log.warning("finish.waits", run=run_id, error=str(error))
        return
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _NO_ROOM:  # a library's temporary file
            log.warning("finish.storage", run=run_id, error=str(error))
            pause_for_storage(context, StorageFull(f"no space left for a temporary file: {error}"))
            return
        # A defect of ours must end the run too: asked again, it would fail again for ever.
        log.exception("finish.failed", run=run_id)
        state, reason = RunState.FAILED, f"the results could not be written: {error}"
    with writing(context.engine) as connection:
        runs.change_state(
            connection,
            run_id,
            expected=(RunState.FINISHING,),
            state=state,
            reason=reason,
            finished_at=runs.now_utc(),
        )
    log.info("run.finished", run=run_id, state=state)


def write_results(context: Context, run: RunRow, failures: Sequence[FailedLink]) -> None:
    """Write table (Parquet, CSV), summary, report and environment."""
    stored = resolve_stored(run, context.settings)
    resolved = stored.resolved
    cards = tuple(pinned_card(stored.pins, name) for name in resolved.spec.functions)
    table = read_table(context.engine, stored)
    classes = read_classes(context.engine, stored, cards)
    analysis = analyze(
        table,
        classes=classes,
        precisions={name: card.precision for name, card in zip(resolved.spec.functions, cards, strict=True)},
        threshold=resolved.spec.detection_threshold,
        seed=resolved.spec.seed,
        spec=resolved.spec,
    )
    verdicts = read_verdicts(context, stored, table)
    for name, write in ((TABLE_PARQUET, table.to_parquet), (TABLE_CSV, table.to_csv)):
        buffer = io.BytesIO()
        write(buffer)
        context.store.put(run_key(run.id, name), buffer.getvalue(), replace=True)
    context.store.put(run_key(run.id, SUMMARY), summary_json(analysis, verdicts), replace=True)
    html = build_report(_report_input(context, run, stored, cards, table, analysis, verdicts, failures))
    context.store.put(run_key(run.id, REPORT), html.encode(), replace=True)
    context.store.put(run_key(run.id, ENVIRONMENT), orjson.dumps(environment()), replace=True)


def summary_json(analysis: Analysis, verdicts: Sequence[RequirementVerdict]) -> bytes:
    """Return the numbers of a run as JSON."""
    return orjson.dumps(
        {
            "summary": asdict(analysis.summary),
            "findings": asdict(analysis.findings),
            "verdicts": list(map(asdict, verdicts)),
        },
        option=orjson.OPT_SERIALIZE_NUMPY,
    )


def _report_input(
    context: Context,
    run: RunRow,
    stored: StoredRun,
    cards: tuple[FunctionCard, ...],
    table: EvaluationTable,
    analysis: Analysis,
    verdicts: tuple[RequirementVerdict, ...],
    failures: Sequence[FailedLink],
) -> ReportInput:
    resolved, pins = stored.resolved, stored.pins
    spec = resolved.spec
    with reading(context.engine) as connection:
        rejected = runs.rejections(connection, run.id)
    classes = {"image": pins.engine.numeric_class, "ground truth": pins.truth.numeric_class}
    classes |= {f"inference, {name}": pins.functions[name].numeric_class for name in spec.functions}
    provenance = Provenance(
        run_id=run.id,
        spec_digest=run.spec_digest,
        seed=spec.seed,
        asset=resolved.manifest.name,
        asset_digest=run.asset_digest,
        renderer=_renderer(resolved, pins.engine.revision),
        resolution=(spec.resolution.width, spec.resolution.height),
        numeric_classes=classes,
        functions=cards,
        software=software(),
        submitted=run.created_at,
        finished=runs.now_utc(),
        more={"parent run": run.parent_run or "none", "iteration": str(run.iteration)},
    )
    return ReportInput(
        document=run.spec.model_dump(mode="json"),
        provenance=provenance,
        table=table,
        summary=analysis.summary,
        trends=analysis.trends,
        findings=analysis.findings,
        verdicts=verdicts,
        variants=run.variant_count,
        frames=(run.variant_count - run.rejected_count) * len(resolved.cameras) * len(resolved.times.elapsed),
        rejections=rejected,
        failures=_grouped(failures),
        picture=_Pictures(context),
    )


class _Pictures:
    """Paints the report's pictures."""

    def __init__(self, context: Context) -> None:
        self._context = context

    def __call__(self, frame_id: str, kind: PictureKind, *, sensor: str, function: str | None) -> bytes | None:
        kind_of_picture = _KIND_OF_PICTURE[kind]
        try:
            source = find_picture(
                self._context, FrameKey.parse(frame_id), kind=kind_of_picture, function=function, sensor=sensor
            )
            painted = paint_picture(self._context, source)
        except TransientError:
            raise  # a report without this picture would stay so
        except ValerieError as error:
            log.warning("finish.picture", frame=frame_id, kind=kind, error=str(error))
            return None
        return jpeg(painted)


def _grouped(failures: Sequence[FailedLink]) -> tuple[Failure, ...]:
    """Return failures of the same kind as one, with their number."""
    groups: dict[tuple[str, str, int], list[str]] = defaultdict(list)
    for failure in failures:
        error = failure.error
        message, attempts = (
            (error.message, error.attempts) if isinstance(error, Fault) else (f"its input {error.cause} failed", 0)
        )
        groups[failure.kind, message, attempts].append(str(failure.frame))
    return tuple(
        Failure(stage=stage, error=message, attempts=attempts, count=len(frames), example=frames[0])
        for (stage, message, attempts), frames in sorted(groups.items(), key=lambda item: -len(item[1]))
    )


def _renderer(resolved: ResolvedRun, revision: int) -> str:
    """Return the engine as the report names it."""
    settings = ", ".join(f"{name} {value}" for name, value in resolved.engine_inputs.items())
    return f"{resolved.spec.engine}, revision {revision}" + (f" ({settings})" if settings else "")
