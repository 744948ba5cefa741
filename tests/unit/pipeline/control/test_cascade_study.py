"""A study of two render engines through the control loop: drawn products, priced as if one engine cost 25 times as much."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.world.drawn import CLASS, DrawnWorld, spec
from tests.world.makers import DrawingMaker
from tests.world.world import settings_of
from valerie.db import runs, studies
from valerie.db.claiming import Job
from valerie.db.engine import reading
from valerie.db.publishing import Finished
from valerie.db.studies import BatchRow, StudyRow
from valerie.errors import InvalidInput
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.control.studies import commands
from valerie.pipeline.control.studies.reporting import report
from valerie.pipeline.work import finish
from valerie.runs.products.pins import Offer
from valerie.runs.products.states import Stage, route_of
from valerie.runs.study.study_document import StudyDocument, StudyState, parse_study

#: Price of a layer by the costly engine; by the cheap one it is 0.4.
COSTLY = 30.0
VARIANTS = 200


def document(**more: Any) -> StudyDocument:
    vary = [["person-1.pos.x", "UNIFORM", -1.0, 4.0], ["person-1.pos.y", "UNIFORM", 5.0, 35.0]]
    study = {
        "measure": "min(pacc) >= 0.5",
        "goal": {"name": "cascade", "renderer": "pyrender"},
        "budget": {"variants": VARIANTS},
        "batch": 30,
    }
    functions = ["semantic-fpn-small"]
    return parse_study(
        spec("two", vary=vary, functions=functions, cameras=["camera-1"], width=48, height=28) | study | more
    )


@pytest.fixture(scope="module")
def pursued(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[DrawnWorld, StudyRow, list[BatchRow]]]:
    """A study that ended; its control loop was replaced at every step, as if its process had been killed."""
    make = DrawingMaker.make
    world = DrawnWorld(settings_of(tmp_path_factory.mktemp("two")))

    def priced(maker: DrawingMaker, job: Job) -> Finished:
        finished = make(maker, job)
        costly = job.kind == "layer" and world.row(job.frame.key.run_id).spec.engine == "pyrender"
        return replace(finished, cpu_seconds=COSTLY) if costly else finished

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(DrawingMaker, "make", priced)
        patch.setattr(finish, "write_results", lambda *_: None)
        route = route_of(Stage.RENDER, "pyrender", CLASS)
        world.offer("costly", Offer(stage=Stage.RENDER, name="pyrender", numeric_class=CLASS, revision=1, route=route))
        study = commands.begin(world.context, document())
        latest = time.monotonic() + 240
        while (row := read(world, study)[0]).state is StudyState.RUNNING:
            assert time.monotonic() < latest, row
            world.loop = ControlLoop(world.context)
            world.step()
        yield world, *read(world, study)


def read(world: DrawnWorld, study: str) -> tuple[StudyRow, list[BatchRow]]:
    with reading(world.context.engine) as connection:
        return studies.get(connection, study), studies.batches(connection, study)


def engines(world: DrawnWorld, batches: list[BatchRow]) -> list[str]:
    with reading(world.context.engine) as connection:
        return [runs.get(connection, str(batch.run_id)).spec.engine for batch in batches]


def test_each_batch_has_one_engine_and_the_costly_one_sees_points_of_the_cheap_one(
    pursued: tuple[DrawnWorld, StudyRow, list[BatchRow]],
) -> None:
    world, study, batches = pursued
    assert study.state is StudyState.FINISHED
    rendered = engines(world, batches)
    assert rendered[:3] == ["raster", "raster", "pyrender"]
    cheap = {tuple(p) for b, engine in zip(batches, rendered, strict=True) if engine == "raster" for p in b.points}
    costly = [tuple(p) for b, engine in zip(batches, rendered, strict=True) if engine == "pyrender" for p in b.points]
    assert len(cheap) + len(costly) == VARIANTS
    assert set(costly) <= cheap
    assert len(set(costly)) == len(costly)
    with reading(world.context.engine) as connection:
        assert {runs.get(connection, str(batch.run_id)).spec.seed for batch in batches} == {0}, "pairs share the seed"


def test_the_estimate_and_the_split_follow_from_scores_and_prices(
    pursued: tuple[DrawnWorld, StudyRow, list[BatchRow]],
) -> None:
    world, study, batches = pursued
    rendered = engines(world, batches)
    scores: dict[str, dict[tuple[float, ...], float]] = {"raster": {}, "pyrender": {}}
    seconds = dict.fromkeys(scores, 0.0)
    for batch, engine in zip(batches, rendered, strict=True):
        assert batch.outcomes is not None
        assert batch.outcomes.cpu_seconds is not None
        seconds[engine] += batch.outcomes.cpu_seconds
        for point, score in zip(batch.points, batch.outcomes.scores, strict=True):
            scores[engine][tuple(point)] = float("nan") if score is None else score
    both = np.array([(scores["raster"][p], y) for p, y in scores["pyrender"].items()])
    x, y = both[~np.isnan(both).any(axis=1)].T
    beta = np.polyfit(x, y, 1)[0]
    everywhere = np.nanmean(list(scores["raster"].values()))
    assert study.result is not None
    numbers: Any = study.result.numbers
    assert numbers["estimate"] == pytest.approx(y.mean() + beta * (everywhere - x.mean()))
    assert numbers["correlation"] == pytest.approx(np.corrcoef(x, y)[0, 1])
    assert numbers["low"] < numbers["estimate"] < numbers["high"]
    assert f"mean of min(pacc) by the costly engine is {numbers['estimate']:.4f} (" in study.result.sentences[0]
    price = [seconds[engine] / len(scores[engine]) for engine in ("raster", "pyrender")]
    assert numbers["costs"] == pytest.approx(price)
    # A layer costs 0.4 by the one and 30 by the other engine; truth and prediction cost 0.8 with both.
    assert price[1] - price[0] == pytest.approx(COSTLY - 0.4, abs=0.1)
    rho = numbers["correlation"]
    ratio = min(max(np.sqrt(rho**2 / (1 - rho**2) * price[1] / price[0]), 1), 50)
    said = " ".join(study.result.sentences)
    assert (
        f"{price[0]:.3g} s of CPU time by the cheap and {price[1]:.3g} s by the costly engine: {ratio:.1f} cheap"
        in said
    )
    residuals = y - y.mean() - beta * (x - x.mean())
    others = np.array([score for score in scores["raster"].values() if not np.isnan(score)])
    variance = (residuals**2).sum() / (len(y) - 2) / len(y) + beta**2 * others.var(ddof=1) / len(others)
    assert f"takes {100 * (1 - variance / (y.var(ddof=1) / len(y))):.0f} % off the variance" in said
    assert "not for a study that someone stops" in said


def test_the_report_shows_variants_on_which_the_engines_disagree(
    pursued: tuple[DrawnWorld, StudyRow, list[BatchRow]],
) -> None:
    world, study, _ = pursued
    page = report(world.context, study.id)
    for engine in ("raster", "pyrender"):
        assert f"The engines disagree, {engine}" in page


def test_one_engine_twice_and_an_unknown_engine_are_refused(
    pursued: tuple[DrawnWorld, StudyRow, list[BatchRow]],
) -> None:
    context = pursued[0].context
    with pytest.raises(InvalidInput, match="the costly engine is the cheap one"):
        document(goal={"name": "cascade", "renderer": "raster"})
    with pytest.raises(InvalidInput, match=r"goal\.renderer.*pyrendr"):
        commands.begin(context, document(goal={"name": "cascade", "renderer": "pyrendr"}))
    with pytest.raises(InvalidInput, match=r"budget\.variants.*109.*>= 110"):
        commands.begin(context, document(budget={"variants": 109}))
