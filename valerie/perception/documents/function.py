"""The document of a function under test: kind, payload, input, and the meaning of its classes.

The document is the sidecar that a user writes, the body of a registration, a database column and a card. A function is this
document and at most one payload file; both are addressed by content and never change. Nothing here imports torch.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    BeforeValidator,
    Field,
    SerializeAsAny,
    StringConstraints,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import ErrorDetails

from valerie.document import Document
from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.labels import TRAIN_LABELS, VOID
from valerie.loading import load_document
from valerie.parameters.assignment import digest
from valerie.perception.base import FunctionCard
from valerie.perception.documents.class_maps import CLASS_LISTS, MAX_CLASSES, class_lookup
from valerie.perception.documents.options import OPTIONS, Options
from valerie.plain import Json
from valerie.validation import problem_of

#: Raised when the meaning of the document changes; the first part of every digest.
_SCHEME: Final = 1

Kind = Literal["network", "onnx", "huggingface", "http", "predictions"]
EngineName = Literal["torch", "openvino", "onnxruntime", "none"]
Precision = Literal["fp32", "bf16", "fp16", "int8"]

#: Kind to the engines that can run it, the default first.
ENGINES: Final[Mapping[str, tuple[EngineName, ...]]] = MappingProxyType(
    {
        "network": ("torch", "openvino", "onnxruntime"),
        "onnx": ("openvino", "onnxruntime"),
        "huggingface": ("torch", "openvino", "onnxruntime"),
        "http": ("none",),
        "predictions": ("none",),
    }
)
#: Kind to the format of its payload; the other kinds have none.
PAYLOADS: Final[Mapping[str, str]] = MappingProxyType(
    {"network": "safetensors", "onnx": "onnx", "huggingface": "safetensors"}
)
#: Engine to the precisions that it offers. Only ONNX files have int8 (`valerie.perception.running.quantizing`).
PRECISIONS: Final[Mapping[str, tuple[Precision, ...]]] = MappingProxyType(
    {
        "torch": ("fp32", "bf16", "fp16"),
        "openvino": ("fp32", "bf16", "fp16", "int8"),
        "onnxruntime": ("fp32", "int8"),
        "none": ("fp32",),
    }
)

ClassName = Annotated[str, StringConstraints(strict=True, min_length=1, max_length=200)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
SideLength = Annotated[int, Field(strict=True, ge=1, le=16_384)]


def _scale(value: object) -> object:
    """Return ``"1"`` or ``"1/255"`` also for the numbers 1 and 0.00392…; other values unchanged."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return next((name for name, number in (("1", 1.0), ("1/255", 1 / 255)) if abs(value - number) < 1e-6), value)
    return value


def _listed(value: object) -> object:
    """Return the classes of a named list; other values unchanged."""
    if not isinstance(value, str):
        return value
    if value not in CLASS_LISTS:
        raise UnknownName("list of classes", value, CLASS_LISTS, field="output.classes", limit="[class, class, …]")
    return CLASS_LISTS[value]


class Payload(Document):
    """The one file of a function.

    Attributes:
        sha256: digest of the file, hex.
        bytes: length of the file.
        format: format of the file.
    """

    sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
    bytes: Annotated[int, Field(strict=True, ge=1)]
    format: Literal["safetensors", "onnx"]


class InputDocument(Document):
    """The conversion of a frame to the network's input; see `valerie.perception.running.adaptation`.

    Attributes:
        size: width and height of the network's input; None: the frame's.
        mode: ``pad`` repeats the last row and column up to ``size`` or the next multiples; ``resize`` resamples to
            ``size``; ``tile`` cuts the frame into overlapping pieces of ``size``.
        multiple_of: sides are padded to a multiple of this (``pad`` without ``size``).
        longest_side: frames with a longer side are first resampled to about this (``pad`` without ``size``), to sides that are
            multiples already, so that nothing is padded. For networks that were trained on small pictures.
        overlap: smallest number of pixels that neighbouring tiles share; a pixel takes its label from the tile in which it
            is farthest from an edge.
        mean, std: per channel, in the order of ``channel_order`` and the unit of ``scale``: the network sees
            ``(x · scale − mean) / std`` of 8-bit sRGB values x.
        scale: ``1/255`` or ``1``.
        channel_order: of the network's input; frames are RGB.
        layout: of the network's input tensor.
    """

    size: tuple[SideLength, SideLength] | None = None
    mode: Literal["pad", "resize", "tile"] = "pad"
    multiple_of: Annotated[int, Field(strict=True, ge=1, le=1024)] = 1
    longest_side: SideLength | None = None
    overlap: Annotated[int, Field(strict=True, ge=0, le=4096)] = 0
    mean: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    std: tuple[Positive, Positive, Positive] = (1.0, 1.0, 1.0)
    scale: Annotated[Literal["1", "1/255"], BeforeValidator(_scale)] = "1/255"
    channel_order: Literal["rgb", "bgr"] = "rgb"
    layout: Literal["nchw", "nhwc"] = "nchw"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.size is None and self.mode in ("resize", "tile"):
            raise ValueError(f"mode {self.mode} needs a size: [width, height]")
        if self.overlap and self.mode != "tile":
            raise ValueError("overlap belongs to mode tile")
        if self.size is not None and self.overlap >= min(self.size):
            raise ValueError(f"overlap {self.overlap} must be below both sides of size {list(self.size)}")
        if self.multiple_of > 1 and self.size is not None:
            raise ValueError("multiple_of belongs to mode pad without a size")
        if self.longest_side is not None and self.size is not None:
            raise ValueError("longest_side belongs to mode pad without a size")
        if self.longest_side is not None and self.longest_side < self.multiple_of:
            raise ValueError(f"longest_side {self.longest_side} must not be below multiple_of {self.multiple_of}")
        return self

    @property
    def value_range(self) -> float:
        """Factor from the unit of mean and std to 8-bit values: 255 if that unit is [0, 1], otherwise 1."""
        return 255.0 if self.scale == "1/255" else 1.0


class OutputDocument(Document):
    """The network's output and the meaning of its classes.

    Attributes:
        kind: ``logits`` or ``probabilities`` (the largest channel wins, of equal ones the first), or ``labels`` (ids).
        classes: names in the order of channels or ids; or the name of a list in `CLASS_LISTS`.
        class_map: name or id of a class to a Cityscapes class or ``void``; see `valerie.perception.documents.class_maps`.
        threshold: for a single class: pixels with a larger value belong to it; None: 0 for logits, 0.5 for probabilities.
        align_corners: logits are upsampled so that the outermost pixel centres coincide; if False, pixel centres lie at
            halves, as in the training of most networks. A ``network`` knows its own.
        target_classes: the Cityscapes classes that the function is judged by; empty: all that the map reaches. All-class
            scores cover only these: see `valerie.perception.base.FunctionCard`.
    """

    kind: Literal["logits", "probabilities", "labels"] = "logits"
    classes: Annotated[tuple[ClassName, ...], BeforeValidator(_listed), Field(min_length=1, max_length=MAX_CLASSES)] = (
        CLASS_LISTS["cityscapes"]
    )
    class_map: dict[str, ClassName] = Field(default_factory=dict)
    threshold: Finite | None = None
    align_corners: bool = False
    target_classes: tuple[ClassName, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        reached = set(self.reached)
        for number, name in enumerate(self.target_classes):
            if name not in reached:
                raise UnknownName("target class", name, reached, field=f"output.target_classes.{number}")
        if self.threshold is not None and (len(self.classes) > 1 or self.kind == "labels"):
            raise ValueError("threshold belongs to a single class of logits or probabilities")
        return self

    @property
    def lookup(self) -> NDArray[np.uint8]:
        """(256,) uint8 table from the function's ids to train ids."""
        return class_lookup(self.classes, self.class_map)

    @property
    def cut(self) -> float:
        """Score above which a pixel belongs to the class, for a function with one class."""
        return self.threshold if self.threshold is not None else {"logits": 0.0, "probabilities": 0.5}[self.kind]

    @property
    def reached(self) -> tuple[str, ...]:
        """Evaluated Cityscapes classes that the function can predict, in the order of train ids."""
        train_ids = set(self.lookup[: len(self.classes)].tolist())
        return tuple(label.name for label in TRAIN_LABELS if label.train_id in train_ids)

    @property
    def unmapped(self) -> tuple[str, ...]:
        """Classes of the function that count as void, in order."""
        return tuple(name for name, to in zip(self.classes, self.lookup.tolist(), strict=False) if to == VOID)


class FunctionDocument(Document):
    """A function under test.

    Attributes:
        name: name in specs.
        kind: kind of the payload, or other source of predictions.
        payload: the one file; None for ``http`` and ``predictions``, which have none.
        architecture: for a ``network``, see `valerie.perception.networks.architectures`; for ``huggingface``, the model type.
        options: options of its kind; see `valerie.perception.documents.options`.
        input, output: conversion of frames to the network's input, and of its output to labels.
        engine: engine that runs it; by default the first that fits the kind.
        precision: requested precision; the actual one is read back from the engine and is part of the numeric class.
        trained_on: name of an asset or data set to the part that it has learned from; of a generated asset the site seeds, such
            as ``1000-1094; 1100``. See `valerie.perception.documents.training_data`.
        provenance: free entries: source, licence, figures, checks.
    """

    name: Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_.-]*$", max_length=64)]
    kind: Kind
    payload: Payload | None = None
    architecture: Annotated[str, StringConstraints(max_length=200)] = ""
    options: SerializeAsAny[Options] = Field(default_factory=Options, validate_default=True)
    input: InputDocument = InputDocument()
    output: OutputDocument = OutputDocument()
    engine: EngineName
    precision: Precision = "fp32"
    trained_on: dict[str, str] = Field(default_factory=dict)
    provenance: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _default_engine(cls, values: object) -> object:
        if isinstance(values, dict) and "engine" not in values and values.get("kind") in ENGINES:
            return {**values, "engine": ENGINES[values["kind"]][0]}
        return values

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.engine not in ENGINES[self.kind]:
            raise ValueError(f"engine {self.engine} cannot run kind {self.kind}: {' | '.join(ENGINES[self.kind])}")
        if self.precision not in PRECISIONS[self.engine]:
            raise ValueError(f"engine {self.engine} has no {self.precision}: {' | '.join(PRECISIONS[self.engine])}")
        if self.precision == "int8" and self.kind != "onnx":
            raise ValueError(f"kind {self.kind} has no int8; `valerie function quantize` makes a function of kind onnx")
        file_format = PAYLOADS.get(self.kind)
        actual = self.payload.format if self.payload else None
        if actual != file_format:
            raise ValueError(
                f"kind {self.kind} takes {f'a file of {file_format}' if file_format else 'no file'}, not {actual or 'none'}"
            )
        if self.kind in ("network", "huggingface") and not self.architecture:
            raise ValueError(f"kind {self.kind} needs an architecture")
        return self

    @field_validator("options", mode="before")
    @classmethod
    def _options_of_kind(cls, options: object, info: ValidationInfo) -> object:
        kind = info.data.get("kind")
        if kind is None:  # which is an error of its own
            return Options()
        return OPTIONS[kind].model_validate(options.model_dump() if isinstance(options, Options) else options)

    @property
    def file(self) -> Payload:
        """The payload of a function of a kind that has one."""
        assert self.payload is not None, f"functions of kind {self.kind} have no file"
        return self.payload

    @property
    def digest(self) -> str:
        """Digest of everything but the name, 32 hexadecimal characters; two names of one function share it.

        Entries with their default value are left out, so that an entry added by a later version changes no digest.
        """
        entries = self.model_dump(mode="json", exclude={"name"}, exclude_defaults=True)
        # If all options have their defaults, their entry is an empty mapping.
        return digest("function", _SCHEME, {name: entry for name, entry in entries.items() if entry != {}})

    def card(self, *, digest: str | None = None, precision: str | None = None) -> FunctionCard:
        """Return the card of this function.

        Args:
            digest: shown on the card; None: the document's.
            precision: read back from the engine; None: the requested one.
        """
        architecture = self.architecture or self.kind
        return FunctionCard(
            self.name,
            digest or self.digest,
            architecture,
            precision or self.precision,
            self.engine,
            dict(self.provenance),
            self.output.target_classes or self.output.reached,
        )


def parse_function(source: str | bytes | Mapping[str, Json], **entries: object) -> FunctionDocument:
    """Read a document that a user wrote.

    Args:
        source: YAML or JSON text, or a loaded mapping.
        entries: entries that override the text, e.g. ``payload``.

    Raises:
        InvalidInputs: every problem, each with its dotted field.
        InvalidInput, UnknownName: the text is not a document, or a class name is unknown; near matches are named.
    """
    values = {**load_document(source), **entries}
    try:
        return FunctionDocument.model_validate(values)
    except ValidationError as error:
        kind = str(values.get("kind"))
        # A known kind has an engine by default, and an unknown one is a problem of its own.
        problems = [
            problem for problem in error.errors(include_url=False) if problem["loc"] != ("engine",) or kind in ENGINES
        ]
        raise InvalidInputs([_problem(problem, kind) for problem in problems]) from None


def _problem(problem: ErrorDetails, kind: str) -> InvalidInput:
    *parents, last = problem["loc"] or ("",)
    field = ".".join(map(str, problem["loc"]))
    if problem["type"] == "extra_forbidden":
        return UnknownName("field", str(last), _fields(parents, kind), field=field)
    return problem_of(problem, field)


def _fields(parents: Sequence[int | str], kind: str) -> list[str]:
    parts: dict[int | str, type[BaseModel]] = {
        "payload": Payload,
        "input": InputDocument,
        "output": OutputDocument,
        "options": OPTIONS.get(kind, Options),
    }
    return list(parts[parents[0]].model_fields if parents else FunctionDocument.model_fields)
