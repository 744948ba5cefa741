"""One self-contained HTML page per study: the answer, the decisive pictures, the batches and their cost."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from valerie.analysis.report.pages import page_environment
from valerie.guided.domain import BELOW_ONE, Domain, shown
from valerie.guided.map import Call
from valerie.parameters.definitions import Value
from valerie.parameters.distributions import Choice, Constant
from valerie.studies.boundary import CELLS, ILLEGAL, BoundarySlice
from valerie.studies.resolved import ResolvedStudy

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
        ended: True if the study proposes no more.
        outlook: what is missing for the goal and its cost, in words; empty where nothing is, or it is not known.
        boundary: a slice of a map; None for the other goals.
        domain: name, distribution and values of each varied parameter.
        conditions: name and value of what all variants share, such as the render engine.
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
    domain: tuple[tuple[str, str, str], ...]
    conditions: tuple[tuple[str, str], ...]
    document: str
    digest: str
    asset_digest: str


def build_report(source: StudyReport) -> str:
    """Return the page; equal input gives equal text."""
    template = page_environment("valerie.studies").get_template("study.html.j2")
    return template.render(source=source, cells=CELLS, colours=_COLOURS)


def domain_rows(domain: Domain) -> tuple[tuple[str, str, str], ...]:
    """Return name, distribution and values of each varied parameter: ends and median, or all choices."""
    rows = []
    for definition, variation in zip(domain.definitions, domain.variations, strict=True):
        distribution, unit = variation.distribution, f" {definition.unit}" if definition.unit else ""
        if isinstance(distribution, Choice | Constant):
            count = distribution.count(definition) or 1
            values = ", ".join(f"{shown(distribution.value(k, definition))}{unit}" for k in range(count))
        else:
            low, middle, high = (
                shown(value) for value in distribution.quantiles(np.array([0, 0.5, BELOW_ONE]), definition)
            )
            values = f"{low} to {high}{unit}, median {middle}{unit}"
        rows.append((definition.name, distribution.distribution.lower(), values))
    return tuple(rows)


def condition_rows(study: ResolvedStudy) -> tuple[tuple[str, str], ...]:
    """Return name and value of what all variants of a study share."""
    spec = study.document.spec
    constants = "; ".join(f"{name} {shown(value)}" for name, value in spec.constants.items())
    rows = {
        "Asset": _named(spec.asset),
        "Functions": ", ".join(spec.functions),
        "Render engine": "; ".join(map(_named, study.renderers)),
        "Cameras": ", ".join(study.run.cameras),
        "Resolution": f"{spec.resolution.width} × {spec.resolution.height}",
        "Constraints": "; ".join(spec.constraints),
        "Constants": constants,
    }
    return tuple((name, value) for name, value in rows.items() if value)


def _named(chosen: str | Mapping[str, Value]) -> str:
    """Format a name, or a mapping with a name and options."""
    return chosen if isinstance(chosen, str) else ", ".join(f"{name} {shown(value)}" for name, value in chosen.items())
