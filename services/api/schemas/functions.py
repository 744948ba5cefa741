"""Answers about functions under test and uploaded predictions."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, JsonValue

from services.api.schemas.base import DIGEST, FRAME_ID, Read
from valerie.runs.moments import Moment

_DOCUMENT: dict[str, JsonValue] = {
    "name": "my-net",
    "kind": "onnx",
    "payload": {"sha256": "e0" * 32, "bytes": 16_042_000, "format": "onnx"},
    "output": {"kind": "logits", "classes": ["road", "person", "everything else"]},
    "engine": "openvino",
    "precision": "fp32",
}
_CARD = [
    ["digest", DIGEST],
    ["kind", "onnx"],
    ["classes", "3: road, person, everything else → void"],
    ["input size", "the frame's own, padded to multiples of 32"],
]
_PROVENANCE = {"source": "my-net.onnx", "producer": "pytorch 2.13.0", "opset": "17"}


class FunctionRead(Read):
    name: str = Field(examples=["my-net"])
    digest: str = Field(
        description="digest of a registered version (32 characters), or of an installed function's file",
        examples=[DIGEST],
    )
    architecture: str = Field(examples=["onnx"])
    precision: str = Field(examples=["fp32"])
    engine: str = Field(examples=["openvino"])
    provenance: dict[str, str] = Field(examples=[_PROVENANCE])
    numeric_classes: list[str] = Field(
        description="numeric classes in which living workers offer it", examples=[["openvino-2026.4.1-cpu-fp32-amx-t2"]]
    )
    problem: str | None = Field(None, description="why it cannot be used; all other fields but the name are empty then")
    reference: str | None = Field(
        None,
        description="name of this version in a spec; null for an installed function",
        examples=[f"my-net@{DIGEST[:12]}"],
    )
    kind: str | None = Field(
        None,
        description="network, onnx, huggingface, http or predictions; null for a class of an installed package",
        examples=["onnx"],
    )
    version: int | None = Field(None, description="number of the version of a registered name", examples=[1])
    classes: list[str] | None = Field(
        None, description="Cityscapes classes that it can predict", examples=[["road", "person"]]
    )
    unmapped: list[str] | None = Field(
        None, description="its own classes that count as void", examples=[["everything else"]]
    )
    judged_by: list[str] = Field(
        [],
        description="Cityscapes classes that its scores over all classes cover; empty: all 19",
        examples=[["road", "person"]],
    )
    card: list[Annotated[list[str], Field(min_length=2, max_length=2)]] = Field(
        description="title and text of each row of its card, for people to read", examples=[_CARD]
    )
    created_at: Moment | None = Field(None, examples=["2026-11-21T06:40:00Z"])


class TrialRead(Read):
    """Result of running the function once."""

    numeric_class: str = Field(examples=["openvino-2026.4.1-cpu-fp32-amx-t1"])
    precision: str = Field(description="read back from the compiled model", examples=["fp32"])
    picture: tuple[int, int] = Field(description="width and height in pixels", examples=[[256, 128]])
    cpu_seconds: float = Field(description="of one picture", examples=[0.021])


class NoTrialRead(Read):
    """The reason why the function was not run."""

    skipped: str = Field(examples=["nothing to open: kind http"])


class FunctionDetail(FunctionRead):
    document: dict[str, JsonValue] | None = Field(
        None, description="of a registered version; see docs/functions.md", examples=[_DOCUMENT]
    )
    check: TrialRead | NoTrialRead | None = Field(
        None, description="result of the trial run; only in the answer to a registration"
    )


class PredictionRead(Read):
    frame_id: str = Field(examples=[FRAME_ID])
    new: bool = Field(description="false: the same label map was stored already", examples=[True])
