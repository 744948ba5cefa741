"""The training loop: cross-entropy, AdamW, a polynomial schedule, checkpoints; deterministic on the CPU."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from valerie.errors import InvalidInput
from valerie.labels import PERSON
from valerie.perception.importing.function_file import compact, function_file_bytes
from valerie.perception.importing.network_weights import load_network
from valerie.perception.networks.architectures import Network, build_network
from valerie.perception.running.engines.labelling import in_channels_last, normalised
from valerie.perception.running.engines.processor import multiplies_bf16
from valerie.perception.training.checkpoint import CheckpointFile, Position
from valerie.perception.training.frame_folder import TrainingFrame
from valerie.perception.training.held_out_figures import ValidationFigures, validate
from valerie.perception.training.loss import pixel_loss
from valerie.perception.training.samples import batches
from valerie.perception.training.statistics import channel_statistics, class_weights, spread
from valerie.perception.training.training_settings import TrainingSettings

#: Held-out frames for validation during training; at the end all are used.
_QUICK_FRAMES: Final = 64
_POLY_POWER: Final = 0.9


@dataclass(frozen=True, slots=True)
class TrainingProgress:
    """The progress of a run.

    Attributes:
        step, steps: completed and planned steps.
        fraction: fraction of the schedule, 0…1; above step / steps if the time budget is the tighter bound.
        loss: loss of the last step.
        elapsed_s: training time, over all resumptions.
        figures: figures of a validation after this step; None if there was none.
    """

    step: int
    steps: int
    fraction: float
    loss: float
    elapsed_s: float
    figures: ValidationFigures | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TrainedModel:
    """The result of a run; its weights are rounded to half precision, as in function files.

    Attributes:
        network: the network in evaluation mode, fp32, on the CPU.
        settings: settings of its training.
        mean, std: its normalisation.
        steps: optimiser steps taken.
        final_loss: mean loss over the last steps (at most 50).
        figures: figures of the rounded weights on all held-out frames; None without held-out frames.
    """

    network: Network
    settings: TrainingSettings
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    steps: int
    final_loss: float
    figures: ValidationFigures | None

    def to_bytes(self, provenance: dict[str, str]) -> bytes:
        """Return the function file (see `valerie.perception.importing.function_file`).

        Args:
            provenance: entries of the header; seed, steps, precision, settings and figures are added.
        """
        state = self.network.state_dict()
        tensors = {name: value.numpy() for name, value in state.items() if value.is_floating_point()}
        own = {
            "seed": str(self.settings.seed),
            "steps": str(self.steps),
            "training-precision": self.settings.precision,
            "training-torch": torch.__version__,
            "training-settings": self.settings.model_dump_json(exclude={"loader_threads", "device"}),
            "final-loss": f"{self.final_loss:.4f}",
        }
        figures = {} if self.figures is None else self.figures.as_text()
        return function_file_bytes(
            tensors,
            architecture=self.settings.architecture,
            mean=self.mean,
            std=self.std,
            provenance={**provenance, **own, **figures},
            longest_side=self.settings.longest_side,
        )


def train(
    settings: TrainingSettings,
    frames: Sequence[TrainingFrame],
    *,
    held_out: Sequence[TrainingFrame] = (),
    progress: Callable[[TrainingProgress], None] = lambda _: None,
    checkpoint: Path | None = None,
    start_from: Path | None = None,
    threads: int | None = None,
) -> TrainedModel:
    """Train one network from scratch, from the weights of a function file, or from a checkpoint.

    Args:
        settings: settings of the training.
        frames: frames to train on.
        held_out: frames to validate on, from sites that ``frames`` does not show.
        progress: called after every step.
        checkpoint: file that is written every ``checkpoint_every`` steps and at the end. If it exists, training resumes
            from it and ends with the same weights as without the interruption.
        start_from: function file of the same architecture with the first weights and the normalisation; the schedule is
            new.
        threads: torch's CPU threads in this process from now on; None leaves them unchanged. A run is repeatable only with
            equal threads.

    Raises:
        InvalidInput: no frames, a site in both sets, a checkpoint of another run, a file of another architecture.
        UnknownName: the architecture.
    """
    _require_apart(frames, held_out)
    if threads is not None:
        torch.set_num_threads(threads)
    device = _device(settings)
    settings = settings.model_copy(update={"precision": _precision(settings, device)})
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        network = build_network(settings.architecture)
    if start_from is None:
        mean, std = channel_statistics(frames)
    else:
        mean, std = _start_from(start_from, settings, network)
    network = _in_training(in_channels_last(network).to(device), settings)
    mean_tensor, std_tensor = torch.tensor(mean, device=device), torch.tensor(std, device=device)
    optimiser = torch.optim.AdamW(network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
    weights = torch.from_numpy(class_weights(frames, settings.class_balance)).to(device)
    weights[PERSON.train_id] *= settings.person_weight
    position = Position()
    resumption = None if checkpoint is None else CheckpointFile(checkpoint, settings, mean, std)
    if resumption is not None and resumption.path.exists():
        position = resumption.read(network, optimiser)
    step, recent = position.step, position.recent

    started = time.monotonic() - position.elapsed_s
    stream = batches(frames, settings, step)
    try:
        for pictures, labels in stream:
            elapsed = time.monotonic() - started
            fraction = _fraction(settings, step, elapsed)
            if fraction >= 1.0:
                break
            for group in optimiser.param_groups:
                group["lr"] = _learning_rate(settings, step, fraction)
            loss = _step(
                network,
                normalised(torch.from_numpy(pictures).to(device), mean_tensor, std_tensor),
                torch.from_numpy(labels).to(device),
                weights,
                optimiser,
                settings,
            )
            step += 1
            recent = (*recent[-49:], loss)
            figures = None
            if held_out and step % settings.validate_every == 0 and step < settings.steps:
                figures = validate(
                    network,
                    spread(held_out, _QUICK_FRAMES),
                    mean_tensor,
                    std_tensor,
                    longest_side=settings.longest_side,
                )
                _in_training(network, settings)
            if resumption is not None and (step % settings.checkpoint_every == 0 or step == settings.steps):
                elapsed = time.monotonic() - started
                resumption.write(network, optimiser, Position(step=step, elapsed_s=elapsed, recent=recent))
            progress(TrainingProgress(step, settings.steps, fraction, loss, elapsed, figures))
    finally:
        stream.close()

    _round_as_stored(network)
    network.eval().requires_grad_(requires_grad=False)
    final = None
    if held_out:
        final = validate(network, held_out, mean_tensor, std_tensor, longest_side=settings.longest_side)
    mean_loss = sum(recent) / len(recent) if recent else float("nan")
    return TrainedModel(network.cpu(), settings, mean, std, step, mean_loss, final)


def _start_from(
    path: Path, settings: TrainingSettings, network: Network
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Load a function file's weights into ``network`` and return its normalisation."""
    started, header = load_network(path)
    if header.architecture != settings.architecture:
        raise InvalidInput(
            "the file holds another architecture",
            field="start_from",
            value=header.architecture,
            limit=settings.architecture,
        )
    network.load_state_dict(started.state_dict())
    return header.mean, header.std


def _in_training(network: Network, settings: TrainingSettings) -> Network:
    """Put the network into training mode, except batch normalisation that keeps its statistics, and return it."""
    network.train()
    if settings.keep_norm_statistics:
        for module in network.modules():
            if isinstance(module, nn.BatchNorm2d):
                module.eval()
    return network


def _step(
    network: Network,
    pictures: Tensor,
    labels: Tensor,
    weights: Tensor,
    optimiser: torch.optim.Optimizer,
    settings: TrainingSettings,
) -> float:
    """Make one optimiser step and return the loss."""
    with torch.autocast(pictures.device.type, torch.bfloat16, enabled=settings.precision == "bf16"):
        logits: Tensor = network(pictures)
        full = functional.interpolate(
            logits, size=labels.shape[-2:], mode="bilinear", align_corners=network.align_corners
        )
    # In fp32: a sum over a million pixels needs the mantissa.
    loss = pixel_loss(full.float(), labels.long(), weights, void_weight=settings.void_weight)
    optimiser.zero_grad(set_to_none=True)
    torch.autograd.backward(loss)
    optimiser.step()
    return float(loss.detach())


def _fraction(settings: TrainingSettings, step: int, elapsed: float) -> float:
    by_steps = step / settings.steps
    return by_steps if settings.time_budget_s is None else max(by_steps, elapsed / settings.time_budget_s)


def _learning_rate(settings: TrainingSettings, step: int, fraction: float) -> float:
    warmup = min(1.0, (step + 1) / (settings.warmup_steps + 1))
    return float(settings.learning_rate * warmup * (1.0 - fraction) ** _POLY_POWER)


def _device(settings: TrainingSettings) -> torch.device:
    if settings.device == "cuda" and not torch.cuda.is_available():
        raise InvalidInput("there is no CUDA device here", field="device", value="cuda", limit="cpu or auto")
    if settings.device == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    return torch.device(settings.device)


def _precision(settings: TrainingSettings, device: torch.device) -> Literal["bf16", "fp32"]:
    if settings.precision != "auto":
        return settings.precision
    fast = torch.cuda.is_bf16_supported() if device.type == "cuda" else multiplies_bf16()
    return "bf16" if fast else "fp32"


def _require_apart(frames: Sequence[TrainingFrame], held_out: Sequence[TrainingFrame]) -> None:
    if not len(frames):
        raise InvalidInput("no frames to train on", field="frames", limit="at least one")
    both = _seeds(frames) & _seeds(held_out)
    if both:
        raise InvalidInput("sites in training and held-out frames", field="held_out", value=sorted(both)[:5])


def _seeds(frames: Sequence[TrainingFrame]) -> frozenset[int]:
    seeds: frozenset[int] | None = getattr(frames, "site_seeds", None)  # a folder knows without reading frames
    return seeds if seeds is not None else frozenset(frame.site_seed for frame in frames)


def _round_as_stored(network: nn.Module) -> None:
    with torch.no_grad():
        for tensor in network.state_dict().values():
            if tensor.is_floating_point():
                tensor.copy_(torch.from_numpy(compact(tensor.cpu().numpy())))
