"""The run spec as a document: one frozen model that is REST body, database column and replayable file.

Numbers may carry units (``50 cm``) and stay as they were written; `valerie.runs.resolution` turns them into the units
of the asset's declarations. Both notations of the user's edge (the paper's lists, mappings) are turned into this one
form by `valerie.runs.notation`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

import yaml
from pydantic import (
    Field,
    PrivateAttr,
    model_validator,
)

from valerie.errors import InvalidInput, InvalidInputs
from valerie.parameters.assignment import digest
from valerie.parameters.definitions import ParameterType
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.values import Count, Document, Name, Quantity, Scalar, Text
from valerie.runs.varied import Varied
from valerie.sensing.settings import SensorSetting


class DeclaredParameter(Document):
    """The paper's ``parameter_name, scene_graph_ref, type, minimum, maximum`` (section 4).

    Attributes:
        name: how this spec calls it, e.g. ``p1``.
        path: the asset's parameter.
        type: must be the asset's.
        minimum, maximum: within the asset's declared range; None takes the asset's.
        choices: some of the asset's; empty takes all.
    """

    name: Name
    path: Name
    type: ParameterType
    minimum: Quantity | None = None
    maximum: Quantity | None = None
    choices: tuple[Name, ...] = ()


class BlockDocument(Document):
    """One design over its varied parameters.

    Attributes:
        design: ``grid``, ``points``, ``latin_hypercube``, ``sobol``, ``halton``, ``random``, or one that is plugged in.
        count: number of variants of a design that draws them.
        vary: varied parameters; in a grid the right-most moves fastest.
        constants: parameter to value, for this block.
        points: assignments of the design ``points``.
    """

    design: Name = "grid"
    count: Count | None = None
    vary: tuple[Varied, ...] = ()
    constants: dict[str, Scalar] = Field(default_factory=dict)
    points: tuple[dict[str, Scalar], ...] = ()


class Resolution(Document):
    """Size of the images in pixels."""

    width: Annotated[int, Field(strict=True, ge=16, le=8192)] = 960
    height: Annotated[int, Field(strict=True, ge=16, le=8192)] = 540


class SequenceDocument(Document):
    """Frames that follow each other in time; each variant and camera has all of them.

    Attributes:
        frames: how many.
        step: from one to the next, seconds unless another unit is written.
        start: moment of the first, likewise.
    """

    frames: Annotated[int, Field(strict=True, ge=1, le=100_000)]
    step: Quantity
    start: Quantity = 0


class TrajectoryDocument(Document):
    """How one thing moves, instead of how the asset says; see `valerie.scene.motion.trajectory.Trajectory`.

    Attributes:
        path: a movable thing or a camera, e.g. ``person-1``.
        keyframes: each with ``time`` and the same parameters of the thing, e.g. ``pos.x``.
        interpolation: ``smooth`` or ``linear``.
        facing: ``path``: heading or yaw follow the movement; ``kept``: they do not.
        stride_m: metres that a pedestrian walks in two steps.
    """

    path: Name
    keyframes: Annotated[tuple[dict[str, Quantity], ...], Field(min_length=1, max_length=1000)]
    interpolation: Literal["smooth", "linear"] = "smooth"
    facing: Literal["path", "kept"] | None = None
    stride_m: Quantity | None = None


class Requirement(Document):
    """What the run is evidence for.

    Attributes:
        id: in the user's own requirements, e.g. ``SYS-214``.
        text: the requirement.
        criterion: what counts as met.
    """

    id: Name
    text: Text = ""
    criterion: Text = ""


class RunSpec(Document):
    """What a validation run is.

    Attributes:
        schema_version: of this document.
        name: for people; need not be unique.
        description: for people.
        asset: name of an asset, or ``{name: urban-street, seed: 7}`` with a generator's arguments.
        seed: of all random designs; 0 is a seed.
        parameters: names of this spec's own for the asset's parameters; without them ``vary`` uses the asset's names.
        blocks: the run is their union, in order.
        constants: parameter to value, in all blocks.
        constraints: comparisons that a variant must meet, e.g. ``p1 < 3 or character == 'yellow-shirt'``.
        sequence: frames that follow each other in time; None: one frame of each variant and camera.
        trajectories: how things move, beside or instead of what the asset says.
        cameras: names of the asset's cameras; None takes all.
        resolution: size of the images in pixels.
        renderer: the engine of the linear images, or ``{name: cycles, samples: 64}`` with settings of that engine.
        annotations: truth of every frame beyond labels and depth: normals, boxes, joints, light, flow, velocity.
        sensors: one picture of each frame for each of them.
        functions: names of the perception functions under test; none: frames and truth alone.
        detection_threshold: t of the detection rate, the share of persons with pacc ≥ t.
        requirement: what the run is evidence for.
        parent_run, iteration: the run that this one refines, and which round it is.

    Raises:
        InvalidInputs: names that stand twice.
    """

    schema_version: Literal[1] = 1
    name: Name
    description: Text = ""
    asset: Name | dict[str, Scalar]
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 0
    parameters: tuple[DeclaredParameter, ...] = ()
    blocks: Annotated[tuple[BlockDocument, ...], Field(min_length=1, max_length=10_000)] = (BlockDocument(),)
    constants: dict[str, Scalar] = Field(default_factory=dict)
    constraints: Annotated[tuple[Text, ...], Field(max_length=100)] = ()
    sequence: SequenceDocument | None = None
    trajectories: Annotated[tuple[TrajectoryDocument, ...], Field(max_length=1000)] = ()
    cameras: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None
    resolution: Resolution = Resolution()
    renderer: Name | dict[str, Scalar] = "raster"
    annotations: tuple[AnnotationKind, ...] = ()
    sensors: Annotated[tuple[SensorSetting, ...], Field(min_length=1, max_length=100)] = (SensorSetting(),)
    functions: Annotated[tuple[Name, ...], Field(max_length=100)] = ()
    detection_threshold: Annotated[float, Field(strict=True, gt=0, le=1)] = 0.5
    requirement: Requirement | None = None
    parent_run: Name | None = None
    iteration: Annotated[int, Field(strict=True, ge=0, le=10**6)] = 0

    #: Dotted place in this form to the place where the user wrote it; lost when the document is stored.
    _places: dict[str, str] = PrivateAttr(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _one_notation(cls, given: Any) -> Any:
        from valerie.runs.notation import normalized

        return normalized(given) if isinstance(given, dict) else given

    @model_validator(mode="after")
    def _check(self) -> Self:
        problems = [
            InvalidInput("named twice", field=f"{field}.{i}", value=name)
            for field, names in (
                ("parameters", [p.name for p in self.parameters]),
                ("cameras", list(self.cameras or ())),
                ("trajectories", [trajectory.path for trajectory in self.trajectories]),
                ("sensors", [sensor.name for sensor in self.sensors]),
                ("functions", list(self.functions)),
                ("annotations", [kind.value for kind in self.annotations]),
            )
            for i, name in enumerate(names)
            if name in names[:i]
        ]
        if isinstance(self.asset, dict) and not isinstance(self.asset.get("name"), str):
            problems.append(InvalidInput("an asset mapping has a name", field="asset", limit="as urban-street"))
        if isinstance(self.renderer, dict) and not isinstance(self.renderer.get("name"), str):
            problems.append(InvalidInput("a renderer mapping has a name", field="renderer", limit="as cycles"))
        if problems:
            raise InvalidInputs(problems)
        return self

    def __eq__(self, other: object) -> bool:
        # Where something was written is no part of what was written.
        return isinstance(other, RunSpec) and self.__dict__ == other.__dict__

    def __hash__(self) -> int:
        return hash(self.digest)

    @property
    def engine(self) -> str:
        """Name of the renderer."""
        return engine_name(self.renderer)

    @property
    def engine_settings(self) -> dict[str, Scalar]:
        """What the spec says of the renderer's settings."""
        return (
            {key: value for key, value in self.renderer.items() if key != "name"}
            if isinstance(self.renderer, dict)
            else {}
        )

    @property
    def digest(self) -> str:
        """32 hexadecimal characters that stand for the whole document, whichever notation it was written in."""
        document = self.model_dump(mode="json")
        document["sensors"] = [{"name": sensor.name, **sensor.document()} for sensor in self.sensors]
        return digest("run-spec", document)

    def to_yaml(self) -> str:
        """The document as a file that reads back as an equal spec; defaults are left out."""
        document = {"schema_version": self.schema_version, **self.model_dump(mode="json", exclude_defaults=True)}
        return str(yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100))

    def field(self, place: str) -> str:
        """A dotted place of this form as the user wrote it, e.g. ``vary.p1.step`` for ``blocks.0.vary.0.step``."""
        return written_place(place, self._places)

    def written_at(self, places: Mapping[str, str]) -> Self:
        """Remember where the user wrote what."""
        self._places.update(places)
        return self


def engine_name(renderer: str | Mapping[str, Any]) -> str:
    """The name in a spec's ``renderer``, whichever of its forms it has."""
    return renderer if isinstance(renderer, str) else str(renderer["name"])


def written_place(place: str, places: Mapping[str, str]) -> str:
    """``place`` with its longest part that ``places`` knows replaced."""
    head, tail = place, ""
    while head:
        if head in places:
            return places[head] + tail
        head, _, last = head.rpartition(".")
        tail = f".{last}{tail}"
    return place
