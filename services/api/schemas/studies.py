"""Answers about studies and their batches."""

from __future__ import annotations

from typing import Final

from pydantic import Field, JsonValue

from services.api.schemas.base import DIGEST, RUN_ID, Digest, NextCursor, Read
from valerie.runs.forecasting.plan import Plan
from valerie.runs.moments import Moment
from valerie.runs.study.study_document import Budget, Outcomes, StudyResult, StudyState

STUDY_ID: Final = "s1ng219w3v1ks"
#: A study in the notation of its file.
STUDY: Final[dict[str, JsonValue]] = {
    "name": "how often",
    "asset": "urban-street",
    "vary": [["person-1.pos.x", "UNIFORM", -3, 5], ["person-1.pos.y", "GAUSSIAN", 15, 8]],
    "functions": ["deeplabv3plus-small"],
    "measure": "min(pacc) >= 0.5",
    "goal": "estimate",
    "budget": {"variants": 256},
}
REASON: Final = (
    "No score is known yet. How often variants fail is open, and the model needs the first 64. 32 points as they occur in "
    "operation estimate the rate without any model."
)


class BatchCounts(Read):
    failed: int = Field(description="variants with a score below the bound of the measure", examples=[3])
    passed: int = Field(examples=[28])
    undefined: int = Field(description="legal variants without a score", examples=[1])


class BatchRead(Read):
    number: int = Field(description="from 0", examples=[0])
    reason: str = Field(
        description="why these variants: what was known, what is uncertain, what they decide", examples=[REASON]
    )
    count: int = Field(description="variants requested from the strategy", examples=[32])
    legal: int = Field(description="variants that count in the budget", examples=[32])
    rejected: list[int] = Field(description="indexes of rejected variants", examples=[[]])
    basis: Digest = Field(description="digest of everything that the proposal depends on")
    based_on: int = Field(description="it depends on the outcomes of the batches before this one", examples=[0])
    accepted_at: Moment | None = Field(description="null until it is accepted")
    run_id: str | None = Field(examples=[RUN_ID])
    outcomes: Outcomes | None = Field(
        description="scores, null where undefined; null until the run ends",
        examples=[{"scores": [0.93, 0.12, None], "second": [], "rejected": []}],
    )
    counts: BatchCounts | None = Field(
        description="outcomes of the legal variants; null until the run ends",
        examples=[{"failed": 3, "passed": 28, "undefined": 1}],
    )
    cpu_seconds: float | None = Field(description="CPU seconds spent on its run", examples=[41.5])


class StudyRead(Read):
    id: str = Field(examples=[STUDY_ID])
    name: str = Field(examples=["how often"])
    state: StudyState = Field(examples=["running"])
    reason: str | None = Field(description="what it waits for, or why it ended")
    by_hand: bool = Field(description="a person accepts each batch", examples=[False])
    goal: str = Field(examples=["estimate"])
    question: str = Field(description="the goal in words", examples=["How often does a variant fail?"])
    measure: str = Field(description="score of a variant and its bound", examples=["min(pacc) >= 0.5"])
    where: str = Field(description="rows that count; empty: all", examples=["distance_m <= 30"])
    budget: Budget = Field(examples=[{"variants": 256, "cpu_hours": None, "deadline": None}])
    result: StudyResult | None = Field(
        description="result so far; null before the first batch has ended",
        examples=[
            {
                "sentences": [
                    "Of the legal variants, 3.10% (1.20% to 6.60%, 95 % confidence) fail, by 128 operational points alone."
                ],
                "numbers": {"evaluations": 128},
                "batches": 4,
            }
        ],
    )
    asset_digest: Digest = Field(examples=[DIGEST])
    created_at: Moment = Field(examples=["2026-11-21T02:43:08Z"])
    finished_at: Moment | None


class StudyDetail(StudyRead):
    document: str = Field(description="the study as the text of a file", examples=["name: how often\n…"])
    left: int = Field(description="variants left in the budget", examples=[128])
    outlook: str | None = Field(
        description="what is missing for the goal, with its cost at the mean price so far; null where that is not known",
        examples=["About 120 further variants, 14 min 2 s of CPU time, are expected to reach the goal."],
    )
    batches: list[BatchRead]


class StudyPage(Read):
    items: list[StudyRead]
    next: NextCursor


class StudyTemplate(Read):
    text: str = Field(
        description="a commented study as YAML", examples=["# A study of VALERIE …\nname: my-first-study\n…"]
    )


class NextBatchRead(Read):
    number: int = Field(description="from 0", examples=[0])
    reason: str = Field(examples=[REASON])
    legal: int = Field(examples=[32])
    rejected: int = Field(examples=[0])
    accepted: bool = Field(description="false while it waits for a person", examples=[False])
    run_id: str | None = Field(examples=[RUN_ID])
    spec: str = Field(description="of its run, as the text of a file", examples=["name: how often, batch 1\n…"])
    plan: Plan = Field(description="size and cost of its run")
