"""What a report is made of: everything is handed in, nothing is looked up, so that equal input gives equal bytes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from typing import Protocol

from valerie.analysis.findings import Findings
from valerie.analysis.summary import Summary
from valerie.analysis.table import EvaluationTable
from valerie.analysis.trends import Trends
from valerie.perception.base import FunctionCard


class PictureKind(StrEnum):
    PICTURE = "picture"
    TRUTH = "truth"
    PREDICTION = "prediction"


class PictureSource(Protocol):
    """Gives the pictures of the gallery, e.g. from the artifact store."""

    def __call__(self, frame_id: str, kind: PictureKind, *, sensor: str, function: str | None) -> bytes | None:
        """A JPEG, PNG or WebP file; None where it is not to be had any more.

        Args:
            frame_id: the frame, as in the table.
            kind: the picture, or the picture with the truth or the prediction laid over it.
            sensor: the sensor setting that made the picture.
            function: whose prediction; None for the other kinds.
        """
        ...


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where the results come from: enough to make them again.

    Attributes:
        run_id, spec_digest: of the run.
        seed: of the spec.
        asset, asset_digest: the scene.
        renderer: name and revision of the engine.
        resolution: (width, height) pixels.
        numeric_classes: stage → what its numbers depend on besides the revision (driver, inference engine, precision).
        functions: the functions under test.
        software: name and version of the program.
        submitted, finished: with time zone; ``finished`` is None while work remains.
        more: further facts, shown as they are.
    """

    run_id: str
    spec_digest: str
    seed: int
    asset: str
    asset_digest: str
    renderer: str
    resolution: tuple[int, int]
    numeric_classes: Mapping[str, str]
    functions: tuple[FunctionCard, ...]
    software: str
    submitted: datetime
    finished: datetime | None = None
    more: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Failure:
    """Products that failed for good in the same way.

    Attributes:
        stage: e.g. ``image``, ``prediction``.
        error: the message, as recorded.
        attempts: how often the work was tried.
        count: how many products.
        example: one of them, e.g. a frame id.
    """

    stage: str
    error: str
    attempts: int
    count: int = 1
    example: str = ""


@dataclass(frozen=True, slots=True)
class ReportInput:
    """All of a report.

    Attributes:
        document: the run's spec as plain JSON types; its ``name`` is the title.
        provenance: see there.
        table, summary, trends, findings: the numbers.
        variants: number of variants of the run, rejected ones included.
        frames: number of frames planned for the variants that were not rejected.
        rejections: variants that were not rendered, by reason.
        failures: what failed for good.
        picture: gives the gallery's pictures; None for a report without gallery.
    """

    document: Mapping[str, object]
    provenance: Provenance
    table: EvaluationTable
    summary: Summary
    trends: Trends
    findings: Findings
    variants: int
    frames: int
    rejections: Mapping[str, int] = field(default_factory=dict)
    failures: tuple[Failure, ...] = ()
    picture: PictureSource | None = None
