"""What a function under test is: a picture in, a map of train ids out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from valerie.errors import UnknownName
from valerie.labels import NUM_TRAIN_CLASSES, TRAIN_LABELS


@dataclass(frozen=True, slots=True)
class FunctionCard:
    """What is known of a function under test; travels with results.

    Attributes:
        name: name in specs, e.g. ``deeplabv3plus-small``.
        digest: SHA-256 of the weights file (with header), hex.
        architecture: e.g. ``deeplabv3plus-small``.
        precision: the precision that the engine really runs in, read back, e.g. ``fp32``.
        engine: e.g. ``torch``.
        provenance: free facts: training data, seeds, figures, licence.
        judged_by: names of the Cityscapes classes that its all-class figures are over, in the order of train ids; empty: all 19.

    Raises:
        UnknownName: ``judged_by`` names what is no evaluated class.
    """

    name: str
    digest: str
    architecture: str
    precision: str
    engine: str
    provenance: dict[str, str]
    judged_by: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        known = [label.name for label in TRAIN_LABELS]
        for name in self.judged_by:
            if name not in known:
                raise UnknownName("evaluated class", name, known, field="judged_by")
        # One spelling each, also after a trip through JSON: all 19 are none.
        judged = tuple(name for name in known if name in self.judged_by)
        object.__setattr__(self, "judged_by", judged if len(judged) < NUM_TRAIN_CLASSES else ())

    @property
    def judged_ids(self) -> tuple[int, ...]:
        """Train ids of the classes that it is judged by."""
        return judged_ids(self.judged_by)


def judged_ids(judged_by: Sequence[str]) -> tuple[int, ...]:
    """Train ids of `FunctionCard.judged_by`, ascending: of all 19 classes where it is empty."""
    return tuple(label.train_id for label in TRAIN_LABELS if not judged_by or label.name in judged_by)


class PerceptionFunction(Protocol):
    """A loaded function under test; one per process stays loaded.

    Contract (`valerie.testing.PerceptionContract`): deterministic; never changes its input; output has the picture's
    height and width; only declared train ids (0…18, 255).
    """

    @property
    def revision(self) -> int:
        """Raised by hand whenever equal weights and pictures give other labels; part of every prediction's digest."""
        ...

    @property
    def card(self) -> FunctionCard: ...

    @property
    def numeric_class(self) -> str:
        """Inference engine, version, device and precision, e.g. ``torch-2.13.0-cpu-fp32``."""
        ...

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 sRGB picture to (H, W) uint8 train ids."""
        ...

    def close(self) -> None: ...


@runtime_checkable
class BatchFunction(PerceptionFunction, Protocol):
    """A function that is cheaper for several pictures at once, as networks on a GPU are."""

    @property
    def batch_size(self) -> int:
        """How many pictures are best given to `predict_many`; 1 where there is nothing to gain."""
        ...

    def predict_many(self, pictures: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
        """`predict` of each of several pictures of one size; the labels do not depend on which were given together."""
        ...
