import json

import numpy as np
import orjson
import pytest

from valerie.analysis.analyze import analyze
from valerie.analysis.comparisons import FindingKind
from valerie.analysis.findings import Findings
from valerie.analysis.summary_text import summary_text
from valerie.analysis.table import EvaluationTable

GRID = {"xs": np.linspace(-2, 7, 10).tolist(), "ys": np.linspace(5, 33, 15).tolist()}


@pytest.fixture(scope="module")
def of(request):
    def choose(analysis, kind):
        return [finding for finding in analysis.findings.items if finding.kind is kind]

    return choose


def test_the_drop_at_thirty_metres_is_a_finding_with_its_numbers(dropping_table, of):
    analysis = analyze(dropping_table)
    (drop,) = [f for f in of(analysis, FindingKind.BINS) if f.column == "distance_m" and f.function == "a-net"]

    assert drop.effect == pytest.approx(-0.4, abs=0.02)
    assert drop.interval.low < -0.4 < drop.interval.high < 0
    assert drop.sentence.startswith("a-net: pACC falls by 4")
    assert "from distance 25–30 m (" in drop.sentence
    assert f"n = {drop.n['second']:,}" in drop.sentence


def test_a_function_without_a_drop_has_no_finding_about_distance(dropping_table, of):
    findings = of(analyze(dropping_table), FindingKind.BINS)

    assert not [f for f in findings if f.function == "b-net"]


def sun_law(rows, path, values, drop):
    """Return the rows repeated under several values of one more parameter; pACC drops under the last value."""
    repeated = []
    for number, value in enumerate(values):
        for row in rows:
            pacc = max(0.0, row["pacc"] - (drop if value == values[-1] else 0.0))
            tp = round(pacc * row["pixel_area"])
            index = number * 10_000 + row["variant_index"]
            repeated.append(
                {**row, path: value, "variant_index": index, "frame_id": f"{index}-{row['camera']}",
                 "tp": tp, "fn": row["pixel_area"] - tp, "pacc": tp / row["pixel_area"]}
            )  # fmt: skip
    return repeated


@pytest.mark.parametrize(
    ("kind", "path", "values", "words"),
    [
        ("ANGLE", "scene.sun-1.azimuth", (40.0, 180.0, 300.0), "where sun-1.azimuth is 300° than elsewhere"),
        ("BOOL", "scene.car-3.visible", (False, True), "where car-3.visible is true than where it is false"),
        ("CATEGORICAL", "scene.car-3.colour", ("red", "tan"), "where car-3.colour is tan than where it is red"),
        ("FLOAT", "sensor.exposure_ev", (0.0, -1.0, -3.0), "where sensor.exposure_ev is -3 than elsewhere"),
    ],
)
def test_values_of_every_varied_parameter_are_compared(synthetic, parameters, of, kind, path, values, words):
    rows = synthetic(lambda *law: 0.9 + 0.02 * law[-1], functions=("net",), xs=GRID["xs"][::3], ys=GRID["ys"][::2])
    rows = [row for row in rows if row["pacc"] is not None]
    table = EvaluationTable.from_rows(sun_law(rows, path, values, 0.3), {**parameters, path: kind})
    (finding,) = [f for f in of(analyze(table, resamples=500), FindingKind.VALUES) if f.column == path]

    assert finding.effect == pytest.approx(-0.3, abs=0.02)
    assert finding.interval.low < -0.3 < finding.interval.high < 0
    assert words in finding.sentence
    assert "pACC is lower by" in finding.sentence


def test_characters_are_compared_within_the_same_situations(dropping_table, of):
    (finding,) = of(analyze(dropping_table), FindingKind.CHARACTERS)

    assert finding.function == "b-net"
    assert finding.effect == pytest.approx(-0.1, abs=0.01)
    assert finding.n == {"pairs": 150 * 3}
    assert "b-net sees yellow-shirt better than black-outfit in the same situations" in finding.sentence
    assert "10." in finding.sentence or "9.9" in finding.sentence


def test_the_difference_is_that_of_the_pairs_even_where_one_half_is_missing(dropping_table, of):
    keep = np.ones(len(dropping_table), bool)
    far = dropping_table.numbers("scene.person-1.pos.y") > 20
    keep[far & dropping_table.codes("character").where("yellow-shirt")] = False
    table = dropping_table.select(keep)
    findings = [f for f in of(analyze(table), FindingKind.CHARACTERS) if f.function == "a-net"]

    assert findings == []  # black outfits have the lower mean only because they also stand far away


def test_functions_are_compared_on_the_same_pictures(dropping_table, of):
    findings = of(analyze(dropping_table), FindingKind.FUNCTIONS)
    best = {f.sentence.split(" sees ")[1].split(" better")[0]: f.function for f in findings}

    pacc, functions = dropping_table.numbers("pacc"), dropping_table.codes("function")
    for character, function in best.items():
        rows = dropping_table.codes("character").where(character)
        means = {name: pacc[rows & functions.where(name)].mean() for name in functions.names}
        assert max(means, key=means.__getitem__) == function
    assert findings


def test_designs_without_pairs_compare_averages_and_say_so(synthetic, parameters, of):
    generator = np.random.default_rng(1)
    rows = []
    for number in range(80):
        character = ("black-outfit", "yellow-shirt")[number % 2]
        place = {"xs": [float(generator.uniform(-2, 7))], "ys": [float(generator.uniform(5, 33))]}
        low = 0.5 if character == "black-outfit" else 0.8
        of_place = synthetic(
            lambda *law, low=low: low + 0.03 * law[-1],
            characters=(character,),
            functions=("net",),
            seed=number,
            **place,
        )
        rows += [{**row, "variant_index": number, "frame_id": f"{number}-{row['camera']}"} for row in of_place]
    (finding,) = of(analyze(EvaluationTable.from_rows(rows, parameters)), FindingKind.CHARACTERS)

    assert finding.n == {"first": 120, "second": 120}
    assert "on average, in different situations" in finding.sentence


def test_a_function_that_calls_everything_person_is_named(synthetic, parameters, of):
    rows = synthetic(lambda *_: 1.0, functions=("net",), false_positives=5000, **GRID)
    (finding,) = of(analyze(EvaluationTable.from_rows(rows, parameters)), FindingKind.FALSE_POSITIVES)
    tp = sum(row["tp"] for row in rows)
    wrong = 5000 * len(rows)

    assert finding.effect == pytest.approx(wrong / (wrong + tp) - 0.5)
    assert (
        f"{100 * wrong / (wrong + tp):.1f} % of the pixels that it calls person belong to no person" in finding.sentence
    )


def test_a_precise_function_is_not_named_for_its_precision(dropping_table, of):
    assert of(analyze(dropping_table), FindingKind.FALSE_POSITIVES) == []


def test_noise_alone_gives_no_finding_in_nearly_every_run(synthetic, parameters):
    loud = 0
    for seed in range(12):
        rows = synthetic(lambda *law: 0.7 + 0.1 * law[-1], xs=GRID["xs"][::2], ys=GRID["ys"][::3], seed=seed)
        findings = analyze(EvaluationTable.from_rows(rows, parameters), seed=seed, resamples=1000).findings
        assert findings.examined > 3
        loud += bool(findings.items)
    assert loud <= 3  # each run has a finding with probability 5 % at most; P(more than 3 of 12) is 0.2 %


def test_findings_are_sorted_by_evidence_and_never_hold_zero(dropping_table):
    findings = analyze(dropping_table).findings
    evidence = [finding.evidence for finding in findings.items]

    assert evidence == sorted(evidence, reverse=True)
    assert all(f.interval.low > 0 or f.interval.high < 0 for f in findings.items)
    assert findings.examined > findings.held >= len(findings.items)


def test_equal_input_gives_equal_findings_and_they_survive_json(dropping_table):
    first, second = analyze(dropping_table, seed=3).findings, analyze(dropping_table, seed=3).findings

    assert first == second
    assert Findings.from_json(json.loads(json.dumps(first.to_json()))) == first


def test_names_with_braces_are_not_formatted(synthetic, parameters):
    rows = synthetic(lambda f, *_: 0.9 if f == "{0}" else 0.3, functions=("{0}", "{size}"), **GRID)
    sentences = [f.sentence for f in analyze(EvaluationTable.from_rows(rows, parameters)).findings.items]

    assert any("{0} sees" in sentence and "{size} does" in sentence for sentence in sentences)


def test_a_handful_of_frames_gives_no_comparison(synthetic, parameters):
    rows = synthetic(lambda *_: 0.5, xs=[0.0], ys=[5.0, 9.0])
    findings = analyze(EvaluationTable.from_rows(rows, parameters)).findings

    assert (findings.items, findings.examined) == ((), 0)


def test_an_empty_table_gives_no_findings(parameters):
    analysis = analyze(EvaluationTable.from_rows([], parameters))

    assert analysis.findings.items == ()
    assert analysis.trends.items == ()


def test_functions_of_different_precision_are_not_compared(dropping_table, of):
    names = dropping_table.codes("function").names
    assert len(names) == 2
    analysis = analyze(dropping_table, precisions={names[0]: "fp32", names[1]: "bf16"}, resamples=300)
    assert of(analysis, FindingKind.FUNCTIONS) == []
    (sentence,) = analysis.findings.unpaired
    assert sentence.startswith(f"{names[0]} (fp32) and {names[1]} (bf16) ran in different precisions")
    assert sentence in summary_text(analysis.summary, analysis.findings)
    assert Findings.from_json(orjson.loads(orjson.dumps(analysis.findings.to_json()))) == analysis.findings


@pytest.mark.parametrize("precisions", [("bf16", "bf16"), ("fp32", "uint8"), ("fp32", "remote")])
def test_functions_of_full_or_equally_reduced_precision_are_compared(dropping_table, of, precisions):
    by_function = dict(zip(dropping_table.codes("function").names, precisions, strict=True))
    analysis = analyze(dropping_table, precisions=by_function, resamples=300)
    assert of(analysis, FindingKind.FUNCTIONS)
    assert analysis.findings.unpaired == ()
