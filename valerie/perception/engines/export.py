"""A torch network as an ONNX file, for the engines that take one."""

from __future__ import annotations

import logging
import warnings
from pathlib import Path

import torch
from torch import nn
from torch.export import Dim

from valerie.perception.labelling import ALIGNMENT

_EXAMPLE = 2 * ALIGNMENT, 3 * ALIGNMENT


def export_onnx(module: nn.Module, path: Path) -> None:
    """Write a module as one file that takes one picture whose sides are any multiples of 32.

    Args:
        module: (1, 3, H, W) float32 to logits (1, C, h, w), in evaluation mode.
        path: where to.
    """
    shapes = ({2: ALIGNMENT * Dim("rows", min=1, max=512), 3: ALIGNMENT * Dim("columns", min=1, max=512)},)
    # The exporter announces changes of its own insides, and that libraries nobody needs are not installed.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            module,
            (torch.zeros(1, 3, *_EXAMPLE),),
            dynamo=True,
            verbose=False,
            dynamic_shapes=shapes,
            input_names=["picture"],
            output_names=["logits"],
        )
        assert program is not None
        program.save(path, external_data=False)
