"""Input of a report. A report reads nothing else, so equal input gives equal bytes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from typing import Protocol

from valerie.analysis.claims.claims import Claims
from valerie.analysis.claims.ledger import LedgerEntry
from valerie.analysis.comparison.beside import Beside
from valerie.analysis.findings.findings import Findings
from valerie.analysis.findings.importance import Explanation, explanations
from valerie.analysis.report.odd import OddCoverage
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.summary.summary import Summary
from valerie.analysis.trends.trends import Trends
from valerie.analysis.verdicts.verdicts import RequirementVerdict
from valerie.perception.base import FunctionCard
from valerie.plain import JsonObject
from valerie.runs.products.pictures import PictureKind


class PictureSource(Protocol):
    """Reader of the gallery's pictures, for example from the artifact store."""

    def __call__(
        self, frame_id: str, kind: PictureKind, *, sensor: str, function: str | None, person: int | None = None
    ) -> bytes | None:
        """Return a JPEG, PNG or WebP file; None if its products are gone.

        Args:
            frame_id: id of the frame in the table.
            kind: the plain picture, the picture under an overlay of truth or prediction, or the errors at a person from near.
            sensor: name of the sensor setting.
            function: name of the function for a prediction and a close-up; None for the other kinds.
            person: instance id of the person for a close-up; None for the other kinds.
        """
        ...


@dataclass(frozen=True, slots=True)
class Provenance:
    """Origin of the results, complete enough to reproduce them.

    Attributes:
        run_id, spec_digest, seed: of the run.
        asset, asset_digest: name and digest of the asset.
        renderer: name and revision of the engine.
        resolution: (width, height) in pixels.
        numeric_classes: stage to its numeric class (driver, inference engine, precision).
        functions: the functions under test.
        software: name and version of the program.
        submitted, finished: times with time zone; ``finished`` is None while work remains.
        more: further facts: title to text.
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
        stage: for example ``image`` or ``prediction``.
        error: recorded message.
        attempts: number of attempts.
        count: number of products.
        example: id of one of them, for example of a frame.
    """

    stage: str
    error: str
    attempts: int
    count: int = 1
    example: str = ""


@dataclass(frozen=True)
class ReportInput:
    """Everything that a report shows.

    Attributes:
        document: the run's spec as JSON values; its ``name`` is the title of the report.
        provenance: origin of the results.
        table, summary, trends, findings: the results.
        variants: number of variants of the run, rejected ones included.
        frames: number of frames planned for the variants that were not rejected.
        verdicts: verdicts on the run's requirements.
        rejections: reason to number of rejected variants.
        failures: products that failed for good.
        picture: reads the gallery's pictures; None for a report without gallery.
        claims: claims, numbers and pictures of a source to compare with the run.
        ledger: the answers to its claims.
        beside: comparison with another run of the same scenes.
        odd: coverage of the operational design domain; None where nobody asked.
    """

    document: JsonObject
    provenance: Provenance
    table: EvaluationTable
    summary: Summary
    trends: Trends
    findings: Findings
    variants: int
    frames: int
    verdicts: tuple[RequirementVerdict, ...] = ()
    rejections: Mapping[str, int] = field(default_factory=dict)
    failures: tuple[Failure, ...] = ()
    picture: PictureSource | None = None
    claims: Claims | None = None
    ledger: tuple[LedgerEntry, ...] = ()
    beside: Beside | None = None
    odd: OddCoverage | None = None

    @cached_property
    def explained(self) -> tuple[Explanation, ...]:
        """What explains the pACC of each function, computed once for the page and its figures."""
        return explanations(self.table, seed=self.trends.seed)
