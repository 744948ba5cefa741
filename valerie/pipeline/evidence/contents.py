"""The documents of an evidence folder about the origin of its numbers, and the names of its files."""

from __future__ import annotations

from datetime import datetime
from typing import Final, NamedTuple

from pydantic import Field

from valerie.document import Document
from valerie.parameters.definitions import Value

SPEC: Final = "spec.json"
RUN: Final = "run.json"
PINS: Final = "pins.json"
FRAMES: Final = "frames.json"
#: Folder of the pictures.
PICTURES: Final = "frames"


class ResultDigests(Document):
    """SHA-256, hex, of the results that every execution of a spec in equal numeric classes reproduces, without run ids.

    Attributes:
        frames: Merkle root over the pictures.
        table: digest of ``evaluations.csv`` without the columns ``run_id`` and ``frame_id``.
        verdicts: digest of the verdicts as JSON with sorted keys, indented by two.
    """

    frames: str
    table: str
    verdicts: str


class RunFacts(Document):
    """The run that the evidence is about.

    Attributes:
        id, name: of the run.
        state: its final state.
        spec_digest, asset_digest: digests of its spec and its asset.
        parent_run, iteration: the refined run and the iteration.
        created_at, started_at, finished_at: times with time zone.
        results: digests of its results.
    """

    id: str = Field(max_length=32)
    name: str
    state: str
    spec_digest: str
    asset_digest: str
    parent_run: str | None
    iteration: int
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    results: ResultDigests


class FramePicture(NamedTuple):
    """A picture of a frame.

    Attributes:
        kind: ``picture``, ``truth``, ``prediction`` or ``close-up``.
        function: index in the functions of the spec, of a prediction and a close-up.
        person: instance id, of a close-up.
        file: its path in the folder.
    """

    kind: str
    function: int | None
    person: int | None
    file: str


class FrameEntry(Document):
    """A frame through one sensor setting, with its pictures.

    Attributes:
        variant, camera, time: indices in the run.
        sensor: index in the sensors of the spec.
        functions: indices, in its functions, of those whose predictions are shown.
        persons: instance ids of those who are shown from near.
        assignment: path to value of the variant.
    """

    variant: int = Field(ge=0)
    camera: int = Field(ge=0)
    time: int = Field(ge=0)
    sensor: int = Field(ge=0)
    functions: tuple[int, ...]
    persons: tuple[int, ...] = ()
    assignment: dict[str, Value]

    @property
    def place(self) -> str:
        """The frame's id without its run."""
        return f"{self.variant}.{self.camera}.{self.time}"

    @property
    def pictures(self) -> tuple[FramePicture, ...]:
        """The pictures: the plain one, the truth, each function's prediction, and each person as each function sees them."""
        stem = f"{PICTURES}/{self.place}/sensor-{self.sensor}"
        return (
            FramePicture("picture", None, None, f"{stem}-picture.png"),
            FramePicture("truth", None, None, f"{stem}-truth.png"),
            *(
                FramePicture("prediction", function, None, f"{stem}-prediction-{function}.png")
                for function in self.functions
            ),
            *(
                FramePicture("close-up", function, person, f"{stem}-close-up-{function}-{person}.png")
                for function in self.functions
                for person in self.persons
            ),
        )


class FrameList(Document):
    """The frames of the folder, in order."""

    frames: tuple[FrameEntry, ...]
