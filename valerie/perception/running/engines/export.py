"""Export torch networks to ONNX.

The export uses tracing, since torch's newer exporter takes 30 times as long (5 s for the smallest network) in every process.
"""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path
from typing import Final

import torch
from torch import nn

from valerie.perception import networks
from valerie.perception.running.adaptation import Size

#: A small picture with different sides, which every network here takes.
_EXAMPLE: Final = Size(64, 96)
_OPSET: Final = 17
_OWN_CODE: Final = str(Path(networks.__file__).parent)


def export_onnx(module: nn.Module, size: Size | None) -> bytes:
    """Return a module as one ONNX file.

    Args:
        module: (1, 3, H, W) float32 to logits (1, C, h, w), in evaluation mode.
        size: height and width of the pictures; None leaves them free, for modules whose code does not depend on them.
    """
    axes = {"picture": {2: "height", 3: "width"}, "logits": {2: "rows", 3: "columns"}} if size is None else None
    exported = BytesIO()
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module,
            (torch.zeros(1, 3, *(size or _EXAMPLE)),),
            exported,  # type: ignore[arg-type]  # a file object is taken as well
            dynamo=False,
            opset_version=_OPSET,
            input_names=["picture"],
            output_names=["logits"],
            dynamic_axes=axes,
        )
    return exported.getvalue()


def looks_at_size(module: nn.Module) -> bool:
    """Return True if Python code of `valerie.perception.networks` branches on a picture's size, which a trace would freeze."""
    with warnings.catch_warnings(record=True) as noticed, torch.no_grad():
        warnings.simplefilter("always")
        torch.jit.trace(module, torch.zeros(1, 3, *_EXAMPLE), check_trace=False)  # type: ignore[no-untyped-call]
    return any(
        warning.category.__name__ == "TracerWarning" and warning.filename.startswith(_OWN_CODE) for warning in noticed
    )
