"""Make references with detectron2 and its projects DeepLab and PointRend: ``python -m tools.references.detectron2 CHECKOUT``.

It needs ``fvcore``, ``iopath``, ``omegaconf``, ``hydra-core``, ``yacs``, ``cloudpickle``, ``tabulate`` and ``termcolor``,
but neither torchvision nor detectron2's compiled operators, which these networks do not use.
"""

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from tools.references.making import Built, Case, Origin, StandIns, main

ORIGIN = Origin(
    script="tools/references/detectron2.py",
    source="github.com/facebookresearch/detectron2",
    commit="02b5c4e295e990042a714712c21dc79b731e8833",
    packages=("torch", "fvcore"),
    made=(
        "The original model built from its configuration, run unchanged on a processor (compiled operators, which it does not "
        "use, left out): every tensor and the picture by tools/references/recipe.py, logits of backbone and head at the "
        "picture's size."
    ),
    unused=("sem_seg_head.point_head.",),
)

DEEPLAB = "projects/DeepLab/configs/Cityscapes-SemanticSegmentation/deeplab_v3_plus_R_103_os16_mg124_poly_90k_bs16.yaml"
POINT_REND = "projects/PointRend/configs/SemanticSegmentation/pointrend_semantic_R_101_FPN_1x_cityscapes.yaml"
PLAIN = "configs/Base-RCNN-FPN.yaml"


def cases_of(checkout: Path) -> Sequence[Case]:
    """Return DeepLab's R-103, PointRend's coarse head at two depths, and the same head without PointRend."""
    # detectron2 compares this version at import.
    sys.meta_path.insert(0, StandIns(["torchvision", "detectron2._C"], {"__version__": "0.28.0"}))
    small = {
        "INPUT.CROP.SIZE": [32, 48],
        "MODEL.RESNETS.NORM": "BN",
        "MODEL.SEM_SEG_HEAD.NORM": "BN",
    }
    why = (
        "BN is SyncBN on one processor. A crop of 32 x 48 gives a pooling window of 2 x 3, smaller than the 4 x 6 map of the "
        "small picture, as the window of 32 x 64 is smaller than the map of a full picture."
    )
    part = "backbone and coarse_sem_seg_head; the point head is not used"
    plain = {
        "MODEL.META_ARCHITECTURE": "SemanticSegmentor",
        "MODEL.RESNETS.DEPTH": 101,
        "MODEL.SEM_SEG_HEAD.NUM_CLASSES": 19,
    }
    coarse = [
        Case(
            name=f"semantic-fpn-r{depth}-gn",
            layout="detectron2 PointRend",
            file=POINT_REND,
            settings={"MODEL.RESNETS.DEPTH": depth, "part": part},
            build=partial(_built, checkout, POINT_REND, {"MODEL.RESNETS.DEPTH": depth}, coarse=True),
            whole=depth == 101,
        )
        for depth in (101, 50)
    ]
    return [
        Case(
            name="deeplabv3plus-r103",
            layout="detectron2 DeepLab",
            file=DEEPLAB,
            settings=small | {"why": why},
            build=partial(_built, checkout, DEEPLAB, small),
            whole=True,
        ),
        *coarse,
        Case(
            name="semantic-fpn-r101-gn-plain",
            architecture="semantic-fpn-r101-gn",
            layout="detectron2 semantic FPN",
            file=PLAIN,
            settings=plain,
            build=partial(_built, checkout, PLAIN, plain),
        ),
    ]


def _built(checkout: Path, file: str, settings: Mapping[str, Any], *, coarse: bool = False) -> Built:
    configuration = import_module("detectron2.config").get_cfg()
    if file == DEEPLAB:
        import_module("detectron2.projects.deeplab").add_deeplab_config(configuration)
    elif file == POINT_REND:
        import_module("detectron2.projects.point_rend").add_pointrend_config(configuration)
    configuration.merge_from_file(str(checkout / file))
    options = {"MODEL.DEVICE": "cpu", **settings}
    configuration.merge_from_list([each for pair in options.items() for each in pair])
    model: Any = import_module("detectron2.modeling").build_model(configuration)
    head = model.sem_seg_head.coarse_sem_seg_head if coarse else model.sem_seg_head
    # The heads give logits and losses; without labels there are no losses.
    return model, lambda picture: head(model.backbone(picture))[0]


if __name__ == "__main__":
    sys.exit(main(ORIGIN, cases_of))
