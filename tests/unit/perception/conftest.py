from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

from valerie.perception.function_file import function_file_bytes  # noqa: E402
from valerie.perception.networks.architectures import build_network  # noqa: E402

MEAN, STD = (0.4, 0.45, 0.5), (0.2, 0.25, 0.3)


def state_arrays(network: torch.nn.Module) -> dict[str, object]:
    """Parameters and buffers as numpy arrays, without the batch counters."""
    state = network.state_dict()
    return {name: value.numpy() for name, value in state.items() if not name.endswith("num_batches_tracked")}


@pytest.fixture
def write_function(tmp_path: Path) -> Callable[..., Path]:
    """Writes a function file with random weights: ``write_function("semantic-fpn-small", seed=1, ...)``."""

    def write(architecture: str = "semantic-fpn-small", *, seed: int = 0, name: str | None = None, **changes) -> Path:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            tensors = state_arrays(build_network(architecture))
        tensors.update(changes.pop("tensors", {}))
        for dropped in changes.pop("drop", ()):
            del tensors[dropped]
        named = changes.pop("named", architecture)
        given = {"architecture": named, "mean": MEAN, "std": STD, "provenance": {"licence": "Apache-2.0"}}
        path = tmp_path / f"{name or architecture}.safetensors"
        path.write_bytes(function_file_bytes(tensors, **(given | changes)))
        return path

    return write
