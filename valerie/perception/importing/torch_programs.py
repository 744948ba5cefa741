"""Conversion of torch programs to ONNX. A program is loaded once, and only where the operator allows it.

Loading either format may run its author's code, and there is no other way to read it. Only the exported graph is kept,
which is data.
"""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path
from typing import Final

import torch

from valerie.errors import InvalidInput

_OPSET: Final = 17
_ANY_SIDES: Final = (256, 128)


def program_to_onnx(path: Path, size: tuple[int, int] | None) -> bytes:
    """Load a program, which runs it, and export it to one ONNX file with an input ``picture`` (1, 3, height, width).

    Args:
        path: ``….pt2`` (`torch.export.save`) or ``….torchscript`` (`torch.jit.save`).
        size: width and height of the network's input; None: any.

    Raises:
        InvalidInput: it cannot be loaded or exported; states the reason.
    """
    width, height = size or _ANY_SIDES
    free = {2: "height", 3: "width"}
    exported = BytesIO()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the exporter warns about itself
            network = _Exported(path) if path.suffix == ".pt2" else torch.jit.load(path).eval()  # type: ignore[no-untyped-call]
            torch.onnx.export(
                network,
                (torch.zeros(1, 3, height, width),),
                exported,  # type: ignore[arg-type]  # a file object is taken as well
                dynamo=False,  # one file
                opset_version=_OPSET,
                input_names=["picture"],
                output_names=["result"],
                dynamic_axes=None if size else {"picture": free, "result": free},
            )
    except Exception as error:  # a program may fail in any way
        reason = str(error).strip().partition("\n")[0]
        hint = "" if size else "; if it takes one size only, state it in the document: input: {size: [width, height]}"
        raise InvalidInput(f"it cannot be loaded and exported ({reason}){hint}", field=path.name) from error
    return exported.getvalue()


class _Exported(torch.nn.Module):
    """Wrapper that hides a program's submodules: the exporter asks every submodule for its mode, and these have none."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        program = torch.export.load(path).module()
        program.requires_grad_(requires_grad=False)
        self._held = (program,)  # in a tuple, so that it is not a submodule

    def forward(self, picture: torch.Tensor) -> torch.Tensor:
        result: torch.Tensor = self._held[0](picture)
        return result
