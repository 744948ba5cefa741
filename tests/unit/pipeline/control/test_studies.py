"""Studies end to end with the blank engine, calm and killed at their writes."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from html import escape, unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie import entry_points
from valerie.db import runs, studies
from valerie.db.engine import reading
from valerie.db.studies import BatchRow, StudyRow
from valerie.entry_points import EntryPoint
from valerie.errors import Conflict, InvalidInput, RenderingError
from valerie.guided.domain import Cube
from valerie.guided.estimate import Estimate
from valerie.guided.strategy import OpenBatches, Proposal, Reason, Result
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.pipeline.control import lifecycle
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.control.studies import advancing, commands
from valerie.pipeline.control.studies.reporting import outlook, report
from valerie.pipeline.control.studies.resolving import resolve_document
from valerie.pipeline.reading.selection import evaluated_persons
from valerie.pipeline.work import finish
from valerie.runs.moments import duration
from valerie.runs.products.states import RunState
from valerie.runs.study.study_document import Outcomes, PluginGoal, StudyState, parse_study
from valerie.studies import pursuit
from valerie.studies.boundary import CELLS
from valerie.studies.pursuit import Pursuit
from valerie.studies.report import StudyReport, build_report

#: Two batches.
SHORT = {"variants": 20}


class SmallEstimate(Estimate):
    """A pool of candidates that is quick to draw."""

    def __init__(self, domain: Cube, **arguments: Any) -> None:
        super().__init__(domain, **arguments, pool=300)


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    """A study reads rows; the reports of its runs and large pools are tested elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(finish, "write_results", lambda *_: None)
        patch.setattr(pursuit, "Estimate", SmallEstimate)
        yield


@pytest.fixture(scope="module")
def calm(quick: None, tmp_path_factory: pytest.TempPathFactory, assets: Path) -> tuple[Pipeline, str]:
    """A study that nothing disturbed."""
    pipeline = Pipeline(tmp_path_factory.mktemp("calm"), assets)
    pursue(pipeline, study := begin(pipeline))
    return pipeline, study


def document(**more: Any) -> dict[str, Any]:
    """A study over the street of boxes; about half of its variants fail, and a third stands in the house."""
    vary = [["person-1.pos.x", "UNIFORM", -3, 3], ["person-1.pos.y", "UNIFORM", 3, 9]]
    study = {
        "constraints": ["person-1.pos.x < 1 or person-1.pos.y < 6"],
        "measure": "min(pacc) >= 0.5",
        "goal": {"name": "estimate", "first": 20},
        "budget": {"variants": 34},
        "batch": 10,
    }
    return spec(vary=vary, **study) | more


def begin(pipeline: Pipeline, **more: Any) -> str:
    return commands.begin(pipeline.context, parse_study(document(**more)))


def row(pipeline: Pipeline, study: str) -> StudyRow:
    with reading(pipeline.context.engine) as connection:
        return studies.get(connection, study)


def batches(pipeline: Pipeline, study: str) -> list[BatchRow]:
    with reading(pipeline.context.engine) as connection:
        return studies.batches(connection, study)


def history(pipeline: Pipeline, study: str) -> list[tuple[Any, ...]]:
    """All that a study decided, without times and the ids of its runs."""
    return [
        (b.number, b.count, b.points, b.rejected, b.reason, b.basis, b.based_on, b.outcomes)
        for b in batches(pipeline, study)
    ]


def pursue(pipeline: Pipeline, study: str, *, until: Callable[[], bool] = lambda: False) -> StudyRow:
    latest = time.monotonic() + 300
    while time.monotonic() < latest:
        pipeline.step()
        if row(pipeline, study).state is not StudyState.RUNNING or until():
            return row(pipeline, study)
    raise AssertionError(f"still {row(pipeline, study)}")


def test_a_study_spends_its_budget_in_runs_and_knows_a_rate(calm: tuple[Pipeline, str]) -> None:
    pipeline, study = calm
    ended = row(pipeline, study)
    assert (ended.state, ended.reason) == (StudyState.FINISHED, "the budget of 34 variants is spent")
    known = batches(pipeline, study)
    assert [(b.count, len(b.points), b.based_on) for b in known] == [
        (10, 10, 0), (10, 10, 0), (10, 0, 1), (10, 10, 2), (4, 4, 3),
    ]  # fmt: skip
    assert all(not b.rejected for b in known)
    with reading(pipeline.context.engine) as connection:
        children = [runs.get(connection, b.run_id) for b in known if b.run_id]
    assert [(r.iteration, r.rejected_count, r.variant_count) for r in children] == [
        (0, 0, 10), (1, 0, 10), (3, 0, 10), (4, 0, 4),
    ]  # fmt: skip
    assert [r.parent_run for r in children[1:]] == [r.id for r in children[:-1]]
    scores = [score for b in known if b.outcomes for score in b.outcomes.scores]
    assert set(scores) == {0.0, 1.0}
    assert ended.result is not None
    free: Any = ended.result.numbers["assumption_free"]
    operational = [b.outcomes.scores[:n] for b, n in zip(known, (10, 10, 0, 5, 2), strict=True) if b.outcomes]
    failed = [score == 0.0 for part in operational for score in part]
    assert free["estimate"] == pytest.approx(sum(failed) / len(failed))
    assert free["units"] == 27


def test_the_next_batch_is_proposed_while_one_is_in_work(pipeline: Pipeline) -> None:
    study = begin(pipeline)
    pipeline.loop.tick(everything=True)
    assert [b.run_id is not None for b in batches(pipeline, study)] == [True, True]
    pipeline.loop.tick(everything=True)
    assert len(batches(pipeline, study)) == 2


class Killed(BaseException):
    """The process ends here."""


def test_a_study_killed_at_its_writes_decides_what_the_calm_one_does(
    calm: tuple[Pipeline, str], pipeline: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = begin(pipeline)
    chance = np.random.default_rng(0)
    deaths = []

    def deadly(module: Any, name: str) -> None:
        real = getattr(module, name)

        def call(*arguments: Any, **keywords: Any) -> Any:
            # Before it is committed; the next process repeats it. The first call of each always dies.
            if name not in deaths or chance.random() < 0.4:
                deaths.append(name)
                raise Killed
            return real(*arguments, **keywords)

        monkeypatch.setattr(module, name, call)

    for name in ("set_run", "propose", "end", "set_values"):
        deadly(studies, name)
    latest = time.monotonic() + 300
    while row(pipeline, study).state is StudyState.RUNNING and time.monotonic() < latest:
        try:
            pipeline.step()
        except Killed:
            # Another process goes on: messages of the broker are lost, and nothing is in memory.
            pipeline.loop = ControlLoop(pipeline.context)
            pipeline.broker.ready.clear()
    assert row(pipeline, study).state is StudyState.FINISHED
    assert history(pipeline, study) == history(*calm)
    assert row(pipeline, study).result == row(*calm).result
    assert {"set_run", "propose", "end", "set_values"} <= set(deaths)
    with reading(pipeline.context.engine) as connection:
        assert len(runs.page(connection, limit=100)) == 4


def test_products_that_fail_are_tried_again_and_are_no_outcomes(calm: tuple[Pipeline, str], pipeline: Pipeline) -> None:
    study = begin(pipeline)
    broken: set[str] = set()

    def refuse_once(job: Any) -> None:
        if job.kind == "layer" and job.digest not in broken and len(broken) < 5:
            broken.add(job.digest)
            raise RenderingError("the image is constant")

    pipeline.makers["render"].before = refuse_once
    assert pursue(pipeline, study).state is StudyState.FINISHED
    assert len(broken) == 5
    assert history(pipeline, study) == history(*calm)


def test_what_fails_for_good_pauses_the_study_until_a_person_resumes_it(pipeline: Pipeline) -> None:
    study = begin(pipeline, budget=SHORT)

    def refuse(job: Any) -> None:
        if job.kind == "layer":
            raise RenderingError("the image is constant")

    pipeline.makers["render"].before = refuse
    paused = pursue(pipeline, study)
    assert paused.state is StudyState.PAUSED
    assert "retried 3 times" in (paused.reason or "")
    pipeline.makers["render"].before = lambda _job: None
    commands.resume(pipeline.context, study)
    assert pursue(pipeline, study).state is StudyState.FINISHED


def test_a_cancelled_run_pauses_the_study(pipeline: Pipeline) -> None:
    study = begin(pipeline, budget=SHORT)
    pipeline.loop.tick(everything=True)
    run = batches(pipeline, study)[0].run_id
    assert run is not None
    lifecycle.cancel(pipeline.context, run)
    paused = pursue(pipeline, study)
    assert (paused.state, paused.reason) == (StudyState.PAUSED, f"run {run} of batch 1 is cancelled")
    commands.resume(pipeline.context, study)
    assert pursue(pipeline, study).state is StudyState.FINISHED


def test_a_study_whose_batch_would_wait_for_ever_is_refused(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines(max_owner_variants=7)
    study = parse_study(document(budget=SHORT, batch=8))
    with pytest.raises(InvalidInput, match=r"batch: .*Eve may have unfinished.*got 8.*7 variants"):
        commands.begin(pipeline.context, study, owner="Eve")
    commands.begin(pipeline.context, study)


def test_a_study_whose_owner_has_no_room_waits_until_there_is(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines(max_owner_runs=1)
    other = pipeline.submit(owner="Eve")
    study = commands.begin(pipeline.context, parse_study(document(budget=SHORT)), owner="Eve")
    pipeline.loop.tick(everything=True)
    waiting = row(pipeline, study)
    assert (waiting.state, waiting.reason) == (StudyState.RUNNING, "Eve would have 2 unfinished runs; limit: 1")
    lifecycle.cancel(pipeline.context, other)
    pipeline.loop.tick(everything=True)
    first = batches(pipeline, study)[0].run_id
    assert first is not None
    assert pipeline.row(first).owner == "Eve"
    assert pursue(pipeline, study).state is StudyState.FINISHED


def test_by_hand_a_batch_waits_and_may_get_another_size(pipeline: Pipeline) -> None:
    study = begin(pipeline, mode="by hand", budget=SHORT)
    pipeline.step()
    pipeline.step()
    (waiting,) = batches(pipeline, study)
    assert waiting.run_id is None
    assert row(pipeline, study).reason == "batch 1 is proposed: accept it"
    proposed = commands.next_batch(pipeline.context, study)
    assert (proposed.legal, proposed.accepted, proposed.plan.frames) == (10, False, 20)
    with pytest.raises(InvalidInput, match="count"):
        commands.accept(pipeline.context, study, count=21)
    commands.accept(pipeline.context, study, count=16)
    with pytest.raises(Conflict, match="no proposal"):
        commands.accept(pipeline.context, study)
    pursue(pipeline, study, until=lambda: len(batches(pipeline, study)) == 2)
    assert [len(b.points) for b in batches(pipeline, study)] == [16, 4]
    commands.set_mode(pipeline.context, study, by_hand=False)
    assert pursue(pipeline, study).state is StudyState.FINISHED


def test_a_stopped_study_keeps_what_is_known_and_cancels_its_runs(pipeline: Pipeline) -> None:
    study = begin(pipeline)
    pursue(pipeline, study, until=lambda: sum(b.outcomes is not None for b in batches(pipeline, study)) == 2)
    pipeline.loop.tick(everything=True)
    commands.stop(pipeline.context, study)
    ended = row(pipeline, study)
    assert ended.state is StudyState.STOPPED
    assert ended.result is not None
    assert ended.result.numbers["evaluations"] == 20
    open_runs = [b.run_id for b in batches(pipeline, study) if b.run_id and b.outcomes is None]
    assert {pipeline.state(run) for run in open_runs} == {RunState.CANCELLED}


def test_a_stop_rule_ends_the_study_and_widens_the_interval_for_its_looks(pipeline: Pipeline) -> None:
    study = begin(pipeline, stop={"width": 0.9})
    ended = pursue(pipeline, study)
    assert ended.state is StudyState.FINISHED
    assert "0.9 was requested" in (ended.reason or "")
    assert ended.result is not None
    free: Any = ended.result.numbers["assumption_free"]
    assert free["level"] == pytest.approx(1 - 0.05 / 3)
    assert len(batches(pipeline, study)) < 5


def test_a_stop_rule_keeps_the_planned_sizes_of_batches(pipeline: Pipeline) -> None:
    study = begin(pipeline, stop={"width": 0.1}, mode="by hand")
    pipeline.step()
    with pytest.raises(InvalidInput, match=r"count: the stop rule.*planned.*got 5"):
        commands.accept(pipeline.context, study, count=5)
    assert commands.accept(pipeline.context, study, count=10) == 0


def test_explain_ends_with_a_pair_whose_variants_were_run(pipeline: Pipeline) -> None:
    study = begin(pipeline, goal="explain", batch=6, budget={"variants": 200})
    ended = pursue(pipeline, study)
    assert (ended.state, ended.reason) == (StudyState.FINISHED, "The pair is minimal.")
    assert ended.result is not None
    assert "verdict flips" in ended.result.sentences[0]
    places = advancing.informed_pursuit(
        advancing.resolve_row(pipeline.context, ended), batches(pipeline, study)
    ).decisive()
    scores = {}
    for number, index, words in places:
        outcomes = batches(pipeline, study)[number].outcomes
        assert outcomes is not None
        scores[words] = outcomes.scores[index]
    assert scores["It fails"] == 0.0
    assert scores["It passes"] == 1.0
    number, index, _ = places[0]
    run = batches(pipeline, study)[number].run_id
    assert run is not None
    with reading(pipeline.context.engine) as connection:
        stored = resolve_stored(runs.get(connection, run), pipeline.context.settings)
        persons = [p.row for p in evaluated_persons(connection, stored) if p.frame.variant == index]
    missed = [row for row in persons if row["pacc"] == 0.0]
    page = unescape(report(pipeline.context, study))
    said = re.search(r"When it fails, (.*) is (\S+) m away, (\S+) % hidden \((.*)\)\.", page)
    assert said is not None
    assert said.groups() in [
        (r["character"] or "the person", f"{r['distance_m']:.3g}", f"{100 * r['occlusion_rate']:.3g}", r["camera"])
        for r in missed
    ]
    assert "Difference, camera-1" in page
    assert "<td>person-1.pos.y</td><td>uniform</td><td>3 to 9 m, median 6 m</td>" in page
    assert "<td>Render engine</td><td>blank</td>" in page
    assert re.search(r"Absolute difference of the failing and the passing picture, \S+ times as bright", page)
    lifecycle.delete(pipeline.context, run)
    assert "When it fails" not in report(pipeline.context, study)


def test_a_minimal_pair_says_by_how_much_each_number_changes(pipeline: Pipeline) -> None:
    vary: list[Any] = [["person-1.heading", "UNIFORM", 0, 360], ["person-1.pos.y", "UNIFORM", 3, 9]]
    vary.append(["person-1.pos.x", "UNIFORM", -3, 0])

    def turned(heading: Any, y: Any, x: Any) -> Any:
        return np.where((heading > 0.95) & (y < 0.5), 0.0, 1.0)

    pair = {"person-1.heading": 10.0, "person-1.pos.y": 8.0, "person-1.pos.x": -1.0}
    goal = {"name": "explain", "failing": {**pair, "person-1.heading": 350.0, "person-1.pos.y": 4.0}, "passing": pair}
    known = planted(pipeline, turned, vary=vary, goal=goal)[0].result()
    assert known is not None
    said = re.search(
        r"heading from 10 to (\S+) deg \(turned by (\S+) deg\) and person-1.pos.y from 8 to (\S+) m \((\S+) m less\), every",
        known.sentences[0],
    )
    assert said is not None
    heading, turn, y, less = map(float, said.groups())
    assert turn == pytest.approx(370 - heading, abs=0.1)
    assert less == pytest.approx(8 - y, abs=0.01)


def test_a_pair_that_does_not_fail_and_pass_ends_with_its_scores(pipeline: Pipeline) -> None:
    place = {"person-1.pos.x": 0.0, "person-1.pos.y": 4.0}
    study = begin(
        pipeline,
        goal={"name": "explain", "failing": place, "passing": {**place, "person-1.pos.y": 4.0}},
    )
    ended = pursue(pipeline, study)
    assert ended.state is StudyState.FINISHED
    assert "do not fail and pass" in (ended.reason or "")


def test_verify_ends_where_the_requirement_is_decided_and_is_reported(pipeline: Pipeline) -> None:
    study = begin(pipeline, goal={"name": "verify", "share": 0.95}, batch=8)
    ended = pursue(pipeline, study)
    assert (ended.state, ended.reason) == (StudyState.FINISHED, "The requirement is decided.")
    assert ended.result is not None
    assert ended.result.numbers["outcome"] == "not met"
    page = report(pipeline.context, study)
    assert "Is the requirement met?" in page
    assert escape(ended.result.sentences[0]) in page
    assert "<figcaption><b>It fails, " in page


@dataclass(frozen=True)
class Told:
    """A batch with planted scores."""

    count: int
    points: list[list[float]]
    outcomes: Outcomes


def planted(pipeline: Pipeline, score: Callable[..., Any], **more: Any) -> tuple[Pursuit, list[Told]]:
    """Take a study to its end with scores from the coordinates in the unit cube: (n,) each to (n,) or (2, n)."""
    vary = [["person-1.pos.x", "UNIFORM", -3, 0], ["person-1.pos.y", "UNIFORM", 3, 9]]  # beside the house
    ours = {"constraints": [], "vary": vary, "budget": {"variants": 260}, "batch": 20}
    parsed = parse_study(document(**{**ours, **more}))
    known, batches = Pursuit(resolve_document(pipeline.context, parsed)), list[Told]()
    while left := parsed.budget.variants - sum(len(batch.points) for batch in batches):
        proposal = known.ask(batches, min(parsed.batch, left))
        if not len(proposal) and not known.waits:
            break
        scored = np.atleast_2d(score(*proposal.points.T))
        columns = np.where(np.isnan(scored), None, scored).tolist()
        scores = Outcomes(scores=columns[0], second=columns[1] if len(columns) == 2 else ())
        batches.append(Told(parsed.batch, proposal.points.tolist(), scores))
    known.follow(batches, everything=True)
    return known, batches


def test_find_counts_modes_and_shows_a_variant_of_each(pipeline: Pipeline) -> None:
    def corners(x: Any, y: Any) -> Any:
        return np.clip(np.minimum(np.hypot(x, y), np.hypot(1 - x, 1 - y)) / 0.5, 0, 1)

    known, batches = planted(pipeline, corners, goal="find")
    result = known.result()
    assert result is not None
    assert len(result.numbers["modes"]) == 2  # type: ignore[arg-type]
    assert result.sentences[0] == f"2 modes in {result.numbers['failures']} repeated failures."
    assert any("every failure repeats" in sentence for sentence in result.sentences)
    noisy = planted(pipeline, corners, goal="find", sensors=[{"name": "noisy", "noise": {"shot": True}}])[0].result()
    assert noisy is not None
    assert not any("every failure repeats" in sentence for sentence in noisy.sentences)
    shown = {words: batches[number].outcomes.scores[index] for number, index, words in known.decisive()}
    assert list(shown) == ["Mode 1", "Mode 2"]
    assert all(score is not None and score < 0.5 for score in shown.values())


def test_map_draws_the_two_parameters_that_change_calls(pipeline: Pipeline) -> None:
    known, batches = planted(
        pipeline, lambda x, y: np.clip(1.3 * y - 0.2 * x, 0, 1), goal="map", budget={"variants": 150}
    )
    result = known.result()
    assert result is not None
    assert result.numbers["passing"] == pytest.approx(0.538, abs=0.03)
    assert result.sentences[0].startswith(f"pass: {100 * result.numbers['passing']:.1f} %, fail: ")  # type: ignore[operator]
    for number, index, words in known.decisive():
        assert words == "Next to the bound"
        assert batches[number].outcomes.scores[index] == pytest.approx(0.5, abs=0.05)
    drawn = known.boundary()
    assert drawn is not None
    assert drawn.names == ("person-1.pos.y", "person-1.pos.x")
    assert drawn.ends[0] == ("3 m", "9 m")
    sizes = {call: sum(width for *_, width, other in drawn.strips if other == call) for call in drawn.calls}
    assert sum(sizes.values()) == CELLS**2
    assert sizes["pass"] / CELLS**2 == pytest.approx(0.538, abs=0.05)
    texts = dict.fromkeys(("id", "name", "question", "state", "measure", "where", "document", "digest"), "text")
    page = build_report(
        StudyReport(
            **texts,
            ended=True,
            sentences=(),
            outlook="",
            boundary=drawn,
            pictures=(),
            batches=(),
            totals=(),
            domain=(),
            conditions=(),
            asset_digest="text",
        )
    )
    areas = re.findall(r'<rect x="\d+" y="\d+" width="(\d+)" height="1" fill="(#\w+)"', page)
    assert len({colour for _, colour in areas}) == len(drawn.calls)
    assert sum(int(width) for width, _ in areas) == CELLS**2
    assert {column >= CELLS // 2 for _, column, _, call in drawn.strips if call == "pass"} == {False, True}


def test_rank_names_the_parameter_that_matters_first(pipeline: Pipeline) -> None:
    known, _ = planted(pipeline, lambda x, y: 0.2 * x + 0.8 * y, goal="rank")
    result = known.result()
    assert result is not None
    assert result.sentences[0].startswith("person-1.pos.y: 9")
    assert result.numbers["blocks"] == (260 - 30) // 4
    shapley = {}
    for sentence in result.sentences[:2]:
        match = re.search(r"Shapley effect (\d+) % \((−?\d+) … (\d+)\)", sentence)
        assert match is not None
        shapley[sentence.partition(":")[0]] = (int(match[1]), int(match[2].replace("−", "-")), int(match[3]))
    for name, share in {"person-1.pos.x": 100 / 17, "person-1.pos.y": 1600 / 17}.items():  # of an additive score
        estimate, low, high = shapley[name]
        assert estimate == pytest.approx(share, abs=10)
        assert low < estimate < high


def test_rank_says_why_equal_scores_have_no_shares(pipeline: Pipeline) -> None:
    known, _ = planted(pipeline, lambda x, y: np.full(len(x), 0.9), goal="rank")
    result = known.result()
    assert result is not None
    assert (
        result.sentences[-1]
        == "Apart from at most one block, all scores are equal, so there are no shares of variance."
    )


def test_verify_bounds_the_mean_score_without_a_share(pipeline: Pipeline) -> None:
    known, _ = planted(pipeline, lambda x, y: np.full(len(x), 0.9), goal="verify")
    result = known.result()
    assert result is not None
    assert result.numbers["outcome"] == "met"
    assert "mean of min(pacc) over the variants is 0.900, at least 0.5 required" in result.sentences[0]
    assert "false verdict is at most 0.05" in result.sentences[1]


def test_a_measure_with_an_upper_bound_is_reported_as_the_measure_and_not_as_its_score(pipeline: Pipeline) -> None:
    more: dict[str, Any] = {"measure": "max(iou) <= 0.9"}
    known, _ = planted(pipeline, lambda x, y: np.full(len(x), 0.3), goal="verify", **more)
    result = known.result()
    assert result is not None
    assert result.sentences[0].startswith("Met: the mean of max(iou) over the variants is 0.700, at most 0.9 required")
    assert (result.numbers["estimate"], result.numbers["bound"]) == (pytest.approx(0.7), pytest.approx(0.9))
    functions = ["blank", "deeplabv3plus-small"]
    goal = {"name": "compare", "within": 0.05}
    known, _ = planted(
        pipeline, lambda x, y: np.stack([0.5 + 0.1 * y, 0.6 + 0.1 * y]), goal=goal, functions=functions, **more
    )
    result = known.result()
    assert result is not None
    assert result.numbers["estimate"] == pytest.approx(-0.1)
    assert ": -0.100 (-" in result.sentences[0]
    assert result.sentences[1] == "Better: deeplabv3plus-small."


def test_what_the_intervals_of_a_rate_hold_for_is_said(pipeline: Pipeline) -> None:
    def never(x: Any, y: Any) -> Any:
        return np.full(len(x), 0.9)

    goal = {"name": "estimate", "first": 100}
    sentences = planted(pipeline, never, goal=goal)[0].result().sentences  # type: ignore[union-attr]
    assert "95 % confidence), by 180 operational points" in sentences[0].replace(" fail, by", ", by")
    assert "do not use it: 0 failures at operational points of guided batches cannot show" in sentences[1]
    assert "someone stops because of them" in sentences[-1]
    sentences = planted(pipeline, never, goal=goal, stop={"width": 0.001})[0].result().sentences  # type: ignore[union-attr]
    assert "99.44 % confidence" in sentences[0]
    assert "all planned looks" in sentences[-1]


def test_the_plan_of_a_batch_notes_units_that_the_document_leaves_out(pipeline: Pipeline) -> None:
    def notes(start: object) -> tuple[str, ...]:
        vary = {"person-1.pos.x": {"uniform": {"from": start, "to": "0 m"}}}
        return commands.plan_study(pipeline.context, parse_study(document(vary=vary))).plan.notes

    assert notes("-3 m") == ()
    assert notes(-3) == ("person-1.pos.x: numbers without unit are in m",)


def test_a_rate_without_any_model_claims_no_help_of_a_model(pipeline: Pipeline) -> None:
    """Nineteen of the twenty first variants, and none of the last, have a score: too few for a model."""

    def rarely(x: Any, y: Any) -> Any:
        scores = np.full(len(x), np.nan)
        scores[: 19 if len(x) == 20 else 0] = 0.2
        return scores

    more: dict[str, Any] = {"goal": {"name": "estimate", "first": 20}, "budget": {"variants": 40}, "batch": 32}
    result = planted(pipeline, rarely, **more)[0].result()
    assert result is not None
    assert "fail, by 40 operational points alone" in result.sentences[0]
    assert result.sentences[1] == "No batch had enough scores for a model."
    assert not any("model's help" in sentence for sentence in result.sentences)


def test_a_small_estimate_gets_its_model_though_some_scores_are_undefined(pipeline: Pipeline) -> None:
    def mostly(x: Any, y: Any) -> Any:
        return np.where(np.arange(len(x)) < 4, np.nan, x)

    result = planted(pipeline, mostly, goal="estimate", budget={"variants": 64}, batch=64)[0].result()
    assert result is not None
    assert result.numbers["assisted"] is not None


def test_an_undecided_study_expects_further_variants_from_its_scores(pipeline: Pipeline) -> None:
    def close(x: Any, y: Any) -> Any:
        return np.where(x < 0.25, np.nan, np.where(y < 0.45, 0.0, 1.0))

    known = planted(pipeline, close, goal="verify")[0].result()
    assert known is not None
    numbers: Any = known.numbers
    assert numbers["outcome"] == "undecided"
    assert known.further == pytest.approx(numbers["further"] * 260 / (260 - numbers["undefined"]), abs=1)
    functions = ["blank", "deeplabv3plus-small"]
    goal = {"name": "compare", "within": 0.02}
    known = planted(pipeline, lambda x, y: np.stack([0.5 * x, 0.5 * y]), goal=goal, functions=functions)[0].result()
    assert known is not None
    numbers = known.numbers
    assert known.further == pytest.approx(260 * ((numbers["half_width"] / 0.02) ** 2 - 1), abs=1)
    assert "holds nearly when the study ends by itself, at ± 0.02" in known.sentences[-1]
    assert "which function is better holds at any time" in known.sentences[-1]
    known = planted(pipeline, close, goal={"name": "estimate", "first": 100}, stop={"width": 0.05})[0].result()
    assert known is not None
    free: Any = known.numbers["assumption_free"]
    assert known.further == pytest.approx(260 * (((free["high"] - free["low"]) / 0.05) ** 2 - 1), abs=1)
    assert planted(pipeline, close, goal="estimate")[0].result().further is None  # type: ignore[union-attr]


def test_what_an_undecided_study_lacks_is_priced_at_the_mean_of_its_variants(pipeline: Pipeline) -> None:
    study = begin(pipeline, goal={"name": "verify", "share": 0.4}, budget=SHORT)
    ended = pursue(pipeline, study)
    assert ended.result is not None
    further = ended.result.further
    assert further is not None
    done = batches(pipeline, study)
    seconds = sum(batch.cpu_seconds or 0.0 for batch in done) * further / sum(batch.legal for batch in done)
    words = f"About {further:,} further variants, {duration(seconds)} of CPU time, are expected to reach the goal"
    assert outlook(ended, done, ended.result) == f"{words}; the budget has 0 left."
    assert words in report(pipeline.context, study)
    free = [replace(batch, cpu_seconds=0.0) for batch in done]
    assert "CPU" not in (outlook(ended, free, ended.result) or "")


def test_compare_takes_the_scores_of_two_functions_in_their_order(pipeline: Pipeline) -> None:
    functions = ["blank", "deeplabv3plus-small"]
    known, batches = planted(
        pipeline,
        lambda x, y: np.stack([0.8 * y, 0.8 * y + 0.2 * x]),
        goal={"name": "compare", "within": 0.05},
        functions=functions,
    )
    result = known.result()
    assert result is not None
    assert result.numbers["estimate"] == pytest.approx(0.1, abs=0.03)
    assert "Better: deeplabv3plus-small." in result.sentences
    number, index, words = known.decisive()[0]
    assert words == "deeplabv3plus-small does better"
    first, second = batches[number].outcomes.by_variant[index]
    assert first is not None
    assert second is not None
    assert second - first > 0.15
    rows = [
        {"variant_index": 0, "frame_id": "r-000000-0", "sensor": "", "function": function, "pacc": value}
        for function, value in zip(reversed(functions), (0.25, 0.75), strict=True)
    ]
    outcomes = known.study.outcomes(rows, 2, (), 0.0)
    assert outcomes.by_variant == [(0.75, 0.25), (None, None)]


@dataclass(frozen=True)
class Lowest(Result):
    """The result of a strategy of another package."""

    lowest: float


class Line:
    """A strategy of another package: points on a line, from the place that it is told to begin at."""

    def __init__(self, domain: Cube, *, at_least: float, seed: int, begin: float = 0.0) -> None:
        del at_least, seed
        self.domain, self.next, self.open = domain, begin, OpenBatches()
        self.result: Lowest | None = None

    def ask(self, count: int) -> Proposal:
        places = self.next + 0.01 * np.arange(count)
        self.next += 0.01 * count
        return self.open.add(np.column_stack([places] * self.domain.dimensions), Reason("line", {"points": count}))

    def tell(self, points: Any, scores: Any) -> None:
        self.result = Lowest(float(np.nanmin(self.open.close(points, scores))))


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> None:
    """The package ``lines`` offers the strategy ``line``."""
    offers = (EntryPoint("line", f"{__name__}:Line", "lines"), EntryPoint("map", f"{__name__}:Line", "lines"))
    installed = entry_points.installed
    monkeypatch.setattr(entry_points, "installed", lambda g: offers if g == "valerie.strategies" else installed(g))
    monkeypatch.setenv("VALERIE_PLUGINS", "lines")


def test_a_strategy_of_another_package_is_pursued(pipeline: Pipeline, plugged: None) -> None:
    study = begin(pipeline, goal={"name": "line", "options": {"begin": 0.2}}, budget=SHORT)
    ended = pursue(pipeline, study)
    assert ended.reason == "the budget of 20 variants is spent"
    first, second = batches(pipeline, study)
    assert [point[0] for point in (*first.points, *second.points)] == pytest.approx([0.2 + 0.01 * i for i in range(20)])
    assert first.reason == "line: points 10."
    assert ended.result is not None
    assert (ended.result.sentences, ended.result.numbers) == (("Lowest: 0.",), {"lowest": 0.0})
    assert parse_study(ended.document.to_yaml()) == ended.document
    assert "What does the strategy of another package find?" in report(pipeline.context, study)


def test_a_strategy_of_another_package_that_is_gone_or_leaves_the_cube_pauses_its_study(
    pipeline: Pipeline, plugged: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    outside = begin(pipeline, goal={"name": "line", "options": {"begin": 0.85}}, budget=SHORT)
    paused = pursue(pipeline, outside)
    assert paused.state is StudyState.PAUSED
    assert "outside the unit cube" in (paused.reason or "")
    study = begin(pipeline, goal="line", budget=SHORT)
    monkeypatch.setenv("VALERIE_PLUGINS", "")
    monkeypatch.setattr(entry_points, "installed", lambda _: ())
    paused = pursue(pipeline, study)
    assert paused.state is StudyState.PAUSED
    assert "line" in (paused.reason or "")


def test_a_strategy_that_is_not_allowed_or_refuses_its_options_is_refused(
    pipeline: Pipeline, plugged: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InvalidInput, match=r"goal\.options: the strategy line refuses them: .*'end'"):
        begin(pipeline, goal={"name": "line", "options": {"end": 1}})
    assert not isinstance(parse_study(document(goal="map", budget={"variants": 200})).goal, PluginGoal)
    monkeypatch.setenv("VALERIE_PLUGINS", "")
    with pytest.raises(InvalidInput, match="offered by the package lines, which VALERIE_PLUGINS does not name"):
        begin(pipeline, goal="line")


@pytest.mark.parametrize(
    ("change", "limit"),
    [
        ({"goal": "estimate", "budget": {"variants": 23}}, ">= 24"),
        ({"goal": "map"}, ">= 64"),
        ({"goal": "rank", "budget": {"variants": 29}}, ">= 30"),
        ({"goal": {"name": "compare", "within": 0.1}, "functions": ["blank", "deeplabv3plus-small"]}, ">= 50"),
    ],
)
def test_a_budget_without_any_answer_is_refused(pipeline: Pipeline, change: dict[str, Any], limit: str) -> None:
    with pytest.raises(InvalidInput, match=f"budget.variants: .*{limit}"):
        begin(pipeline, **change)


def test_the_runs_of_a_study_have_its_deadline(pipeline: Pipeline) -> None:
    study = begin(pipeline, budget=SHORT | {"deadline": "2999-12-01T06:00Z"})
    pursue(pipeline, study, until=lambda: any(batch.run_id for batch in batches(pipeline, study)))
    ids = [batch.run_id for batch in batches(pipeline, study) if batch.run_id]
    assert {pipeline.row(run_id).deadline for run_id in ids} == {datetime(2999, 12, 1, 6, tzinfo=UTC)}
