"""Networks with stored weights, ready to predict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.labels import NUM_TRAIN_CLASSES
from valerie.perception.importing.function_file import FunctionHeader, read_header, read_tensors
from valerie.perception.networks.architectures import Network, NetworkSettings, build_network

#: Counter of batches, which batch normalisation needs only for training; files may lack it.
_TRAINING_ONLY = ".num_batches_tracked"


def load_network(path: Path) -> tuple[Network, FunctionHeader]:
    """Build the architecture that a function file names, with its weights; fp16 on disk becomes fp32.

    Returns:
        The network in evaluation mode, without gradients; and the file's header.

    Raises:
        NotFound: no such file.
        UnknownName: the architecture.
        InvalidInput: the file is damaged, or its tensors are not those of the architecture; names the first differences.
    """
    header = read_header(path)
    # Shapes are checked first, so that a wrong file is refused before its data are read.
    shapes = tensor_shapes(header.architecture)
    require_same_shapes(shapes, header.shapes, field=path.name)
    return filled_network(header.architecture, read_tensors(path), field=path.name), header


def tensor_shapes(
    architecture: str | NetworkSettings, num_classes: int = NUM_TRAIN_CLASSES
) -> dict[str, tuple[int, ...]]:
    """Return name and shape of every tensor that a network needs to predict, in the network's order; nothing is allocated.

    Raises:
        UnknownName: the architecture.
    """
    with torch.device("meta"):
        state = build_network(architecture, num_classes).state_dict()
    return {name: tuple(tensor.shape) for name, tensor in state.items() if not name.endswith(_TRAINING_ONLY)}


def filled_network(
    architecture: str | NetworkSettings,
    tensors: Mapping[str, NDArray[np.floating]],
    num_classes: int = NUM_TRAIN_CLASSES,
    *,
    field: str = "tensors",
) -> Network:
    """Return a network with these tensors as fp32, in evaluation mode, without gradients.

    Args:
        architecture: a name in `valerie.perception.networks.architectures.ARCHITECTURES`, or other settings.
        tensors: tensors by the network's own names; batch counters are ignored.
        num_classes: channels of the logits.
        field: source of the tensors, for messages.

    Raises:
        UnknownName: the architecture.
        InvalidInput: the tensors are not those of the architecture; names the first differences.
    """
    shapes = {name: tuple(array.shape) for name, array in tensors.items()}
    require_same_shapes(tensor_shapes(architecture, num_classes), shapes, field=field)
    # On the meta device, fresh weights cost neither time nor memory and do not advance the caller's random generator.
    with torch.device("meta"):
        network = build_network(architecture, num_classes)
    state = {}
    for name in network.state_dict():
        if name.endswith(_TRAINING_ONLY):
            state[name] = torch.tensor(0)
        else:
            state[name] = torch.from_numpy(np.array(tensors[name], np.float32))
    network.load_state_dict(state, strict=True, assign=True)
    network.requires_grad_(requires_grad=False)
    return network.eval()


def require_same_shapes(
    shapes: Mapping[str, tuple[int, ...]], actual: Mapping[str, tuple[int, ...]], *, field: str
) -> None:
    """Refuse tensors that are not those of a network; batch counters are optional.

    Raises:
        InvalidInput: names the first three tensors that are missing, unknown or of another shape.
    """
    problems = differing_tensors(shapes, actual)
    if problems:
        raise InvalidInput(f"the tensors are not those of the architecture: {first_three(problems)}", field=field)


def first_three(problems: Sequence[str]) -> str:
    """Return the first three problems as text, and how many more there are."""
    more = f"; and {len(problems) - 3} more" if len(problems) > 3 else ""
    return "; ".join(problems[:3]) + more


def differing_tensors(shapes: Mapping[str, tuple[int, ...]], actual: Mapping[str, tuple[int, ...]]) -> list[str]:
    """Return one sentence for each tensor that is missing, unknown or of another shape; batch counters are ignored."""
    missing = [f"{name} is missing" for name in shapes if name not in actual]
    unknown = [f"{name} is unknown" for name in actual if name not in shapes and not name.endswith(_TRAINING_ONLY)]
    reshaped = [
        f"{name} is {list(actual[name])} instead of {list(shape)}"
        for name, shape in shapes.items()
        if name in actual and actual[name] != shape
    ]
    return missing + unknown + reshaped
