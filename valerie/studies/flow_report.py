"""One self-contained HTML page for a validation flow: figure 3 of the paper, with what each of its stages did."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from valerie.analysis.report.pages import page_environment
from valerie.studies.report import ShownPicture


class StageState(StrEnum):
    """State of a stage, and its class in the page."""

    DONE = "done"
    WORKING = "working"
    OPEN = "open"


@dataclass(frozen=True, slots=True)
class ShownStage:
    """A box of the flow.

    Attributes:
        name: what is done.
        state: True if it has been done.
        facts: its outcome in words.
    """

    name: str
    state: StageState
    facts: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ShownRound:
    """A round: its stages in order, and its row of the table.

    Attributes:
        number: from 1.
        function: the version that is verified.
        verdict: met, not met or undecided; empty before.
        estimate: share of variants that pass, or mean score, as text.
        variants, frames, training_frames: numbers as text.
        cpu: CPU time of studies and of the training, as text.
        pictures: frames of failures.
    """

    number: int
    function: str
    stages: tuple[ShownStage, ...]
    verdict: str
    estimate: str
    variants: str
    frames: str
    training_frames: str
    cpu: tuple[str, str]
    pictures: tuple[ShownPicture, ...] = ()


@dataclass(frozen=True, slots=True)
class FlowReport:
    """The content of the page, as text.

    Attributes:
        going: True while the flow goes on; the page then reloads itself.
        totals: the last five columns of the table, over all rounds.
    """

    name: str
    requirement: str
    state: str
    going: bool
    rounds: tuple[ShownRound, ...]
    totals: tuple[str, ...]
    notes: tuple[str, ...]
    document: str
    digest: str


def build_flow_report(source: FlowReport) -> str:
    """Write the page; equal input gives equal text."""
    return page_environment("valerie.studies").get_template("flow.html.j2").render(source=source)
