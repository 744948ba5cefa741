"""Measure what strategies cost on a real domain: that of ``examples/guided.yaml``, with the legality of its variants.

A batch costs its proposal, its scores and the result so far, as a study computes them. The share is of its layers and truths by
`raster`, measured beside it: variants of the same domain, with warm caches, encoded.
"""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import yaml

from valerie import plugins
from valerie.guided.strategy import Scores
from valerie.parameters.samplers import UnitPoints
from valerie.pipeline.base.resolved_runs import resolve_new
from valerie.plain import JsonObject
from valerie.rendering.base import View
from valerie.runs.study.study_document import parse_study
from valerie.scene.assets.asset import load_asset
from valerie.scene.variation.variant import apply
from valerie.settings import Settings
from valerie.storage import codecs
from valerie.studies.pursuit import strategy_of
from valerie.studies.resolved import ResolvedStudy, resolve_study

GOALS: Final = ("estimate", "find", "map", "rank", "compare", "cascade")
#: Number of batches by the number of variants in each.
BATCHES: Final = {64: 20, 512: 6}
#: Variants that are rendered; the first ones warm the caches.
_RENDERED: Final = 48
_WARMING: Final = 16
_OPTIONS: Final[dict[str, JsonObject]] = {"compare": {"within": 0.001}, "cascade": {"renderer": "cycles"}}
_FUNCTIONS: Final = ("semantic-fpn-small", "deeplabv3plus-small")
_EXAMPLE: Final = Path(__file__).parents[1] / "examples" / "guided.yaml"
#: Parameters of a car that drives past the person.
_CAR: Final[dict[str, JsonObject]] = {
    "constants": {"car-101.kind": "sedan"},
    "vary": {"car-101.pos.y": {"uniform": {"from": "0 m", "to": "60 m"}}},
}


@dataclass(frozen=True, slots=True)
class OverheadRow:
    """CPU seconds of a strategy per batch.

    Attributes:
        batch: variants of a batch, the same in all `BATCHES` of it.
        seconds: mean of these batches.
        rendering: share of its layers and truths, with warm caches.
    """

    goal: str
    of: str
    batch: int
    seconds: float
    rendering: float


def measure_overhead(goal: str, batch: int, *, car: bool = False) -> OverheadRow:
    """Measure a goal's strategy on scores that fall with the distance; about a tenth of them fails.

    Args:
        car: if True, a car moves, too.
    """
    study = _study(goal, batch, car=car)
    _pursued(study, goal, batch)  # imports its libraries
    started = time.process_time()
    _pursued(study, goal, batch)
    seconds = (time.process_time() - started) / BATCHES[batch]
    named = f"{goal}, car" if car else goal
    return OverheadRow("overhead", named, batch, seconds, seconds / (batch * _frame_seconds(car=car)))


def _pursued(study: ResolvedStudy, goal: str, batch: int) -> None:
    """Ask for some batches."""
    strategy, compares = strategy_of(study), goal == "compare"
    for _ in range(BATCHES[batch]):
        asked = strategy.ask(batch).points
        if not len(asked):  # decided
            break
        scores = _score(asked)
        strategy.tell(asked, np.column_stack([scores, scores - 0.2 * (asked[:, 0] > 0.5)]) if compares else scores)
        _ = strategy.result


@functools.cache
def _frame_seconds(*, car: bool) -> float:
    """Measure the CPU seconds of a variant's layer and truth."""
    study = _study("estimate", _RENDERED, car=car)
    points = strategy_of(study).ask(_RENDERED).points
    run = resolve_new(study.spec(points, 0, parent=None, seed=0), Settings(), registered=_FUNCTIONS)
    asset, spec = load_asset(run.spec.asset), run.spec
    assert spec.cameras is not None, "the example names its camera"
    view = View(spec.cameras[0], spec.resolution.width, spec.resolution.height)
    engine, truth_pass = plugins.create_renderer("raster"), plugins.create_truth_pass("")
    started, digest = 0.0, ""
    for i, (_, values) in enumerate(run.space.values(0, _RENDERED)):
        if i == _WARMING:
            started = time.process_time()
        scene = apply(values, asset)
        layer = engine.layer(scene, view)
        statics, truth = truth_pass.parts(scene, view)
        if i == 0:
            engine.background(scene, view)
            digest = codecs.statics_digest(statics)
        codecs.encode_layer(layer)
        codecs.encode_truth_layer(truth, digest)
    return (time.process_time() - started) / (_RENDERED - _WARMING)


def _study(goal: str, batch: int, *, car: bool) -> ResolvedStudy:
    document = yaml.safe_load(_EXAMPLE.read_text()) | {"batch": batch, "budget": {"variants": 20 * batch}}
    document["goal"] = {"name": goal, **_OPTIONS.get(goal, {})}
    if car:
        document |= {name: document.get(name, {}) | added for name, added in _CAR.items()}
    document["functions"] = _FUNCTIONS[: 2 if goal == "compare" else 1]
    study = parse_study(document)
    return resolve_study(study, resolve_new(study.spec, Settings(), registered=_FUNCTIONS))


def _score(points: UnitPoints) -> Scores:
    far, turned = points[:, 1], np.sin(2 * np.pi * points[:, 2])
    return np.asarray(np.clip(1.2 - far + 0.1 * turned, 0.2, 1))
