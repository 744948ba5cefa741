"""The document of a study and its measure."""

from __future__ import annotations

from importlib import resources
from typing import Any

import numpy as np
import pytest

from valerie.errors import InvalidInput, InvalidInputs
from valerie.runs.study.measure import parse_measure
from valerie.runs.study.study_document import EstimateGoal, ExplainGoal, StudyDocument, parse_study


def document(**more: Any) -> dict[str, Any]:
    return {
        "name": "how often",
        "asset": "urban-street",
        "vary": [["person-1.pos.x", "UNIFORM", -3, 5], ["person-1.pos.y", "GAUSSIAN", 15, 8]],
        "functions": ["deeplabv3plus-small"],
        "measure": "min(pacc) >= 0.5",
        "goal": "estimate",
        "budget": {"variants": 256},
        **more,
    }


def test_a_file_holds_spec_and_study_side_by_side_and_reads_back_equal() -> None:
    study = parse_study(document(stop={"width": 0.1}, batch=32, constraints=["person-1.pos.x < 4"]))
    assert [varied.parameter for varied in study.spec.blocks[0].vary] == ["person-1.pos.x", "person-1.pos.y"]
    assert isinstance(study.goal, EstimateGoal)
    again = parse_study(study.to_yaml())
    assert again == study
    assert again.digest == study.digest


def test_the_digest_covers_what_decides_and_not_the_mode() -> None:
    study = parse_study(document())
    assert parse_study(document(mode="by hand")).digest == study.digest
    for change in ({"seed": 1}, {"batch": 8}, {"measure": "min(pacc) >= 0.6"}, {"where": "distance_m < 9"}):
        assert parse_study(document(**change)).digest != study.digest


def test_the_written_template_is_a_study() -> None:
    text = resources.files("valerie.studies").joinpath("template.yaml").read_text(encoding="utf-8")
    assert isinstance(parse_study(text), StudyDocument)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"goal": "estimat"}, "goal: unknown goal 'estimat'"),
        ({"goal": None}, "goal"),
        ({"goal": {"name": "estimate", "first": 3}}, "goal.first: .*got 3.*>= 20"),
        ({"goal": {"name": "estimate", "first": 300}}, "goal.first.*256"),
        ({"goal": {"name": "explain", "failing": {"person-1.pos.x": 1}}}, "goal.passing"),
        ({"goal": {"name": "find", "repeats": 11}}, "goal.repeats.*11.*<= 10"),
        ({"goal": {"name": "verify", "share": 95}}, "goal.share.*95.*< 1"),
        ({"goal": {"name": "verify", "confidence": 0.4}}, "goal.confidence.*0.4.*>= 0.5"),
        ({"goal": {"name": "map", "repeats": 1}}, "goal.repeats"),
        ({"goal": "rank", "vary": [["person-1.pos.x", "UNIFORM", -3, 5]]}, "vary.*got 1.*>= 2"),
        ({"goal": "compare", "functions": ["a", "b"]}, "goal.within"),
        ({"goal": {"name": "compare", "within": 0.1}}, "functions.*got 1.*2"),
        ({"goal": {"name": "compare", "within": 0}, "functions": ["a", "b"]}, "goal.within.*got 0.*> 0"),
        ({"goal": "verify", "measure": "min(pacc) >= 0"}, "measure.*both sides"),
        ({"budget": {"variants": 7}}, "budget.variants.*7.*>= 8"),
        ({"budget": {}}, "budget.variants"),
        ({"budgte": {"variants": 9}}, "budgte.*budget"),
        ({"budget": 40}, "budget: a mapping is needed here; got 40"),
        (
            {"budget": {"variants": 40, "deadline": "tomorrow"}},
            "budget.deadline: a moment is needed here; got tomorrow; limit: as 2027-01-31T18:00",
        ),
        ({"goal": {"name": "find", "bach": 3}}, "goal.bach: this field is unknown; got 3"),
        ({"batch": 1001}, "batch.*1001.*<= 1000"),
        ({"batch": 300}, "batch.*300.*256"),
        ({"mode": "by foot"}, "mode"),
        ({"measure": "min(pacc)"}, "measure"),
        ({"measure": "min(pac) >= 0.5"}, "measure.*pacc"),
        ({"measure": "min(pacc) >= 50"}, r"measure: .*between 0 and 1; got min\(pacc\) >= 50;"),
        ({"measure": "max(pacc) > 0.5"}, r"got max\(pacc\) > 0.5; limit: max\(pacc\) >= "),
        ({"measure": "worst(pacc) >= 0.5"}, "unknown statistic 'worst'; known: max, mean, min, quantile, share"),
        ({"measure": "pacc >= 0.5"}, r"measure: not a statistic.*got pacc >= 0.5; limit: min\(pacc\) >= 0.5, mean"),
        ({"functions": []}, "functions.*one function"),
        ({"vary": []}, "vary"),
        ({"design": "sobol"}, "design.*decides this itself"),
        ({"goal": "explain", "stop": {"width": 0.1}}, "stop.width"),
        ({"vary": [["person-1.pos.x", "UNIFORMM", -3, 5]]}, "vary.*UNIFORM"),
    ],
)
def test_a_problem_names_field_value_and_limit(change: dict[str, Any], said: str) -> None:
    with pytest.raises(InvalidInput, match=said):
        parse_study({key: value for key, value in document(**change).items() if value is not None})


def test_several_problems_are_reported_at_once() -> None:
    with pytest.raises(InvalidInputs) as error:
        parse_study(document(measure="min(pac) >= 0.5", batch=500, stop={"width": 0.1}, goal="explain"))
    assert len(error.value.problems) >= 3


def test_a_share_may_be_stated_in_per_cent() -> None:
    assert parse_study(document(goal={"name": "verify", "share": "90 %"})) == parse_study(
        document(goal={"name": "verify", "share": 0.9})
    )
    with pytest.raises(InvalidInput, match=r"goal.share: .*110 %"):
        parse_study(document(goal={"name": "verify", "share": "110 %"}))


def test_a_given_pair_needs_no_budget_of_its_own() -> None:
    place = {"person-1.pos.x": 1, "person-1.pos.y": 9}
    study = parse_study(
        document(goal={"name": "explain", "failing": place, "passing": {**place, "person-1.pos.y": 20}})
    )
    assert isinstance(study.goal, ExplainGoal)
    assert study.goal.failing == place


@pytest.mark.parametrize(
    ("text", "values", "score", "at_least"),
    [
        ("min(pacc) >= 0.5", [0.9, 0.2, np.nan], 0.2, 0.5),
        ("max(pacc) >= 0.5", [0.9, 0.2], 0.9, 0.5),
        ("max(pacc) <= 0.3", [0.9, 0.2], 0.1, 0.7),
        ("mean(iou) >= 60 %", [0.5, 0.7], 0.6, 0.6),
        ("share(pacc >= 0.5) >= 95 %", [0.9, 0.2, np.nan, 0.6], 2 / 3, 0.95),
        ("share(fp <= 200) >= 0.5", [100, 300], 0.5, 0.5),
        ("min(pacc) >= 0.5", [np.nan], np.nan, 0.5),
        ("mean(pacc) >= 0.5", [], np.nan, 0.5),
    ],
)
def test_a_measure_turns_the_rows_of_a_variant_into_a_score(
    text: str, values: list[float], score: float, at_least: float
) -> None:
    measure = parse_measure(text)
    assert measure.score(values) == pytest.approx(score, nan_ok=True)
    assert measure.at_least == pytest.approx(at_least)


@pytest.mark.parametrize(
    ("text", "missed"),
    [
        ("min(pacc) >= 0.5", "pacc < 0.5"),
        ("max(iou) <= 0.9", "iou > 0.9"),
        ("mean(iou) >= 60 %", "iou < 0.6"),
        ("share(pacc >= 0.5) >= 95 %", "pacc < 0.5"),
        ("share(pacc <= 0.2) <= 5 %", "pacc <= 0.2"),
        ("quantile(pacc, 0.1) >= 0.3", "pacc < 0.3"),
    ],
)
def test_a_measure_names_the_rows_that_speak_against_a_variant(text: str, missed: str) -> None:
    assert parse_measure(text).missed == missed


def test_rounds_change_no_proposal_and_are_written_again() -> None:
    plain, rounds = (parse_study(document(**more)) for more in ({}, {"rounds": {"most": 3, "training": {"steps": 7}}}))
    assert plain.digest == rounds.digest
    assert parse_study(rounds.to_yaml()).rounds == rounds.rounds
    with pytest.raises(InvalidInputs, match=r"rounds\.training\.steps"):
        parse_study(document(rounds={"training": {"steps": 0}}))
