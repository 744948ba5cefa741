"""Findings of planted tables, whose effects are known."""

import json
from collections import defaultdict
from dataclasses import asdict, replace

import numpy as np
import pytest

from tests.planted_tables import planted_table
from valerie.analysis.findings.child_specs import child_spec
from valerie.analysis.findings.findings import Findings, PictureFault
from valerie.analysis.findings.search import find_findings
from valerie.analysis.findings.wording import candidate_text
from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.summary.summary import summarize
from valerie.analysis.summary.text import summary_text
from valerie.errors import InvalidInput
from valerie.plain import typed
from valerie.runs.resolving.spec import parse
from valerie.statistics.contrasts import Matching

PLACES = {"xs": np.linspace(-2, 7, 6).tolist(), "ys": np.linspace(5, 33, 8).tolist()}
SUN = "scene.sun-1.azimuth"
ELEVATION = "scene.sun-1.elevation"


def plain(*law):
    return 0.75 + 0.06 * law[-1]


@pytest.fixture
def run(synthetic, parameters, grid):
    """Build the table of a grid, each place under several values of one more parameter.

    The last value lowers pACC by ``drop``; besides, each value changes each place by chance, by ``wobble``.
    """

    def build(law=plain, path=SUN, values=(140.0, 260.0), drop=0.0, kind="ANGLE", places=PLACES, wobble=0.0, **more):
        rows, generator = [], np.random.default_rng(more.get("seed", 0))
        for number, value in enumerate(values):
            changes = defaultdict(lambda: wobble * generator.standard_normal())
            for row in synthetic(law, **places, **more):
                place = row["scene.person-1.pos.x"], row["scene.person-1.pos.y"]
                share = row["pacc"] + changes[place] - (drop if value == values[-1] else 0.0)
                tp = round(min(max(0.0, share), 1.0) * row["pixel_area"])
                index = number * 100_000 + row["variant_index"]
                frame = f"{index}-{row['camera']}"
                changed = {"tp": tp, "fn": row["pixel_area"] - tp, "pacc": tp / row["pixel_area"]}
                rows.append({**row, path: value, "variant_index": index, "frame_id": frame, **changed})
        return EvaluationTable.from_rows(rows, {**parameters, path: kind}, grid)

    return build


@pytest.mark.parametrize(
    ("kind", "path", "values", "words"),
    [
        ("ANGLE", SUN, (140.0, 260.0), "with sun-1.azimuth 260° than with 140°"),
        ("BOOL", "scene.car-3.visible", (False, True), "with car-3.visible true than with false"),
        ("CATEGORICAL", "scene.car-3.colour", ("red", "tan"), "with car-3.colour tan than with red"),
        ("FLOAT", "sensor.exposure_ev", (0.0, 1.5), "with sensor.exposure_ev 1.5 than with 0"),
    ],
)
def test_an_effect_of_twenty_points_within_places_is_confirmed(run, kind, path, values, words):
    table = run(path=path, values=values, drop=0.2, kind=kind, functions=("net",))
    finding = find_findings(table).items[0]

    assert finding.effect == pytest.approx(-0.2, abs=0.01)
    assert finding.low <= finding.effect <= finding.high < 0
    assert finding.sentence.startswith("net: pACC is 20.0 points lower " + words)
    assert "all else equal (joint 95 % interval −" in finding.sentence
    assert (finding.matching, finding.places) == (Matching.BLOCKS, 24)
    assert finding.pairs == 24 * 2 * 3  # characters, cameras


def test_the_pair_of_views_differs_in_the_change_alone(run):
    table = run(drop=0.2, functions=("net",))
    rows = {row["frame_id"]: row for row in table.arrow.to_pylist()}
    (finding,) = [item for item in find_findings(table).items if item.steps[0].factor == "sun-1.azimuth"]
    before, after = (rows[view.frame_id] for view in finding.examples[0])

    assert {name for name in table.parameters if before[name] != after[name]} == {SUN}
    assert before["camera"] == after["camera"]
    assert [view.pacc for view in finding.examples[0]] == [before["pacc"], after["pacc"]]
    assert before["pacc"] > after["pacc"]


def test_runs_without_an_effect_confirm_nothing_in_nearly_every_run(run):
    loud = 0
    for seed in range(12):
        findings = find_findings(run(values=(40.0, 140.0, 260.0), wobble=0.4, seed=seed), seed=seed)
        assert findings.comparisons > 100
        loud += bool(findings.items)
    assert loud <= 3  # each run confirms something with probability 5 % at most; P(more than 3 of 12) is 0.2 %


def test_with_too_few_places_to_split_everything_is_a_candidate(run):
    table = run(drop=0.3, places={"xs": [0.0, 3.0], "ys": [5.0, 9.0, 20.0]}, functions=("net",))
    findings = find_findings(table)

    assert (findings.items, findings.places_confirming) == ((), 0)
    assert findings.candidates[0].steps[0].factor == "sun-1.azimuth"
    assert findings.candidates[0].places_needed > 0
    text = summary_text(summarize(table), findings)
    assert "too few to confirm anything: 10 places are needed" in text
    assert "Candidates, not confirmed" in text
    assert "fresh places are needed" in text


def test_candidates_are_numbered_after_findings(run):
    found = find_findings(run(drop=0.3, functions=("net",)))
    unsure = find_findings(run(drop=0.3, places={"xs": [0.0, 3.0], "ys": [5.0, 9.0, 20.0]}, functions=("net",)))
    findings = replace(found, candidates=unsure.candidates)
    last = len(findings.items) + len(findings.candidates)

    assert found.items
    assert unsure.candidates
    assert [findings.numbered(k) for k in range(1, last + 1)] == [*findings.items, *findings.candidates]
    assert f"\n{len(findings.items) + 1}. {findings.candidates[0].sentence[:40]}" in summary_text(
        summarize(run(drop=0.3, functions=("net",))), findings
    )
    with pytest.raises(InvalidInput, match=f"--finding: no such finding.*1 … {last}"):
        findings.numbered(last + 1)


def test_a_difference_between_places_names_what_else_differs(run):
    far = lambda _function, _character, distance, _occlusion, noise: (0.9 if distance < 30 else 0.4) + 0.02 * noise  # noqa: E731
    findings = find_findings(run(far, functions=("net",)))
    (finding,) = [one for one in (*findings.items, *findings.candidates) if one.steps[0].factor == "person-1.pos.y"]

    assert finding.matching is Matching.MODEL
    assert finding.effect < -0.4
    assert "between different places" in finding.sentence
    assert "The sides also differ in" in finding.sentence
    (distance,) = [quantity for quantity in finding.unequal if quantity.column == "distance_m"]
    assert distance.after - distance.before > 2


def test_a_change_within_places_has_sides_alike(run):
    (finding,) = [item for item in find_findings(run(drop=0.2, functions=("net",))).items if len(item.steps) == 1]

    assert finding.unequal == ()


def test_an_effect_that_one_character_alone_has_is_an_interaction(run):
    table = run(functions=("net",))
    rows = table.arrow.to_pylist()
    for row in rows:
        if row[SUN] == 260.0 and row["character"] == "yellow-shirt":
            tp = round(row["tp"] * 0.5)
            row |= {"tp": tp, "fn": row["pixel_area"] - tp, "pacc": tp / row["pixel_area"]}
    findings = find_findings(EvaluationTable.from_rows(rows, table.parameters, table.designs))
    (finding,) = [item for item in findings.items if len(item.steps) == 2]

    assert {step.factor for step in finding.steps} == {"sun-1.azimuth", "person-1.character"}
    assert abs(finding.effect) == pytest.approx(0.375, abs=0.03)
    assert "net: the effect of " in finding.sentence


def test_functions_are_compared_on_identical_frames(run):
    better = lambda function, *law: (0.8 if function == "a-net" else 0.7) + 0.1 * law[-1]  # noqa: E731
    findings = find_findings(run(better))
    (finding,) = [item for item in findings.items if not item.function]

    assert finding.sentence.startswith("a-net sees more than b-net on identical frames: pACC is ")
    assert finding.effect == pytest.approx(-0.1, abs=0.03)
    assert "joint 95 % interval −" not in finding.sentence  # the better one is named, so the interval is above 0
    assert all(before.frame_id == after.frame_id for before, after in finding.examples)
    assert [view.function for view in finding.examples[0]] == ["a-net", "b-net"]


def test_differences_between_places_that_are_alike_stay_candidates(synthetic_table):
    def rings(_function, _character, distance, _occlusion, noise):
        return 0.5 + 0.3 * np.sin(distance / 3) + 0.02 * noise

    xs, ys = np.linspace(-20, 20, 10).tolist(), np.linspace(5, 33, 12).tolist()
    findings = find_findings(synthetic_table(rings, xs=xs, ys=ys, functions=("a-net",)))
    assert not any(finding.matching is Matching.MODEL for finding in findings.items)
    withheld = [finding for finding in findings.candidates if finding.matching is Matching.MODEL]
    assert withheld
    assert all(finding.low is None for finding in withheld)
    assert candidate_text(withheld[0]).endswith("repeat the grid on several sites to confirm it.")
    assert all(f"(in the {findings.places_searched} places searched" in finding.sentence for finding in withheld)
    assert findings.notes[0].startswith("a-net: in some differences, neighbouring places score alike")


def test_functions_of_different_precision_are_not_compared(run):
    better = lambda function, *law: (0.8 if function == "a-net" else 0.5) + 0.02 * law[-1]  # noqa: E731
    findings = find_findings(run(better), precisions={"a-net": "fp32", "b-net": "bf16"})

    assert [one for one in (*findings.items, *findings.candidates) if not one.function] == []
    (sentence,) = [note for note in findings.notes if "precision" in note]
    assert sentence.startswith("a-net (fp32) and b-net (bf16) ran in different precisions")


@pytest.mark.parametrize("precisions", [("bf16", "bf16"), ("fp32", "uint8"), ("fp32", "remote")])
def test_functions_of_full_or_equally_reduced_precision_are_compared(run, precisions):
    better = lambda function, *law: (0.8 if function == "a-net" else 0.5) + 0.02 * law[-1]  # noqa: E731
    findings = find_findings(run(better), precisions=dict(zip(("a-net", "b-net"), precisions, strict=True)))

    assert [item for item in findings.items if not item.function]
    assert [note for note in findings.notes if "precision" in note] == []


def test_a_function_that_calls_everything_person_is_named_where_variants_were_drawn(synthetic, parameters, grid):
    rows = synthetic(lambda *_: 1.0, functions=("net",), false_positives=5000, **PLACES)
    drawn = EvaluationTable.from_rows(rows, parameters, {"run-1": Design((("random", 96),))})
    tp, wrong = sum(row["tp"] for row in rows), 5000 * len(rows)
    (sentence,) = find_findings(drawn).notes

    assert f"net, sensor default: {100 * wrong / (wrong + tp):.1f} % of the pixels that it calls person" in sentence
    assert "96 variants" in sentence
    assert find_findings(EvaluationTable.from_rows(rows, parameters, grid)).notes == ()


def test_a_precise_function_is_not_named_for_its_precision(synthetic, parameters):
    rows = synthetic(plain, functions=("net",), false_positives=1, **PLACES)
    assert find_findings(EvaluationTable.from_rows(rows, parameters, {"run-1": Design((("random", 96),))})).notes == ()


def test_a_finding_of_a_grid_proposes_positions_between_those_of_the_run(run):
    spec = parse(
        {
            "name": "suns", "asset": "urban-street", "functions": ["net"],
            "vary": [["sun-1.azimuth", "CHOICE", 140, 260], ["person-1.pos.x", "HOMOGENEOUS", -2, 7, 1.8]],
        }
    )  # fmt: skip
    (finding,) = [
        item for item in find_findings(run(drop=0.2, functions=("net",)), spec=spec).items if len(item.steps) == 1
    ]
    child = parse(finding.spec)
    listed = {vary.parameter: vary.values for vary in child.blocks[0].vary}

    assert (child.parent_run, child.iteration, child.name) == ("run-1", 1, "suns refined")
    assert listed[SUN] == (140.0, 260.0)
    assert listed["scene.person-1.character"] == ("black-outfit", "yellow-shirt")
    assert not set(listed["scene.person-1.pos.x"]) & set(PLACES["xs"])
    assert min(PLACES["xs"]) < min(listed["scene.person-1.pos.x"]) < max(listed["scene.person-1.pos.x"]) < 7
    assert len(listed["scene.person-1.pos.x"]) * len(listed["scene.person-1.pos.y"]) >= finding.places_needed


def test_a_finding_of_a_drawn_design_proposes_other_draws(synthetic, parameters):
    spec = parse(
        {
            "name": "drawn", "asset": "urban-street", "functions": ["net"], "seed": 4,
            "blocks": [{"design": "random", "count": 96, "vary": [["person-1.pos.x", "UNIFORM", -2, 7]]}],
        }
    )  # fmt: skip
    by_character = lambda _function, character, *_: 0.9 if character == "yellow-shirt" else 0.5  # noqa: E731
    rows = synthetic(by_character, functions=("net",), **PLACES)
    table = EvaluationTable.from_rows(rows, parameters, {"run-1": Design((("random", 96),))})
    child = parse(find_findings(table, spec=spec).items[0].spec)

    assert (child.seed, child.parent_run, child.iteration) == (5, "run-1", 1)
    assert child.blocks[0].design == "random"
    assert child.blocks[0].count >= 96
    assert child.blocks[0].vary == spec.blocks[0].vary


@pytest.mark.parametrize("design", ["random", "grid"])
def test_a_proposed_run_allows_for_rejected_variants(design):
    block = {"design": design, "vary": [["person-1.pos.x", "HOMOGENEOUS", 0, 59, 1]]}
    document = {"name": "half", "asset": "urban-street", "functions": ["net"], "blocks": [block]}
    spec = parse({**document, "blocks": [block | ({} if design == "grid" else {"count": 60})]})
    own, planned = np.arange(0, 60, 2), Design(((design, 60),))
    table = planted_table(np.full(30, 0.5), own, design=planned)
    child = parse(child_spec(table, spec, (), (), 90)).blocks[0]

    assert (child.count if design == "random" else len(child.vary[0].values)) >= 180


def test_equal_input_gives_equal_findings_and_they_survive_json(run):
    table = run(drop=0.2)
    first, second = find_findings(table, seed=3), find_findings(table, seed=3)

    assert first == second
    assert typed(Findings, json.loads(json.dumps(asdict(first)))) == first


def test_names_with_braces_are_not_formatted(run):
    table = run(lambda f, *_: 0.9 if f == "{0}" else 0.3, functions=("{0}", "{size}"))
    sentences = [finding.sentence for finding in find_findings(table).items]

    assert any(sentence.startswith("{0} sees more than {size}") for sentence in sentences)


def test_an_empty_table_has_no_findings(parameters):
    findings = find_findings(EvaluationTable.from_rows([], parameters))

    assert (findings.items, findings.candidates, findings.comparisons) == ((), (), 0)


def test_a_finding_that_pictures_without_content_alone_carry_is_a_fault_of_the_picture(
    synthetic, parameters, grid
) -> None:
    # Nobody can find anything under the second sun: its pictures are black.
    rows = []
    for number, elevation in enumerate((40.0, -8.0)):
        for row in synthetic(lambda *_: 0.8, **PLACES):
            night = elevation < 0
            scores = {"tp": 0, "fn": row["pixel_area"], "pacc": 0.0} if night else {}
            levels = {"picture_mean": 0.05 if night else 90.0, "picture_deviation": 0.3 if night else 40.0}
            index = number * 100_000 + row["variant_index"]
            named = {"variant_index": index, "frame_id": f"{index}-{row['camera']}", ELEVATION: elevation}
            rows.append({**row, **scores, **levels, **named})
    findings = find_findings(EvaluationTable.from_rows(rows, {**parameters, ELEVATION: "ANGLE"}, grid))
    nights = [item for item in findings.items if item.function and item.steps[0].factor == "sun-1.elevation"]
    assert len(nights) == 2
    for finding in nights:
        assert finding.picture_fault == PictureFault("black", 0.5, None)
        assert finding.sentence.startswith(
            "A fault of the picture: 50.0 % of these views are black; without faulty ones nothing is left to compare. "
            f"{finding.function}: pACC is"
        )
    assert typed(Findings, json.loads(json.dumps(asdict(findings)))) == findings


def test_black_pictures_among_others_carry_a_finding_only_where_less_than_half_of_it_is_left(
    synthetic, parameters, grid
) -> None:
    # Dusk costs 0.4 by itself. In one place of six its pictures are black, which costs the rest there.
    rows = []
    for number, elevation in enumerate((40.0, -2.0)):
        for row in synthetic(lambda *_: 0.8, **PLACES):
            dusk, dark = elevation < 0, elevation < 0 and row["scene.person-1.pos.x"] == PLACES["xs"][0]
            tp = 0 if dark else row["tp"] // 2 if dusk else row["tp"]
            scores = (
                {"tp": tp, "fn": row["pixel_area"] - tp, "pacc": tp / row["pixel_area"]} if row["pixel_area"] else {}
            )
            levels = {"picture_mean": 0.1 if dark else 90.0, "picture_deviation": 0.3 if dark else 40.0}
            index = number * 100_000 + row["variant_index"]
            named = {"variant_index": index, "frame_id": f"{index}-{row['camera']}", ELEVATION: elevation}
            rows.append({**row, **scores, **levels, **named})
    findings = find_findings(EvaluationTable.from_rows(rows, {**parameters, ELEVATION: "ANGLE"}, grid))
    for function in ("a-net", "b-net"):
        faults = {
            frozenset(step.factor for step in item.steps): item.picture_fault
            for item in (*findings.items, *findings.candidates)
            if item.function == function
        }
        # That dusk is worse in that place is a fault of the picture; that it is worse at all is not.
        assert faults[frozenset({"sun-1.elevation"})] is None
        assert faults[frozenset({"sun-1.elevation", "person-1.pos.x"})] is not None
