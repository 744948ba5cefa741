"""Rows of measures: visibility, light and scores of persons, and the scores of frames."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from sqlalchemy import Connection, bindparam, select

from valerie.db.long_table import COLUMNS
from valerie.db.models import PersonLight, PersonScore, PersonView
from valerie.measures import Cell, Measures, Source, names_from

SEEN: Final = names_from(Source.PLACE, Source.PIXELS)
LIT: Final = names_from(Source.LIGHT)
_SCORED: Final = names_from(Source.PERSON_SCORE)


@dataclass(frozen=True, slots=True)
class MeasuredPerson:
    """The light on a person, or a function's score on one: a row of `PersonLight` or `PersonScore`.

    Attributes:
        instance_id: label id × 1000 + n.
        measures: name to value, of the table.
    """

    instance_id: int
    measures: Measures

    @property
    def columns(self) -> Mapping[str, Cell]:
        """Column to value, without the product's digest."""
        return {"instance_id": self.instance_id, **self.measures}


@dataclass(frozen=True, slots=True)
class SeenPerson:
    """A person as visible in a picture: a row of `PersonView`.

    Attributes:
        instance_id: label id × 1000 + n; 0: a scene without persons.
        measures: name to value, of place and pixels; from queries that say so, also of light.
        box: x0, y0, x1, y1 of the visible pixels, end exclusive; None if no pixel is visible.
        amodal_box: the same for the person rendered alone.
    """

    instance_id: int
    measures: Measures
    box: list[int] | None
    amodal_box: list[int] | None

    @property
    def columns(self) -> Mapping[str, Cell | list[int]]:
        """Column to value, without the product's digest."""
        return {"instance_id": self.instance_id, **self.measures, "box": self.box, "amodal_box": self.amodal_box}


@dataclass(frozen=True, slots=True)
class FrameScore:
    """The scores of a function on a frame: a row of `Score`.

    Attributes:
        confusion: packed confusion matrix.
        tp, fn, tn: pixels of the class person.
        pacc: recall of the class person; None if the frame shows no person.
        measures: name to value, of the frame.
    """

    confusion: bytes
    tp: int
    fn: int
    tn: int
    pacc: float | None
    measures: Measures

    @property
    def figures(self) -> Measures:
        """Name to value, without the matrix."""
        return {"tp": self.tp, "fn": self.fn, "tn": self.tn, "pacc": self.pacc, **self.measures}

    @property
    def columns(self) -> Mapping[str, Cell | bytes]:
        """Column to value, without the product's digest."""
        return {"confusion": self.confusion, **self.figures}


#: Built once: building it takes longer than running it.
_VIEWS: Final = (
    select(PersonView.instance_id, PersonView.box, PersonView.amodal_box, *(COLUMNS[name] for name in SEEN))
    .where(PersonView.truth == bindparam("of_truth"))
    .order_by(PersonView.instance_id)
)


def person_views(connection: Connection, truth: str) -> list[SeenPerson]:
    """Read the visibility of the persons in one truth product."""
    return [
        SeenPerson(number, dict(zip(SEEN, values, strict=True)), box, amodal)
        for number, box, amodal, *values in connection.execute(_VIEWS, {"of_truth": truth})
    ]


def amodal_boxes(connection: Connection, truths: Collection[str]) -> dict[tuple[str, int], Sequence[int] | None]:
    """Read the amodal boxes of the persons in several truth products, by digest and instance id."""
    query = select(PersonView.truth, PersonView.instance_id, PersonView.amodal_box).where(PersonView.truth.in_(truths))
    return {(truth, number): box for truth, number, box in connection.execute(query)}


def person_lights(connection: Connection, product: str) -> list[MeasuredPerson]:
    """Read the light on the persons in one product of kind ``light``."""
    query = (
        select(PersonLight.instance_id, *(COLUMNS[name] for name in LIT))
        .where(PersonLight.product == product)
        .order_by(PersonLight.instance_id)
    )
    return [
        MeasuredPerson(number, dict(zip(LIT, values, strict=True))) for number, *values in connection.execute(query)
    ]


def person_scores(connection: Connection, scores: Sequence[str]) -> dict[str, list[MeasuredPerson]]:
    """Read the scores of each person, by the digest of the scores product."""
    query = (
        select(PersonScore.digest, PersonScore.instance_id, *(COLUMNS[name] for name in _SCORED))
        .where(PersonScore.digest.in_(scores))
        .order_by(PersonScore.digest, PersonScore.instance_id)
    )
    persons: dict[str, list[MeasuredPerson]] = {digest: [] for digest in scores}
    for digest, number, *values in connection.execute(query):
        persons[digest].append(MeasuredPerson(number, dict(zip(_SCORED, values, strict=True))))
    return persons
