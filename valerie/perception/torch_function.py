"""A perception function that runs in torch on the CPU: the fp32 reference."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from valerie.errors import InferenceError, InvalidInput
from valerie.perception.base import FunctionCard
from valerie.perception.documents import FunctionDocument
from valerie.perception.labelling import in_channels_last, label_maps
from valerie.perception.loaders import load_network


class TorchFunction:
    """A network of `valerie.perception.networks`; see `valerie.perception.base.PerceptionFunction`.

    fp32 is the reference: labels are reproducible within one numeric class. The kernels that torch picks depend on the
    instruction set and on the number of threads (the last bits of the logits do differ), so both are part of the class.

    Args:
        document: kind ``network``, engine ``torch``.
        path: the function file.
        threads: torch's threads *of this process*; one function per process is the intended use.
        digest: what stands for the function on its card.

    Raises:
        NotFound, UnknownName, InvalidInput: as `valerie.perception.loaders.load_network`.
    """

    #: Raised by hand whenever normalising, padding or labelling gives other pixels; part of every prediction's digest.
    revision: ClassVar[int] = 1

    def __init__(self, document: FunctionDocument, path: Path, *, threads: int, digest: str) -> None:
        network, _ = load_network(path)
        torch.set_num_threads(threads)
        self._network = in_channels_last(network)
        self._mean = torch.tensor(document.input.mean)
        self._std = torch.tensor(document.input.std)
        self._card = document.card(digest=digest, precision=_precision(network))

    @property
    def card(self) -> FunctionCard:
        return self._card

    @property
    def numeric_class(self) -> str:
        """E.g. ``torch-2.13.0-cpu-fp32-avx512-t1``: version without build tag, device, precision, kernels, threads."""
        version = torch.__version__.partition("+")[0]
        isa = torch.backends.cpu.get_cpu_capability().lower().replace(" ", "-")
        return f"torch-{version}-cpu-{self._card.precision}-{isa}-t{torch.get_num_threads()}"

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 sRGB picture to (H, W) uint8 train ids.

        Raises:
            InvalidInput: the picture is not (H, W, 3) uint8 or is empty.
            InferenceError: torch failed.
        """
        if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3 or picture.size == 0:
            given = f"{picture.dtype} {picture.shape}"
            raise InvalidInput("not a picture", field="picture", value=given, limit="(H, W, 3) uint8, not empty")
        # A copy, because torch wants a writable array and the caller's may be read-only.
        batch = torch.from_numpy(picture.copy()).unsqueeze(0)
        try:
            with torch.inference_mode():
                labels = label_maps(self._network, batch, self._mean, self._std)[0]
        except RuntimeError as error:
            raise InferenceError(f"{self._card.name}: torch failed on a picture of {picture.shape}: {error}") from error
        result: NDArray[np.uint8] = labels.numpy()
        return result

    def close(self) -> None:
        """Free the weights; the instance is unusable afterwards."""
        del self._network


def _precision(network: torch.nn.Module) -> str:
    """The precision that the weights really have, e.g. ``fp32``."""
    kinds = {parameter.dtype for parameter in network.parameters()}
    names = {torch.float32: "fp32", torch.bfloat16: "bf16", torch.float16: "fp16"}
    return "+".join(sorted(names[kind] for kind in kinds))
