"""Counts per person: the visible pixels of a person that were predicted as person, and the others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.labels import PERSON
from valerie.measures import Source, names_from
from valerie.metrics.scores import pacc


class _Person(Protocol):
    @property
    def instance_id(self) -> int: ...


class InstanceTruth(Protocol):
    """The part of a ground truth that counts need (`valerie.rendering.base.GroundTruth` has it).

    Attributes:
        instance_map: (H, W) uint16 instance ids, 0 without an instance.
        persons: one entry per person in the scene, visible or not.
    """

    @property
    def instance_map(self) -> NDArray[np.uint16]: ...

    @property
    def persons(self) -> Sequence[_Person]: ...


class InstanceCounts(NamedTuple):
    """Visible pixels of one person.

    Attributes:
        instance_id: label id × 1000 + n.
        tp: pixels predicted as the person's class.
        fn: pixels predicted as anything else.
        tp_empty: those of these pixels that are predicted as the person's class without the person; None if unknown.
    """

    instance_id: int
    tp: int
    fn: int
    tp_empty: int | None = None

    @property
    def pacc(self) -> float | None:
        """The person's pACC; None without a visible pixel."""
        return pacc(self.tp, self.fn)

    @property
    def pacc_empty(self) -> float | None:
        """The pACC of the same pixels without the person; None without a visible pixel, or if unknown."""
        return None if self.tp_empty is None else pacc(self.tp_empty, self.tp + self.fn - self.tp_empty)

    @property
    def measures(self) -> dict[str, float | None]:
        """The person's scores in the long table."""
        return {name: getattr(self, name) for name in names_from(Source.PERSON_SCORE)}


def person_counts(
    truth: InstanceTruth,
    predicted: NDArray[np.uint8],
    *,
    empty: NDArray[np.uint8] | None = None,
) -> tuple[InstanceCounts, ...]:
    """Count tp and fn of every person in the scene. False positives belong to no person.

    Args:
        truth: ground truth of the frame. A person without a visible pixel gets tp = fn = 0, and so no pACC.
        predicted: (H, W) uint8 train ids.
        empty: (H, W) uint8, the prediction of the same scene without movables.

    Returns:
        One entry per person, by ascending instance id.

    Raises:
        InvalidInput: the maps differ in shape.
    """
    instance_map = truth.instance_map
    for field, prediction in (("predicted", predicted), ("empty", empty)):
        if prediction is not None and prediction.shape != instance_map.shape:
            limit = instance_map.shape
            raise InvalidInput("differs from the truth in shape", field=field, value=prediction.shape, limit=limit)
    first = PERSON.id * 1000
    # Unsigned arithmetic wraps, so one comparison tests first ≤ id ≤ first + 999.
    places = np.flatnonzero(instance_map.ravel() - np.uint16(first) < 1000)
    numbers = instance_map.ravel()[places] - np.uint16(first)
    visible = np.bincount(numbers, minlength=1000)

    def hits(labels: NDArray[np.uint8]) -> NDArray[np.int64]:
        return np.bincount(numbers[labels.ravel()[places] == PERSON.train_id], minlength=1000)

    tp, tp_empty = hits(predicted), None if empty is None else hits(empty)
    persons = {person.instance_id - first for person in truth.persons if 0 <= person.instance_id - first < 1000}
    return tuple(
        InstanceCounts(first + n, int(tp[n]), int(visible[n] - tp[n]), None if tp_empty is None else int(tp_empty[n]))
        for n in sorted(persons | set(np.flatnonzero(visible).tolist()))
    )
