"""The validation flow in rounds, on drawn products and drawn training frames: calm, killed, met and refused."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.world import makers
from tests.world.drawn import CLASS, TOWN, DrawnWorld, installed_town, spec
from tests.world.makers import predict
from tests.world.training import draw_frames
from tests.world.world import settings_of
from valerie.db import functions, studies
from valerie.db.engine import reading
from valerie.db.studies import StudyRow
from valerie.errors import InvalidInput
from valerie.labels import to_train_ids
from valerie.perception.importing.function_file import read_header
from valerie.perception.training.fit import TrainingProgress
from valerie.pipeline.functions.probe import inference_names
from valerie.pipeline.retraining.retrain import Watcher
from valerie.pipeline.rounds.flow import Flow, FlowEnd, Surroundings, until_met
from valerie.pipeline.rounds.flow_reporting import flow_report
from valerie.pipeline.work import finish
from valerie.rendering.base import GroundTruth
from valerie.runs.products.pins import Offer
from valerie.runs.products.states import Stage, route_of
from valerie.runs.study.study_document import StudyDocument, StudyState, parse_study
from valerie.statistics.verdicts import Outcome

TRAINING = {"frames": 2, "sites": 1, "width": 160, "height": 96, "steps": 2, "batch": 2, "held_out_frames": 0}
FUNCTION = "semantic-fpn-small"


def see(truth: GroundTruth, function: int, distance_m: float, *, seed: int) -> NDArray[np.uint8]:
    """Predict alike for all versions: only the file of a version, which names the ids of runs, decides the seed."""
    del seed
    return predict(truth, function, distance_m, seed=int(100 * distance_m))


@pytest.fixture(scope="module", autouse=True)
def quick(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A flow reads rows; reports of runs and rendered frames are tested elsewhere."""
    with installed_town(tmp_path_factory.mktemp("town")), pytest.MonkeyPatch.context() as patch:
        patch.setattr("valerie.pipeline.retraining.retrain.render_training_frames", draw_frames)
        patch.setattr(finish, "write_results", lambda *_: None)
        patch.setattr(makers, "predict", see)
        yield


def document(**more: Any) -> StudyDocument:
    """Variants up to 47 m away, of which the drawn function loses the far ones."""
    vary = [["person-1.pos.x", "UNIFORM", -1.0, 4.0], ["person-1.pos.y", "UNIFORM", 5.0, 35.0]]
    study = {
        "measure": "min(pacc) >= 0.5",
        "goal": {"name": "verify", "share": 0.9},
        "budget": {"variants": 120},
        "batch": 16,
        "rounds": {"most": 1, "search": 16, "training": TRAINING},
    }
    run_document = spec("flow", asset=TOWN, vary=vary, functions=[FUNCTION], cameras=["camera-1"])
    return parse_study(run_document | study | more)


class Machine:
    """A deployment that pursues studies, and the folder of its trainings."""

    def __init__(self, folder: Path) -> None:
        self.world = DrawnWorld(settings_of(folder / "data"))
        route = route_of(Stage.INFER, CLASS)
        engines = (
            Offer(stage=Stage.INFER, name=name, numeric_class=CLASS, revision=1, route=route)
            for name in inference_names()
        )
        self.world.offer("drawn-engines", *engines, stage=Stage.INFER)
        self.trainings = folder / "training"
        self.steps = 0

    def flow(self, asked: StudyDocument) -> Iterator[Flow]:
        return until_met(
            self.world.context, asked, Surroundings(self.wait, self.trainings, watcher=Watcher(on_step=self.count))
        )

    def count(self, _: object) -> None:
        self.steps += 1

    def wait(self, study_id: str) -> None:
        latest = time.monotonic() + 30
        while self.study(study_id).state is StudyState.RUNNING:
            assert time.monotonic() < latest
            self.world.step()

    def study(self, study_id: str) -> StudyRow:
        with reading(self.world.context.engine) as connection:
            return studies.get(connection, study_id)

    def studies(self) -> list[StudyRow]:
        with reading(self.world.context.engine) as connection:
            return studies.page(connection, limit=50)

    def versions(self) -> int:
        with reading(self.world.context.engine) as connection:
            return len(list(functions.every(connection)))


def told(flow: Flow) -> list[tuple[Any, ...]]:
    """Return the decisions of a flow, without ids, times, and digests of files that name the ids of runs."""
    return [
        (
            each.function.partition("@")[0],
            *(
                (part.study.document.goal, part.study.result, [b.outcomes for b in part.batches])
                for part in each.studied
            ),
            None if each.training is None else (each.training.region, each.training.selected),
        )
        for each in flow.rounds
    ]


@pytest.fixture(scope="module")
def calm(quick: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, list[Flow]]:
    """A flow that nothing disturbed, after each of its stages."""
    machine = Machine(tmp_path_factory.mktemp("calm"))
    return machine, list(machine.flow(document()))


def test_a_requirement_that_no_version_meets_is_verified_once_more_after_the_last_training(
    calm: tuple[Machine, list[Flow]],
) -> None:
    machine, flows = calm
    ended = flows[-1]
    assert (ended.ending, ended.outcome) == (FlowEnd.ROUNDS, Outcome.NOT_MET)
    assert [flow.ending for flow in flows[:-1]] == [None] * (len(flows) - 1)
    first, second = ended.rounds
    assert first.training is not None
    assert (first.function, second.function) == (FUNCTION, first.training.reference)
    assert second.search is None
    assert second.training is None
    assert (first.training.frames, first.training.steps) == (2, 2)
    header = read_header(next(machine.trainings.glob("*/*-retrained.safetensors")))
    assert header.provenance["retrained-from-run"].split(", ") == [
        run for part in first.studied for run in part.run_ids
    ]
    assert first.training.where == "pacc < 0.5"
    assert sum(part.variants for each in ended.rounds for part in each.studied) <= 120
    assert all(part.frames == part.variants for each in ended.rounds for part in each.studied)  # one camera


def test_each_verification_draws_fresh_variants_and_takes_its_share_of_the_error(
    calm: tuple[Machine, list[Flow]],
) -> None:
    parts = [part for each in calm[1][-1].rounds for part in each.studied]
    points = [tuple(point) for part in parts for batch in part.batches for point in batch.points]
    repeats = [part for part in parts if part.study.document.goal.name == "find"]
    drawn = [p for part in parts if part not in repeats for b in part.batches for p in map(tuple, b.points)]
    assert len(set(drawn)) == len(drawn)
    assert not set(drawn) & {tuple(p) for part in repeats for b in part.batches for p in b.points}
    assert len(points) > len(drawn)
    goals: list[Any] = [part.study.document.goal for part in parts if part not in repeats]
    assert [goal.confidence for goal in goals] == [pytest.approx(1 - 0.05 / 2)] * 2


def test_the_same_call_repeats_no_stage_that_is_done(calm: tuple[Machine, list[Flow]]) -> None:
    machine, flows = calm
    before = len(machine.studies()), machine.steps, machine.versions()
    again = list(machine.flow(document()))
    assert again == flows
    assert (len(machine.studies()), machine.steps, machine.versions()) == before


class Killed(BaseException):
    """The process ends here."""


def test_a_flow_killed_in_every_stage_makes_what_the_calm_one_makes(
    calm: tuple[Machine, list[Flow]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = Machine(tmp_path)
    deaths: set[object] = set()

    def die_once(what: object) -> None:
        if what not in deaths:
            deaths.add(what)
            raise Killed

    def wait(study_id: str) -> None:
        die_once(("study begun", machine.study(study_id).name))
        Machine.wait(machine, study_id)
        die_once(("study ended", machine.study(study_id).name))

    def count(progress: TrainingProgress) -> None:
        Machine.count(machine, progress)
        die_once(("step", progress.step))

    monkeypatch.setattr(machine, "wait", wait)
    monkeypatch.setattr(machine, "count", count)
    ended = None
    for _ in range(20):
        try:
            ended = list(machine.flow(document()))[-1]
            break
        except Killed:
            continue
    assert ended is not None
    assert told(ended) == told(calm[1][-1])
    assert len(deaths) >= 8
    assert len(machine.studies()) == len(calm[0].studies())
    assert machine.versions() == 1


def test_a_version_that_sees_everyone_ends_the_flow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine = Machine(tmp_path)

    def better(truth: GroundTruth, function: int, distance_m: float, *, seed: int) -> NDArray[np.uint8]:
        """Predictions of the new version are right."""
        if machine.versions():
            return to_train_ids(truth.class_map).copy()
        return see(truth, function, distance_m, seed=seed)

    monkeypatch.setattr(makers, "predict", better)
    ended = list(machine.flow(document()))[-1]
    assert (ended.ending, ended.outcome) == (FlowEnd.MET, Outcome.MET)
    assert [each.verification.outcome for each in ended.rounds if each.verification] == [Outcome.NOT_MET, Outcome.MET]


def test_cpu_hours_end_a_flow(tmp_path: Path) -> None:
    """One batch costs 16 times a layer, a truth and a prediction, at least."""
    hours = 16 * sum(makers.CPU_SECONDS[kind] for kind in ("layer", "truth", "prediction")) / 3600
    ended = list(Machine(tmp_path).flow(document(budget={"variants": 120, "cpu_hours": hours})))[-1]
    assert ended.ending is FlowEnd.BUDGET
    assert len(ended.rounds) == 1
    assert ended.rounds[0].training is None


def test_another_goal_or_too_few_variants_are_refused(calm: tuple[Machine, list[Flow]]) -> None:
    with pytest.raises(InvalidInput, match="rounds verify a requirement"):
        next(calm[0].flow(document(goal="find")))
    with pytest.raises(InvalidInput, match=r"budget\.variants.*31.*32"):
        next(calm[0].flow(document(budget={"variants": 31})))


def test_the_report_shows_every_round_with_its_cost(calm: tuple[Machine, list[Flow]]) -> None:
    machine, flows = calm
    context = machine.world.context
    ended = flows[-1]
    page = flow_report(context, ended)
    assert page == flow_report(context, ended)
    assert "The requirement is not met after the last version." in page
    assert all(each.function in page for each in ended.rounds)
    variants = sum(part.variants for each in ended.rounds for part in each.studied)
    assert f'<td class="number"><b>{variants}</b></td>' in page
    assert "refresh" not in page
    begun = flow_report(context, flows[0])
    assert 'class="working" aria-current="step"><h3>Verify</h3>' in begun
    assert 'http-equiv="refresh"' in begun
    assert page.count("data:image/jpeg") >= 2
