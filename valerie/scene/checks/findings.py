"""One thing that the check of an asset found, in a form for people and for machines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from valerie.errors import InvalidInput, InvalidInputs


class Severity(StrEnum):
    """How bad a finding is."""

    ERROR = "error"  #: runs with the asset are refused or fail
    WARNING = "warning"  #: runs work, but hardly as their author means
    NOTE = "note"  #: what was left out or filled in


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was found.

    Attributes:
        severity: how bad it is.
        code: what kind of thing, for machines: ``inside-solid``, ``out-of-view`` ….
        where: file, node or field; empty where the whole asset is meant.
        message: what is wrong, and what to do about it.
        value: what was found.
        limit: what would have been expected.
    """

    severity: Severity
    code: str
    where: str
    message: str
    value: object = None
    limit: object = None

    def __str__(self) -> str:
        return f"{self.severity}: {InvalidInput(self.message, field=self.where, value=self.value, limit=self.limit)}"

    def document(self) -> dict[str, Any]:
        """Plain data; ``value`` and ``limit`` as text, None where there is none."""
        return {
            "severity": str(self.severity),
            "code": self.code,
            "where": self.where,
            "message": self.message,
            "value": None if self.value is None else str(self.value),
            "limit": None if self.limit is None else str(self.limit),
        }


def from_error(error: InvalidInput, code: str, *, file: str = "") -> Iterator[Finding]:
    """The findings that an error stands for: one for each of its problems.

    Args:
        error: raised while the asset was read.
        code: of the findings.
        file: where the error's own field does not tell.
    """
    if isinstance(error, InvalidInputs):
        for problem in error.problems:
            yield from from_error(problem, code, file=file)
        return
    yield Finding(Severity.ERROR, code, error.field or file, error.message, error.value, error.limit)
