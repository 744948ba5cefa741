"""Layouts: the names of our networks' tensors in public programs, and the pictures that these expect.

Each layout maps the modules of our networks to those of the origin; tensors follow their modules. The tests check each
mapping with names and logits that the origin's own code produced.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from valerie.perception.networks.architectures import ARCHITECTURES
from valerie.perception.networks.deeplabv3plus import DeepLabSettings

Tensors = dict[str, NDArray[np.floating]]
Names = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class PictureUnits:
    """The pictures that a network expects, from 8-bit values x: ``(x · scale − mean) / std``, channels in ``channel_order``.

    Attributes:
        mean, std: per channel in ``channel_order``, in the unit of ``scale``.
        scale: ``1/255`` or ``1``.
        channel_order: channel order of the network's input.
    """

    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    scale: Literal["1", "1/255"]
    channel_order: Literal["rgb", "bgr"]


_IMAGENET: Final = PictureUnits((0.485, 0.456, 0.406), (0.229, 0.224, 0.225), "1/255", "rgb")
_IMAGENET_8_BIT: Final = PictureUnits((123.675, 116.28, 103.53), (58.395, 57.12, 57.375), "1", "rgb")
#: Networks that were fine-tuned from Caffe's weights: blue first, and the standard deviation is inside the weights.
_CAFFE: Final = PictureUnits((103.53, 116.28, 123.675), (1.0, 1.0, 1.0), "1", "bgr")


@dataclass(frozen=True, slots=True)
class Layout:
    """The format in which another program stores one of our networks.

    Attributes:
        name: name in messages and on cards.
        source: repository whose code the layout follows.
        modules: our module name to theirs.
        architectures: architectures of the program, in the order in which they are tried. Of several with the same tensors,
            the file's settings choose one; without settings, the first is taken.
        ignored: prefixes of names outside the network (heads for training, optional heads).
        units: format of the picture, unless the file states another.
        licence: licence of the program; weights may have another.
        reorder: puts channels into our order if the origin concatenates maps in another order.
    """

    name: str
    source: str
    modules: Names
    architectures: tuple[str, ...]
    ignored: tuple[str, ...]
    units: PictureUnits
    licence: str
    reorder: Callable[[Tensors, str], Tensors] = lambda tensors, _: tensors

    def name_of(self, tensor: str) -> str:
        """Return the other program's name for one of our tensors.

        Raises:
            KeyError: the layout has no such module.
        """
        module, _, leaf = tensor.rpartition(".")
        return f"{self.modules[module]}.{leaf}"


def _identity(*modules: str) -> Iterator[tuple[str, str]]:
    return ((module, module) for module in modules)


def _numbered(pattern: str, to: str, count: int) -> Iterator[tuple[str, str]]:
    return ((pattern.format(i), to.format(i)) for i in range(count))


def _blocks() -> Iterator[tuple[int, str]]:
    """Yield the stages and blocks of the deepest ResNet; shallower ones have fewer."""
    return ((stage, f"layer{stage + 1}.{block}") for stage, count in enumerate((3, 4, 23, 3)) for block in range(count))


def _torchvision_resnet() -> Iterator[tuple[str, str]]:
    yield from _identity("backbone.conv1", "backbone.bn1", *(f"backbone.stem.{i}" for i in range(9)))
    for _, block in _blocks():
        for part in ("conv1", "bn1", "conv2", "bn2", "conv3", "bn3", "downsample.0", "downsample.1"):
            yield f"backbone.{block}.{part}", f"backbone.{block}.{part}"


def _detectron_resnet(prefix: str) -> Iterator[tuple[str, str]]:
    yield from (("backbone.conv1", f"{prefix}.stem.conv1"), ("backbone.bn1", f"{prefix}.stem.conv1.norm"))
    for i in range(3):
        yield f"backbone.stem.{3 * i}", f"{prefix}.stem.conv{i + 1}"
        yield f"backbone.stem.{3 * i + 1}", f"{prefix}.stem.conv{i + 1}.norm"
    for stage, block in _blocks():
        theirs = f"{prefix}.res{stage + 2}.{block.partition('.')[2]}"
        for i in (1, 2, 3):
            yield f"backbone.{block}.conv{i}", f"{theirs}.conv{i}"
            yield f"backbone.{block}.bn{i}", f"{theirs}.conv{i}.norm"
        yield f"backbone.{block}.downsample.0", f"{theirs}.shortcut"
        yield f"backbone.{block}.downsample.1", f"{theirs}.shortcut.norm"


def _vainf() -> Iterator[tuple[str, str]]:
    yield from _torchvision_resnet()
    for i in (0, 1):
        yield from _numbered(f"aspp.convs.{{}}.{i}", f"classifier.aspp.convs.{{}}.{i}", 4)
        yield f"aspp.pool.{i + 1}", f"classifier.aspp.convs.4.{i + 1}"
        yield f"aspp.project.{i}", f"classifier.aspp.project.{i}"
        yield f"low_level.{i}", f"classifier.project.{i}"
        yield f"decoder.{i}", f"classifier.classifier.{i}"
    yield "classifier", "classifier.classifier.3"


def _mmseg_deeplab() -> Iterator[tuple[str, str]]:
    yield from _torchvision_resnet()
    for i, kind in enumerate(("conv", "bn")):
        yield f"aspp.convs.0.{i}", f"decode_head.aspp_modules.0.{kind}"
        for branch in (1, 2, 3):
            yield f"aspp.convs.{branch}.{i}", f"decode_head.aspp_modules.{branch}.depthwise_conv.{kind}"
            yield f"aspp.convs.{branch}.{i + 3}", f"decode_head.aspp_modules.{branch}.pointwise_conv.{kind}"
        yield f"aspp.pool.{i + 1}", f"decode_head.image_pool.1.{kind}"
        yield f"aspp.project.{i}", f"decode_head.bottleneck.{kind}"
        yield f"low_level.{i}", f"decode_head.c1_bottleneck.{kind}"
        for j in (0, 1):
            yield f"decoder.{6 * j + i}", f"decode_head.sep_bottleneck.{j}.depthwise_conv.{kind}"
            yield f"decoder.{6 * j + i + 3}", f"decode_head.sep_bottleneck.{j}.pointwise_conv.{kind}"
    yield "classifier", "decode_head.conv_seg"


def _mmseg_order(tensors: Tensors, architecture: str) -> Tensors:
    """Put channels into our order: mmsegmentation concatenates the pooled branch first and the low-level maps last."""
    settings = ARCHITECTURES[architecture]
    assert isinstance(settings, DeepLabSettings)
    reordered = dict(tensors)
    reordered["aspp.project.0.weight"] = np.roll(tensors["aspp.project.0.weight"], -settings.pyramid_channels, axis=1)
    depthwise = [
        "decoder.0.weight",
        *(f"decoder.1.{leaf}" for leaf in ("weight", "bias", "running_mean", "running_var")),
    ]
    for name in depthwise:
        reordered[name] = np.roll(tensors[name], settings.low_level_channels, axis=0)
    reordered["decoder.3.weight"] = np.roll(tensors["decoder.3.weight"], settings.low_level_channels, axis=1)
    return reordered


def _mmseg_fpn() -> Iterator[tuple[str, str]]:
    yield from _torchvision_resnet()
    yield from _numbered("fpn.lateral.{}", "neck.lateral_convs.{}.conv", 4)
    yield from _numbered("fpn.output.{}", "neck.fpn_convs.{}.conv", 4)
    for level in range(4):
        for j in range(max(1, level)):
            for i, kind in enumerate(("conv", "bn")):
                # an upsampling module follows every convolution, except at the finest level
                yield f"heads.{level}.convs.{j}.{i}", f"decode_head.scale_heads.{level}.{2 * j}.{kind}"
    yield "predictor", "decode_head.conv_seg"


def _detectron_deeplab() -> Iterator[tuple[str, str]]:
    yield from _detectron_resnet("backbone")
    decoder = "sem_seg_head.decoder"
    for i, norm in enumerate(("", ".norm")):
        yield from _numbered(f"aspp.convs.{{}}.{i}", f"{decoder}.res5.project_conv.convs.{{}}{norm}", 4)
        yield f"aspp.project.{i}", f"{decoder}.res5.project_conv.project{norm}"
        yield f"low_level.{i}", f"{decoder}.res2.project_conv{norm}"
        for j in (0, 1):
            yield f"decoder.{3 * j + i}", f"{decoder}.res2.fuse_conv.{j}{norm}"
    yield "aspp.pool.1", f"{decoder}.res5.project_conv.convs.4.1"
    yield "classifier", "sem_seg_head.predictor"


def _detectron_fpn(head: str) -> Iterator[tuple[str, str]]:
    yield from _detectron_resnet("backbone.bottom_up")
    for level in range(4):
        yield f"fpn.lateral.{level}", f"backbone.fpn_lateral{level + 2}"
        yield f"fpn.output.{level}", f"backbone.fpn_output{level + 2}"
        for j in range(max(1, level)):
            for i, norm in enumerate(("", ".norm")):
                yield f"heads.{level}.convs.{j}.{i}", f"{head}.p{level + 2}.{2 * j}{norm}"
    yield "predictor", f"{head}.predictor"


def _named(pairs: Iterator[tuple[str, str]]) -> Names:
    return MappingProxyType(dict(pairs))


_DETECTRON: Final = "https://github.com/facebookresearch/detectron2"
#: Tensors that detectron2 keeps beside the weights.
_DETECTRON_IGNORED: Final = ("pixel_mean", "pixel_std", "sem_seg_head.point_head.")
_DETECTRON_FPNS: Final = ("semantic-fpn-r101-gn", "semantic-fpn-r50-gn")

LAYOUTS: Final[tuple[Layout, ...]] = (
    Layout(
        name="VainF/DeepLabV3Plus-Pytorch",
        source="https://github.com/VainF/DeepLabV3Plus-Pytorch",
        modules=_named(_vainf()),
        architectures=("deeplabv3plus-r101", "deeplabv3plus-r101-os8", "deeplabv3plus-r50", "deeplabv3plus-r50-os8"),
        ignored=(),
        units=_IMAGENET,
        licence="MIT",
    ),
    Layout(
        name="mmsegmentation DeepLabV3+",
        source="https://github.com/open-mmlab/mmsegmentation",
        modules=_named(_mmseg_deeplab()),
        architectures=(
            "deeplabv3plus-r101c-os8",
            "deeplabv3plus-r101c-os8-aligned",
            "deeplabv3plus-r101c-os16",
            "deeplabv3plus-r50c-os8",
            "deeplabv3plus-r50c-os8-aligned",
            "deeplabv3plus-r18c-os8",
            "deeplabv3plus-r18c-os8-aligned",
        ),
        ignored=("auxiliary_head.",),
        units=_IMAGENET_8_BIT,
        licence="Apache-2.0",
        reorder=_mmseg_order,
    ),
    Layout(
        name="mmsegmentation semantic FPN",
        source="https://github.com/open-mmlab/mmsegmentation",
        modules=_named(_mmseg_fpn()),
        architectures=("semantic-fpn-r101c", "semantic-fpn-r50c"),
        ignored=("auxiliary_head.",),
        units=_IMAGENET_8_BIT,
        licence="Apache-2.0",
    ),
    Layout(
        name="detectron2 DeepLab",
        source=f"{_DETECTRON}, projects/DeepLab",
        modules=_named(_detectron_deeplab()),
        architectures=("deeplabv3plus-r103",),
        ignored=_DETECTRON_IGNORED,
        units=_IMAGENET_8_BIT,
        licence="Apache-2.0",
    ),
    Layout(
        name="detectron2 PointRend",
        source=f"{_DETECTRON}, projects/PointRend",
        modules=_named(_detectron_fpn("sem_seg_head.coarse_sem_seg_head")),
        architectures=_DETECTRON_FPNS,
        ignored=_DETECTRON_IGNORED,
        units=_CAFFE,
        licence="Apache-2.0",
    ),
    Layout(
        name="detectron2 semantic FPN",
        source=_DETECTRON,
        modules=_named(_detectron_fpn("sem_seg_head")),
        architectures=_DETECTRON_FPNS,
        ignored=_DETECTRON_IGNORED,
        units=_CAFFE,
        licence="Apache-2.0",
    ),
)
