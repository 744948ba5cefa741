"""Checkpoints of a training run: safetensors, so that going on from a file never runs anything that it holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from valerie.errors import InvalidInput
from valerie.perception.training.settings import TrainingSettings
from valerie.perception.training.statistics import Triple

#: Step, seconds of training, recent losses.
Place = tuple[int, float, list[float]]

_NETWORK: Final = "network."
_OPTIMISER: Final = "optimiser."


def write_checkpoint(
    path: Path,
    settings: TrainingSettings,
    mean: Triple,
    std: Triple,
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    place: Place,
) -> None:
    """Write everything that the next step depends on; the file is whole or not there."""
    step, elapsed, recent = place
    tensors = {f"{_NETWORK}{name}": value for name, value in network.state_dict().items()}
    for number, slots in optimiser.state_dict()["state"].items():
        tensors |= {f"{_OPTIMISER}{number}.{slot}": value for slot, value in slots.items()}
    entries = {
        "run": _identity(settings, mean, std),
        "step": json.dumps(step),
        "elapsed": json.dumps(elapsed),
        "recent": json.dumps(recent),
    }
    unfinished = path.with_name(path.name + ".part")
    save_file({name: value.contiguous() for name, value in tensors.items()}, unfinished, metadata=entries)
    unfinished.replace(path)


def read_checkpoint(
    path: Path,
    settings: TrainingSettings,
    mean: Triple,
    std: Triple,
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
) -> Place:
    """Put network and optimiser where they were.

    Raises:
        InvalidInput: no checkpoint, or one of another run (other settings, other frames).
    """
    parameters = list(network.parameters())
    try:
        with safe_open(path, framework="pt") as stored:
            entries: dict[str, str] = stored.metadata() or {}
            if entries.get("run") != _identity(settings, mean, std):
                raise InvalidInput("a checkpoint of another run (other settings or frames)", field=path.name)
            tensors: dict[str, Tensor] = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise InvalidInput(f"not a checkpoint ({error})", field=path.name) from error
    network.load_state_dict(
        {name.removeprefix(_NETWORK): value for name, value in tensors.items() if name.startswith(_NETWORK)}
    )
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        if name.startswith(_OPTIMISER):
            number, _, slot = name.removeprefix(_OPTIMISER).partition(".")
            state.setdefault(int(number), {})[slot] = _laid_out_like(parameters[int(number)], value)
    optimiser.load_state_dict({**optimiser.state_dict(), "state": state})
    return json.loads(entries["step"]), json.loads(entries["elapsed"]), json.loads(entries["recent"])


def _laid_out_like(parameter: Tensor, value: Tensor) -> Tensor:
    """The value in the parameter's memory order; AdamW's step counter is a scalar and has none."""
    if value.shape != parameter.shape:
        return value
    return torch.empty_like(parameter, requires_grad=False).copy_(value)


def _identity(settings: TrainingSettings, mean: Triple, std: Triple) -> str:
    """What must be equal to go on; where and with how many threads is free. The statistics stand for the frames."""
    return f"{settings.model_dump_json(exclude={'loader_threads', 'device'})} {mean} {std}"
