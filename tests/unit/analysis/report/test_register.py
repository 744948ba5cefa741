from __future__ import annotations

from dataclasses import replace

from tests.planted_tables import planted_finding
from valerie.analysis.findings.findings import Findings, ScoredPerson
from valerie.analysis.report.register import register, register_json, register_table

LIT, DARK = (
    ScoredPerson("r1.0.0.0", "default", "net", 24001, 0.9),
    ScoredPerson("r1.1.0.0", "default", "net", 24001, 0.1),
)
LOWER = planted_finding(LIT, DARK)
HIGHER = replace(LOWER, confirmed=False, effect=0.2, low=0.1, high=0.3, examples=((DARK, LIT),), places_needed=70)
OTHERS = (replace(LOWER, function=""), replace(LOWER, steps=LOWER.steps * 2))
FINDINGS = Findings((LOWER, *OTHERS), (HIGHER,), comparisons=9, level=0.95, places_searched=20, places_confirming=20)


def test_the_condition_is_the_worse_side_of_a_finding_and_its_frames_are_the_evidence() -> None:
    lower, higher = register(FINDINGS)
    assert (lower.id, lower.triggering_condition, lower.reference_condition) == (
        "T1",
        "sun-1.elevation 5°",
        "sun-1.elevation 40°",
    )
    assert (higher.id, higher.triggering_condition) == ("T2", "sun-1.elevation 40°")
    assert [(one.effect, one.low, one.high) for one in (lower, higher)] == [(-0.2, -0.3, -0.1)] * 2
    assert [one.evidence for one in (lower, higher)] == [(DARK.frame_id,)] * 2
    assert [(one.confirmed, one.places_needed, one.retest) for one in (lower, higher)] == [
        (True, None, "name: again\n"),
        (False, 70, "name: again\n"),
    ]


def test_table_and_json_hold_every_entry_also_where_there_is_none() -> None:
    entries = register(FINDINGS)
    assert register_table(entries).num_rows == len(register_json(entries)) == 2
    assert register_table(()).num_rows == 0
