"""Architectures by name.

A name consists of the network, its ResNet, and departures from the plain form:

- ``r18c``, ``r50c``, ``r101c``: the ResNet has a deep stem; DeepLabV3+ is then mmsegmentation's, with separable convolutions.
- ``r103``: Detectron2's deep stem of twice the width.
- ``os8``, ``os16``: output stride of the ResNet in DeepLabV3+; 16 if not named.
- ``aligned``: bilinear resampling with aligned corners.
- ``gn``: group normalisation in the heads, and strides in the 1×1 convolutions, both as in Detectron2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Final

from valerie.errors import UnknownName
from valerie.labels import NUM_TRAIN_CLASSES
from valerie.perception.networks.deeplabv3plus import DeepLabSettings, DeepLabV3Plus
from valerie.perception.networks.resnet import ResNetSettings
from valerie.perception.networks.semantic_fpn import SemanticFpn, SemanticFpnSettings

Network = DeepLabV3Plus | SemanticFpn
NetworkSettings = DeepLabSettings | SemanticFpnSettings


def _deeplab(depth: int, output_stride: int = 16) -> DeepLabSettings:
    rates = (6, 12, 18) if output_stride == 16 else (12, 24, 36)
    return DeepLabSettings(ResNetSettings(depth, output_stride=output_stride), rates)


def _separable_deeplab(depth: int, *, channels: int = 512, low_level: int = 48) -> DeepLabSettings:
    return DeepLabSettings(
        ResNetSettings(depth, output_stride=8, stem="deep", dilate_both=False),
        rates=(12, 24, 36),
        pyramid_channels=channels,
        low_level_channels=low_level,
        decoder_channels=channels,
        decoder_convs=2,
        separable=True,
        project_kernel=3,
    )


def _fpn(depth: int) -> SemanticFpnSettings:
    return SemanticFpnSettings(ResNetSettings(depth))


def _deep_fpn(depth: int) -> SemanticFpnSettings:
    return SemanticFpnSettings(ResNetSettings(depth, stem="deep"))


def _detectron_fpn(depth: int) -> SemanticFpnSettings:
    return SemanticFpnSettings(ResNetSettings(depth, stride_in_1x1=True), head_norm="group")


_DEEPLAB_SMALL: Final = DeepLabSettings(
    ResNetSettings(18, width=32, output_stride=16), pyramid_channels=128, low_level_channels=32, decoder_channels=128
)
_FPN_SMALL: Final = SemanticFpnSettings(ResNetSettings(18, width=32), pyramid_channels=96, head_channels=64)
_MULTI_GRID: Final = replace(
    _separable_deeplab(101),
    backbone=ResNetSettings(101, output_stride=16, stem="deep", last_dilations=(1, 2, 4)),
    rates=(6, 12, 18),
)
_R18C: Final = _separable_deeplab(18, channels=128, low_level=12)
_R103: Final = DeepLabSettings(
    ResNetSettings(101, output_stride=16, stem="deep", stem_channels=128, last_dilations=(2, 4, 8)),
    decoder_convs=2,
    # a training crop of 512 × 1024 pixels at output stride 16
    pool_window=(32, 64),
)

#: The paper's two architectures: in small sizes, which ship trained, and in the sizes of public checkpoints.
ARCHITECTURES: Final[Mapping[str, NetworkSettings]] = MappingProxyType(
    {
        "deeplabv3plus-small": _DEEPLAB_SMALL,
        "deeplabv3plus-r18": _deeplab(18),
        "deeplabv3plus-r18c-os8": _R18C,
        "deeplabv3plus-r18c-os8-aligned": replace(_R18C, align_corners=True),
        "deeplabv3plus-r50": _deeplab(50),
        "deeplabv3plus-r50-os8": _deeplab(50, 8),
        "deeplabv3plus-r101": _deeplab(101),
        "deeplabv3plus-r101-os8": _deeplab(101, 8),
        "deeplabv3plus-r50c-os8": _separable_deeplab(50),
        "deeplabv3plus-r50c-os8-aligned": replace(_separable_deeplab(50), align_corners=True),
        "deeplabv3plus-r101c-os8": _separable_deeplab(101),
        "deeplabv3plus-r101c-os8-aligned": replace(_separable_deeplab(101), align_corners=True),
        "deeplabv3plus-r101c-os16": _MULTI_GRID,
        "deeplabv3plus-r103": _R103,
        "semantic-fpn-small": _FPN_SMALL,
        "semantic-fpn-r18": _fpn(18),
        "semantic-fpn-r50": _fpn(50),
        "semantic-fpn-r101": _fpn(101),
        "semantic-fpn-r50c": _deep_fpn(50),
        "semantic-fpn-r101c": _deep_fpn(101),
        "semantic-fpn-r50-gn": _detectron_fpn(50),
        "semantic-fpn-r101-gn": _detectron_fpn(101),
    }
)


def build_network(architecture: str | NetworkSettings, num_classes: int = NUM_TRAIN_CLASSES) -> Network:
    """Build a network with fresh weights, drawn from torch's global generator.

    Args:
        architecture: a name in `ARCHITECTURES`, or other settings.
        num_classes: channels of the logits.

    Raises:
        UnknownName: no such architecture.
    """
    if isinstance(architecture, str):
        if architecture not in ARCHITECTURES:
            raise UnknownName("architecture", architecture, ARCHITECTURES, field="architecture")
        architecture = ARCHITECTURES[architecture]
    if isinstance(architecture, DeepLabSettings):
        return DeepLabV3Plus(architecture, num_classes)
    return SemanticFpn(architecture, num_classes)
