"""Verify a requirement, find failures, train on them and verify the new version, until the requirement is met.

A flow has no state of its own. Each stage is found by its content: a study by its document, a training by its folder, a
version by its digest. So the same call continues a flow that was killed, and repeats no stage that is done.

Every version is verified on variants that no earlier stage drew, and each verification takes its share of the error
(Bonferroni): the chance that any of them says *met* or *not met* falsely is at most 1 − ``confidence``.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Final

from valerie.db import runs, studies
from valerie.db.engine import database_moment, reading
from valerie.db.studies import BatchRow, StudyRow
from valerie.errors import Conflict, InvalidInput
from valerie.perception.training.fit import TrainingProgress
from valerie.perception.training.frame_folder import Shard
from valerie.pipeline.base.context import Context
from valerie.pipeline.control.studies import commands
from valerie.pipeline.control.studies.resolving import resolve_document
from valerie.pipeline.retraining.retrain import TrainingResources, Watcher, register_retrained, retrain, training_folder
from valerie.pipeline.retraining.weakness import Weakness, find_weakness
from valerie.runs.study.measure import parse_measure
from valerie.runs.study.study_document import Budget, FindGoal, Goal, StudyDocument, StudyState, VerifyGoal
from valerie.statistics.verdicts import Outcome

#: Fewest variants of a verification.
FEWEST: Final = 8
#: Longest name of a flow in the names of its studies.
_NAME: Final = 150


class FlowEnd(StrEnum):
    """The reason why a flow ended."""

    #: The requirement is met.
    MET = "met"
    #: The last version that the document allows is verified.
    ROUNDS = "rounds"
    #: CPU hours or the deadline are spent.
    BUDGET = "budget"
    #: The requirement is not met, but no row that was seen speaks against the function.
    NO_FAILURE = "no failure"


@dataclass(frozen=True, slots=True)
class Studied:
    """A study of a flow that has ended.

    Attributes:
        study, batches: as stored.
        frames: number of pictures that the function judged.
    """

    study: StudyRow
    batches: tuple[BatchRow, ...]
    frames: int

    @property
    def variants(self) -> int:
        """Number of legal variants."""
        return sum(batch.legal for batch in self.batches)

    @property
    def cpu_seconds(self) -> float:
        """CPU time of workers."""
        return sum(batch.cpu_seconds or 0.0 for batch in self.batches)

    @property
    def run_ids(self) -> list[str]:
        """Ids of its runs."""
        return [batch.run_id for batch in self.batches if batch.run_id is not None]

    @property
    def outcome(self) -> Outcome:
        """The verdict of a verification; undecided before any score."""
        result = self.study.result
        return Outcome.UNDECIDED if result is None else Outcome(str(result.numbers["outcome"]))


@dataclass(frozen=True, slots=True)
class Trained:
    """A training of a flow.

    Attributes:
        reference: of the new version.
        where, region: rows that were trained against, and their region.
        selected: number of these rows.
        frames, drawn: pictures to train on, and the scenes that were drawn for them.
        steps: of the training.
        site_seeds: of the pictures, first and last.
        cpu_seconds: of rendering and training, over all attempts.
    """

    reference: str
    where: str
    region: str
    selected: int
    frames: int
    drawn: int
    steps: int
    site_seeds: tuple[int, int]
    cpu_seconds: float


@dataclass(frozen=True, slots=True)
class Round:
    """One round; a stage that has not ended is None.

    Attributes:
        function: reference of the version that is verified.
    """

    function: str
    verification: Studied | None = None
    search: Studied | None = None
    training: Trained | None = None

    @property
    def studied(self) -> tuple[Studied, ...]:
        """Its studies."""
        return tuple(part for part in (self.verification, self.search) if part is not None)

    @property
    def cpu_seconds(self) -> float:
        """CPU time of its stages."""
        trained = 0.0 if self.training is None else self.training.cpu_seconds
        return trained + sum(part.cpu_seconds for part in self.studied)


@dataclass(frozen=True, slots=True)
class Flow:
    """A flow so far.

    Attributes:
        document: what was asked.
        rounds: the last one may be in work.
        ending: None while it goes on.
    """

    document: StudyDocument
    rounds: tuple[Round, ...]
    ending: FlowEnd | None = None

    @property
    def outcome(self) -> Outcome:
        """The latest verdict."""
        verified = [each.verification for each in self.rounds if each.verification is not None]
        return verified[-1].outcome if verified else Outcome.UNDECIDED


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The deployment and the callbacks that a flow needs.

    Attributes:
        wait: returns when the study with this id no longer runs.
        trainings: folder of all trainings; what an earlier attempt left there is used.
        resources: of this machine, for trainings.
        watcher: is notified of sites and steps.
    """

    wait: Callable[[str], None]
    trainings: Path
    resources: TrainingResources = field(default_factory=TrainingResources)
    watcher: Watcher = field(default_factory=Watcher)


def check_flow(document: StudyDocument) -> None:
    """Check that rounds of verification and training follow from a study.

    Raises:
        InvalidInput: another goal, or too few variants for all rounds.
    """
    if not isinstance(document.goal, VerifyGoal):
        raise InvalidInput("rounds verify a requirement", field="goal", value=document.goal.name, limit="verify")
    rounds = document.rounds
    fewest = rounds.most * (FEWEST + rounds.search) + FEWEST
    if document.budget.variants < fewest:
        refusal = f"{rounds.most} trainings, each after a search, need more variants"
        raise InvalidInput(refusal, field="budget.variants", value=document.budget.variants, limit=f">= {fewest}")


def until_met(context: Context, document: StudyDocument, around: Surroundings) -> Iterator[Flow]:
    """Yield the flow before its first stage, and after each.

    Args:
        context: of the deployment, whose control loop and workers pursue the studies.
        document: with the goal ``verify``.
        around: what the flow needs.

    Raises:
        InvalidInput: `check_flow` refuses the document, or the function or asset cannot be trained on.
        Conflict: a study was paused or stopped.
    """
    check_flow(document)
    flow = Flow(document, (Round(document.spec.functions[0]),))
    yield flow
    while flow.ending is None:
        flow = _next(context, flow, around)
        yield flow


def _next(context: Context, flow: Flow, around: Surroundings) -> Flow:
    """Return the flow after its next stage."""
    *earlier, now = flow.rounds
    if now.training is not None:
        earlier, now = [*flow.rounds], Round(now.training.reference)
    elif now.verification is not None:
        if now.verification.outcome is Outcome.MET:
            return replace(flow, ending=FlowEnd.MET)
        if len(earlier) == flow.document.rounds.most:
            return replace(flow, ending=FlowEnd.ROUNDS)
    if _spent(context, flow):
        return replace(flow, ending=FlowEnd.BUDGET)
    if now.verification is None:
        now = replace(now, verification=_studied(context, _verification(flow, now.function, len(earlier)), around))
    elif now.search is None:
        now = replace(now, search=_studied(context, _search(flow, now.function, len(earlier)), around))
    else:
        weakness = _weakness(context, flow.document, now)
        if weakness is None:
            return replace(flow, ending=FlowEnd.NO_FAILURE)
        now = replace(now, training=_trained(context, flow.document, weakness, len(earlier), around))
    return replace(flow, rounds=(*earlier, now))


# -- the documents of the studies ------------------------------------------------------------------------------------


def _verification(flow: Flow, function: str, number: int) -> StudyDocument:
    """Return the study that verifies a version: with an equal part of the variants that searches leave."""
    document, goal = flow.document, flow.document.goal
    assert isinstance(goal, VerifyGoal), "checked"
    trainings = document.rounds.most - number
    left = document.budget.variants - sum(part.variants for each in flow.rounds for part in each.studied)
    variants = (left - trainings * document.rounds.search) // (trainings + 1)
    goal = goal.model_copy(update={"confidence": 1 - (1 - goal.confidence) / (document.rounds.most + 1)})
    return _stage(flow, goal, function, seed=2 * number, variants=variants, name=f"verification {number + 1}")


def _search(flow: Flow, function: str, number: int) -> StudyDocument:
    variants = flow.document.rounds.search
    return _stage(flow, FindGoal(), function, seed=2 * number + 1, variants=variants, name=f"search {number + 1}")


def _stage(flow: Flow, goal: Goal, function: str, *, seed: int, variants: int, name: str) -> StudyDocument:
    document, spec, budget = flow.document, flow.document.spec, flow.document.budget
    hours = None if budget.cpu_hours is None else budget.cpu_hours - _cpu_hours(flow)
    return document.model_copy(
        update={
            "spec": spec.model_copy(
                update={"name": f"{spec.name[:_NAME]}, {name}", "functions": (function,), "seed": spec.seed + seed}
            ),
            "goal": goal,
            "budget": Budget(variants=variants, cpu_hours=hours, deadline=budget.deadline),
            "batch": min(document.batch, variants),
        }
    )


def _spent(context: Context, flow: Flow) -> bool:
    budget = flow.document.budget
    with reading(context.engine) as connection:
        now = database_moment(connection)
    if budget.deadline is not None and now >= budget.deadline:
        return True
    return budget.cpu_hours is not None and _cpu_hours(flow) >= budget.cpu_hours


def _cpu_hours(flow: Flow) -> float:
    return sum(each.cpu_seconds for each in flow.rounds) / 3600


# -- the stages ------------------------------------------------------------------------------------------------------


def _studied(context: Context, document: StudyDocument, around: Surroundings) -> Studied:
    """Run a study to its end, or find it where it has ended already."""
    study = _known(context, document)
    study_id = commands.begin(context, document) if study is None else study.id
    if study is not None and study.state is StudyState.PAUSED:
        commands.resume(context, study_id)
    around.wait(study_id)
    with reading(context.engine) as connection:
        study, batches = studies.get(connection, study_id), studies.batches(connection, study_id)
        stored = [runs.get(connection, batch.run_id) for batch in batches if batch.run_id is not None]
    if study.state is not StudyState.FINISHED:
        raise Conflict(f"study {study_id} is {study.state}" + (f": {study.reason}" if study.reason else ""))
    frames = sum(run.progress.frames.fed for run in stored if run.progress is not None)
    return Studied(study, tuple(batches), frames)


def _known(context: Context, document: StudyDocument) -> StudyRow | None:
    asset = resolve_document(context, document).run.asset_digest
    with reading(context.engine) as connection:
        rows = studies.named(connection, document.name)
    same = (row for row in rows if (row.document.digest, row.asset_digest) == (document.digest, asset))
    return next((row for row in same if row.state is not StudyState.STOPPED), None)


def _weakness(context: Context, document: StudyDocument, now: Round) -> Weakness | None:
    """Return the rows of the round that speak against the function; None without any."""
    first, *further = (run_id for part in now.studied for run_id in part.run_ids)
    missed = parse_measure(document.measure).missed
    where = f"({document.where}) and {missed}" if document.where else missed
    try:
        return find_weakness(context, first, where, now.function, further=further)
    except InvalidInput as problem:
        if problem.field == "where":
            return None
        raise


def _trained(
    context: Context, document: StudyDocument, weakness: Weakness, number: int, around: Surroundings
) -> Trained:
    """Train and register the next version; equal trainings go on in the folder that they began."""
    settings = document.rounds.training
    settings = settings.model_copy(update={"seed": settings.seed + number})
    folder = around.trainings / training_folder(weakness, settings, weakness.next_name)
    meter = _Meter(folder / "cpu-seconds.json")

    def on_site(shard: Shard) -> None:
        meter.read()
        around.watcher.on_site(shard)

    def on_step(progress: TrainingProgress) -> None:
        meter.read()
        around.watcher.on_step(progress)

    retrained = retrain(
        weakness,
        folder / f"{weakness.next_name}.safetensors",
        settings,
        folder=folder,
        resources=around.resources,
        watcher=Watcher(on_site, on_step),
    )
    registered, _ = register_retrained(context, retrained, weakness.next_name)
    return Trained(
        registered.reference,
        weakness.where,
        str(weakness.region),
        weakness.selected,
        retrained.frames,
        retrained.drawn,
        retrained.steps,
        retrained.site_seeds,
        meter.total,
    )


class _Meter:
    """CPU time of this process and its children, added up in a file over all attempts at a training."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self.total = float(json.loads(file.read_bytes())) if file.is_file() else 0.0
        self._last = self._now()

    def read(self) -> None:
        """Add the time since the last reading."""
        now = self._now()
        self.total += now - self._last
        self._last = now
        draft = self._file.with_suffix(".new")
        draft.write_text(json.dumps(self.total))
        draft.replace(self._file)

    @staticmethod
    def _now() -> float:
        return sum(os.times()[:4])  # without the elapsed time
