"""The results of an ended run, and its report, optionally with claims or a comparison with another run."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pyarrow as pa
import structlog
from sqlalchemy import Connection

from valerie.analysis.analyze import Analysis, analyze
from valerie.analysis.claims.claims import Claims
from valerie.analysis.claims.ledger import write_ledger
from valerie.analysis.comparison.beside import Beside, ComparedRun, put_beside
from valerie.analysis.comparison.wording import difference_of_specs
from valerie.analysis.report.figures import figure_tables
from valerie.analysis.report.model import Failure, Provenance, ReportInput
from valerie.analysis.report.odd import OddCoverage, odd_coverage
from valerie.analysis.report.report import build_report
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.verdicts.verdicts import RequirementVerdict
from valerie.db import results, runs, variants
from valerie.db.archives import reading_run
from valerie.db.engine import database_moment, reading
from valerie.db.results import FailedLink
from valerie.db.runs import RunRow
from valerie.errors import Conflict, InvalidInput, TransientError, UnknownName, ValerieError
from valerie.perception.base import FunctionCard
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.environment import environment, software
from valerie.pipeline.base.pinning import pinned_card
from valerie.pipeline.base.progress import Count
from valerie.pipeline.base.resolved_runs import StoredRun, resolve_stored
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.pipeline.reading.painting import jpeg
from valerie.pipeline.reading.run_verdicts import read_verdicts
from valerie.pipeline.reading.scenes import SceneRun, match_scenes
from valerie.pipeline.reading.selection import evaluated_persons, run_where
from valerie.pipeline.reading.tables import read_classes, read_table, read_together
from valerie.runs.document.differing import FREE, differing
from valerie.runs.moments import duration
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pictures import PictureKind
from valerie.runs.products.pins import Pins, TolerantPins, inference_part, numeric_classes
from valerie.runs.products.ready import Fault
from valerie.runs.products.states import ProductKind, RunState
from valerie.runs.resolving.spec import ResolvedRun

log = structlog.get_logger()

#: Fields of a spec that are no difference of a comparison: they change neither pictures nor scores, or define the scenes, which
#: are compared one by one.
_BESIDES: Final = (FREE - {"functions", "detection_threshold"}) | {
    "annotations", "infer_backgrounds", "blocks", "constants", "parameters",
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class RunResults:
    """All results of the evaluations of a run, or of several that are taken together.

    Attributes:
        runs, sample: rows of the runs, and their resolved specs.
        cards: function name to its card.
        table, analysis, verdicts: the results. Requirements are judged for one run only.
        failures: products that failed for good.
        differing: what else than the site or the draw differs between the runs, in words.
    """

    runs: tuple[RunRow, ...]
    sample: tuple[StoredRun, ...]
    cards: Mapping[str, FunctionCard]
    table: EvaluationTable
    analysis: Analysis
    verdicts: tuple[RequirementVerdict, ...]
    failures: Sequence[FailedLink]
    differing: tuple[str, ...] = ()

    @property
    def run(self) -> RunRow:
        """Row of the first run."""
        return self.runs[0]

    @property
    def stored(self) -> StoredRun:
        """Resolved spec of the first run."""
        return self.sample[0]


def read_results(context: Context, run: RunRow, failures: Sequence[FailedLink]) -> RunResults:
    """Compute the results of a run whose products are all done or failed."""
    stored = resolve_stored(run, context.settings)
    table = read_table(context.engine, stored)
    cards, analysis = _analyzed(context, (stored,), table)
    return RunResults((run,), (stored,), cards, table, analysis, read_verdicts(context, stored, table), failures)


def _analyzed(
    context: Context, stored: Sequence[StoredRun], table: EvaluationTable
) -> tuple[dict[str, FunctionCard], Analysis]:
    """Return the cards of the functions of one or several runs, and the analysis of their rows."""
    cards = {name: pinned_card(run.pins, name) for run in reversed(stored) for name in run.resolved.spec.functions}
    spec = stored[0].resolved.spec
    analysis = analyze(
        table,
        classes=read_classes(context.engine, stored, cards),
        precisions={name: card.precision for name, card in cards.items()},
        threshold=spec.detection_threshold,
        seed=spec.seed,
        spec=spec,
    )
    return cards, analysis


@dataclass(frozen=True, slots=True)
class ReportWith:
    """The report of an ended run with something beside it.

    Attributes:
        html: the report.
        source: its content, with the answers to the claims.
    """

    html: str
    source: ReportInput

    @property
    def figures(self) -> dict[str, pa.Table]:
        """Numbers of the figures, by figure."""
        return figure_tables(self.source.table, self.source.trends, self.source.explained)


def write_report(context: Context, results: RunResults) -> str:
    """Return the report of a run as HTML."""
    return build_report(_report_input(context, results))


def report_with(
    context: Context, *run_ids: str, claims: Claims | None = None, other: str | Beside | None = None
) -> ReportWith:
    """Return the report of an ended run, or of several together, with a ledger of claims, a comparison, or both.

    Args:
        context: context of this process.
        run_ids: id of the run, or ids of the runs of a sample, for example of one grid on several sites.
        claims: statements to test.
        other: id of the other run, or a comparison that was made elsewhere, such as of a part of this run in Cycles.

    Raises:
        NotFound: no such run.
        Conflict: it has not ended, its asset changed, or runs evaluated different versions of a function.
        InvalidInput, UnknownName: a claim names something that the run does not have, or the runs share no scene;
            several runs vary different parameters, or are to be compared with another one.
    """
    here = _ended(context, *run_ids)
    if isinstance(other, str) and len(run_ids) > 1:
        limit = "one run, or a comparison that was made elsewhere"
        raise InvalidInput("several runs are compared with another one", field="--beside", value=other, limit=limit)
    beside = _compared(context, here, other, claims) if isinstance(other, str) else other
    ledger = () if claims is None else write_ledger(claims, here.table, seed=here.run.spec.seed)
    source = replace(_report_input(context, here), claims=claims, ledger=ledger, beside=beside)
    return ReportWith(build_report(source), source)


def compare_runs(
    context: Context,
    run_id: str,
    other: str,
    *,
    functions: tuple[str, str] | None = None,
    claims: Claims | None = None,
    across: Sequence[str] = (),
    where: str = "",
    progress: Count = lambda *_: None,
) -> Beside:
    """Compare an ended run with another one of the same scenes, or two functions of one run.

    Args:
        context: context of this process.
        run_id: id of the run.
        other: id of the other run; the same, to compare its functions.
        functions: a function of the run, and the one of the other run to compare it with; None: all that both have.
        claims: statements to test in both.
        across: names or paths of parameters that each run holds at a value of its own; frames match across them.
        where: expression that selects rows of the run; empty: all.
        progress: is told how many frames of a run were read, of how many.

    Raises:
        NotFound, Conflict, UnknownName: as for `report_with`.
        InvalidInput: likewise, or a parameter of ``across`` is unknown or varies inside a run, or ``where`` is wrong, selects
            nothing, or selects by scores.
    """
    here = _ended(context, run_id)
    if where.strip():
        here = replace(here, table=_selected(context, here.stored, here.table, where))
    beside = _compared(context, here, other, claims, functions, across, progress)
    return replace(beside, where=where.strip())


def _selected(context: Context, run: StoredRun, table: EvaluationTable, where: str) -> EvaluationTable:
    condition = run_where(where, run.resolved, field="--where")
    if condition.scored:
        # What one side scored low by chance, the other would seem to improve.
        limit = "what is known without a function, such as distance_m, or a parameter"
        raise InvalidInput("a comparison of scores cannot select by them", field="--where", value=where, limit=limit)
    with reading_run(context.engine, run.id) as connection:
        rows = np.array([condition.holds(person.row) for person in evaluated_persons(connection, run)], np.bool_)
    if not rows.any():
        raise InvalidInput("selects no row", field="--where", value=where)
    return table.select(rows)


def _ended(context: Context, *run_ids: str) -> RunResults:
    with reading(context.engine) as connection:
        rows = tuple(_ended_row(connection, run_id) for run_id in run_ids)
    failures: list[FailedLink] = []
    for run_id in run_ids:
        with reading_run(context.engine, run_id) as connection:
            failures += results.failures(connection, run_id)
    if len(rows) == 1:
        return read_results(context, rows[0], failures)
    together = read_together(context, run_ids)
    cards, analysis = _analyzed(context, together.runs, together.table)
    return RunResults(rows, together.runs, cards, together.table, analysis, (), failures, together.differing)


def _ended_row(connection: Connection, run_id: str) -> RunRow:
    run = runs.get(connection, run_id)
    if run.state not in (RunState.COMPLETED, RunState.COMPLETED_WITH_FAILURES):
        raise Conflict(f"run {run_id} is {run.state} and has no results; a run gets them when it completes")
    return run


def _compared(
    context: Context,
    here: RunResults,
    other: str,
    claims: Claims | None,
    functions: tuple[str, str] | None = None,
    across: Sequence[str] = (),
    progress: Count = lambda *_: None,
) -> Beside:
    with reading(context.engine) as connection:
        row = _ended_row(connection, other)
    there = resolve_stored(row, context.settings)
    spec = here.stored.resolved.spec
    own, compared = functions or (None, None)
    name, table = _side(here.run, here.stored, here.table, own)
    name_there, table_there = _side(row, there, read_table(context.engine, there), compared)
    scenes, scenes_there, held = match_scenes(
        SceneRun(here.stored, table), SceneRun(there, table_there), across, progress
    )
    differs = [difference_of_specs(*one) for one in differing(spec, there.resolved.spec, besides=_BESIDES)]
    return put_beside(
        ComparedRun(name, here.run.id, table, scenes),
        ComparedRun(name_there, other, table_there, scenes_there),
        findings=[*here.analysis.findings.items, *here.analysis.findings.candidates],
        claims=claims,
        differs=[*held, *differs],
        threshold=spec.detection_threshold,
        seed=spec.seed,
    )


def _side(run: RunRow, stored: StoredRun, table: EvaluationTable, function: str | None) -> tuple[str, EvaluationTable]:
    """Return the name and the rows of a run, or of one of its functions."""
    name = f"{run.name} ({stored.resolved.spec.engine})"
    if function is None:
        return name, table
    functions = stored.resolved.spec.functions
    if function not in functions:
        raise UnknownName(f"function of run {run.id}", function, functions, field="--function")
    return f"{function} in {name}", table.select(table.codes("function").where(function))


def _report_input(context: Context, results: RunResults) -> ReportInput:
    run, resolved, pins = results.run, results.stored.resolved, results.stored.pins
    spec = resolved.spec
    rejected: Counter[str] = Counter()
    spent: defaultdict[ProductKind, float] = defaultdict(float)
    with reading(context.engine) as connection:
        now = database_moment(connection)
    for row in results.runs:
        with reading_run(context.engine, row.id) as connection:
            rejected.update(variants.rejections(connection, row.id))
            for kind, seconds in runs.cpu_seconds(connection, row.id).items():
                spent[kind] += seconds
    submitted = min(row.created_at for row in results.runs)
    finished, own = max(row.finished_at or now for row in results.runs), environment()
    classes = numeric_classes(pins)
    parts = ("image", "ground truth", *map(inference_part, spec.functions))
    provenance = Provenance(
        run_id=run.id,
        spec_digest=run.spec_digest,
        seed=spec.seed,
        asset=resolved.manifest.name,
        asset_digest=run.asset_digest,
        renderer=_renderer(resolved, pins.engine.revision),
        resolution=(spec.resolution.width, spec.resolution.height),
        numeric_classes={part: classes[part] for part in parts},
        functions=tuple(results.cards.values()),
        software=software(),
        submitted=submitted,
        finished=finished,
        more={
            "Duration": duration((finished - submitted).total_seconds()),
            "CPU time": ", ".join(f"{kind.value} {duration(seconds)}" for kind, seconds in sorted(spent.items()))
            or "not known",
            "Report written on": f"{own.system} {own.machine}, {own.python}",
            "Parent run": run.parent_run or "none",
            "Iteration": str(run.iteration),
            **_tolerance(pins),
            **_sample(results),
        },
    )
    return ReportInput(
        document=run.spec.model_dump(mode="json"),
        provenance=provenance,
        table=results.table,
        summary=results.analysis.summary,
        trends=results.analysis.trends,
        findings=results.analysis.findings,
        verdicts=results.verdicts,
        variants=sum(row.variant_count for row in results.runs),
        frames=sum(
            (row.variant_count - row.rejected_count) * len(part.resolved.cameras) * len(part.resolved.times.elapsed)
            for row, part in zip(results.runs, results.sample, strict=True)
        ),
        rejections=rejected,
        failures=_grouped(results.failures),
        picture=_Pictures(context),
        odd=read_odd(resolved, results.table),
    )


def _tolerance(pins: Pins) -> dict[str, str]:
    """Return the bounds of a run with tolerance: title to text."""
    if not isinstance(pins, TolerantPins):
        return {}
    return {
        "Reproducible": f"within a tolerance: one numeric class for each place, of those that agree in {pins.bounds.text}"
    }


def _sample(results: RunResults) -> dict[str, str]:
    """Return the facts about runs that are taken together: title to text; none of a single run."""
    if len(results.runs) == 1:
        return {}
    further = []
    for row in results.runs[1:]:
        asset = row.spec.asset
        text = asset if isinstance(asset, str) else ", ".join(f"{key} {value}" for key, value in asset.items())
        further.append(f"{row.id} ({text})")
    return {
        "Taken together with": "; ".join(further),
        "What else differs": "; ".join(results.differing) or "nothing but site or draw",
    }


def read_odd(resolved: ResolvedRun, table: EvaluationTable) -> OddCoverage:
    """Return how much of an operational design domain a run shows; what follows a trajectory is left out."""
    motion = resolved.times.motion
    moved = () if motion is None else motion.moved
    definitions = [definition for definition in resolved.definitions if definition.path not in moved]
    return odd_coverage(definitions, table, resolved.space[0].values)


class _Pictures:
    """Paints the report's pictures."""

    def __init__(self, context: Context) -> None:
        self._context = context

    def __call__(
        self, frame_id: str, kind: PictureKind, *, sensor: str, function: str | None, person: int | None = None
    ) -> bytes | None:
        try:
            source = find_picture(self._context, FrameKey.parse(frame_id), kind=kind, function=function, sensor=sensor)
            picture = paint_picture(self._context, source, person=person)
        except TransientError:
            raise  # otherwise the report would lack this picture for good
        except ValerieError as error:
            log.warning("finish.picture", frame=frame_id, kind=kind, error=str(error))
            return None
        return jpeg(picture)


def _grouped(failures: Sequence[FailedLink]) -> tuple[Failure, ...]:
    """Return equal failures as one, with their number."""
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
    """Return the engine's name in the report."""
    settings = ", ".join(f"{name} {value}" for name, value in resolved.engine_inputs.items())
    return f"{resolved.spec.engine}, revision {revision}" + (f" ({settings})" if settings else "")
