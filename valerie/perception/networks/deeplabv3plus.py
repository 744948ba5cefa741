"""DeepLabV3+ on a ResNet with output stride 16 (Chen et al. 2018, doi:10.1007/978-3-030-01234-2_49)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import torch
from torch import Tensor, nn

from valerie.perception.networks.blocks import conv_bn_relu, resize_like
from valerie.perception.networks.resnet import ResNet, ResNetSettings


@dataclass(frozen=True, slots=True)
class DeepLabSettings:
    """Size of a DeepLabV3+.

    Attributes:
        backbone: the ResNet; its output stride is 16.
        rates: dilation rates of the atrous pyramid (6, 12, 18 belong to output stride 16).
        pyramid_channels: channels of each branch of the pyramid and of its result.
        low_level_channels: channels to which the stride-4 features are reduced.
        decoder_channels: channels of the 3×3 convolution before the classifier.
    """

    backbone: ResNetSettings
    rates: tuple[int, ...] = (6, 12, 18)
    pyramid_channels: int = 256
    low_level_channels: int = 48
    decoder_channels: int = 256


class AtrousPyramid(nn.Module):
    """Atrous spatial pyramid pooling: 1×1, dilated 3×3 and whole-image branches, joined by a 1×1 convolution."""

    def __init__(self, channels_in: int, channels: int, rates: tuple[int, ...]) -> None:
        super().__init__()
        self.convs = nn.ModuleList(
            [conv_bn_relu(channels_in, channels, 1)]
            + [conv_bn_relu(channels_in, channels, 3, dilation=rate) for rate in rates]
        )
        self.pool = nn.Sequential(nn.AdaptiveAvgPool2d(1), *conv_bn_relu(channels_in, channels, 1))
        self.project = conv_bn_relu(channels * (len(rates) + 2), channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(N, channels_in, h, w) to (N, channels, h, w)."""
        branches = [conv(x) for conv in self.convs]
        branches.append(self.pool(x).expand(-1, -1, *x.shape[-2:]))
        result: Tensor = self.project(torch.cat(branches, dim=1))
        return result


class DeepLabV3Plus(nn.Module):
    """Encoder, atrous pyramid, and a decoder that puts the stride-4 features beside the upsampled pyramid."""

    #: Stride of the logits.
    stride: Final = 4

    def __init__(self, settings: DeepLabSettings, num_classes: int) -> None:
        super().__init__()
        self.backbone = ResNet(settings.backbone)
        low, *_, high = self.backbone.channels
        self.aspp = AtrousPyramid(high, settings.pyramid_channels, settings.rates)
        self.low_level = conv_bn_relu(low, settings.low_level_channels, 1)
        joined = settings.pyramid_channels + settings.low_level_channels
        self.decoder = conv_bn_relu(joined, settings.decoder_channels, 3)
        self.classifier = nn.Conv2d(settings.decoder_channels, num_classes, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(N, 3, H, W) normalised picture, H and W multiples of 32, to (N, classes, H / 4, W / 4) logits."""
        low, _, _, high = self.backbone(x)
        low = self.low_level(low)
        high = resize_like(self.aspp(high), low)
        logits: Tensor = self.classifier(self.decoder(torch.cat([low, high], dim=1)))
        return logits
