"""From a function file to a network that is ready to predict."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch

from valerie.errors import InvalidInput
from valerie.perception.function_file import FunctionHeader, read_header, read_tensors
from valerie.perception.networks.architectures import Network, build_network

#: Batch normalisation counts its batches for training only; files need not hold it.
_TRAINING_ONLY = ".num_batches_tracked"


def load_network(path: Path) -> tuple[Network, FunctionHeader]:
    """Build the architecture that the file names and fill it; fp16 on disk runs as fp32.

    Returns:
        The network in evaluation mode, without gradients; and the file's header.

    Raises:
        NotFound: no such file.
        UnknownName: the architecture.
        InvalidInput: the file is damaged, or its tensors are not those of the architecture (the first that differ are
            named).
    """
    header = read_header(path)
    # Building draws random weights first; that must not move the generator of whoever loads a function.
    with torch.random.fork_rng(devices=[]):
        network = build_network(header.architecture)
    expected = {name: tuple(tensor.shape) for name, tensor in network.state_dict().items()}
    # Shapes come first: what does not fit is refused before its data are read.
    require_same_shapes(expected, header.shapes, field=path.name)
    state = {name: torch.from_numpy(array).to(torch.float32) for name, array in read_tensors(path).items()}
    network.load_state_dict(state, strict=False)  # strict but for the batch counters, checked above
    network.requires_grad_(requires_grad=False)
    return network.eval(), header


def require_same_shapes(
    expected: Mapping[str, tuple[int, ...]], given: Mapping[str, tuple[int, ...]], *, field: str
) -> None:
    """Refuse tensors that are not those of a network.

    Raises:
        InvalidInput: names the first three tensors that are missing, unknown or of another shape.
    """
    needed = {name: shape for name, shape in expected.items() if not name.endswith(_TRAINING_ONLY)}
    problems = [f"{name} is missing" for name in needed if name not in given]
    problems += [f"{name} is unknown" for name in given if name not in expected]
    problems += [
        f"{name} is {list(given[name])} instead of {list(shape)}"
        for name, shape in needed.items()
        if name in given and given[name] != shape
    ]
    if problems:
        shown = "; ".join(problems[:3])
        more = f"; and {len(problems) - 3} more" if len(problems) > 3 else ""
        raise InvalidInput(f"the tensors are not those of the architecture: {shown}{more}", field=field)
