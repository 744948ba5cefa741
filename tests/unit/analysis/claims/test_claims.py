"""The ledger of claims on planted tables, whose answers are known."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.planted_tables import X, planted_table
from valerie.analysis.claims.claims import parse_claims
from valerie.analysis.claims.ledger import ClaimOutcome, LedgerEntry, ledger_table, write_ledger
from valerie.analysis.claims.published import numbers_beside
from valerie.analysis.claims.text import ledger_text
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.plain import typed
from valerie.statistics.curves import proven_changes

PLACES = {"xs": np.linspace(-2, 7, 10).tolist(), "ys": np.linspace(5, 33, 12).tolist()}
PAPER = Path(__file__).parents[4] / "examples" / "claims" / "paper.yaml"


@pytest.fixture(scope="module")
def table(synthetic_table) -> EvaluationTable:
    """120 places: pACC is 0.9, less 0.2 in yellow for a-net, and falls from 30 % occlusion on."""

    def law(function, character, _distance, occlusion, noise):
        dressed = 0.2 if (function, character) == ("a-net", "yellow-shirt") else 0.0
        return 0.9 - dressed - 1.5 * max(0.0, occlusion - 0.3) + 0.01 * noise

    return synthetic_table(law, **PLACES)


def answers(table, **test):
    claims = parse_claims({"title": "planted", "claims": [{"id": "c", "says": "so it is", **test}]})
    return write_ledger(claims, table)


def outcomes(table, **test):
    return [entry.outcome for entry in answers(table, **test)]


COLOURS = {"factor": "person-1.character", "first": "yellow-shirt", "second": "black-outfit"}


def test_a_difference_is_paired_and_judged_for_each_function(table):
    lower, equal = answers(table, difference={**COLOURS, "sign": "<"})
    assert (lower.function, lower.outcome) == ("a-net", ClaimOutcome.REPRODUCED)
    assert lower.low < -0.2 < lower.high < 0
    assert lower.places == 120
    assert equal.outcome is not ClaimOutcome.REPRODUCED
    assert outcomes(table, difference={**COLOURS, "sign": ">"}, functions=["a-net"]) == [ClaimOutcome.NOT_REPRODUCED]
    assert outcomes(table, difference={**COLOURS, "sign": "="}) == [
        ClaimOutcome.NOT_REPRODUCED,
        ClaimOutcome.REPRODUCED,
    ]


def test_a_score_that_leaves_its_level_is_placed_on_the_axis_where_the_places_suffice(table, synthetic_table):
    def law(_function, _character, _distance, occlusion, noise):
        return 0.9 - 1.5 * max(0.0, occlusion - 0.3) + 0.01 * noise

    many = {"xs": np.linspace(-2, 7, 30).tolist(), "ys": np.linspace(5, 33, 40).tolist()}
    large = synthetic_table(law, **many, functions=("b-net",), characters=("black-outfit",))
    right = {"over": "occlusion_rate", "at": 0.36, "tolerance": 0.25}
    wrong = {"over": "occlusion_rate", "at": 0.7, "tolerance": 0.05}
    (entry,) = answers(large, departure=right)
    assert entry.outcome is ClaimOutcome.REPRODUCED
    assert entry.low < 0.3 + 0.1 / 1.5 < entry.high
    assert outcomes(large, departure=wrong) == [ClaimOutcome.NOT_REPRODUCED]
    assert outcomes(table, departure=right, functions=["b-net"]) == [ClaimOutcome.UNDECIDED]


def test_trends_follow_the_data(table):
    over = {"over": "occlusion_rate"}
    assert outcomes(table, trend={**over, "shape": "falling"}, functions=["b-net"]) == [ClaimOutcome.REPRODUCED]
    assert outcomes(table, trend={**over, "shape": "rising"}, functions=["b-net"]) == [ClaimOutcome.NOT_REPRODUCED]
    region = "occlusion_rate < 0.25"
    level = outcomes(table, trend={**over, "shape": "level"}, where=region, functions=["b-net"])
    assert level == [ClaimOutcome.UNDECIDED]  # a level is shown by a narrow band alone


def test_a_hump_neither_rises_nor_falls(synthetic_table):
    def law(_function, _character, distance, _occlusion, noise):
        return 0.9 - abs(distance - 30) / 20 + 0.01 * noise

    humped = synthetic_table(law, **PLACES, functions=("b-net",))
    for shape in ("rising", "falling", "level"):
        (entry,) = answers(humped, trend={"over": "distance_m", "shape": shape})
        assert entry.outcome is ClaimOutcome.NOT_REPRODUCED
        assert "falls and rises" in entry.finding


def test_a_trend_is_reproduced_without_an_effect_as_rarely_as_its_confidence_says():
    rng = np.random.default_rng(5)
    place = np.repeat(np.arange(48), 6)
    changes = []
    for seed in range(200):
        # Rows of a place are alike, and half of the places are found, half missed.
        scores = (rng.random(48) < 0.5)[place] * 0.8 + 0.2 * rng.random(len(place))
        along = rng.random(48)[place]
        changes.append(proven_changes(along, scores, place, seed=seed))
    # At 5 % in all, 17 or more of 200 have a chance of 2 %.
    assert sum(change.low > 0 or change.high < 0 for change in changes) < 17
    assert sum(change.falls or change.rises for change in changes) < 17


def test_rows_of_blocks_that_set_a_parameter_of_no_interest_are_left_out() -> None:
    scores, metal = [0.9, 0.9, 0.5, 0.5, 0.1, 0.1], [np.nan, np.nan, 0.0, 0.0, 0.6, 0.6]
    plain = planted_table(scores, range(6))
    path = "scene.person-1.cloth.metallic"
    two_blocks = EvaluationTable.from_columns(
        {name: plain.arrow[name] for name in plain.arrow.column_names} | {path: metal}, {X: "FLOAT", path: "FLOAT"}
    )
    claim = {"id": "mean", "says": "so it is", "quantity": {"of": "pacc", "low": 0.8}}
    document = {
        "title": "planted",
        "without": ["person-1.cloth.metallic"],
        "claims": [claim, {**claim, "id": "all", "without": []}],
        "numbers": [{"what": "mean", "of": "pacc", "value": 0.9}],
    }
    first, everything = write_ledger(parse_claims(document), two_blocks)
    assert (first.rows, first.estimate, everything.rows) == (2, pytest.approx(0.9), 6)
    assert numbers_beside(parse_claims(document), two_blocks)[0].rows == 2
    assert write_ledger(parse_claims(document), plain)[0].rows == 6  # a run that sets it nowhere


def test_the_paper_is_answered_by_its_own_block_and_its_materials_by_the_clothing_block() -> None:
    claims = parse_claims(yaml.safe_load(PAPER.read_text()))
    assert claims.without == ("person-1.cloth.metallic",)
    of_materials = [claim.id for claim in claims.claims if claim.without == ()]
    assert of_materials == ["shine-flips", "shine-bright"]
    assert all(cross.without == () for cross in claims.crosses)
    assert all(number.without is None for number in claims.numbers)


def test_a_flip_names_the_two_frames(table):
    (entry,) = answers(table, flip={**COLOURS, "at_least": 0.15}, functions=["a-net"])
    assert entry.outcome is ClaimOutcome.REPRODUCED
    assert len(set(entry.frames)) == 2
    assert outcomes(table, flip={**COLOURS, "at_least": 0.6}, functions=["a-net"]) == [ClaimOutcome.NOT_REPRODUCED]


def test_a_flip_reads_the_same_from_either_side(table):
    reverse = {**COLOURS, "first": COLOURS["second"], "second": COLOURS["first"]}
    (there,), (back,) = (
        answers(table, flip={**side, "at_least": 0.15}, functions=["a-net"]) for side in (COLOURS, reverse)
    )
    assert there.estimate == pytest.approx(-back.estimate)
    assert there.frames == back.frames[::-1]
    own = table.codes("function").where("a-net")
    frames = [table.codes("frame_id").names[k] for k in table.codes("frame_id").index[own]]
    pacc = dict(zip(frames, table.numbers("pacc")[own].tolist(), strict=True))
    assert there.estimate == pytest.approx(pacc[there.frames[1]] - pacc[there.frames[0]])


def test_a_quantity_of_frames_is_computed_once_and_a_score_for_each_function(table):
    distances = table.numbers("distance_m")
    (entry,) = answers(table, quantity={"of": "distance_m", "statistic": "minimum", "low": 17, "high": 18})
    assert entry.function == ""
    assert entry.estimate == distances.min()
    share = {"of": "occlusion_rate", "statistic": "share", "above": 0.05, "low": 0.0, "high": 1.0}
    (entry,) = answers(table, quantity=share)
    assert entry.estimate == pytest.approx((table.numbers("occlusion_rate")[::2] > 0.05).mean(), abs=1e-12)
    assert len(answers(table, quantity={"of": "pacc", "low": 0.5})) == 2
    assert outcomes(table, quantity={"of": "pacc", "high": 0.1}) == [ClaimOutcome.NOT_REPRODUCED] * 2


def test_slips_and_claims_that_no_run_can_test_stand_in_the_ledger(table):
    assert outcomes(table, slip="85 % cannot have less than 85 %") == [ClaimOutcome.SLIP]
    assert outcomes(table, untestable="the paper's networks are not to be had") == [ClaimOutcome.NOT_TESTABLE]


@pytest.mark.parametrize("test", [{"difference": {"sign": "<"}}, {"flip": {"at_least": 0.4}}])
def test_a_claim_about_a_factor_that_the_run_does_not_vary_is_not_testable_here(table, test):
    ((kind, rest),) = test.items()
    (entry,) = answers(table, **{kind: {**COLOURS, "factor": "rain", **rest}})
    assert entry.outcome is ClaimOutcome.NOT_TESTABLE
    assert "does not vary rain; it varies " in entry.finding
    assert "person-1.character" in entry.finding


@pytest.mark.parametrize(
    ("claim", "error", "words"),
    [
        (
            {"functions": ["c-net"], "trend": {"over": "distance_m", "shape": "level"}},
            UnknownName,
            r"claims\.0\.functions",
        ),
        ({"difference": {**COLOURS, "first": "red", "sign": "<"}}, UnknownName, r"claims\.0\.difference\.first"),
        ({"trend": {"over": "distans", "shape": "level"}}, UnknownName, "distance_m"),
        ({"where": "pac > 1", "trend": {"over": "distance_m", "shape": "level"}}, InvalidInput, r"claims\.0\.where"),
    ],
)
def test_a_claim_about_something_that_the_run_lacks_is_refused_with_its_place(table, claim, error, words):
    with pytest.raises(error, match=words):
        answers(table, **claim)


@pytest.mark.parametrize(
    "claim",
    [
        {},
        {"slip": "a", "untestable": "b"},
        {"quantity": {"of": "pacc"}},
        {"quantity": {"of": "pacc", "statistic": "share", "low": 0.5}},
        {"trend": {"over": "distance_m", "shape": "bent"}},
    ],
)
def test_a_claim_has_one_complete_test(claim):
    with pytest.raises(InvalidInputs, match="claims"):
        parse_claims({"title": "t", "claims": [{"id": "c", "says": "s", **claim}]})


def test_a_ledger_survives_json_and_becomes_a_table(table):
    entries = answers(table, flip={**COLOURS, "at_least": 0.15})
    assert typed(tuple[LedgerEntry, ...], list(map(asdict, entries))) == entries
    arrow = ledger_table(entries)
    assert arrow.num_rows == 2
    assert arrow["outcome"].to_pylist()[0] == "reproduced"


def test_the_papers_claims_are_a_document_whose_words_stand_in_the_paper():
    claims = parse_claims(yaml.safe_load(PAPER.read_text()))
    assert len({claim.id for claim in claims.claims}) == len(claims.claims)
    assert all(claim.source.startswith(("6.", "table", "figure")) for claim in claims.claims)


def test_the_ledger_names_what_its_intervals_are_for(table):
    entries = answers(table, difference={**COLOURS, "sign": "<"}, functions=["a-net"])
    assert ledger_table(entries)["estimand"].to_pylist() == ["listed_grid"]
    claims = parse_claims({"title": "planted", "claims": [{"id": "c", "says": "so", "slip": "no"}]})
    assert ledger_text(claims, entries).endswith(
        "Quantities are those of the listed variants; intervals of differences and along an axis are for places like these "
        "on this site, 95 % each, from all places, since a claim is stated beforehand. A finding is judged by the places that "
        "did not suggest it, together with all others, and may have no interval where a claim has.\n"
    )
