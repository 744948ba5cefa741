"""Questions and answers about tags and notes."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from services.api.schemas.base import Read
from valerie.runs.marks import MAX_TAGS, MarkKind, Subject, Tag
from valerie.runs.moments import Moment

_KIND = "what is marked"
_NAME = "of a frame variant.camera.time, of a finding its sentence; empty for the run"
_NOTE = "Persons in the dark coat are missed here."


class MarkPut(BaseModel):
    """The tags and the note that a subject shall have; empty ones remove its mark."""

    model_config = ConfigDict(extra="forbid")

    kind: MarkKind = Field(MarkKind.RUN, description=_KIND, examples=["frame"])
    name: str = Field("", max_length=1000, description=_NAME, examples=["12.0.0"])
    tags: Annotated[list[Tag], Field(max_length=MAX_TAGS, examples=[["night"]])] = []
    note: str = Field("", max_length=10_000, pattern=r"^[^\x00]*$", examples=[_NOTE])

    @property
    def subject(self) -> Subject:
        return Subject(kind=self.kind, name=self.name)


class MarkRead(Read):
    kind: MarkKind = Field(description=_KIND, examples=["frame"])
    name: str = Field(description=_NAME, examples=["12.0.0"])
    tags: list[str] = Field(examples=[["night"]])
    note: str = Field(examples=[_NOTE])
    changed_at: Moment = Field(examples=["2026-11-21T02:43:08Z"])
