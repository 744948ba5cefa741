"""Build the report of a validation flow from its stages and the stored products."""

from __future__ import annotations

from itertools import islice
from typing import Final

from valerie.pipeline.base.context import Context
from valerie.pipeline.control.studies.advancing import informed_pursuit
from valerie.pipeline.control.studies.reporting import decisive_pictures
from valerie.pipeline.control.studies.resolving import resolve_row
from valerie.pipeline.rounds.flow import Flow, FlowEnd, Round, Studied, Trained
from valerie.runs.moments import duration
from valerie.runs.study.study_document import StudyDocument, VerifyGoal
from valerie.studies.flow_report import FlowReport, ShownRound, ShownStage, StageState, build_flow_report
from valerie.studies.report import ShownPicture

#: Frames that are shown of a round, failures first.
_PICTURES: Final = 3
_ENDINGS: Final = {
    FlowEnd.MET: "The requirement is met.",
    FlowEnd.ROUNDS: "The requirement is {outcome} after the last version.",
    FlowEnd.BUDGET: "The requirement is {outcome}; the CPU hours or the time are spent.",
    FlowEnd.NO_FAILURE: "The requirement is {outcome}, and nothing that was seen speaks against the function.",
}


def flow_report(context: Context, flow: Flow) -> str:
    """Return the page of a flow, with what its stages found so far."""
    document = flow.document
    studied = [part for each in flow.rounds for part in each.studied]
    trained = [each.training for each in flow.rounds if each.training is not None]
    state = "The flow goes on." if flow.ending is None else _ENDINGS[flow.ending].format(outcome=flow.outcome)
    return build_flow_report(
        FlowReport(
            name=document.name,
            requirement=_requirement(document),
            state=state,
            going=flow.ending is None,
            rounds=tuple(_shown(context, flow, number) for number in range(len(flow.rounds))),
            totals=(
                f"{sum(part.variants for part in studied):,}",
                f"{sum(part.frames for part in studied):,}",
                f"{sum(part.frames for part in trained):,}",
                duration(sum(part.cpu_seconds for part in studied)),
                duration(sum(part.cpu_seconds for part in trained)),
            ),
            notes=_notes(document),
            document=document.to_yaml(),
            digest=document.digest,
        )
    )


def _requirement(document: StudyDocument) -> str:
    goal = document.goal
    assert isinstance(goal, VerifyGoal), "a flow verifies"
    rows = f", over the rows with {document.where}" if document.where else ""
    if goal.share is None:
        return f"On the mean of the variants: {document.measure}{rows}."
    return f"At least {100 * goal.share:g} % of the variants have {document.measure}{rows}."


def _notes(document: StudyDocument) -> tuple[str, ...]:
    goal = document.goal
    assert isinstance(goal, VerifyGoal), "a flow verifies"
    verifications = document.rounds.most + 1
    return (
        f"Each of at most {verifications} verifications draws fresh variants and takes its share of the error (Bonferroni).",
        f"So all verdicts hold together with {100 * goal.confidence:g} %.",
        "Training pictures come from sites that no run and no earlier training used.",
        "CPU time is that of workers and of the training. Products that were there already cost nothing.",
    )


def _shown(context: Context, flow: Flow, number: int) -> ShownRound:
    now = flow.rounds[number]
    verified = now.verification
    trained = now.training
    return ShownRound(
        number=number + 1,
        function=now.function,
        stages=_stages(flow, now, last=number == len(flow.rounds) - 1),
        verdict="" if verified is None else verified.outcome,
        estimate="" if verified is None else _estimate(verified),
        variants=f"{sum(part.variants for part in now.studied):,}",
        frames=f"{sum(part.frames for part in now.studied):,}",
        training_frames="" if trained is None else f"{trained.frames:,}",
        cpu=(
            duration(sum(part.cpu_seconds for part in now.studied)),
            "" if trained is None else duration(trained.cpu_seconds),
        ),
        pictures=_pictures(context, now),
    )


def _stages(flow: Flow, now: Round, *, last: bool) -> tuple[ShownStage, ...]:
    facts = (
        ("Verify", None if now.verification is None else _verified(now.verification)),
        ("Find failures", None if now.search is None else _searched(now.search)),
        ("Train", None if now.training is None else _trained(now.training)),
    )
    stages: list[ShownStage] = []
    working = last and flow.ending is None
    for name, known_facts in facts:
        if known_facts is not None:
            stages.append(ShownStage(name, StageState.DONE, known_facts))
        elif flow.ending is not None:
            break
        else:
            stages.append(ShownStage(name, StageState.WORKING if working else StageState.OPEN))
            working = False
    return tuple(stages)


def _estimate(verified: Studied) -> str:
    result = verified.study.result
    estimate = None if result is None else result.numbers["estimate"]
    return f"{estimate:.3f}" if isinstance(estimate, float) else ""


def _verified(verified: Studied) -> tuple[str, ...]:
    return (f"{verified.variants:,} variants: {verified.outcome}.", f"Study {verified.study.id}.")


def _searched(searched: Studied) -> tuple[str, ...]:
    result = searched.study.result
    sentence = () if result is None else result.sentences[:1]
    return (f"{searched.variants:,} variants.", *sentence, f"Study {searched.study.id}.")


def _trained(trained: Trained) -> tuple[str, ...]:
    first, last = trained.site_seeds
    sites = f"site {first}" if first == last else f"sites {first}–{last}"
    return (
        f"{trained.selected:,} rows with {trained.where}; region: {trained.region or 'everywhere'}.",
        f"{trained.frames:,} images of {trained.drawn:,} scenes on {sites}, {trained.steps:,} steps.",
        f"Registered as {trained.reference}.",
    )


def _pictures(context: Context, now: Round) -> tuple[ShownPicture, ...]:
    for part in reversed(now.studied):
        pursuit = informed_pursuit(resolve_row(context, part.study), part.batches)
        pictures = tuple(islice(decisive_pictures(context, pursuit, part.batches), _PICTURES))
        if pictures:
            return pictures
    return ()
