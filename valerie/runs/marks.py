"""Tags and notes that people put on a run, a frame or a finding. Neither is part of a spec, a digest or a result."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Final

from pydantic import Field, StringConstraints, field_validator

from valerie.document import Document

#: Most tags of one subject.
MAX_TAGS: Final = 20

#: A short word or a few: letters, digits, blanks and some signs.
Tag = Annotated[str, StringConstraints(pattern=r"^[\w][\w .:/+-]{0,39}$", strip_whitespace=True)]


class MarkKind(StrEnum):
    """A kind of thing that people mark."""

    RUN = "run"
    FRAME = "frame"
    FINDING = "finding"


class Subject(Document):
    """A run, or a part of it.

    Attributes:
        kind: of the part.
        name: of a frame ``variant.camera.time``, of a finding its sentence; empty for the run.
    """

    kind: MarkKind = MarkKind.RUN
    name: Annotated[str, Field(max_length=1000)] = ""


class Mark(Document):
    """Tags and a note; one without either is no mark.

    Attributes:
        tags: each once, sorted.
        note: text for people.
    """

    tags: Annotated[tuple[Tag, ...], Field(max_length=MAX_TAGS)] = ()
    note: Annotated[str, StringConstraints(max_length=10_000, pattern=r"^[^\x00]*$")] = ""

    @field_validator("tags")
    @classmethod
    def _sort(cls, tags: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(sorted(set(tags)))

    def __bool__(self) -> bool:
        return bool(self.tags or self.note)
