"""Networks in torch: fp32 on the CPU is the reference that every other engine is compared with."""

from __future__ import annotations

import re
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from valerie.errors import MissingDependency
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.adaptation import Size
from valerie.perception.running.engines.labelling import in_channels_last, largest_channel, normalised
from valerie.perception.running.engines.processor import instruction_set

_TYPES: Final = {"fp32": torch.float32, "bf16": torch.bfloat16, "fp16": torch.float16}
_NAMES: Final = {kind: name for name, kind in _TYPES.items()}
#: Pictures at once on a GPU with the memory for it (a full-HD frame of a ResNet-101 takes about 2 GB).
_GPU_BATCH: Final = 4
_GPU_BATCH_BYTES: Final = 12 << 30


class TorchEngine:
    """See `valerie.perception.running.engines.base.InferenceEngine`.

    torch chooses kernels by instruction set and number of threads, and on a GPU by the batch. All of these are part of the
    numeric class, and a GPU's batch is always full, so that a label never depends on the other pictures.

    Args:
        module: see `valerie.perception.running.engines.modules.open_module`; the engine owns it from now on.
        document: document of the function.
        threads: torch's CPU threads *in this process*.
        device: ``auto`` uses a GPU if there is one; ``cpu``; ``cuda`` or ``cuda:1``.

    Raises:
        MissingDependency: no such device, or it has no such precision.
    """

    name: Final = "torch"

    def __init__(self, module: nn.Module, document: FunctionDocument, *, threads: int, device: str = "auto") -> None:
        self._device = _device(device)
        precision = document.precision
        if self._device.type == "cpu" and precision == "fp16":
            raise MissingDependency("torch has no fp16 on processors; use bf16 or fp32, or a GPU")
        torch.set_num_threads(threads)
        if self._device.type == "cuda":
            _reproducible_on_gpu()
        self._module = in_channels_last(module.to(self._device, _TYPES[precision]))
        self._input = document.input
        self._output = document.output
        self._aligned = bool(getattr(module, "align_corners", document.output.align_corners))
        self._mean = torch.tensor(document.input.mean, device=self._device)
        self._std = torch.tensor(document.input.std, device=self._device)
        self.batch_size = 1 if self._device.type == "cpu" else _gpu_batch(self._device)
        self.precision = _precision(self._module)

    @property
    def numeric_class(self) -> str:
        """E.g. ``torch-2.13.0-cpu-fp32-avx512-t1`` or ``torch-2.13.0-cuda13.0-nvidia-h100-fp32-b4``."""
        version = torch.__version__.partition("+")[0]
        if self._device.type == "cuda":
            gpu = re.sub(r"[^a-z0-9]+", "-", torch.cuda.get_device_name(self._device).lower()).strip("-")
            return f"torch-{version}-cuda{torch.version.cuda}-{gpu}-{self.precision}-b{self.batch_size}"
        kernels = torch.backends.cpu.get_cpu_capability().lower().replace(" ", "-")
        if self.precision != "fp32":  # torch's own name does not distinguish the instructions that matter here
            kernels = f"{kernels}-{instruction_set()}"
        return f"torch-{version}-cpu-{self.precision}-{kernels}-t{torch.get_num_threads()}"

    def answer(self, piece: NDArray[np.uint8]) -> NDArray[Any]:
        """See `Engine`."""
        with torch.inference_mode():
            logits: NDArray[Any] = self._logits(piece[None])[0].float().cpu().numpy()
        return logits

    def ids(self, pieces: NDArray[np.uint8], labels: Size) -> NDArray[np.uint8]:
        """See `Engine`."""
        count = len(pieces)
        if count < self.batch_size:
            pieces = np.concatenate([pieces, np.repeat(pieces[-1:], self.batch_size - count, axis=0)])
        with torch.inference_mode():
            ids = self._ids(self._logits(pieces), labels)[:count].cpu()
        answer: NDArray[np.uint8] = ids.numpy()
        return answer

    def _logits(self, pieces: NDArray[np.uint8]) -> torch.Tensor:
        batch = torch.from_numpy(np.ascontiguousarray(pieces)).to(self._device)
        if self._input.channel_order == "bgr":
            batch = batch.flip(-1)
        values = normalised(batch, self._mean, self._std, self._input.value_range)
        logits: torch.Tensor = self._module(values.to(_TYPES[self.precision]))
        return logits

    def _ids(self, logits: torch.Tensor, labels: Size) -> torch.Tensor:
        if len(self._output.classes) > 1:
            return largest_channel(logits, *labels, align_corners=self._aligned)
        values = nn.functional.interpolate(logits, size=tuple(labels), mode="bilinear", align_corners=self._aligned)
        return torch.where(values[:, 0] > self._output.cut, 0, 255).to(torch.uint8)

    def close(self) -> None:
        """Free the weights."""
        del self._module
        if self._device.type == "cuda":
            torch.cuda.empty_cache()


def _device(name: str) -> torch.device:
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    device = torch.device(name)
    if device.type == "cuda" and (not torch.cuda.is_available() or (device.index or 0) >= torch.cuda.device_count()):
        raise MissingDependency(f"torch sees no GPU {name!r} on this machine")
    return device


def _reproducible_on_gpu() -> None:
    """Switch off TF32, which is not fp32, and the choice of kernels by measured time."""
    torch.backends.cuda.matmul.allow_tf32 = False
    torch.backends.cudnn.allow_tf32 = False
    torch.backends.cudnn.benchmark = False
    torch.backends.cudnn.deterministic = True


def _gpu_batch(device: torch.device) -> int:
    return _GPU_BATCH if torch.cuda.get_device_properties(device).total_memory >= _GPU_BATCH_BYTES else 1


def _precision(network: nn.Module) -> str:
    """Return the precision of the weights, e.g. ``fp32``."""
    kinds = {parameter.dtype for parameter in network.parameters()}
    return "+".join(sorted(_NAMES[kind] for kind in kinds))
