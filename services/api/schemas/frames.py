"""Answers about variants and frames."""

from __future__ import annotations

from pydantic import Field

from services.api.schemas.base import (
    ASSIGNMENT,
    FRAME_ID,
    FUNCTION,
    NUMERIC_CLASS,
    RUN_ID,
    UNITS,
    Digest,
    NextCursor,
    Read,
    measured,
)
from valerie.measures import OF_PERSON, Source
from valerie.parameters.definitions import Value

_INFER_CLASS = "openvino-2026.4.1-cpu-fp32-amx-t1"
_STATE = "done, failed, or the state of the slowest of its products"
_IMAGE = f"/v1/frames/{FRAME_ID}/image"
_BOX = [516, 242, 552, 371]


class VariantRead(Read):
    index: int = Field(examples=[5])
    block: int = Field(examples=[0])
    assignment: dict[str, Value] = Field(description="path to value; angles in degrees", examples=[ASSIGNMENT])
    rejection: str | None = Field(description="why it has no frames; null for an accepted variant")


class VariantPage(Read):
    items: list[VariantRead]
    next: NextCursor


class FrameRead(Read):
    id: str = Field(examples=[FRAME_ID])
    variant_index: int = Field(examples=[5])
    camera: str = Field(examples=["camera-1"])
    time_index: int = Field(examples=[0])
    time_s: float = Field(description="time of the frame in seconds; 0 in a run without time", examples=[0.0])
    background: Digest
    layer: Digest
    truth: Digest
    state: str = Field(description=_STATE, examples=["done"])
    removed: str | None = Field(description="why pictures of it are gone since its run completed; null: none is")


class FramePage(Read):
    items: list[FrameRead]
    next: NextCursor


class PersonRead(measured(*OF_PERSON)):  # type: ignore[misc]  # the fields are those of the measures
    instance_id: int = Field(description="label id × 1000 + n; 0 stands for a scene without persons", examples=[24001])
    character: str | None = Field(examples=["yellow-shirt"])
    box: list[int] | None = Field(
        description="x0, y0, x1, y1 of the visible pixels, end exclusive; null if none is visible", examples=[_BOX]
    )
    amodal_box: list[int] | None = Field(description="box of the person rendered alone", examples=[_BOX])


class PersonScoreRead(measured(Source.PERSON_SCORE)):  # type: ignore[misc]  # likewise
    instance_id: int = Field(examples=[24001])


class FrameEvaluation(measured(Source.FRAME_SCORE)):  # type: ignore[misc]  # likewise
    sensor: str = Field(examples=["default"])
    function: str = Field(examples=[FUNCTION])
    prediction: Digest
    scores: Digest
    state: str = Field(description=_STATE, examples=["done"])
    infer_class: str = Field(description="numeric class of the prediction", examples=[_INFER_CLASS])
    fp: int | None = Field(
        description="pixels predicted as person that belong to none; null until done", examples=[310]
    )
    tp: int | None = Field(description="pixels of persons that are predicted as person", examples=[1980])
    fn: int | None = Field(description="pixels of persons that are predicted as another class", examples=[210])
    tn: int | None = Field(description="all other pixels", examples=[515900])
    pacc: float | None = Field(description="recall of the class person in this frame", examples=[0.9041])
    called_instead: dict[str, int] = Field(
        description="class that missed pixels of persons are called, to their number, most first",
        examples=[{"rider": 130, "car": 80}],
    )
    judged_by: list[str] = Field(
        description="classes that pixel_accuracy, miou, fwiou and macc cover; empty: all 19", examples=[[]]
    )
    persons: list[PersonScoreRead]
    images: dict[str, str] = Field(
        description="kind of picture to its address: this function's input and prediction",
        examples=[{"prediction": f"{_IMAGE}?kind=prediction&function={FUNCTION}&sensor=default"}],
    )


class SequenceRead(Read):
    frames: int = Field(
        description="moments of each variant and camera; their frames' ids differ only in the last part", examples=[10]
    )
    step_s: float = Field(description="seconds from one to the next", examples=[0.5])


class NeighbourRead(Read):
    frame: str = Field(examples=[f"{RUN_ID}.6.0.0"])
    value: Value = Field(examples=[5.0])


class ParameterNeighboursRead(Read):
    parameter: str = Field(description="its path, or camera", examples=["scene.person-1.pos.y"])
    before: NeighbourRead | None = Field(description="null at an end of its values")
    after: NeighbourRead | None


class FrameDetail(FrameRead):
    run_id: str = Field(examples=[RUN_ID])
    width: int = Field(examples=[960])
    height: int = Field(examples=[540])
    sequence: SequenceRead | None = Field(description="null: each variant and camera has one frame")
    assignment: dict[str, Value] = Field(
        description="of the variant, and the places of moving things at the frame's time", examples=[ASSIGNMENT]
    )
    units: dict[str, str] = Field(description="path to unit of a parameter that has one", examples=[UNITS])
    render_class: str = Field(description="numeric class of the image", examples=[NUMERIC_CLASS])
    truth_class: str = Field(description="numeric class of the ground truth", examples=[NUMERIC_CLASS])
    annotations: dict[str, str] = Field(
        description="kind to digest of the annotations that the run makes", examples=[{}]
    )
    persons: list[PersonRead]
    evaluations: list[FrameEvaluation]
    images: dict[str, str] = Field(
        description="kind of picture to its address, with the run's first sensor setting",
        examples=[{"picture": f"{_IMAGE}?kind=picture", "depth": f"{_IMAGE}?kind=depth"}],
    )
    previous: str | None = Field(
        description="frame before this one in the order of variants and cameras", examples=[f"{RUN_ID}.4.2.0"]
    )
    next: str | None = Field(description="frame after this one", examples=[f"{RUN_ID}.5.1.0"])
    neighbours: list[ParameterNeighboursRead] = Field(
        description="nearest frames that differ in one parameter of a grid only, or in the camera"
    )


class PixelRead(Read):
    """A pixel as one sensor sees it."""

    sensor: str = Field(examples=["default"])
    label: str = Field(description="true class", examples=["person"])
    instance_id: int | None = Field(description="null where the class has no instances", examples=[24001])
    depth_m: float | None = Field(
        description="metres along the optical axis; null where nothing is hit", examples=[18.4]
    )
    predictions: dict[str, str] = Field(
        description="function to its class, or void; only finished ones", examples=[{FUNCTION: "rider"}]
    )
