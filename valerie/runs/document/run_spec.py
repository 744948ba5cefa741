"""The run spec as a document: one frozen model for the REST body, the database column and the file.

Numbers may have units (``50 cm``) and stay as they were written; `valerie.runs.resolving.vocabulary` converts them to the
units of the asset's declarations. `valerie.runs.document.notation` converts both notations of spec files (the paper's lists,
and mappings) to this canonical form.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, Final, Literal, Self

import yaml
from pydantic import Field, PrivateAttr, SerializerFunctionWrapHandler, model_serializer, model_validator

from valerie.document import Document
from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.parameters.assignment import digest
from valerie.parameters.definitions import ParameterType
from valerie.parameters.odd import OddAttribute
from valerie.plain import JsonObject
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.label_policy import LabelPolicy
from valerie.runs.document.varied import Varied
from valerie.runs.statistic import parse_statistic
from valerie.runs.values import Count, Name, Quantity, Scalar, Text
from valerie.sensing.settings import METERING, SensorSetting
from valerie.statistics.units import LISTED


class DeclaredParameter(Document):
    """The paper's ``parameter_name, scene_graph_ref, type, minimum, maximum`` (section 4).

    Attributes:
        name: the parameter's name in this spec, e.g. ``p1``.
        path: the asset's parameter.
        type: must equal the asset's.
        minimum, maximum: within the asset's declared range; None takes the asset's.
        choices: some of the asset's choices; empty takes all.
        odd: attribute of an operational design domain that it stands for, in the terms of ISO 34503; by default the asset's.
        source: where its range comes from: a standard, a measurement, a paper; by default the asset's.
    """

    name: Name
    path: Name
    type: ParameterType
    minimum: Quantity | None = None
    maximum: Quantity | None = None
    choices: tuple[Name, ...] = ()
    odd: OddAttribute | None = None
    source: Annotated[Text, Field(max_length=1000)] = ""


class BlockDocument(Document):
    """One design over its varied parameters.

    Attributes:
        design: ``grid``, ``points``, ``latin_hypercube``, ``sobol``, ``halton``, ``random``, or the name of a plugin.
        count: number of variants, for a design that draws them.
        vary: varied parameters; in a grid the right-most moves fastest.
        constants: parameter to value, for this block.
        points: assignments, for the design ``points``.
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
    """Consecutive frames of each variant and camera.

    Attributes:
        frames: number of frames.
        step: time from one frame to the next, in seconds unless another unit is written.
        start: moment of the first frame, in seconds unless another unit is written.
    """

    frames: Annotated[int, Field(strict=True, ge=1, le=100_000)]
    step: Quantity
    start: Quantity = 0


class TrajectoryDocument(Document):
    """The movement of one object or camera; see `valerie.scene.motion.trajectory.Trajectory`.

    Attributes:
        path: a movable object or a camera, e.g. ``person-1``.
        keyframes: each with ``time`` and the same parameters of the object, e.g. ``pos.x``.
        interpolation: ``smooth`` or ``linear``.
        facing: ``path`` if heading or yaw follow the movement, ``kept`` if they do not.
        stride_m: metres that a pedestrian walks in two steps.
    """

    path: Name
    keyframes: Annotated[tuple[dict[str, Quantity], ...], Field(min_length=1, max_length=1000)]
    interpolation: Literal["smooth", "linear"] = "smooth"
    facing: Literal["path", "kept"] | None = None
    stride_m: Quantity | None = None


class RequirementDocument(Document):
    """A requirement that the run is evidence for; each function gets a verdict on it.

    Attributes:
        id: its number in the user's requirements, e.g. ``SYS-214``.
        text: the requirement in words.
        statistic: the bounded mean, share or quantile of a score, e.g. ``share(pacc >= 0.5) >= 95 %``.
        where: the region that it applies to, e.g. ``distance_m <= 30``; by default everything.
        confidence: 1 − the chance of a false verdict.
        min_visible_pixels: persons with fewer visible pixels do not count.
        functions: names of the functions that it applies to; by default all.
        min_units: smallest number of variants for a verdict.
    """

    id: Name
    text: Text = ""
    statistic: Text
    where: Text = ""
    confidence: Annotated[float, Field(strict=True, gt=0, lt=1)] = 0.95
    min_visible_pixels: Annotated[int, Field(strict=True, ge=0, le=10**9)] = 0
    functions: Annotated[tuple[Name, ...], Field(max_length=100)] = ()
    min_units: Annotated[int, Field(strict=True, ge=1, le=10**9)] = 1


#: A run that keeps failures also keeps one of so many variants.
SAMPLED: Final = 20


class Retention(StrEnum):
    """What a run keeps when it completes, besides all numbers and its report."""

    #: Pictures, truths, annotations and predictions of every frame.
    ALL = "all"
    #: Those of the frames in which a person is not detected or a product failed, of examples in findings and verdicts, and of a
    #: sample of the variants.
    FAILURES = "failures"
    #: None.
    NUMBERS = "numbers"


class Reproducible(StrEnum):
    """How equal the results of another execution are."""

    #: Equal bits: all work goes to workers of one numeric class.
    BITS = "bits"
    #: Equal within bounds: work goes to all workers whose numeric classes agree.
    TOLERANCE = "tolerance"


class RunSpec(Document):
    """The definition of a validation run.

    Attributes:
        schema_version: version of this schema.
        name: title of the run; need not be unique.
        description: free text.
        asset: name of an asset, or a mapping of name and arguments of its pack, such as its seed.
        seed: seed of all random designs; 0 is a valid seed.
        parameters: this spec's names for the asset's parameters; without them ``vary`` uses the asset's names.
        blocks: the parts of the run, in order; the run is their union.
        constants: parameter to value, in all blocks.
        constraints: comparisons that a variant must meet, e.g. ``p1 < 3 or character == 'yellow-shirt'``.
        sequence: consecutive frames; without it, one frame for each variant and camera.
        trajectories: how objects move, in addition to or instead of the asset's trajectories.
        cameras: names of the asset's cameras; by default all.
        resolution: size of the images in pixels.
        renderer: render engine, or ``{name: cycles, samples: 64}`` with settings of that engine.
        annotations: truth of every frame besides labels and depth: normals, boxes, joints, light, flow, velocity;
            a rolling shutter requests ``scan``.
        labels: ``exact``, or ``cityscapes``, which closes gaps in foliage, fences and cycles as annotators do.
        sensors: sensor settings; each frame has one picture for each of them. By default one camera that meters; a setting
            meters if it has ``auto_exposure: true``.
        functions: names of the perception functions under test; if empty, the run makes only frames and truth.
        infer_backgrounds: if true, functions also see each background without movables, which gives ``pacc_empty``; by
            default they do if a run has at most a tenth as many backgrounds as frames.
        detection_threshold: t of the detection rate, the share of persons with pacc ≥ t.
        requirements: requirements that the run is evidence for; each gets a verdict.
        retention: what the run keeps when it completes, besides its numbers: ``all`` pictures, those of ``failures``, of
            examples in the report and of one variant in 20, or only ``numbers``. What another run needs stays.
        reproducible: ``bits`` for one numeric class; ``tolerance`` for all that agree within bounds, one for each place.
        parent_run, iteration: the run that this one refines, and the number of the iteration.

    Raises:
        InvalidInputs: a name is listed twice, or a requirement cannot be judged.
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
    labels: LabelPolicy = LabelPolicy.EXACT
    sensors: Annotated[tuple[SensorSetting, ...], Field(min_length=1, max_length=100)] = (METERING,)
    functions: Annotated[tuple[Name, ...], Field(max_length=100)] = ()
    infer_backgrounds: bool | None = None
    detection_threshold: Annotated[float, Field(strict=True, gt=0, le=1)] = 0.5
    requirements: Annotated[tuple[RequirementDocument, ...], Field(max_length=1000)] = ()
    retention: Retention = Retention.ALL
    reproducible: Reproducible = Reproducible.BITS
    parent_run: Name | None = None
    iteration: Annotated[int, Field(strict=True, ge=0, le=10**6)] = 0

    #: Dotted place in this form to the place where the user wrote it; not stored with the document.
    _places: dict[str, str] = PrivateAttr(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _normalize(cls, document: Any) -> Any:
        from valerie.runs.document.notation import normalized

        return normalized(document) if isinstance(document, dict) else document

    @model_validator(mode="after")
    def _check(self) -> Self:
        problems = [
            InvalidInput("listed twice", field=f"{field}.{i}", value=name)
            for field, names in (
                ("parameters", [p.name for p in self.parameters]),
                ("cameras", list(self.cameras or ())),
                ("trajectories", [trajectory.path for trajectory in self.trajectories]),
                ("sensors", [sensor.name for sensor in self.sensors]),
                ("functions", list(self.functions)),
                ("annotations", [kind.value for kind in self.annotations]),
                ("requirements", [requirement.id for requirement in self.requirements]),
            )
            for i, name in enumerate(names)
            if name in names[:i]
        ]
        if isinstance(self.asset, dict) and not isinstance(self.asset.get("name"), str):
            problems.append(InvalidInput("an asset mapping needs a name", field="asset", limit="{name: …}"))
        if isinstance(self.renderer, dict) and not isinstance(self.renderer.get("name"), str):
            problems.append(InvalidInput("a renderer mapping needs a name", field="renderer", limit="as cycles"))
        for i, requirement in enumerate(self.requirements):
            problems += self._problems_of(requirement, f"requirements.{i}")
        if problems:
            raise InvalidInputs(problems)
        return self

    @model_serializer(mode="wrap")
    def _without_what_release_0_1_0_refuses(self, dump: SerializerFunctionWrapHandler) -> JsonObject:
        document: JsonObject = dump(self)
        if self.retention is Retention.ALL:
            document.pop("retention", None)
        if self.reproducible is Reproducible.BITS:
            document.pop("reproducible", None)
        return document

    def _problems_of(self, requirement: RequirementDocument, place: str) -> list[InvalidInput]:
        problems: list[InvalidInput] = [
            UnknownName("function of the spec", name, self.functions, field=f"{place}.functions.{i}")
            for i, name in enumerate(requirement.functions)
            if name not in self.functions
        ]
        try:
            statistic = parse_statistic(requirement.statistic, field=f"{place}.statistic")
        except InvalidInput as problem:
            return [*problems, problem]
        if requirement.min_visible_pixels and not statistic.of_persons:
            refusal = f"{statistic.measure.name} is a score of whole frames; choose frames by the region"
            field, pixels = f"{place}.min_visible_pixels", requirement.min_visible_pixels
            problems.append(InvalidInput(refusal, field=field, value=pixels, limit="where: …"))
        drawn = any(block.design not in LISTED for block in self.blocks)
        if statistic.at_least == 0 or (statistic.at_least == 1 and drawn):
            refusal = (
                "everything meets this" if statistic.at_least == 0 else "a listed grid can show this, and no sample"
            )
            problems.append(InvalidInput(refusal, field=f"{place}.statistic", value=requirement.statistic))
        return problems

    def __eq__(self, other: object) -> bool:
        # Specs are equal if their contents are, regardless of the notation.
        return isinstance(other, RunSpec) and self.__dict__ == other.__dict__

    def __hash__(self) -> int:
        return hash(self.digest)

    @property
    def engine(self) -> str:
        """Name of the render engine."""
        return engine_name(self.renderer)

    @property
    def engine_settings(self) -> dict[str, Scalar]:
        """Settings of the render engine that the spec contains."""
        if isinstance(self.renderer, str):
            return {}
        return {key: value for key, value in self.renderer.items() if key != "name"}

    @property
    def digest(self) -> str:
        """Digest of everything that the results depend on, the same for both notations."""
        document = self.model_dump(mode="json", exclude={"retention"})
        document["sensors"] = [{"name": sensor.name, **sensor.document()} for sensor in self.sensors]
        return digest("run-spec", document)

    def short(self) -> JsonObject:
        """Return the document without defaults; each sensor says if it meters, as a spec without sensors does."""
        document = self.model_dump(mode="json", exclude_defaults=True)
        for sensor in document.get("sensors", ()):
            sensor.setdefault("auto_exposure", False)
        return document

    def to_yaml(self) -> str:
        """Return the document as YAML without defaults; `parse` returns an equal spec."""
        document = {"schema_version": self.schema_version, **self.short()}
        return str(yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100))

    def field(self, place: str) -> str:
        """Return a dotted place as the user wrote it, e.g. ``vary.p1.step`` for ``blocks.0.vary.0.step``."""
        return written_place(place, self._places)

    def written_at(self, places: Mapping[str, str]) -> Self:
        """Record the places where the user wrote the parts of this document, and return it."""
        self._places.update(places)
        return self


def engine_name(renderer: str | Mapping[str, Scalar]) -> str:
    """Return the engine's name from either form of a spec's ``renderer``."""
    return renderer if isinstance(renderer, str) else str(renderer["name"])


def written_place(place: str, places: Mapping[str, str]) -> str:
    """Return ``place`` with the longest prefix that is a key of ``places`` replaced."""
    head, tail = place, ""
    while head:
        if head in places:
            return places[head] + tail
        head, _, last = head.rpartition(".")
        tail = f".{last}{tail}"
    return place
