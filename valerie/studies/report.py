"""One self-contained HTML page per study: the answer, the decisive pictures, the batches and their cost."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Final

from valerie.analysis.report.pages import page_environment
from valerie.guided.map import Call
from valerie.studies.boundary import CELLS, ILLEGAL, BoundarySlice

#: Colours of the calls of a map.
_COLOURS: Final = {
    Call.PASS.value: "#56b4e9",
    Call.FAIL.value: "#d55e00",
    Call.UNDEFINED.value: "#cc79a7",
    Call.NOT_KNOWN.value: "#c9ced4",
    ILLEGAL: "#ffffff",
}


@dataclass(frozen=True, slots=True)
class ShownPicture:
    """A frame of a decisive variant, or the difference of two.

    Attributes:
        title: description of the variant.
        score, values, frame: of the variant, as text; a difference has no score, and its description instead of values.
        jpeg: the picture with the errors of the function, or the difference.
    """

    title: str
    score: str
    values: str
    frame: str
    jpeg: bytes

    @property
    def base64(self) -> str:
        """The picture in Base64."""
        return base64.b64encode(self.jpeg).decode()


@dataclass(frozen=True, slots=True)
class ShownBatch:
    """A row of the table of batches; unknown numbers are empty."""

    number: int
    run: str
    reason: str
    variants: int
    rejected: int
    failed: int | str
    undefined: int | str
    cost: str


@dataclass(frozen=True, slots=True)
class StudyReport:
    """The content of the page, as text.

    Attributes:
        ended: whether the study proposes no more.
        outlook: what is missing for the goal and its cost, in words; empty where nothing is, or it is not known.
        boundary: a slice of a map; None for the other goals.
        totals: variants, rejected, failed, without score and CPU time of all batches.
    """

    id: str
    name: str
    question: str
    state: str
    ended: bool
    sentences: tuple[str, ...]
    outlook: str
    boundary: BoundarySlice | None
    pictures: tuple[ShownPicture, ...]
    batches: tuple[ShownBatch, ...]
    totals: tuple[str, ...]
    measure: str
    where: str
    document: str
    digest: str
    asset_digest: str


def build_report(source: StudyReport) -> str:
    """Return the page; equal input gives equal text."""
    template = page_environment("valerie.studies").get_template("study.html.j2")
    return template.render(source=source, cells=CELLS, colours=_COLOURS)
