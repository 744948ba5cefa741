"""Choice of the fastest engine: by the machine for shipped functions, by comparison for registered ones."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InferenceError, ValerieError
from valerie.perception.documents.function import ENGINES, EngineName, FunctionDocument, Precision
from valerie.perception.running.engines.processor import multiplies_bf16

#: Precision that depends on the processor.
AUTO: Final = "auto"
#: Entry of the provenance with the reason for the engine.
REASON: Final = "engine chosen"
#: Largest difference of logits between an engine and the reference.
TOLERANCE: Final = 1e-3
#: The engines in fp32 on processors (docs/benchmarks.md).
_FASTEST_FIRST: Final[tuple[EngineName, ...]] = ("openvino", "onnxruntime", "torch")
_ON_GPU: Final = "torch uses the graphics card"
#: Height and width of the picture that engines are compared on.
_SIZE: Final = (128, 256)


class EngineChoice(NamedTuple):
    """An engine and the reason for it."""

    engine: EngineName
    precision: Precision
    reason: str

    def applied(self, document: FunctionDocument) -> FunctionDocument:
        """Return the document with this engine, and with the reason in its provenance."""
        provenance = {**document.provenance, REASON: self.reason}
        return document.model_copy(
            update={"engine": self.engine, "precision": self.precision, "provenance": provenance}
        )


def local_choice(device: str, precision: str) -> EngineChoice:
    """Choose the engine of a shipped function by the hardware and packages of this machine, without loading an engine.

    Args:
        device: see `valerie.perception.running.opening.open_function`.
        precision: ``fp32``, ``bf16``, or `AUTO`: bf16 if the processor has instructions for it, otherwise fp32.
    """
    in_torch: Precision = "bf16" if precision == "bf16" else "fp32"
    if uses_gpu(device):
        return EngineChoice("torch", in_torch, _ON_GPU)
    if find_spec("openvino") is None:
        return EngineChoice("torch", in_torch, "torch, since openvino is not installed")
    if precision == "bf16" or (precision == AUTO and multiplies_bf16()):
        return EngineChoice("openvino", "bf16", "openvino in bf16, which this processor multiplies")
    return EngineChoice("openvino", "fp32", "openvino, the fastest in fp32")


def uses_gpu(device: str) -> bool:
    """Return True if torch would use a graphics card; torch is not loaded."""
    if device == "auto":
        try:
            return Path("/dev/nvidiactl").exists() and not version("torch").endswith("+cpu")
        except PackageNotFoundError:
            return False
    return device.startswith("cuda")


def agreeing_choice(document: FunctionDocument, payload: Path, *, device: str = "cpu") -> EngineChoice:
    """Choose the fastest engine whose logits of a picture differ from the reference's by at most `TOLERANCE`, in fp32.

    The reference is torch, and onnxruntime for ONNX files, which torch does not read. An engine that is not installed or cannot
    run the network is left out, with its reason. What torch runs on a graphics card is not compared.

    Args:
        document: document of a kind with a payload.
        payload: its file.
        device: see `valerie.perception.running.opening.open_function`.

    Raises:
        ValerieError: the reference cannot run it.
    """
    if "torch" in ENGINES[document.kind] and uses_gpu(device):
        return EngineChoice("torch", "fp32", _ON_GPU)
    reference: EngineName = "torch" if "torch" in ENGINES[document.kind] else "onnxruntime"
    reference_answer = _answer(document, payload, reference)
    complaints = []
    for engine in _FASTEST_FIRST:
        if engine == reference:
            break
        try:
            answer = _answer(document, payload, engine)
        except ValerieError as error:
            complaints.append(f"{engine} does not run it here ({error})")
            continue
        if answer.shape == reference_answer.shape and np.abs(answer - reference_answer).max() <= TOLERANCE:
            return EngineChoice(
                engine, "fp32", f"{engine}, the fastest whose logits agree with {reference} to {TOLERANCE:g}"
            )
        complaints.append(f"{engine} differs from it by more than {TOLERANCE:g}")
    return EngineChoice(reference, "fp32", f"{reference}, the reference: {'; '.join(complaints)}")


def _answer(document: FunctionDocument, payload: Path, engine: str) -> NDArray[Any]:
    """Return the answer of an engine to a picture of coloured blocks and noise."""
    from valerie.perception.running.adaptation import plan
    from valerie.perception.running.opening import open_engine

    random = np.random.default_rng(0)
    blocks = np.kron(random.integers(0, 200, (8, 16, 3)), np.ones((16, 16, 1), int))
    picture = (blocks + random.integers(0, 56, (*_SIZE, 3))).astype(np.uint8)
    opened = open_engine(document.model_copy(update={"engine": engine, "precision": "fp32"}), payload, device="cpu")
    try:
        return opened.answer(plan(document.input, *_SIZE).pieces(picture)[0])
    except (ValerieError, MemoryError):
        raise
    except Exception as error:  # engines raise errors of their own libraries
        raise InferenceError(str(error).strip().partition("\n")[0]) from error
    finally:
        opened.close()
