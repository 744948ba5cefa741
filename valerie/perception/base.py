"""A function under test: a picture in, a map of train ids out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput, UnknownName
from valerie.labels import NUM_TRAIN_CLASSES, TRAIN_LABELS


@dataclass(frozen=True, slots=True)
class FunctionCard:
    """Facts about a function under test; they travel with its results.

    Attributes:
        name: name in specs, e.g. ``deeplabv3plus-small``.
        digest: SHA-256 of the weights file (with header), hex.
        architecture: e.g. ``deeplabv3plus-small``.
        precision: read back from the engine, e.g. ``fp32``.
        engine: e.g. ``torch``.
        provenance: free entries: training data, seeds, figures, licence.
        judged_by: names of the Cityscapes classes that its all-class scores cover, in the order of train ids; empty: all 19.

    Raises:
        UnknownName: ``judged_by`` names something that is not an evaluated class.
    """

    name: str
    digest: str
    architecture: str
    precision: str
    engine: str
    provenance: dict[str, str]
    judged_by: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = [label.name for label in TRAIN_LABELS]
        for name in self.judged_by:
            if name not in names:
                raise UnknownName("evaluated class", name, names, field="judged_by")
        # All 19 have one spelling, also after a round trip through JSON: the empty tuple.
        judged = tuple(name for name in names if name in self.judged_by)
        object.__setattr__(self, "judged_by", judged if len(judged) < NUM_TRAIN_CLASSES else ())

    @property
    def judged_ids(self) -> tuple[int, ...]:
        """Train ids of the classes in ``judged_by``."""
        return judged_ids(self.judged_by)


def judged_ids(judged_by: Sequence[str]) -> tuple[int, ...]:
    """Return the train ids of `FunctionCard.judged_by`, ascending; all 19 if it is empty."""
    return tuple(label.train_id for label in TRAIN_LABELS if not judged_by or label.name in judged_by)


def require_picture(picture: NDArray[np.uint8]) -> None:
    """Refuse an array that no function takes as a picture.

    Raises:
        InvalidInput: it is not (H, W, 3) uint8, or it is empty.
    """
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3 or picture.size == 0:
        layout = f"{picture.dtype} {picture.shape}"
        raise InvalidInput("not a picture", field="picture", value=layout, limit="(H, W, 3) uint8, not empty")


class PerceptionFunction(Protocol):
    """A loaded function under test; a process keeps one loaded.

    Contract (`valerie.testing.perception.PerceptionContract`): it is deterministic, never changes its input, and returns maps of
    the picture's height and width with declared train ids only (0…18, 255).
    """

    @property
    def revision(self) -> int:
        """Number that is raised whenever equal weights and pictures give other labels; part of every prediction's digest."""
        ...

    @property
    def card(self) -> FunctionCard: ...

    @property
    def numeric_class(self) -> str:
        """Inference engine, version, device and precision, e.g. ``torch-2.13.0-cpu-fp32``."""
        ...

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the (H, W) uint8 train ids of an (H, W, 3) uint8 sRGB picture."""
        ...

    def close(self) -> None: ...


@runtime_checkable
class BatchFunction(PerceptionFunction, Protocol):
    """A function that predicts several pictures at once at a lower cost, as networks on a GPU do."""

    @property
    def batch_size(self) -> int:
        """Best number of pictures for `predict_many`; 1 if batches gain nothing."""
        ...

    def predict_many(self, pictures: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
        """Return `predict` of several pictures of one size; labels do not depend on how pictures are grouped."""
        ...
