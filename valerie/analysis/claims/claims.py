"""Documents of claims: statements of a paper, a data sheet or a colleague, with their tests (`examples/claims/paper.yaml`)."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from valerie.document import Document
from valerie.validation import problems_of

Text = Annotated[str, Field(min_length=1, max_length=2_000)]
Name = Annotated[str, Field(min_length=1, max_length=128)]
Number = Annotated[float, Field(allow_inf_nan=False)]


Statistic = Literal["mean", "minimum", "maximum", "share"]


class QuantityTest(Document):
    """A statistic of the rows is in a range: their mean, smallest or largest value, or the share above a value."""

    of: Name
    statistic: Statistic = "mean"
    above: Number | None = None
    low: Number | None = None
    high: Number | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.statistic == "share") != (self.above is not None):
            raise ValueError("`above` belongs to a share, and a share needs it")
        if self.low is None and self.high is None:
            raise ValueError("needs `low`, `high` or both")
        return self


class DifferenceTest(Document):
    """The score at one level of a factor minus that at another, everything else equal.

    ``sign`` is ``>``, ``<`` or ``=``; for ``=`` the interval must be within ± ``within``.
    """

    factor: Name
    first: Name
    second: Name
    sign: Literal["<", ">", "="]
    within: Annotated[float, Field(gt=0, lt=1)] = 0.05


class DepartureTest(Document):
    """The score stays level up to ``at`` on an axis and then changes by more than ``by``."""

    over: Name
    at: Number
    tolerance: Annotated[float, Field(ge=0)]
    by: Annotated[float, Field(gt=0, lt=1)] = 0.1


class TrendTest(Document):
    """The score rises, falls or stays level over an axis."""

    over: Name
    shape: Literal["rising", "falling", "level"]


class FlipTest(Document):
    """Some pair of rows that differs only in one factor differs in its score by at least ``at_least``."""

    factor: Name
    first: Name
    second: Name
    at_least: Annotated[float, Field(gt=0, le=1)]


class Claim(Document):
    """One statement and its test.

    Attributes:
        id: identifies the claim.
        source: place in the source, such as ``6.2.2``.
        says: the statement in the source's words.
        where: expression that selects its rows; empty: all.
        without: rows of blocks that set one of these parameters are left out; None: those of the document.
        functions: the functions that it is about; empty: every function of the run.
        quantity, difference, departure, trend, flip: the test.
        untestable: instead of a test, the reason why a run cannot test it.
        slip: instead of a test, the reason why the statement must be an error of the source.
    """

    id: Name
    source: str = ""
    says: Text
    where: str = Field(default="", max_length=2_000)
    without: tuple[Name, ...] | None = None
    functions: tuple[Name, ...] = ()
    quantity: QuantityTest | None = None
    difference: DifferenceTest | None = None
    departure: DepartureTest | None = None
    trend: TrendTest | None = None
    flip: FlipTest | None = None
    untestable: str = ""
    slip: str = ""

    @model_validator(mode="after")
    def _one_test(self) -> Self:
        tests = ("quantity", "difference", "departure", "trend", "flip", "untestable", "slip")
        if sum(bool(getattr(self, name)) for name in tests) != 1:
            raise ValueError(f"needs exactly one of {', '.join(tests)}")
        return self


class Printed(Document):
    """A number that the source prints, which the report compares with the run's.

    Attributes:
        source: place in the source, such as ``table 2``.
        what: description.
        of, statistic, above: the number, as in `Quantity`.
        value: as printed, in the column's unit.
        where, without, functions: as in `Claim`.
    """

    source: str = ""
    what: Text
    of: Name
    statistic: Statistic = "mean"
    above: Number | None = None
    value: Number
    where: str = Field(default="", max_length=2_000)
    without: tuple[Name, ...] | None = None
    functions: tuple[Name, ...] = ()


class Cross(Document):
    """Pictures of one view under the levels of two factors, everything else equal.

    Attributes:
        source: place in the source that shows such pictures.
        title: heading.
        down, across: the factors.
        where, without: selection of the rows that may be shown, as in `Claim`.
        published: the source's own table, line by line; the first line is the head.
    """

    source: str = ""
    title: Text
    down: Name
    across: Name
    where: str = Field(default="", max_length=2_000)
    without: tuple[Name, ...] | None = None
    published: tuple[tuple[str | Number, ...], ...] = ()


class Claims(Document):
    """A document of claims.

    Attributes:
        title: title of the source.
        source: reference to the source.
        without: parameters that the source does not vary: rows of blocks that set one are left out, unless a claim, number
            or cross says otherwise.
        claims: its statements.
        numbers: numbers that it prints.
        crosses: pictures like those that it shows.
    """

    title: Text
    source: str = ""
    without: tuple[Name, ...] = ()
    claims: Annotated[tuple[Claim, ...], Field(min_length=1, max_length=1_000)]
    numbers: Annotated[tuple[Printed, ...], Field(max_length=1_000)] = ()
    crosses: Annotated[tuple[Cross, ...], Field(max_length=100)] = ()


def parse_claims(document: object) -> Claims:
    """Check a document of claims.

    Raises:
        InvalidInputs: every problem of the document, with its place.
    """
    try:
        return Claims.model_validate(document)
    except ValidationError as error:
        raise problems_of(error) from None
