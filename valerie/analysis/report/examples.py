"""Example frames: the extremes of a run, one frame each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.frame_counts import present
from valerie.analysis.rows.table import EvaluationTable, combine
from valerie.analysis.summary.summary import OCCLUDED
from valerie.analysis.trends.trends import AXES


@dataclass(frozen=True, slots=True)
class Example:
    """One person in one frame, and the pACC of each function.

    Attributes:
        title: reason for the choice.
        frame_id, sensor, camera, instance_id, character: the person and the frame.
        measures: the person's value on each axis of the report, and the place of the sun, if defined; time only where it
            varies.
        pacc: per function, 0…1.
    """

    title: str
    frame_id: str
    sensor: str
    camera: str
    instance_id: int
    character: str
    measures: dict[str, float]
    pacc: dict[str, float]


def choose_examples(table: EvaluationTable) -> tuple[Example, ...]:
    """Return the persons with the best pACC, the worst in plain sight, the worst of all, the most occlusion, the most dispute.

    No frame occurs twice, so there may be fewer.
    """
    usable = present(table) & np.isfinite(table.numbers("pacc"))
    if not usable.any():
        return ()
    instance = np.nan_to_num(table.numbers("instance_id"))
    key = combine([table.codes("frame_id").index, table.codes("sensor").index, instance])
    key = np.where(usable, key, -1)
    rows = np.flatnonzero(usable)
    keys, first, inverse = np.unique(key[rows], return_index=True, return_inverse=True)
    pacc = table.numbers("pacc")[rows]
    n = np.bincount(inverse)
    mean = np.bincount(inverse, weights=pacc) / n
    lowest, highest = np.full(len(keys), np.inf), np.full(len(keys), -np.inf)
    np.minimum.at(lowest, inverse, pacc)
    np.maximum.at(highest, inverse, pacc)
    occlusion = np.nan_to_num(table.numbers("occlusion_rate")[rows[first]], nan=0.0)
    in_plain_sight = occlusion <= OCCLUDED
    extremes: list[tuple[str, NDArray[np.float64]]] = [
        ("Best seen", mean),
        ("Worst in plain sight", np.where(in_plain_sight, -mean, -np.inf)),
        ("Worst of all", -mean),
        ("Most occluded", np.where(occlusion > 0, occlusion, -np.inf)),
        ("Most disputed", np.where(highest > lowest, highest - lowest, -np.inf)),
    ]
    chosen: list[Example] = []
    for title, score in extremes:
        for place in np.argsort(-score, kind="stable"):
            if not np.isfinite(score[place]):
                break
            example = _example(table, title, rows[inverse == place])
            if all(example.frame_id != other.frame_id for other in chosen):
                chosen.append(example)
                break
    return tuple(chosen)


def _example(table: EvaluationTable, title: str, rows: NDArray[np.int64]) -> Example:
    people = table.arrow.take(rows).to_pylist()
    person, times = people[0], table.numbers("time_s")
    still = bool(np.all((times == times[0]) | np.isnan(times)))
    axes = (axis.name for axis in AXES if not (still and axis.name == "time_s"))
    shown = (*axes, "sun_elevation_deg", "sun_azimuth_deg")
    return Example(
        title=title,
        frame_id=person["frame_id"],
        sensor=person["sensor"],
        camera=person["camera"],
        instance_id=person["instance_id"],
        character=person["character"] or "",
        measures={name: person[name] for name in shown if person[name] is not None},
        pacc={row["function"]: row["pacc"] for row in people},
    )
