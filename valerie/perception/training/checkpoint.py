"""Checkpoints of a training run as safetensors, so that resuming never runs code in a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from valerie.document import Document
from valerie.errors import InvalidInput
from valerie.perception.training.statistics import Triple
from valerie.perception.training.training_settings import TrainingSettings

_NETWORK: Final = "network."
_OPTIMISER: Final = "optimiser."


class Position(Document):
    """The position of a run in its schedule.

    Attributes:
        step: optimiser steps done.
        elapsed_s: seconds of training, over all resumptions.
        recent: losses of the last steps.
    """

    step: int = 0
    elapsed_s: float = 0.0
    recent: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class CheckpointFile:
    """The checkpoint file of one run.

    Attributes:
        path: path of the file.
        settings: settings of the run.
        mean, std: normalisation of the pictures, which identifies a checkpoint of other frames.
    """

    path: Path
    settings: TrainingSettings
    mean: Triple
    std: Triple

    def write(self, network: nn.Module, optimiser: torch.optim.Optimizer, position: Position) -> None:
        """Write everything that the next step depends on, atomically."""
        tensors = {f"{_NETWORK}{name}": value for name, value in network.state_dict().items()}
        for number, slots in optimiser.state_dict()["state"].items():
            tensors |= {f"{_OPTIMISER}{number}.{slot}": value for slot, value in slots.items()}
        entries = {"run": self._identity(), "position": position.model_dump_json()}
        unfinished = self.path.with_name(self.path.name + ".part")
        save_file({name: value.contiguous() for name, value in tensors.items()}, unfinished, metadata=entries)
        unfinished.replace(self.path)

    def read(self, network: nn.Module, optimiser: torch.optim.Optimizer) -> Position:
        """Restore network and optimiser, and return the position.

        Raises:
            InvalidInput: not a checkpoint, or one of another run (other settings, other frames).
        """
        try:
            with safe_open(self.path, framework="pt") as file:
                entries: dict[str, str] = file.metadata() or {}
                if entries.get("run") != self._identity():
                    raise InvalidInput("a checkpoint of another run (other settings or frames)", field=self.path.name)
                tensors: dict[str, Tensor] = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, OSError) as error:
            raise InvalidInput(f"not a checkpoint ({error})", field=self.path.name) from error
        network.load_state_dict(
            {name.removeprefix(_NETWORK): value for name, value in tensors.items() if name.startswith(_NETWORK)}
        )
        parameters = list(network.parameters())
        state: dict[int, dict[str, Tensor]] = {}
        for name, value in tensors.items():
            if name.startswith(_OPTIMISER):
                number, _, slot = name.removeprefix(_OPTIMISER).partition(".")
                state.setdefault(int(number), {})[slot] = _laid_out_like(parameters[int(number)], value)
        optimiser.load_state_dict({**optimiser.state_dict(), "state": state})
        return Position.model_validate_json(entries["position"])

    def _identity(self) -> str:
        """Return the text that has to match before training resumes; device and number of threads may differ."""
        return f"{self.settings.model_dump_json(exclude={'loader_threads', 'device'})} {self.mean} {self.std}"


def _laid_out_like(parameter: Tensor, value: Tensor) -> Tensor:
    """Return the value in the parameter's memory order; AdamW's step counter is a scalar and has none."""
    if value.shape != parameter.shape:
        return value
    return torch.empty_like(parameter, requires_grad=False).copy_(value)
