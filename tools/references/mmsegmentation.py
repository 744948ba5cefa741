"""Make references with mmsegmentation 1.2.2: ``python -m tools.references.mmsegmentation CHECKOUT``.

The folder is a checkout, or the site-packages that contain the package ``mmsegmentation``; ``mmengine`` and ``mmcv-lite``
are needed too.
"""

import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from tools.references.making import Built, Case, Origin, StandIns, main

RELEASE = "1.2.2"

ORIGIN = Origin(
    script="tools/references/mmsegmentation.py",
    source="github.com/open-mmlab/mmsegmentation",
    commit="c685fe6767c4cadf6b051983ca6208f1b9d1ccb8",
    packages=("torch", "mmsegmentation", "mmengine", "mmcv-lite"),
    made=(
        "The original model built from its configuration, run unchanged on a processor (compiled operators, which it does not "
        "use, left out): every tensor and the picture by tools/references/recipe.py, logits of encode_decode at the picture's "
        "size. The commit is that of the release; what ran was the release's package, which names no commit."
    ),
    unused=("auxiliary_head.",),
)

#: Name of the reference to configuration; the references in WHOLE keep the list of tensors.
FILES = {
    "deeplabv3plus-r101c-os8": "deeplabv3plus/deeplabv3plus_r101-d8_4xb2-80k_cityscapes-512x1024.py",
    "deeplabv3plus-r101c-os8-aligned": "deeplabv3plus/deeplabv3plus_r101-d8_4xb2-80k_cityscapes-769x769.py",
    "deeplabv3plus-r101c-os16": "deeplabv3plus/deeplabv3plus_r101-d16-mg124_4xb2-80k_cityscapes-512x1024.py",
    "deeplabv3plus-r50c-os8": "deeplabv3plus/deeplabv3plus_r50-d8_4xb2-80k_cityscapes-512x1024.py",
    "deeplabv3plus-r50c-os8-aligned": "deeplabv3plus/deeplabv3plus_r50-d8_4xb2-80k_cityscapes-769x769.py",
    "deeplabv3plus-r18c-os8": "deeplabv3plus/deeplabv3plus_r18-d8_4xb2-80k_cityscapes-512x1024.py",
    "deeplabv3plus-r18c-os8-aligned": "deeplabv3plus/deeplabv3plus_r18-d8_4xb2-80k_cityscapes-769x769.py",
    "semantic-fpn-r101c": "sem_fpn/fpn_r101_4xb2-80k_cityscapes-512x1024.py",
    "semantic-fpn-r50c": "sem_fpn/fpn_r50_4xb2-80k_cityscapes-512x1024.py",
}
WHOLE = ("deeplabv3plus-r101c-os8", "semantic-fpn-r101c")


def cases_of(checkout: Path) -> Sequence[Case]:
    """Return the networks of these configurations, in a checkout or beside the installed package."""
    sys.meta_path.insert(0, StandIns(["mmcv.ops"]))
    release = import_module("mmseg").__version__
    if release != RELEASE:
        raise SystemExit(f"{checkout}: another release; got {release}; limit: {RELEASE}")
    configurations = checkout / "configs"
    if not configurations.is_dir():
        configurations = checkout / "mmseg" / ".mim" / "configs"
    return [
        Case(
            name=name,
            layout="mmsegmentation " + ("semantic FPN" if name.startswith("semantic-fpn") else "DeepLabV3+"),
            file=f"configs/{file}",
            settings={"norm_cfg": "BN instead of SyncBN, the same on one processor"},
            build=partial(_built, configurations / file),
            whole=name in WHOLE,
        )
        for name, file in FILES.items()
    ]


def _built(file: Path) -> Built:
    import_module("mmseg.models")
    import_module("mmengine.registry").init_default_scope("mmseg")
    settings = import_module("mmengine.config").Config.fromfile(file).model
    settings.pop("pretrained", None)
    settings.decode_head.pop("sampler", None)
    for part in ("backbone", "decode_head", "auxiliary_head"):
        if part in settings:
            settings[part].norm_cfg.type = "BN"
    model: Any = import_module("mmseg.registry").MODELS.build(settings)
    return model, lambda picture: model.encode_decode(picture, [{"img_shape": tuple(picture.shape[2:])}])


if __name__ == "__main__":
    sys.exit(main(ORIGIN, cases_of))
