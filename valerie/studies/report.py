"""One self-contained HTML page per study: the answer, the decisive pictures, the batches and their cost."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import jinja2

from valerie.analysis.report.pages import page_environment


@dataclass(frozen=True, slots=True)
class ShownPicture:
    """A frame of a decisive variant.

    Attributes:
        title: what the variant is.
        score, values, frame: of the variant, as text.
        jpeg: the picture with the errors of the function.
    """

    title: str
    score: str
    values: str
    frame: str
    jpeg: bytes

    @property
    def base64(self) -> str:
        """The picture as text for the page."""
        return base64.b64encode(self.jpeg).decode()


@dataclass(frozen=True, slots=True)
class ShownBatch:
    """A line of the table of batches; numbers are empty while they are unknown."""

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
    """Everything that the page shows, as text for people.

    Attributes:
        totals: variants, rejected, failed, without score and CPU time of all batches.
    """

    id: str
    name: str
    question: str
    state: str
    sentences: tuple[str, ...]
    pictures: tuple[ShownPicture, ...]
    batches: tuple[ShownBatch, ...]
    totals: tuple[str, ...]
    measure: str
    where: str
    document: str
    digest: str
    asset_digest: str


def build_report(source: StudyReport) -> str:
    """Write the page; equal input gives equal text."""
    style = files("valerie.analysis.report").joinpath("templates/report.css").read_text(encoding="utf-8")
    return _environment().get_template("study.html.j2").render(source=source, style=style)


@cache
def _environment() -> jinja2.Environment:
    return page_environment("valerie.studies")
