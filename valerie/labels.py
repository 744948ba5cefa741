"""The class map: label ids, train ids, names, colours and instance ids of Cityscapes.

Ground truth stores *label ids* (``person`` = 24), and networks use *train ids* (``person`` = 11, void = 255). An
*instance id* is ``label id × 1000 + n`` for classes with instances (Cordts et al. 2016, arXiv:1604.01685).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput, UnknownName

#: Train id (and prediction value) of pixels that are ignored.
VOID: Final = 255
#: Largest n of an instance id (uint16 holds 65,535; the largest label id with instances is 33).
MAX_INSTANCE: Final = 999


@dataclass(frozen=True, slots=True)
class Label:
    """One class.

    Attributes:
        name: the name in Cityscapes, e.g. ``traffic light``.
        id: label id, 0…33.
        train_id: 0…18, or 255 (void).
        category: the Cityscapes category, e.g. ``human``.
        has_instances: True if the objects of the class have instance ids.
        color: sRGB, 0…255, for pictures.
    """

    name: str
    id: int
    train_id: int
    category: str
    has_instances: bool
    color: tuple[int, int, int]

    @property
    def node_class(self) -> str:
        """The class as written in node names, e.g. ``traffic-light`` for ``traffic light``."""
        return self.name.replace(" ", "-")


CITYSCAPES: Final = (
    Label("unlabeled", 0, VOID, "void", False, (0, 0, 0)),
    Label("ego vehicle", 1, VOID, "void", False, (0, 0, 0)),
    Label("rectification border", 2, VOID, "void", False, (0, 0, 0)),
    Label("out of roi", 3, VOID, "void", False, (0, 0, 0)),
    Label("static", 4, VOID, "void", False, (0, 0, 0)),
    Label("dynamic", 5, VOID, "void", False, (111, 74, 0)),
    Label("ground", 6, VOID, "void", False, (81, 0, 81)),
    Label("road", 7, 0, "flat", False, (128, 64, 128)),
    Label("sidewalk", 8, 1, "flat", False, (244, 35, 232)),
    Label("parking", 9, VOID, "flat", False, (250, 170, 160)),
    Label("rail track", 10, VOID, "flat", False, (230, 150, 140)),
    Label("building", 11, 2, "construction", False, (70, 70, 70)),
    Label("wall", 12, 3, "construction", False, (102, 102, 156)),
    Label("fence", 13, 4, "construction", False, (190, 153, 153)),
    Label("guard rail", 14, VOID, "construction", False, (180, 165, 180)),
    Label("bridge", 15, VOID, "construction", False, (150, 100, 100)),
    Label("tunnel", 16, VOID, "construction", False, (150, 120, 90)),
    Label("pole", 17, 5, "object", False, (153, 153, 153)),
    Label("polegroup", 18, VOID, "object", False, (153, 153, 153)),
    Label("traffic light", 19, 6, "object", False, (250, 170, 30)),
    Label("traffic sign", 20, 7, "object", False, (220, 220, 0)),
    Label("vegetation", 21, 8, "nature", False, (107, 142, 35)),
    Label("terrain", 22, 9, "nature", False, (152, 251, 152)),
    Label("sky", 23, 10, "sky", False, (70, 130, 180)),
    Label("person", 24, 11, "human", True, (220, 20, 60)),
    Label("rider", 25, 12, "human", True, (255, 0, 0)),
    Label("car", 26, 13, "vehicle", True, (0, 0, 142)),
    Label("truck", 27, 14, "vehicle", True, (0, 0, 70)),
    Label("bus", 28, 15, "vehicle", True, (0, 60, 100)),
    Label("caravan", 29, VOID, "vehicle", True, (0, 0, 90)),
    Label("trailer", 30, VOID, "vehicle", True, (0, 0, 110)),
    Label("train", 31, 16, "vehicle", True, (0, 80, 100)),
    Label("motorcycle", 32, 17, "vehicle", True, (0, 0, 230)),
    Label("bicycle", 33, 18, "vehicle", True, (119, 11, 32)),
)

BY_ID: Final = {label.id: label for label in CITYSCAPES}
BY_NAME: Final = {label.name: label for label in CITYSCAPES}
_BY_NODE_CLASS: Final = {label.node_class: label for label in CITYSCAPES}

#: The 19 evaluated classes, in train-id order.
TRAIN_LABELS: Final = tuple(sorted((label for label in CITYSCAPES if label.train_id != VOID), key=lambda x: x.train_id))
NUM_TRAIN_CLASSES: Final = len(TRAIN_LABELS)
#: Name of a pixel or a class without an evaluated class.
VOID_NAME: Final = "void"
#: Train id to name, void last.
TRAIN_NAMES: Final = {**{label.train_id: label.name for label in TRAIN_LABELS}, VOID: VOID_NAME}

PERSON: Final = BY_NAME["person"]
RIDER: Final = BY_NAME["rider"]
SKY: Final = BY_NAME["sky"]

_ID_TO_TRAIN: Final = np.full(256, VOID, np.uint8)
_TRAIN_TO_ID: Final = np.zeros(256, np.uint8)
_ID_TO_COLOR: Final = np.zeros((256, 3), np.uint8)
for _label in CITYSCAPES:
    _ID_TO_TRAIN[_label.id] = _label.train_id
    _ID_TO_COLOR[_label.id] = _label.color
    if _label.train_id != VOID:
        _TRAIN_TO_ID[_label.train_id] = _label.id


def to_train_ids(label_ids: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Map label ids to train ids, any shape; ids without a train id become `VOID`."""
    mapped: NDArray[np.uint8] = _ID_TO_TRAIN[label_ids]
    return mapped


def to_label_ids(train_ids: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Map train ids to label ids, any shape; `VOID` becomes 0 (unlabeled)."""
    mapped: NDArray[np.uint8] = _TRAIN_TO_ID[train_ids]
    return mapped


def colorize(label_ids: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Paint a class map in Cityscapes colours: (H, W) label ids to (H, W, 3) uint8 sRGB."""
    painted: NDArray[np.uint8] = _ID_TO_COLOR[label_ids]
    return painted


def label_of_node_class(node_class: str, *, field: str = "") -> Label:
    """Return the label for the class part of a node name (``person`` in ``person-1``).

    Raises:
        UnknownName: there is no such class.
    """
    try:
        return _BY_NODE_CLASS[node_class]
    except KeyError:
        raise UnknownName("object class", node_class, _BY_NODE_CLASS, field=field) from None


def instance_id(label: Label, number: int) -> int:
    """Return the instance id of the n-th object of a class, ``label.id × 1000 + n``; 0 for a class without instances.

    Raises:
        InvalidInput: ``number`` is not in 0…999.
    """
    if not 0 <= number <= MAX_INSTANCE:
        raise InvalidInput("instance number out of range", field=label.name, value=number, limit=f"0…{MAX_INSTANCE}")
    return label.id * 1000 + number if label.has_instances else 0
