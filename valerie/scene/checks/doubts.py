"""Doubts of the check of an asset, for people and for machines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import TypedDict

from valerie.errors import InvalidInput, InvalidInputs


class Severity(StrEnum):
    """The severity of a doubt."""

    ERROR = "error"  #: runs with the asset are refused or fail
    WARNING = "warning"  #: runs work, but probably not as intended
    NOTE = "note"  #: something was left out or filled in


class DoubtDocument(TypedDict):
    """A doubt as plain data, with its value and its limit as text."""

    severity: str
    code: str
    where: str
    message: str
    value: str | None
    limit: str | None


@dataclass(frozen=True, slots=True)
class Doubt:
    """One doubt.

    Attributes:
        severity: error, warning or note.
        code: kind of doubt, for machines: ``inside-solid``, ``out-of-view`` ….
        where: file, node or field; empty for the whole asset.
        message: the problem and its remedy.
        value: the offending value.
        limit: the expected value.
    """

    severity: Severity
    code: str
    where: str
    message: str
    value: object = None
    limit: object = None

    def __str__(self) -> str:
        return f"{self.severity}: {InvalidInput(self.message, field=self.where, value=self.value, limit=self.limit)}"

    def document(self) -> DoubtDocument:
        """Return the doubt as plain data."""
        return {
            "severity": str(self.severity),
            "code": self.code,
            "where": self.where,
            "message": self.message,
            "value": None if self.value is None else str(self.value),
            "limit": None if self.limit is None else str(self.limit),
        }


def from_error(error: InvalidInput, code: str, *, file: str = "") -> Iterator[Doubt]:
    """Yield a doubt for each problem of an error.

    Args:
        error: raised while the asset was read.
        file: the place if the error has no field.
    """
    if isinstance(error, InvalidInputs):
        for problem in error.problems:
            yield from from_error(problem, code, file=file)
        return
    yield Doubt(Severity.ERROR, code, error.field or file, error.message, error.value, error.limit)
