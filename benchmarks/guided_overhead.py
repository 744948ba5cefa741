"""Measure what strategies cost on a real domain: that of ``examples/guided.yaml``, with the legality of its variants.

A batch costs its proposal, its scores and the result so far, as a study computes them. The shares are of what ``valerie plan``
expects for the batch from the shipped table: of its layers and truths by ``raster``, and of all its products.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import yaml

from valerie.guided.strategy import Scores
from valerie.parameters.samplers import UnitPoints
from valerie.pipeline.base.resolved_runs import resolve_new
from valerie.plain import JsonObject
from valerie.runs.forecasting.forecast import plan
from valerie.runs.products.states import ProductKind
from valerie.runs.study.study_document import parse_study
from valerie.settings import Settings
from valerie.studies.pursuit import strategy_of
from valerie.studies.resolved import ResolvedStudy, resolve_study

GOALS: Final = ("estimate", "find", "map", "rank", "compare", "cascade")
SIZES: Final = (64, 512)
BATCHES: Final = 6
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
        batch: variants of a batch, the same in `BATCHES` batches.
        rendering, products: shares of the expected price of the batch's layers and truths, and of all its products.
    """

    goal: str
    of: str
    batch: int
    seconds: float
    rendering: float
    products: float


def measure_overhead(goal: str, batch: int, *, car: bool = False) -> OverheadRow:
    """Measure a goal's strategy on scores that fall with the distance; about a tenth of them fails.

    Args:
        car: if True, a car moves, too.
    """
    study = _study(goal, batch, car=car)
    _pursued(study, goal, batch)  # imports its libraries
    started = time.process_time()
    points = _pursued(study, goal, batch)
    seconds = (time.process_time() - started) / BATCHES
    price = plan(resolve_new(study.spec(points, 0, parent=None, seed=0), Settings(), registered=_FUNCTIONS))
    rendering = sum(p.cpu_seconds for p in price.products if p.kind in (ProductKind.LAYER, ProductKind.TRUTH))
    of_batch = seconds * len(points) / batch
    products = price.cpu_seconds - price.start_cpu_seconds
    named = f"{goal}, car" if car else goal
    return OverheadRow("overhead", named, batch, seconds, of_batch / rendering, of_batch / products)


def _pursued(study: ResolvedStudy, goal: str, batch: int) -> UnitPoints:
    """Ask for some batches, and return the points of the last one."""
    strategy, compares = strategy_of(study), goal == "compare"
    points = np.empty((0, study.domain.dimensions))
    for _ in range(BATCHES):
        asked = strategy.ask(batch).points
        if not len(asked):  # decided
            break
        points, scores = asked, _score(asked)
        strategy.tell(points, np.column_stack([scores, scores - 0.2 * (points[:, 0] > 0.5)]) if compares else scores)
        _ = strategy.result
    return points


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
