"""Build the report of a study from the database and the stored products."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import structlog

from valerie.db import studies
from valerie.db.archives import reading_run
from valerie.db.engine import reading
from valerie.db.studies import BatchRow, StudyRow
from valerie.errors import NotFound, ValerieError
from valerie.parameters.definitions import Value
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import started_run
from valerie.pipeline.control.studies.advancing import informed_pursuit, left
from valerie.pipeline.control.studies.resolving import resolve_row
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.pipeline.reading.painting import brightened_difference, jpeg
from valerie.pipeline.reading.selection import evaluated_persons
from valerie.runs.moments import duration
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pictures import PictureKind
from valerie.runs.study.study_document import StudyResult
from valerie.studies.pursuit import Pursuit
from valerie.studies.report import ShownBatch, ShownPicture, StudyReport, build_report, condition_rows, domain_rows
from valerie.studies.resolved import ResolvedStudy
from valerie.studies.wording import conditions_text, outlook_text

log = structlog.get_logger()

#: Numbers of variants that are shown if a result names none: those with the lowest scores, and those next above the bound.
_LOWEST: Final = 4
_NEXT: Final = 2
#: A variant of a study: batch, index and description.
_Place = tuple[int, int, str]


def report(context: Context, study_id: str) -> str:
    """Return the page of a study, with the result from the batches that ended.

    Raises:
        NotFound: no such study.
        Conflict: its asset changed.
    """
    with reading(context.engine) as connection:
        study = studies.get(connection, study_id)
        batches = studies.batches(connection, study_id)
    pursuit = informed_pursuit(resolve_row(context, study), batches)
    result, pair = pursuit.result(), pursuit.pair()
    conditions = () if pair is None else _conditions(context, pursuit.study, batches, pair[0])
    differences = () if pair is None else _differences(context, pursuit.study, batches, pair)
    return build_report(
        StudyReport(
            id=study.id,
            name=study.name,
            question=study.document.goal.question,
            state=f"The study is {study.state}." + (f" {_sentence(study.reason)}" if study.reason else ""),
            ended=study.state.is_final,
            sentences=() if result is None else (*result.sentences, *conditions),
            outlook=outlook(study, batches, result) or "",
            boundary=pursuit.boundary(),
            pictures=(*decisive_pictures(context, pursuit, batches), *differences),
            batches=tuple(_shown(batch, pursuit.study) for batch in batches),
            totals=_totals(batches, pursuit.study),
            measure=study.document.measure,
            where=study.document.where,
            domain=domain_rows(pursuit.study.domain),
            conditions=condition_rows(pursuit.study),
            document=study.document.to_yaml(),
            digest=study.document.digest,
            asset_digest=study.asset_digest,
        )
    )


def outlook(study: StudyRow, batches: Sequence[BatchRow], result: StudyResult | None) -> str | None:
    """Return in words what a study lacks for its goal, at the mean price of its variants; None where that is not known."""
    if result is None or result.further is None:
        return None
    ended = [batch for batch in batches if batch.cpu_seconds is not None]
    seconds, variants = sum(batch.cpu_seconds or 0.0 for batch in ended), sum(batch.legal for batch in ended)
    price = result.further * seconds / variants if seconds and variants else None
    return outlook_text(result.further, left(study, batches), price)


def _shown(batch: BatchRow, resolved: ResolvedStudy) -> ShownBatch:
    ended = batch.outcomes is not None
    failed, undefined = _counts(batch, resolved)
    return ShownBatch(
        number=batch.number + 1,
        run=batch.run_id or "",
        reason=batch.reason,
        variants=len(batch.points),
        rejected=len(batch.rejected),
        failed=failed if ended else "",
        undefined=undefined if ended else "",
        cost="" if batch.cpu_seconds is None else duration(batch.cpu_seconds),
    )


def _counts(batch: BatchRow, resolved: ResolvedStudy) -> tuple[int, int]:
    """Return the number of variants with a failing score, and of legal ones that lack a score."""
    if batch.outcomes is None:
        return 0, 0
    unscored = (i for i, scores in enumerate(batch.outcomes.by_variant) if None in scores and i not in batch.rejected)
    return batch.outcomes.failed(resolved.measure.at_least), len(list(unscored))


def _totals(batches: Sequence[BatchRow], resolved: ResolvedStudy) -> tuple[str, ...]:
    counts = [_counts(batch, resolved) for batch in batches]
    numbers = (
        sum(len(batch.points) for batch in batches),
        sum(len(batch.rejected) for batch in batches),
        sum(failed for failed, _ in counts),
        sum(undefined for _, undefined in counts),
    )
    return (*(f"{number:,}" for number in numbers), duration(sum(batch.cpu_seconds or 0.0 for batch in batches)))


def decisive_pictures(context: Context, pursuit: Pursuit, batches: Sequence[BatchRow]) -> Iterator[ShownPicture]:
    """Yield the frames of the decisive variants of a study, where they can be painted."""
    study = pursuit.study
    for number, index, title in pursuit.decisive() or _extremes(study, batches):
        batch = batches[number]
        if batch.run_id is None:
            continue
        functions = study.document.spec.functions
        scores = [None] * len(functions) if batch.outcomes is None else batch.outcomes.by_variant[index]
        values = _named(study, study.domain.values(batch.points[index]))
        for camera, name in enumerate(study.run.cameras):
            key = FrameKey(batch.run_id, index, camera)
            for function, score in zip(functions, scores, strict=True):
                try:
                    picture = jpeg(
                        paint_picture(context, find_picture(context, key, kind=PictureKind.ERRORS, function=function))
                    )
                except ValerieError as error:
                    log.warning("study.picture", frame=str(key), error=str(error))
                    continue
                score_text = "none" if score is None else f"{study.measure.shown(score):.3g}"
                caption = f"{title}, {name}" if len(functions) == 1 else f"{title}, {name}, {function}"
                yield ShownPicture(caption, score_text, values, str(key), picture)


def _differences(
    context: Context, study: ResolvedStudy, batches: Sequence[BatchRow], pair: Sequence[tuple[int, int]]
) -> Iterator[ShownPicture]:
    """Yield the difference of the pictures of a minimal pair for each camera, where it can be painted."""
    for camera, name in enumerate(study.run.cameras):
        keys = [FrameKey(str(batches[number].run_id), index, camera) for number, index in pair]
        try:
            painted = [paint_picture(context, find_picture(context, key, kind=PictureKind.PICTURE)) for key in keys]
        except ValerieError as error:
            log.warning("study.picture", frame=str(keys[0]), error=str(error))
            continue
        pixels, gain = brightened_difference(*painted)
        caption = f"Absolute difference of the failing and the passing picture, {gain:.3g} times as bright"
        yield ShownPicture(f"Difference, {name}", "", caption, " − ".join(map(str, keys)), jpeg(pixels))


def _sentence(reason: str) -> str:
    """Return a reason, which may lack a capital or a full stop, as a sentence."""
    return f"{reason[0].upper()}{reason[1:].removesuffix('.')}."


def _conditions(
    context: Context, study: ResolvedStudy, batches: Sequence[BatchRow], failing: tuple[int, int]
) -> Iterator[str]:
    """Yield in words what the truth measured in the worst row of the failing variant of a minimal pair."""
    number, index = failing
    try:
        run = started_run(context, str(batches[number].run_id))
    except NotFound:
        return
    with reading_run(context.engine, run.id) as connection:
        rows = [person.row for person in evaluated_persons(connection, run) if person.frame.variant == index]
    counting = {
        i: row[study.measure.column] for i, row in enumerate(rows) if study.where is None or study.where.holds(row)
    }
    scores = {i: study.measure.score([value]) for i, value in counting.items() if isinstance(value, float)}
    text = conditions_text(rows[min(scores, key=scores.__getitem__)]) if scores else None
    if text is not None:
        yield text


class _Scored(NamedTuple):
    """The score of a variant, by its batch and its place in that batch."""

    score: float
    batch: int
    place: int


def _extremes(study: ResolvedStudy, batches: Sequence[BatchRow]) -> list[_Place]:
    scores = [
        _Scored(score, batch.number, index)
        for batch in batches
        if batch.outcomes is not None
        for index, score in enumerate(batch.outcomes.scores)
        if score is not None
    ]
    failing = sorted(variant for variant in scores if variant.score < study.measure.at_least)[:_LOWEST]
    passing = sorted(variant for variant in scores if variant.score >= study.measure.at_least)[:_NEXT]
    return [
        *((variant.batch, variant.place, "It fails") for variant in failing),
        *((variant.batch, variant.place, "It passes, barely") for variant in passing),
    ]


def _named(study: ResolvedStudy, values: Mapping[str, Value]) -> str:
    return ", ".join(f"{d.name} {d.text(values[d.path], 4)}" for d in study.domain.definitions)
