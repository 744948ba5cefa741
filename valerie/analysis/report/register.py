"""A register of triggering conditions (ISO 21448), derived from a run's findings.

Each entry names a condition, the functional insufficiency that it reveals, the frames that show it, and a run that tests it
again. The register supports an analysis; it is not a statement of compliance.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Final

import pyarrow as pa

from valerie.analysis.findings.findings import Finding, Findings
from valerie.plain import JsonObject


@dataclass(frozen=True, slots=True)
class TriggeringCondition:
    """A triggering condition of one function.

    Attributes:
        id: ``T1``, ``T2`` …, confirmed ones first.
        function: the function that is insufficient.
        triggering_condition: the level of a factor at which the function is worse.
        reference_condition: the level that it was compared with, everything else equal.
        functional_insufficiency: description of the weakness.
        confirmed: True if places that had no part in the search confirm it; otherwise it is a candidate.
        effect: mean pACC under the condition minus that under the reference, −1…0.
        low, high: interval of the effect; None if there is none.
        places: number of places behind the effect.
        evidence: ids of frames under the condition that show it.
        places_needed: fresh places that a re-test needs; None: unknown.
        retest: YAML of a run that tests it again on fresh places; empty if the spec of the run is unknown.
    """

    id: str
    function: str
    triggering_condition: str
    reference_condition: str
    functional_insufficiency: str
    confirmed: bool
    effect: float
    low: float | None
    high: float | None
    places: int
    evidence: tuple[str, ...]
    places_needed: int | None
    retest: str


def register(findings: Findings) -> tuple[TriggeringCondition, ...]:
    """Return the entries: findings and candidates about one function and one factor.

    Comparisons of functions are not conditions. An interaction shows how the effect of a factor changes, not where a
    function is worse.
    """
    about = [
        finding for finding in (*findings.items, *findings.candidates) if finding.function and len(finding.steps) == 1
    ]
    return tuple(_entry(f"T{number}", finding) for number, finding in enumerate(about, 1))


def register_json(entries: tuple[TriggeringCondition, ...]) -> list[JsonObject]:
    """Return the entries as JSON values."""
    return [asdict(entry) for entry in entries]


def register_table(entries: tuple[TriggeringCondition, ...]) -> pa.Table:
    """Return the entries as a table; frames are separated by spaces."""
    rows = [{**asdict(entry), "evidence": " ".join(entry.evidence)} for entry in entries]
    return pa.Table.from_pylist(rows, schema=_SCHEMA)


_SCHEMA: Final = pa.schema(
    {
        "id": pa.string(),
        "function": pa.string(),
        "triggering_condition": pa.string(),
        "reference_condition": pa.string(),
        "functional_insufficiency": pa.string(),
        "confirmed": pa.bool_(),
        "effect": pa.float64(),
        "low": pa.float64(),
        "high": pa.float64(),
        "places": pa.int64(),
        "evidence": pa.string(),
        "places_needed": pa.int64(),
        "retest": pa.string(),
    }
)


def _entry(name: str, finding: Finding) -> TriggeringCondition:
    (step,) = finding.steps
    lower_after = finding.effect <= 0
    ends = (finding.low, finding.high) if lower_after else (_negative(finding.high), _negative(finding.low))
    before, after = _condition(step.factor, step.before), _condition(step.factor, step.after)
    return TriggeringCondition(
        id=name,
        function=finding.function,
        triggering_condition=after if lower_after else before,
        reference_condition=before if lower_after else after,
        functional_insufficiency=f"Finds fewer of a person's pixels. {finding.sentence}",
        confirmed=finding.confirmed,
        effect=-abs(finding.effect),
        low=ends[0],
        high=ends[1],
        places=finding.places,
        evidence=tuple(dict.fromkeys(pair[lower_after].frame_id for pair in finding.examples)),
        places_needed=finding.places_needed,
        retest=finding.spec,
    )


def _condition(factor: str, level: str) -> str:
    """Return a level with its factor, or the level alone where it starts with the factor: ``camera-3``."""
    return level if level.startswith(factor) else f"{factor} {level}"


def _negative(bound: float | None) -> float | None:
    return None if bound is None else -bound
