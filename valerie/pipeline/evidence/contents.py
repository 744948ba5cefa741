"""The documents of an evidence folder about the origin of its numbers, and the names of its files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from typing import Final, NamedTuple, NotRequired, TypedDict, cast

from pydantic import Field

from valerie.document import Document
from valerie.parameters.definitions import Value
from valerie.runs.products.frame_keys import FrameKey

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


@dataclass(slots=True)
class NamedFrame:
    """A frame through one sensor setting that findings or verdicts name, with the functions and persons that they name."""

    key: FrameKey
    sensor: str | None
    functions: set[str] = field(default_factory=set)
    persons: set[int] = field(default_factory=set)


class _View(TypedDict):
    frame_id: str
    sensor: NotRequired[str | None]
    function: NotRequired[str | None]
    instance_id: NotRequired[int | None]


def named_frames(document: object) -> list[NamedFrame]:
    """Return the frames that a document of results names, sorted.

    An object names a frame by ``frame_id``, and its pictures by ``sensor``, ``function`` and ``instance_id``.
    """
    named: dict[tuple[FrameKey, str], NamedFrame] = {}
    for view in _views(document):
        key, sensor = FrameKey.parse(view["frame_id"]), view.get("sensor")
        frame = named.setdefault((key, sensor or ""), NamedFrame(key, sensor))
        if function := view.get("function"):
            frame.functions.add(function)
        if isinstance(person := view.get("instance_id"), int):
            frame.persons.add(person)
    return [frame for _, frame in sorted(named.items(), key=lambda item: item[0])]


def _views(document: object) -> Iterator[_View]:
    if isinstance(document, dict):
        if isinstance(document.get("frame_id"), str):
            yield cast("_View", document)
        for value in document.values():
            yield from _views(value)
    elif isinstance(document, list):
        for value in document:
            yield from _views(value)
