"""Answers about the results of a run: the long table, points to plot, the summary."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import ConfigDict, Field, JsonValue, computed_field

from services.api.schemas.base import CAMERAS, FUNCTION, NextCursor, Read, measured
from valerie.analysis.findings.findings import Findings
from valerie.analysis.findings.wording import searched_sentence
from valerie.analysis.summary.summary import Summary
from valerie.analysis.summary.wording import certainty_sentences
from valerie.analysis.verdicts.text import sentence
from valerie.analysis.verdicts.verdicts import RequirementVerdict
from valerie.measures import Source


class EvaluationRow(measured(*Source)):  # type: ignore[misc]  # the fields are those of the measures
    """One person in one evaluation; further members are the run's varied parameters, named by their paths.

    In a run that accepts several numeric classes also ``render_class``, ``truth_class`` and ``infer_class``.
    """

    model_config = ConfigDict(extra="allow")


class EvaluationPage(Read):
    items: list[EvaluationRow]
    total: int = Field(description="rows that currently pass the filters", examples=[30])
    next: NextCursor


class PlotAxis(Read):
    column: str = Field(
        description="of the long table: a measure, or the path of a varied parameter", examples=["distance_m"]
    )
    title: str = Field(examples=["distance"])
    unit: str = Field(description="shown after numbers that were multiplied by `scale`; may be empty", examples=["m"])
    scale: float = Field(examples=[1.0])
    group: Literal["person", "conditions", "varied"] = Field(examples=["person"])


class PointColumns(Read):
    """Points of a scatter plot, column by column: the i-th entries belong together."""

    column: str = Field(examples=["distance_m"])
    functions: list[str] = Field(examples=[[FUNCTION]])
    sensors: list[str] = Field(examples=[["default"]])
    cameras: list[str] = Field(examples=[CAMERAS])
    characters: list[str] = Field(examples=[["yellow-shirt"]])
    x: list[float] = Field(description="values of the column", examples=[[17.09]])
    pacc: list[float] = Field(examples=[[0.9041]])
    variant: list[int] = Field(examples=[[5]])
    camera: list[int] = Field(
        description="position in `cameras`; sensor, function and character are positions in their lists", examples=[[0]]
    )
    time: list[int] = Field(description="time index", examples=[[0]])
    sensor: list[int] = Field(examples=[[0]])
    function: list[int] = Field(examples=[[0]])
    character: list[int] = Field(description="-1 for a person without character", examples=[[0]])
    instance: list[int] = Field(examples=[[24001]])
    undefined: dict[str, int] = Field(
        description="persons in frames without a pACC, by reason", examples=[{"fully hidden": 2}]
    )
    share: float = Field(
        description="share of the variants that is shown; below 1 it is an even sample", examples=[1.0]
    )
    axes: list[PlotAxis] = Field(description="columns that this run's pACC can be plotted over")


INTERVAL: Final[dict[str, JsonValue]] = {
    "low": 0.83,
    "high": 0.905,
    "estimate": 0.871,
    "level": 0.95,
    "units": 30,
    "method": "Student's t of units",
    "estimand": "design_box",
}


class SummaryRead(Read):
    """The verdicts on the run's requirements, the table of the paper's section 6.2, and the findings."""

    verdicts: list[RequirementVerdict] = Field(
        description="one for each requirement and function",
        examples=[
            [
                {
                    "id": "SYS-214",
                    "text": "Pedestrians up to 30 m ahead are found.",
                    "statistic": "share(pacc >= 0.5) >= 95 %",
                    "where": "distance_m <= 30",
                    "confidence": 0.95,
                    "function": FUNCTION,
                    "outcome": "undecided",
                    "reason": "the variants are too few for this estimate",
                    "further": 320,
                    "quantity": "share(pacc >= 0.5)",
                    "sign": ">=",
                    "bound": 0.95,
                    "estimate": 0.98,
                    "worst": None,
                    "best": None,
                    "basis": "the space that the variants were drawn from",
                    "method": "sequential test by variant, 95 % confidence at any number of variants",
                    "units": 50,
                    "decided_after": None,
                    "of": "persons",
                    "rows": 100,
                    "undefined": {"fully hidden": 2},
                    "too_small": 0,
                    "lost": 0,
                    "threshold": 0.5,
                    "missed": [{"low": 25.0, "high": 30.0, "persons": 20, "missed": 2}],
                }
            ]
        ],
    )

    summary: Summary = Field(
        examples=[
            {
                "threshold": 0.5,
                "frames": 30,
                "rows": [
                    {
                        "function": FUNCTION,
                        "sensor": "default",
                        "character": "yellow-shirt",
                        "frames": 30,
                        "persons": 30,
                        "defined": 28,
                        "undefined": {"fully hidden": 2},
                        "pacc_mean": 0.871,
                        "pacc_mean_interval": INTERVAL,
                        "pacc_mean_spread": None,
                        "pacc_min": 0.312,
                        "pacc_max": 0.984,
                        "pacc_pooled": 0.889,
                        "pacc_pooled_interval": {**INTERVAL, "low": 0.842, "high": 0.921, "estimate": 0.889},
                        "precision_mean": 0.842,
                        "precision_pooled": 0.851,
                        "iou_mean": 0.748,
                        "iou_pooled": 0.769,
                        "detected": 26,
                        "detection_rate": 0.9286,
                        "detection_interval": {
                            "reason": "few",
                            "more_units": 2,
                            "estimate": 0.9286,
                            "units": 4,
                            "worth": 4.0,
                            "estimand": "design_box",
                        },
                        "detection_spread": None,
                    }
                ],
                "occlusion": [{"character": "yellow-shirt", "persons": 30, "occluded": 4}],
                "empty": [],
                "classes": [],
            }
        ]
    )
    findings: Findings = Field(
        examples=[
            {
                "items": [],
                "candidates": [],
                "comparisons": 6,
                "level": 0.95,
                "places_searched": 6,
                "places_confirming": 6,
                "notes": [],
            }
        ]
    )

    @computed_field(  # type: ignore[prop-decorator]
        description="what the intervals and spreads of the rows are of, and why intervals are missing",
        examples=[["[95 % interval] for the space that the design draws from, from 30 variants."]],
    )
    @property
    def certainty(self) -> list[str]:
        return certainty_sentences(self.summary)

    @computed_field(  # type: ignore[prop-decorator]
        description="how the findings were searched, and whether any is confirmed",
        examples=["6 comparisons searched in 6 places, judged in 6 others with 95 % confidence for all together."],
    )
    @property
    def searched(self) -> str:
        return searched_sentence(self.findings)

    @computed_field(  # type: ignore[prop-decorator]
        description="each verdict in words",
        examples=[
            ["The share of persons with pACC ≥ 0.5 is 98.0 %; at least 95 % is required. The variants are too few."]
        ],
    )
    @property
    def judged(self) -> list[str]:
        return [sentence(verdict) for verdict in self.verdicts]
