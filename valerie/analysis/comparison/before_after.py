"""Several versions of a function on the same frames: scores side by side, and their improvements and regressions.

All versions were evaluated on the same frames, so rows are paired and judged by whole places, all groups together
(`valerie.statistics.gates`). Every score is computed as frame mean and pooled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.frame_counts import FrameCounts, frame_counts, present
from valerie.analysis.rows.pairing import parts_of, row_keys
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput
from valerie.metrics import scores as pixel_scores
from valerie.metrics.collection import CollectionScores
from valerie.plain import JsonObject
from valerie.statistics.gates import SliceComparison, compare_versions
from valerie.statistics.units import Estimand

#: Largest expected share of false ones among the groups named better, and among those named worse.
_FALSE_DISCOVERIES: Final = 0.025
#: Smallest change of a pooled score that counts as better or worse: one percentage point.
_CLASS_STEP: Final = 0.01


@dataclass(frozen=True, slots=True)
class VersionScores:
    """Scores of one version on one group of persons; ratios in [0, 1], None if undefined.

    Attributes:
        pacc_mean, pacc_pooled: over the group's persons; the mean weighs persons equally, the pooled score pixels.
        detected: share of persons with pACC ≥ the threshold.
        precision_mean, precision_pooled, iou_mean, iou_pooled: of the frames that show the group's persons.
        false_pixels: pixels of these frames that are called person and belong to none.
    """

    pacc_mean: float | None
    pacc_pooled: float | None
    detected: float | None
    precision_mean: float | None
    precision_pooled: float | None
    iou_mean: float | None
    iou_pooled: float | None
    false_pixels: int


@dataclass(frozen=True, slots=True)
class GroupDifference:
    """Mean pACC of a later version minus that of the first, on one group of persons.

    Attributes:
        mean: mean over places of the mean difference of their persons.
        low, high: its 95 % interval by place, not adjusted for other groups; None with fewer than six places, or alike ones.
        places: number of places.
        lost, gained: persons that only the first version detects; persons that only the later one detects.
        judgement: ``better`` or ``worse``, all groups accounted for; empty if neither is clear.
        estimand: what the mean and its interval are over.
        places_needed: places that show a change of `valerie.statistics.gates.EFFECT`; None: unknown.
        alike: True if neighbouring places have similar differences, so that they are no independent evidence.
    """

    mean: float
    low: float | None
    high: float | None
    places: int
    lost: int
    gained: int
    judgement: Literal["better", "worse", ""]
    estimand: Estimand
    places_needed: int | None
    alike: bool = False

    @property
    def undecided(self) -> bool:
        """True if no change is clear, and the places are too few to show one, or nobody knows."""
        return not self.judgement and (self.places_needed is None or self.places_needed > self.places)


@dataclass(frozen=True, slots=True)
class GroupComparison:
    """One group of persons under all versions.

    Attributes:
        name: describes the persons.
        persons: number of persons in frames with a defined pACC.
        frames: number of frames that show them.
        sides: per version, in order; the first is "before".
        differences: of each later version to the first.
    """

    name: str
    persons: int
    frames: int
    sides: tuple[VersionScores, ...]
    differences: tuple[GroupDifference, ...]


@dataclass(frozen=True, slots=True)
class VersionChange:
    """One score that a later version improves or worsens.

    Attributes:
        kind: ``group`` of persons (mean pACC), ``class`` (pooled IoU), or ``score`` of the class person (pooled).
        name: name of the group, the class or the score.
        before, after: value of the first and of the later version, in [0, 1].
        step: after − before; above 0 the later version is better. For a group, the mean difference by place.
        difference: by place, with its interval; groups only.
    """

    kind: Literal["group", "class", "score"]
    name: str
    before: float | None
    after: float | None
    step: float
    difference: GroupDifference | None = None


@dataclass(frozen=True, slots=True)
class VersionComparison:
    """Comparison of all versions over all groups and classes.

    Attributes:
        versions: names, "before" first.
        threshold: of the detection rate.
        groups: all persons first, then the parts.
        numeric_classes: numeric class of each version, in their order; empty if unknown.
        judged_by: names of the classes that ``classes`` and ``overall`` cover; all 19 unless a version knows fewer.
        classes: class name to (IoU, recall) per version, pooled over all frames; classes in truth or prediction.
        overall: score over all classes to (frame mean, pooled) per version.
    """

    versions: tuple[str, ...]
    numeric_classes: tuple[str, ...]
    judged_by: tuple[str, ...]
    threshold: float
    groups: tuple[GroupComparison, ...]
    classes: Mapping[str, tuple[tuple[float | None, float | None], ...]]
    overall: Mapping[str, tuple[tuple[float | None, float | None], ...]]

    @property
    def alike(self) -> bool:
        """True unless two versions are known to have run in different numeric classes."""
        return len(set(self.numeric_classes)) < 2

    def changes(self, version: int) -> tuple[VersionChange, ...]:
        """Return the changes of one later version, the largest first.

        A group counts if it is judged better or worse; a class or a score of the class person if it moved by a percentage
        point or more.
        """
        changes = [
            VersionChange("group", group.name, group.sides[0].pacc_mean, group.sides[version].pacc_mean, own.mean, own)
            for group in self.groups
            for own in (group.differences[version - 1],)
            if own.judgement
        ]
        for name, sides in self.classes.items():
            before, after = sides[0][0] or 0.0, sides[version][0] or 0.0
            changes.append(VersionChange("class", name, before, after, after - before))
        whole = self.groups[0].sides
        for name in ("precision", "iou"):
            first, later = (getattr(side, f"{name}_pooled") for side in (whole[0], whole[version]))
            if first is not None and later is not None:
                changes.append(VersionChange("score", name, first, later, later - first))
        clear = (change for change in changes if change.difference is not None or abs(change.step) >= _CLASS_STEP)
        return tuple(sorted(clear, key=lambda change: -abs(change.step)))

    def as_document(self) -> JsonObject:
        """Return JSON values, with the changes of each later version."""
        return {
            "versions": list(self.versions),
            "numeric_classes": list(self.numeric_classes),
            "judged_by": list(self.judged_by),
            "threshold": self.threshold,
            "groups": [asdict(group) for group in self.groups],
            "classes": {name: [list(side) for side in sides] for name, sides in self.classes.items()},
            "overall": {name: [list(side) for side in sides] for name, sides in self.overall.items()},
            "changes": {
                name: [asdict(change) for change in self.changes(number)]
                for number, name in enumerate(self.versions[1:], start=1)
            },
        }


def compare(
    versions: Mapping[str, tuple[EvaluationTable, CollectionScores]],
    *,
    numeric_classes: Sequence[str] = (),
    more_groups: Mapping[str, NDArray[np.bool_]] | None = None,
    threshold: float = 0.5,
) -> VersionComparison:
    """Compare versions of a function on the same frames.

    Args:
        versions: name to long table (one function, one sensor setting) and scores; the first is "before". The rows come
            from `aligned`: the same persons in the same frames, in the same order. Scores are judged by the same classes.
        numeric_classes: numeric class of each version, in their order.
        more_groups: name to (N,) bool over the first table's rows; added to the groups by distance, occlusion, character
            and camera.
        threshold: of the detection rate.

    Raises:
        InvalidInput: fewer than two versions, tables of other rows, or scores of other classes.
    """
    if len(versions) < 2:
        raise InvalidInput("too few versions to compare", field="versions", value=list(versions), limit="at least two")
    tables = [table for table, _ in versions.values()]
    first = tables[0]
    for name, table in zip(versions, tables, strict=True):
        if row_keys(table) != row_keys(first):
            raise InvalidInput("rows of other frames or persons", field=name)
    defined = np.isfinite(first.numbers("pacc"))  # the same in all versions: visibility alone decides it
    more = {name: mask for name, mask in (more_groups or {}).items() if (mask & defined).any()}
    masks = {"all persons": present(first), **more, **parts_of(first, defined)}
    differences = [differences_of(masks, first, table, threshold) for table in tables[1:]]
    sides = [(table, frame_counts(table)) for table in tables]
    groups = [
        _group(name, mask, sides, tuple(own[name] for own in differences), threshold) for name, mask in masks.items()
    ]
    scores = [scores for _, scores in versions.values()]
    judged = scores[0].judged
    if any(score.judged != judged for score in scores):
        raise InvalidInput("scores of other classes", field="versions", value=[list(score.judged) for score in scores])
    classes = {
        scores[0].classes[k].label.name: tuple(
            (score.classes[k].iou.pooled, score.classes[k].pacc.pooled) for score in scores
        )
        for k in judged
        if any(score.classes[k].iou.pooled is not None for score in scores)
    }
    averages = {
        "pixel_accuracy": [score.overall.pixel_accuracy for score in scores],
        "miou": [score.overall.miou for score in scores],
        "macc": [score.overall.macc for score in scores],
        "fwiou": [score.overall.fwiou for score in scores],
    }
    overall = {name: tuple((side.frames.mean, side.pooled) for side in sides) for name, sides in averages.items()}
    judged_by = tuple(scores[0].classes[k].label.name for k in judged)
    return VersionComparison(
        tuple(versions), tuple(numeric_classes), judged_by, threshold, tuple(groups), classes, overall
    )


def differences_of(
    masks: Mapping[str, NDArray[np.bool_]], first: EvaluationTable, later: EvaluationTable, threshold: float
) -> dict[str, GroupDifference]:
    """Return the difference of a later version to the first in each group of rows; both tables have the same rows."""
    before, after = first.numbers("pacc"), later.numbers("pacc")

    def gate(one: NDArray[np.float64], other: NDArray[np.float64]) -> tuple[SliceComparison, ...]:
        return compare_versions(
            one,
            other,
            first.places,
            masks,
            threshold=threshold,
            false_discoveries=_FALSE_DISCOVERIES,
            positions=first.place_positions,
        ).slices

    return {
        fell.name: GroupDifference(
            mean=fell.difference if fell.pairs else 0.0,
            low=fell.low,
            high=fell.high,
            places=fell.places,
            lost=fell.lost,
            gained=fell.gained,
            judgement="worse" if fell.worse else "better" if rose.worse else "",
            estimand=first.units.estimand,
            places_needed=fell.places_needed,
            alike=fell.alike,
        )
        for fell, rose in zip(gate(before, after), gate(after, before), strict=True)
    }


def _group(
    name: str,
    mask: NDArray[np.bool_],
    sides: Sequence[tuple[EvaluationTable, FrameCounts]],
    differences: tuple[GroupDifference, ...],
    threshold: float,
) -> GroupComparison:
    first = sides[0][0]
    defined = mask & np.isfinite(first.numbers("pacc"))
    frames = np.unique(first.evaluations[mask])
    scores = tuple(version_scores(table, counts, defined, frames, threshold) for table, counts in sides)
    return GroupComparison(name, int(defined.sum()), len(frames), scores, differences)


def version_scores(
    table: EvaluationTable,
    counts: FrameCounts,
    defined: NDArray[np.bool_] | NDArray[np.int64],
    frames: NDArray[np.int64],
    threshold: float,
) -> VersionScores:
    """Return the scores of some rows, with precision and IoU of some evaluations.

    Args:
        table: all rows of these evaluations.
        counts: of the table.
        defined: mask or numbers of the rows, each with a pACC.
        frames: numbers of the evaluations.
        threshold: of the detection rate.
    """
    pacc, tp, fn = (table.numbers(name)[defined] for name in ("pacc", "tp", "fn"))
    tp_of_frames, fp, fn_of_frames = counts.tp[frames], counts.fp[frames], counts.fn[frames]
    return VersionScores(
        pacc_mean=_mean(pacc),
        pacc_pooled=pixel_scores.pacc(tp.sum(), fn.sum()),
        detected=_mean((pacc >= threshold).astype(np.float64)),
        precision_mean=_mean_ratio(tp_of_frames, tp_of_frames + fp),
        precision_pooled=pixel_scores.precision(tp_of_frames.sum(), fp.sum()),
        iou_mean=_mean_ratio(tp_of_frames, tp_of_frames + fp + fn_of_frames),
        iou_pooled=pixel_scores.iou(tp_of_frames.sum(), fp.sum(), fn_of_frames.sum()),
        false_pixels=int(fp.sum()),
    )


def _mean(values: NDArray[np.float64]) -> float | None:
    return float(values.mean()) if len(values) else None


def _mean_ratio(part: NDArray[np.float64], whole: NDArray[np.float64]) -> float | None:
    some = whole > 0
    return float((part[some] / whole[some]).mean()) if some.any() else None
