"""Questions and answers about specs that are being written."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from services.api.schemas.base import Read
from valerie.loading import MAX_BYTES
from valerie.parameters.definitions import Value
from valerie.runs.document.draft import Change
from valerie.runs.forecasting.plan import PlannedVariant

_TEXT = "name: first\nasset: urban-street\nvary:\n  person-1.pos.x: {homogeneous: {from: 1, to: 5, step: 1}}\n"
_VARIED = {"parameter": "person-1.pos.x", "distribution": "HOMOGENEOUS", "minimum": 1, "maximum": 5, "step": 1}


class DraftChanges(BaseModel):
    """A text, and what a form changes in it."""

    model_config = ConfigDict(extra="forbid")

    text: Annotated[str, Field(max_length=MAX_BYTES, description="YAML or JSON", examples=[_TEXT])]
    changes: Annotated[
        list[Change],
        Field(max_length=100, examples=[[{"kind": "field", "field": "name", "value": "second"}]]),
    ] = []


class VariedRead(Read):
    place: str = Field(description="dotted, as problems name it", examples=["vary.person-1.pos.x"])
    document: dict[str, JsonValue] = Field(description="in canonical form", examples=[_VARIED])


class DraftRead(Read):
    """A draft after its changes, as a form shows it."""

    text: str = Field(examples=[_TEXT])
    fields: dict[str, JsonValue] = Field(
        description="values at the top level, as written", examples=[{"name": "first", "asset": "urban-street"}]
    )
    vary: list[VariedRead] = Field(description="varied parameters of a run with one block")
    several_blocks: bool = Field(description="a form cannot show its parameters", examples=[False])
    lines: dict[str, int] = Field(
        description="dotted place to the number of its line", examples=[{"name": 1, "asset": 2, "vary": 3}]
    )


class PreviewPicture(Read):
    variant: PlannedVariant = Field(
        examples=[{"index": 0, "values": {"person-1.pos.x": 1.0}, "sun": None, "rejection": None}]
    )
    picture: str | None = Field(description="PNG in base 64; null for a rejected variant", examples=["iVBORw0KGgo="])


class PreviewRead(Read):
    variants: list[PreviewPicture] = Field(description="in the order of the request")
    engine: str = Field(description="that rendered", examples=["raster"])
    draft: dict[str, Value] = Field(
        description="its settings that replace those of the spec", examples=[{"samples": 8, "denoise": True}]
    )
    problem: str | None = Field(
        description="why another engine than the spec's rendered; null if none did",
        examples=["there is no Blender environment"],
    )
