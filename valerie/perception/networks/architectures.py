"""Architecture names and what they build."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from valerie.errors import UnknownName
from valerie.labels import NUM_TRAIN_CLASSES
from valerie.perception.networks.deeplabv3plus import DeepLabSettings, DeepLabV3Plus
from valerie.perception.networks.resnet import ResNetSettings
from valerie.perception.networks.semantic_fpn import SemanticFpn, SemanticFpnSettings

Network = DeepLabV3Plus | SemanticFpn


def _deeplab_small(num_classes: int) -> Network:
    backbone = ResNetSettings(depth=18, width=32, output_stride=16)
    settings = DeepLabSettings(backbone, pyramid_channels=128, low_level_channels=32, decoder_channels=128)
    return DeepLabV3Plus(settings, num_classes)


def _fpn_small(num_classes: int) -> Network:
    backbone = ResNetSettings(depth=18, width=32)
    return SemanticFpn(SemanticFpnSettings(backbone, pyramid_channels=96, head_channels=64), num_classes)


def _deeplab_r101(num_classes: int) -> Network:
    return DeepLabV3Plus(DeepLabSettings(ResNetSettings(depth=101, output_stride=16)), num_classes)


def _fpn_r101(num_classes: int) -> Network:
    return SemanticFpn(SemanticFpnSettings(ResNetSettings(depth=101)), num_classes)


#: The paper's two architectures: in small, which ship trained, and at the published size, to train on one's own.
ARCHITECTURES: Final[Mapping[str, Callable[[int], Network]]] = MappingProxyType(
    {
        "deeplabv3plus-small": _deeplab_small,
        "semantic-fpn-small": _fpn_small,
        "deeplabv3plus-r101": _deeplab_r101,
        "semantic-fpn-r101": _fpn_r101,
    }
)


def build_network(architecture: str, num_classes: int = NUM_TRAIN_CLASSES) -> Network:
    """A network with fresh weights (drawn from torch's global generator).

    Raises:
        UnknownName: no such architecture.
    """
    try:
        builder = ARCHITECTURES[architecture]
    except KeyError:
        raise UnknownName("architecture", architecture, ARCHITECTURES, field="architecture") from None
    return builder(num_classes)
