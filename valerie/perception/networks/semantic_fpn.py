"""Semantic FPN, Detectron2's network for semantic segmentation.

A feature pyramid (Lin et al. 2017, doi:10.1109/CVPR.2017.106) with the semantic branch of Panoptic FPN (Kirillov et al.
2019, doi:10.1109/CVPR.2019.00656).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from torch import Tensor, nn
from torch.nn import functional

from valerie.perception.networks.layers import Norm, conv_norm_relu
from valerie.perception.networks.resnet import ResNet, ResNetSettings


@dataclass(frozen=True, slots=True)
class SemanticFpnSettings:
    """Size and kind of a semantic FPN.

    Attributes:
        backbone: the ResNet; its output stride is 32.
        pyramid_channels: channels of every level of the pyramid (Detectron2: 256).
        head_channels: channels of the scale heads (Detectron2: 128).
        head_norm: normalisation in the scale heads (Detectron2: group).
    """

    backbone: ResNetSettings
    pyramid_channels: int = 256
    head_channels: int = 128
    head_norm: Norm = "batch"


class FeaturePyramid(nn.Module):
    """Lateral 1×1 convolutions, a top-down sum with nearest-neighbour upsampling, and 3×3 output convolutions."""

    def __init__(self, channels_in: tuple[int, ...], channels: int) -> None:
        super().__init__()
        self.lateral = nn.ModuleList([nn.Conv2d(c, channels, 1) for c in channels_in])
        self.output = nn.ModuleList([nn.Conv2d(channels, channels, 3, padding=1) for _ in channels_in])

    def forward(self, features: tuple[Tensor, ...]) -> list[Tensor]:
        """Map features of strides 4, 8, 16, 32 to as many maps of ``channels`` channels, finest first."""
        levels: list[Tensor] = []
        above: Tensor | None = None
        for index in reversed(range(len(features))):
            level: Tensor = self.lateral[index](features[index])
            if above is not None:
                level = level + functional.interpolate(above, size=level.shape[-2:], mode="nearest")
            levels.append(self.output[index](level))
            above = level
        return levels[::-1]


class ScaleHead(nn.Module):
    """3×3 convolutions down to stride 4; twofold upsampling follows each, except at the finest level."""

    def __init__(self, channels_in: int, channels: int, doublings: int, norm: Norm = "batch") -> None:
        super().__init__()
        self.doublings = doublings
        inputs = [channels_in] + [channels] * (doublings - 1)
        self.convs = nn.ModuleList([conv_norm_relu(count, channels, 3, norm=norm) for count in inputs])

    def forward(self, x: Tensor) -> Tensor:
        """Map (N, channels_in, h, w) to (N, channels, h · 2^doublings, w · 2^doublings)."""
        for conv in self.convs:
            x = conv(x)
            if self.doublings:
                x = functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
        return x


class SemanticFpn(nn.Module):
    """Feature pyramid, one head per scale, their sum, and a 1×1 predictor."""

    #: Stride of the logits.
    stride: Final = 4
    #: Resampling of logits to the picture's size.
    align_corners: Final = False

    def __init__(self, settings: SemanticFpnSettings, num_classes: int) -> None:
        super().__init__()
        self.backbone = ResNet(settings.backbone)
        self.fpn = FeaturePyramid(self.backbone.channels, settings.pyramid_channels)
        self.heads = nn.ModuleList(
            [
                ScaleHead(settings.pyramid_channels, settings.head_channels, doublings, settings.head_norm)
                for doublings in range(len(self.backbone.channels))
            ]
        )
        self.predictor = nn.Conv2d(settings.head_channels, num_classes, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Map a normalised picture (N, 3, H, W), H and W multiples of 32, to logits (N, classes, H / 4, W / 4)."""
        levels = self.fpn(self.backbone(x))
        total: Tensor = self.heads[0](levels[0])
        for head, level in zip(self.heads[1:], levels[1:], strict=True):
            total = total + head(level)
        logits: Tensor = self.predictor(total)
        return logits
