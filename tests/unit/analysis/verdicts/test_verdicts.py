"""Verdicts on planted tables: by hand, by scipy, and by the tests that they are built on."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np
import pyarrow.csv
import pytest
from scipy.stats import binomtest

from tests.planted_tables import X, drawn, drawn_space, planted_table, requirement
from valerie.analysis.rows.design import Design
from valerie.analysis.verdicts.text import notes, sentence
from valerie.analysis.verdicts.verdicts import RequirementVerdict, judge_requirements, verdict_table
from valerie.plain import typed
from valerie.statistics.verdicts import Basis, Outcome, judge_sample

NAN = float("nan")


def judged(
    statistic: str, table: Any, space: Any, *, lost: Any = (), fields: Any = (), **rest: Any
) -> RequirementVerdict:
    (verdict,) = judge_requirements([requirement(statistic, **dict(fields))], table, space, lost=lost, **rest)
    return verdict


def lost_row(variant: int, **values: Any) -> dict[str, Any]:
    unknown = dict.fromkeys(("undefined_reason", "pixel_area", "distance_m", "instance_id"))
    row = {"variant_index": variant, "frame_id": f"planted.{variant}.0.0", "function": "net", "sensor": "default"}
    return {**unknown, **row, **values}


@pytest.mark.parametrize(
    ("statistic", "estimate", "outcome"),
    [
        ("mean(pacc) >= 0.55", 0.55, Outcome.MET),
        ("mean(pacc) >= 0.551", 0.55, Outcome.NOT_MET),
        ("mean(pacc) <= 0.55", 0.55, Outcome.MET),
        ("mean(pacc) <= 0.549", 0.55, Outcome.NOT_MET),
        ("share(pacc >= 0.5) >= 75 %", 0.75, Outcome.MET),
        ("share(pacc >= 0.51) >= 75 %", 0.5, Outcome.NOT_MET),
        ("share(fn <= 600) >= 0.75", 0.75, Outcome.MET),
        ("quantile(pacc, 0.25) >= 0.5", 0.75, Outcome.MET),
        ("quantile(fn, 0.75) <= 500", 0.75, Outcome.MET),
        ("quantile(fn, 0.75) <= 499", 0.5, Outcome.NOT_MET),
    ],
)
def test_a_listed_grid_is_counted_and_speaks_of_itself(statistic: str, estimate: float, outcome: Outcome) -> None:
    table = planted_table([0.1, 0.5, 0.7, 0.9], [0, 1, 2, 3])
    verdict = judged(statistic, table, drawn("points", 4))
    assert verdict.outcome is outcome
    assert verdict.estimate == pytest.approx(estimate)
    assert (verdict.basis, verdict.rows, verdict.units, verdict.further) == (Basis.GRID, 4, 4, None)
    assert "the listed grid" in " ".join(notes(verdict))


def test_a_random_design_is_judged_variant_by_variant_in_the_order_of_drawing() -> None:
    rng = np.random.default_rng(0)
    shares = rng.beta(8, 2, (400, 1))
    passed = rng.random((400, 6)) < shares
    variants = np.repeat(np.arange(400), 6)
    shuffled = rng.permutation(2400)
    table = planted_table(np.where(passed, 0.9, 0.1).ravel()[shuffled], variants[shuffled])
    verdict = judged("share(pacc >= 0.5) >= 0.7", table, drawn("random", 400))
    expected = judge_sample(passed.ravel(), variants, at_least=0.7)
    assert verdict.outcome is expected.outcome is Outcome.MET
    assert (verdict.decided_after, verdict.units, verdict.rows) == (expected.decided_after, 400, 2400)
    assert verdict.estimate == pytest.approx(passed.mean())
    assert verdict.basis is Basis.SAMPLE
    # Rows taken as independent would be sure of a bound that variants leave open.
    bound = float(np.floor(100 * passed.mean()) / 100) - 0.02
    assert binomtest(int(passed.sum()), 2400, bound, alternative="greater").pvalue < 0.025
    tight = judged(f"share(pacc >= 0.5) >= {bound}", table, drawn("random", 400))
    assert tight.outcome is Outcome.UNDECIDED
    assert f"about {tight.further:,} more would decide it" in sentence(tight)


def test_a_smaller_random_run_is_undecided_and_says_how_many_variants_more_it_takes() -> None:
    scores = np.tile([0.9] * 9 + [0.1], 12)
    verdict = judged("share(pacc >= 0.5) >= 0.95", planted_table(scores, np.arange(120)), drawn("random", 120))
    assert verdict.outcome is Outcome.UNDECIDED
    assert verdict.further is not None
    more = np.tile(scores, 30)
    longer = judged("share(pacc >= 0.5) >= 0.95", planted_table(more, np.arange(3600)), drawn("random", 3600))
    assert longer.decided_after is not None
    assert longer.decided_after - 120 == pytest.approx(verdict.further, abs=40)


@pytest.mark.parametrize("design", ["sobol", "halton", "latin_hypercube"])
def test_an_even_design_is_judged_by_its_replicates_at_its_number_of_variants(design: str) -> None:
    space, design_of_run = drawn_space(design, 256), drawn(design, 256)
    x = np.array([space[i].values[X] for i in range(256)], float)
    table = planted_table(np.where(x < 900, 0.9, 0.1), np.arange(256))
    # Nine tenths pass: the replicates know that to better than 3 points.
    for bound, outcome in ((0.85, Outcome.MET), (0.9, Outcome.UNDECIDED), (0.95, Outcome.NOT_MET)):
        verdict = judged(f"share(pacc >= 0.5) >= {bound}", table, design_of_run)
        assert (verdict.outcome, verdict.decided_after) == (outcome, None)
        assert "8 replicates" in verdict.method
        assert "at this number of variants" in verdict.method
    few = judged("mean(pacc) >= 0.5", planted_table(np.full(16, 0.9), np.arange(16)), drawn(design, 16))
    assert "sequential" in few.method  # so few points are independent


def test_a_region_over_several_blocks_that_draw_is_not_judged_and_one_block_of_it_is() -> None:
    space = Design((("random", 60), ("points", 2)))
    table = planted_table(np.full(62, 0.9), np.arange(62))
    verdict = judged("mean(pacc) >= 0.5", table, space)
    assert (verdict.outcome, verdict.basis, verdict.estimate) == (Outcome.UNDECIDED, None, None)
    assert "several blocks" in verdict.reason
    for first, last, basis in ((0, 60, Basis.SAMPLE), (60, 62, Basis.GRID)):
        region = (np.arange(62) >= first) & (np.arange(62) < last)
        judgement = judged("mean(pacc) >= 0.5", table, space, regions={"R": region})
        assert (judgement.outcome, judgement.basis) == (Outcome.MET, basis)


def test_rows_without_a_value_are_outside_and_counted_by_reason() -> None:
    table = planted_table(
        [0.9, NAN, NAN, 0.9, 0.1, NAN], [0, 1, 2, 3, 4, 5],
        undefined_reason=[None, "fully hidden", "outside the image", None, None, "absent"],
        pixel_area=[1000, 0, 0, 1000, 20, 0],
    )  # fmt: skip
    verdict = judged("share(pacc >= 0.5) >= 1", table, drawn("points", 6), fields={"min_visible_pixels": 21})
    assert verdict.outcome is Outcome.MET
    assert verdict.undefined == {"fully hidden": 1, "outside the image": 1}
    assert (verdict.rows, verdict.too_small) == (2, 1)
    assert judged("share(pacc >= 0.5) >= 1", table, drawn("points", 6)).outcome is Outcome.NOT_MET


@pytest.mark.parametrize(
    ("passing", "failing", "lost", "outcome"),
    [
        (90, 10, 0, Outcome.MET),
        (90, 0, 10, Outcome.MET),
        (89, 0, 11, Outcome.UNDECIDED),
        (0, 10, 90, Outcome.UNDECIDED),
        (0, 11, 89, Outcome.NOT_MET),
    ],
)
def test_what_failed_counts_at_its_worst_on_a_grid(passing: int, failing: int, lost: int, outcome: Outcome) -> None:
    table = planted_table([0.8] * passing + [0.2] * failing, np.arange(passing + failing))
    rows = [lost_row(passing + failing + i) for i in range(lost)]
    verdict = judged("share(pacc >= 0.5) >= 0.9", table, drawn("points", 100), lost=rows)
    assert (verdict.outcome, verdict.lost) == (outcome, lost)
    assert verdict.further == (lost if outcome is Outcome.UNDECIDED else None)
    if lost:
        assert verdict.worst == pytest.approx(passing / 100)
        assert verdict.best == pytest.approx((passing + lost) / 100)


@pytest.mark.parametrize("failed", [0.1, 0.9])
def test_what_failed_cannot_turn_a_verdict_on_a_sample(failed: float) -> None:
    """Whatever the lost rows would have been, the verdict with them missing is theirs or undecided."""
    rng = np.random.default_rng(1)
    for share in (0.75, 0.85, 0.95, 0.99):
        scores = np.where(rng.random(300) < share, 0.9, 0.1)
        gone = rng.random(300) < 0.03
        rows = [lost_row(i) for i in np.flatnonzero(gone).tolist()]
        part = judged(
            "share(pacc >= 0.5) >= 0.9", planted_table(scores[~gone], np.flatnonzero(~gone)),
            drawn("random", 300), lost=rows,
        )  # fmt: skip
        whole = planted_table(np.where(gone, failed, scores), np.arange(300))
        full = judged("share(pacc >= 0.5) >= 0.9", whole, drawn("random", 300))
        assert part.outcome in (full.outcome, Outcome.UNDECIDED)


def test_rows_that_failed_count_only_where_they_may_lie_in_the_region() -> None:
    fields = {"where": f"distance_m <= 20 and {X} < 50", "min_visible_pixels": 30}
    table = planted_table([0.9], [0])
    rows = [
        lost_row(1, distance_m=None, **{X: 10.0}),  # may be near
        lost_row(2, distance_m=25.0, **{X: 10.0}),  # is far
        lost_row(3, distance_m=None, **{X: 60.0}),  # stands elsewhere
        lost_row(4, distance_m=5.0, pixel_area=29, **{X: 10.0}),  # is too small
        lost_row(5, distance_m=5.0, undefined_reason="fully hidden", **{X: 10.0}),  # has no pACC
        lost_row(6, distance_m=5.0, pixel_area=30, **{X: 10.0}),
        lost_row(7, distance_m=5.0, function="other", **{X: 10.0}),
    ]
    assert judged("mean(pacc) >= 0.5", table, drawn("points", 10), lost=rows, fields=fields).lost == 2


def test_scores_of_frames_count_each_frame_once() -> None:
    table = planted_table(
        [0.9, 0.8, 0.1, NAN], [0, 0, 1, 2], instance_id=[24001, 24002, 24001, 24001],
        iou=[0.8, 0.8, 0.2, NAN], undefined_reason=[None, None, None, "absent"],
    )  # fmt: skip
    verdict = judged("mean(iou) >= 0.5", table, drawn("points", 3))
    assert (verdict.outcome, verdict.estimate, verdict.rows, verdict.of) == (Outcome.MET, 0.5, 2, "frames")
    assert verdict.undefined == {"without IoU": 1}
    assert (verdict.missed, verdict.threshold) == ((), None)
    # Two persons of one frame that failed are one frame.
    rows = [lost_row(3, instance_id=24001), lost_row(3, instance_id=24002)]
    assert judged("mean(iou) >= 0.5", table, drawn("points", 4), lost=rows).lost == 1


def test_missed_persons_are_counted_by_distance() -> None:
    table = planted_table([0.9, 0.4, 0.2, 0.6], [0, 1, 2, 3], distance_m=[3.0, 4.9, 5.0, 29.0])
    verdict = judged("mean(pacc) >= 0.9", table, drawn("points", 4), threshold=0.5)
    assert [(b.low, b.high, b.persons, b.missed) for b in verdict.missed] == [
        (0, 5, 2, 1),
        (5, 10, 1, 1),
        (25, 30, 1, 0),
    ]
    stricter = judged("share(pacc >= 0.7) >= 0.9", table, drawn("points", 4))
    assert (stricter.threshold, sum(band.missed for band in stricter.missed)) == (0.7, 3)
    assert "1 of 2 at 0–5 m, 1 of 1 at 5–10 m" in " ".join(notes(verdict))


def test_a_verdict_rests_on_the_least_number_of_variants_that_is_asked_for() -> None:
    verdict = judged(
        "mean(pacc) >= 0.5", planted_table([0.9] * 4, range(4)), drawn("points", 4), fields={"min_units": 7}
    )
    assert (verdict.outcome, verdict.further) == (Outcome.UNDECIDED, 3)
    assert "7 variants" in verdict.reason


@pytest.mark.parametrize(
    ("fields", "words"), [({}, "more would"), ({"where": "distance_m < 20"}, "more in the region would")]
)
def test_further_variants_are_those_in_the_region(fields: dict[str, str], words: str) -> None:
    table = planted_table([0.9] * 9, range(9))
    verdict = judged("share(pacc >= 0.5) >= 0.9", table, drawn("random", 9), fields=fields)
    assert f"about {verdict.further} {words} decide it" in sentence(verdict)


@pytest.mark.parametrize(
    ("statistic", "words"),
    [
        ("mean(pacc) >= 0.5", "The mean pACC is 60.0 %; at least 50 % is required."),
        ("share(pacc >= 0.3) >= 50 %", "The share of persons with pACC ≥ 0.3 is 100.0 %; at least 50 % is required."),
        (
            "share(fp <= 200) <= 50 %",
            "The share of frames with false person pixels ≤ 200 is 100.0 %; at most 50 % is required.",
        ),
        (
            "quantile(pacc, 0.05) >= 0.3",
            "The share of persons with pACC ≥ 0.3 is 100.0 %; at least 95 % is required: quantile(pacc, 0.05) >= 0.3.",
        ),
    ],
)
def test_a_verdict_is_said_in_words(statistic: str, words: str) -> None:
    table = planted_table([0.8, 0.4], [0, 1], fp=[3, 30])
    assert sentence(judged(statistic, table, drawn("points", 2))) == words


def test_a_region_is_named_and_a_value_that_nobody_has_is_unknown() -> None:
    table = planted_table([NAN], [0])
    verdict = judged("mean(pacc) >= 0.5", table, drawn("points", 1), fields={"where": "distance_m > 99"})
    assert sentence(verdict) == (
        "The mean pACC, where distance_m > 99, is unknown; at least 50 % is required. "
        "The region has no persons with a value."
    )


def test_an_empty_region_is_undecided() -> None:
    table = planted_table([0.9, NAN], [0, 1])
    verdict = judged("mean(pacc) >= 0.5", table, drawn("points", 2), regions={"R": np.array([False, True])})
    assert (verdict.outcome, verdict.units, verdict.undefined) == (Outcome.UNDECIDED, 0, {"fully hidden": 1})
    assert "no persons with a value" in verdict.reason


def test_each_function_has_its_own_verdict_and_verdicts_survive_json_and_tables() -> None:
    table = planted_table([0.9, 0.1], [0, 0], function=["good", "bad"])
    verdicts = judge_requirements([requirement("mean(pacc) >= 0.5", ("good", "bad"))], table, drawn("points", 1))
    assert [(v.function, v.outcome) for v in verdicts] == [("good", "met"), ("bad", "not met")]
    assert typed(tuple[RequirementVerdict, ...], json.loads(json.dumps(list(map(asdict, verdicts))))) == verdicts
    rows = verdict_table(verdicts)
    assert rows["outcome"].to_pylist() == ["met", "not met"]
    assert rows["missed"].to_pylist() == [0, 1]
    sink = pyarrow.BufferOutputStream()
    pyarrow.csv.write_csv(rows, sink)
    assert pyarrow.csv.read_csv(sink.getvalue())["estimate"].to_pylist() == [0.9, 0.1]
