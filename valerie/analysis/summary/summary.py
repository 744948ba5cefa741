"""Summary of a run: the table of the paper's section 6.2 with counts, reasons of gaps, precision, IoU, and intervals or spreads.

Every aggregate exists twice: as *frame mean*, which weighs every person in every frame equally, and from *pooled* counts,
which weigh every pixel equally.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.frame_counts import (
    ALL,
    FrameCounts,
    Group,
    characters,
    frame_counts,
    groups,
    present,
    rows_of,
    settings,
)
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.summary.all_classes import AllClasses
from valerie.analysis.summary.pitfalls import pitfalls
from valerie.errors import InvalidInput
from valerie.metrics import scores as pixel_scores
from valerie.statistics.intervals import Interval, Refusal, mean_interval
from valerie.statistics.units import Estimand

#: Rate above which a person counts as occluded (the paper's "> 5 % occluded").
OCCLUDED: Final = 0.05


#: Part of the places beyond each end of a spread.
_TAIL: Final = 0.1


@dataclass(frozen=True, slots=True)
class Spread:
    """Middle 80 % of the means of places: it shows how much places differ, not how certain a mean is.

    Attributes:
        low, high: quantiles 0.1 and 0.9 (linear between places).
        places: number of places.
    """

    low: float
    high: float
    places: int


@dataclass(frozen=True, slots=True)
class SummaryRow:
    """Results of one function with one sensor setting on one pedestrian. Rates are 0…1, None if undefined.

    A *person-frame* is one person in one frame.

    Attributes:
        function, sensor, character: the group; the character `ALL` stands for any pedestrian.
        frames: number of frames in which such a person is present.
        persons: number of person-frames; more than ``frames`` where a frame shows several such persons.
        defined: number of person-frames with a defined pACC.
        undefined: reason to number of the other person-frames.
        pacc_mean: mean over the defined person-frames.
        pacc_min, pacc_max: smallest and largest value of these.
        pacc_pooled: Σ tp / Σ (tp + fn).
        pacc_mean_interval, pacc_pooled_interval, detection_interval: 95 % intervals, or the reason why there is none
            (`valerie.statistics.intervals`); None without a defined pACC.
        pacc_mean_spread, detection_spread: spread of places, for listed variants, which allow no interval; otherwise None.
        precision_mean, iou_mean: means over the frames in which the score is defined.
        precision_pooled, iou_pooled: from the summed counts of the frames.
        detected: number of person-frames with pACC ≥ the summary's threshold.
        detection_rate: detected / defined.
    """

    function: str
    sensor: str
    character: str
    frames: int
    persons: int
    defined: int
    undefined: dict[str, int]
    pacc_mean: float | None
    pacc_mean_interval: Interval | Refusal | None
    pacc_mean_spread: Spread | None
    pacc_min: float | None
    pacc_max: float | None
    pacc_pooled: float | None
    pacc_pooled_interval: Interval | Refusal | None
    precision_mean: float | None
    precision_pooled: float | None
    iou_mean: float | None
    iou_pooled: float | None
    detected: int
    detection_rate: float | None
    detection_interval: Interval | Refusal | None
    detection_spread: Spread | None


@dataclass(frozen=True, slots=True)
class OcclusionShare:
    """Share of occluded person-frames, independent of the function.

    Attributes:
        character: name of the pedestrian, or `ALL`.
        persons: number of person-frames with a defined occlusion.
        occluded: number of these with a rate above `OCCLUDED`; fully hidden persons included.
    """

    character: str
    persons: int
    occluded: int

    @property
    def share(self) -> float | None:
        """``occluded / persons``; None without persons."""
        return self.occluded / self.persons if self.persons else None


@dataclass(frozen=True, slots=True)
class BlockPersons:
    """A block's part in the rows of a summary.

    Attributes:
        block: its number in the run, from 1.
        share: its share of all person-frames.
        characters: the pedestrians in it.
    """

    block: int
    share: float
    characters: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class EmptyFrames:
    """False positives in frames without any person.

    Attributes:
        function, sensor: names of the function and of the sensor setting.
        frames: number of frames without a person.
        with_false_positives: number of these with at least one pixel predicted as person.
        false_positive_pixels: number of such pixels.
    """

    function: str
    sensor: str
    frames: int
    with_false_positives: int
    false_positive_pixels: int


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of a run.

    Attributes:
        threshold: t of every detection rate.
        frames: number of distinct evaluated frames.
        rows: per function, sensor and character.
        occlusion: share of occluded person-frames per character, then of all.
        empty: frames without persons, per function and sensor; empty if there are none.
        classes: scores over all classes, per function and sensor.
        warnings: sentences about faults that make the numbers meaningless; to be shown before all results.
        blocks: the blocks that the rows mix, of many the largest; empty for a run of one block.
    """

    threshold: float
    frames: int
    rows: tuple[SummaryRow, ...]
    occlusion: tuple[OcclusionShare, ...]
    empty: tuple[EmptyFrames, ...]
    classes: tuple[AllClasses, ...] = ()
    warnings: tuple[str, ...] = ()
    blocks: tuple[BlockPersons, ...] = ()


def summarize(
    table: EvaluationTable,
    *,
    classes: Sequence[AllClasses] = (),
    threshold: float = 0.5,
) -> Summary:
    """Summarize a run.

    Args:
        table: its evaluations.
        classes: scores over all classes, which the table does not contain.
        threshold: smallest pACC of a detected person, 0 < t ≤ 1.

    Raises:
        InvalidInput: the threshold is out of bounds.
    """
    if not 0 < threshold <= 1:
        raise InvalidInput(
            "detection threshold out of bounds", field="detection_threshold", value=threshold, limit="0 < t ≤ 1"
        )
    counts = frame_counts(table)
    frame_numbers = table.codes("frame_id").index
    return Summary(
        threshold=threshold,
        frames=len(np.unique(frame_numbers)),
        rows=tuple(_row(table, group, counts, threshold) for group in groups(table)),
        occlusion=_occlusion(table),
        empty=_empty(table, counts),
        classes=tuple(classes),
        warnings=pitfalls(table),
        blocks=_blocks(table),
    )


def _row(table: EvaluationTable, group: Group, counts: FrameCounts, threshold: float) -> SummaryRow:
    rows = rows_of(table, group)
    pacc = table.numbers("pacc")
    defined = rows & np.isfinite(pacc)
    values = pacc[defined]
    reasons = table.codes("undefined_reason")
    evaluations = np.unique(table.evaluations[rows])
    first = counts.row[evaluations]
    tp, fn, fp = (array[evaluations].sum() for array in (counts.tp, counts.fn, counts.fp))
    own_tp, own_fn = table.numbers("tp")[rows].sum(), table.numbers("fn")[rows].sum()
    is_detected = values >= threshold
    detected = int(np.count_nonzero(is_detected))
    units = table.units.of(defined)

    def interval(scores: NDArray[Any], pixels: NDArray[np.float64] | None = None) -> Interval | Refusal | None:
        return mean_interval(scores, units, weights=pixels) if len(values) else None

    def spread(scores: NDArray[Any]) -> Spread | None:
        listed = len(values) > 0 and units.estimand is Estimand.LISTED_GRID
        return _spread(scores, table.places[defined]) if listed else None

    return SummaryRow(
        function=group.function,
        sensor=group.sensor,
        character=group.character,
        frames=len(np.unique(table.codes("frame_id").index[rows])),
        persons=int(np.count_nonzero(rows)),
        defined=len(values),
        undefined={
            name: int(number)
            for i, name in enumerate(reasons.names)
            if (number := np.count_nonzero(reasons.index[rows] == i))
        },
        pacc_mean=float(values.mean()) if len(values) else None,
        pacc_mean_interval=interval(values),
        pacc_mean_spread=spread(values),
        pacc_min=float(values.min()) if len(values) else None,
        pacc_max=float(values.max()) if len(values) else None,
        pacc_pooled=pixel_scores.pacc(own_tp, own_fn),
        pacc_pooled_interval=interval(values, (table.numbers("tp") + table.numbers("fn"))[defined]),
        precision_mean=_mean(table.numbers("precision")[first]),
        precision_pooled=pixel_scores.precision(tp, fp),
        iou_mean=_mean(table.numbers("iou")[first]),
        iou_pooled=pixel_scores.iou(tp, fp, fn),
        detected=detected,
        detection_rate=detected / len(values) if len(values) else None,
        detection_interval=interval(is_detected),
        detection_spread=spread(is_detected),
    )


def _spread(scores: NDArray[Any], places: NDArray[np.int64]) -> Spread | None:
    """Return the spread of the places' means; None with fewer than two places."""
    rows = np.bincount(places)
    means = np.bincount(places, scores)[rows > 0] / rows[rows > 0]
    if len(means) < 2:
        return None
    low, high = np.quantile(means, (_TAIL, 1 - _TAIL))
    return Spread(float(low), float(high), len(means))


def _occlusion(table: EvaluationTable) -> tuple[OcclusionShare, ...]:
    """Return the occluded shares; each person of each frame counts once, although functions and sensors repeat its row."""
    places = np.flatnonzero(present(table) & np.isfinite(table.numbers("occlusion_rate")))
    if not len(places):
        return ()
    person = table.codes("frame_id").index[places] * 100_000 + table.numbers("instance_id")[places].astype(np.int64)
    once = np.zeros(len(table), np.bool_)
    once[places[np.unique(person, return_index=True)[1]]] = True
    names = characters(table)
    shares = []
    for name in (*names, ALL) if len(names) > 1 else names:
        of_any = [rows_of(table, Group(function, sensor, name)) for function, sensor in settings(table)]
        rates = table.numbers("occlusion_rate")[once & np.logical_or.reduce(of_any)]
        shares.append(OcclusionShare(name, len(rates), int(np.count_nonzero(rates > OCCLUDED))))
    return tuple(shares)


def _blocks(table: EvaluationTable) -> tuple[BlockPersons, ...]:
    blocks, persons = table.by_block(), int(np.count_nonzero(present(table)))
    if len(blocks) < 2:
        return ()
    return tuple(
        BlockPersons(number, int(np.count_nonzero(present(own))) / max(persons, 1), characters(own))
        for number, own in blocks.items()
    )


def _empty(table: EvaluationTable, counts: FrameCounts) -> tuple[EmptyFrames, ...]:
    uninhabited = ~counts.inhabited
    empty = []
    for function, sensor in settings(table):
        evaluations = (table.codes("function").where(function) & table.codes("sensor").where(sensor))[counts.row]
        pixels = counts.fp[uninhabited & evaluations]
        if len(pixels):
            empty.append(EmptyFrames(function, sensor, len(pixels), int(np.count_nonzero(pixels)), int(pixels.sum())))
    return tuple(empty)


def _mean(values: NDArray[np.float64]) -> float | None:
    defined = values[np.isfinite(values)]
    return float(defined.mean()) if len(defined) else None
