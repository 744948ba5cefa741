"""First weights of a training: those of any network of ours, as a function file."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from valerie.errors import InvalidInput
from valerie.labels import NUM_TRAIN_CLASSES
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.documents.training_data import SEEDS, SEEDS_BEFORE
from valerie.perception.importing.function_file import CLASS_NAMES, function_file_bytes, read_tensors

#: Entries that a new version takes from its predecessor.
_CARRIED: Final = ("steps", "steps-before", SEEDS, SEEDS_BEFORE, "licence")


def start_file(document: FunctionDocument, payload: Path) -> bytes:
    """Return a function file with the weights of a network, adapted to the frames of training: RGB, values in [0, 1].

    If the network expects BGR, the channels of its first convolution are reversed, which changes no logit.

    Args:
        document: document of a function of kind ``network``.
        payload: its file.

    Raises:
        InvalidInput: it is not a network of ours, its classes are not the 19 of Cityscapes in their order, or its values do
            not fit into a function file.
    """
    require_trainable(document)
    tensors = dict(read_tensors(payload))
    values = 1.0 if document.input.scale == "1/255" else 1 / 255
    mean, std = (tuple(x * values for x in triple) for triple in (document.input.mean, document.input.std))
    if document.input.channel_order == "bgr":
        mean, std = mean[::-1], std[::-1]
        (first,) = (name for name, tensor in tensors.items() if tensor.ndim == 4 and tensor.shape[1] == 3)
        tensors[first] = np.ascontiguousarray(tensors[first][:, ::-1])
    return function_file_bytes(
        tensors,
        architecture=document.architecture,
        mean=mean,  # type: ignore[arg-type]  # three of each
        std=std,  # type: ignore[arg-type]
        provenance={name: document.provenance[name] for name in _CARRIED if name in document.provenance},
    )


def require_trainable(document: FunctionDocument) -> None:
    """Refuse a function that training cannot start from.

    Raises:
        InvalidInput: states which functions can be trained.
    """
    if document.kind != "network":
        raise InvalidInput(
            "only networks of VALERIE's own architectures can be trained",
            field="function",
            value=f"{document.name}, kind {document.kind}",
            limit="kind network: what ships with VALERIE, and imported checkpoints (docs/networks.md)",
        )
    ids = document.output.lookup[:NUM_TRAIN_CLASSES].tolist()
    if len(document.output.classes) != NUM_TRAIN_CLASSES or ids != list(range(NUM_TRAIN_CLASSES)):
        raise InvalidInput(
            "training frames are labelled with the 19 classes of Cityscapes in their order; the function has others",
            field="output.classes",
            value=", ".join(document.output.classes),
            limit=", ".join(CLASS_NAMES),
        )
