"""Make references with VainF/DeepLabV3Plus-Pytorch: ``python -m tools.references.vainf CHECKOUT``. It needs only torch."""

import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from tools.references.making import Built, Case, Origin, main

ORIGIN = Origin(
    script="tools/references/vainf.py",
    source="github.com/VainF/DeepLabV3Plus-Pytorch",
    commit="4e1087de98bc49d55b9239ae92810ef7368660db",
    made=(
        "The original module, run unchanged on a processor: every tensor and the picture by tools/references/recipe.py, logits "
        "of the whole model at the picture's size."
    ),
)


def cases_of(_: Path) -> Sequence[Case]:
    """Return both depths at both output strides. The stride changes no tensor, so only one list of tensors is kept."""
    return [
        Case(
            name=f"deeplabv3plus-r{depth}" + ("-os8" if stride == 8 else ""),
            layout="VainF/DeepLabV3Plus-Pytorch",
            file=f"network/modeling.py: deeplabv3plus_resnet{depth}",
            settings={"num_classes": 19, "output_stride": stride},
            build=partial(_built, f"deeplabv3plus_resnet{depth}", stride),
            whole=(depth, stride) == (101, 16),
        )
        for depth in (101, 50)
        for stride in (16, 8)
    ]


def _built(function: str, stride: int) -> Built:
    build = getattr(import_module("network.modeling"), function)
    model: Any = build(num_classes=19, output_stride=stride, pretrained_backbone=False)
    return model, model


if __name__ == "__main__":
    sys.exit(main(ORIGIN, cases_of))
