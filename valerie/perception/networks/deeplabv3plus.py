"""DeepLabV3+ on a dilated ResNet (Chen et al. 2018, doi:10.1007/978-3-030-01234-2_49).

Public implementations differ in details on which their weights depend; `DeepLabSettings` contains these details.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional

from valerie.perception.networks.layers import conv_norm_relu, resize_like, separable_conv_relu
from valerie.perception.networks.resnet import ResNet, ResNetSettings


@dataclass(frozen=True, slots=True)
class DeepLabSettings:
    """Size and kind of a DeepLabV3+.

    Attributes:
        backbone: the ResNet; its output stride is 16 or 8.
        rates: dilation rates of the atrous pyramid: 6, 12, 18 for output stride 16, twice that for 8.
        pyramid_channels: channels of each branch of the pyramid and of its result.
        low_level_channels: channels to which the stride-4 features are reduced.
        decoder_channels: channels of the decoder's convolutions.
        decoder_convs: 3×3 convolutions before the classifier, 1 or 2.
        separable: True if dilated convolutions and those of the decoder are separable.
        project_kernel: kernel size of the convolution that joins the pyramid's branches, 1 or 3.
        pool_window: height and width of the window that the pyramid's last branch averages over, in cells of the map; None:
            the whole image, with batch normalisation. A window larger than the map is cut to it.
        align_corners: True if the outermost pixel centres coincide in bilinear resampling.
    """

    backbone: ResNetSettings
    rates: tuple[int, ...] = (6, 12, 18)
    pyramid_channels: int = 256
    low_level_channels: int = 48
    decoder_channels: int = 256
    decoder_convs: int = 1
    separable: bool = False
    project_kernel: int = 1
    pool_window: tuple[int, int] | None = None
    align_corners: bool = False


class AtrousPyramid(nn.Module):
    """Atrous spatial pyramid pooling: 1×1, dilated 3×3 and pooled branches, joined by one convolution."""

    def __init__(self, channels_in: int, settings: DeepLabSettings) -> None:
        super().__init__()
        self._settings = settings
        channels = settings.pyramid_channels
        self.convs = nn.ModuleList([conv_norm_relu(channels_in, channels, 1)])
        for rate in settings.rates:
            if settings.separable:
                self.convs.append(separable_conv_relu(channels_in, channels, dilation=rate))
            else:
                self.convs.append(conv_norm_relu(channels_in, channels, 3, dilation=rate))
        self.pool: nn.Module
        if settings.pool_window is None:
            self.pool = nn.Sequential(nn.AdaptiveAvgPool2d(1), *conv_norm_relu(channels_in, channels, 1))
        else:
            window = WindowMean(settings.pool_window)
            self.pool = nn.Sequential(window, nn.Conv2d(channels_in, channels, 1), nn.ReLU(inplace=True))
        self.project = conv_norm_relu(channels * (len(settings.rates) + 2), channels, settings.project_kernel)

    def forward(self, x: Tensor) -> Tensor:
        """Map (N, channels_in, h, w) to (N, pyramid_channels, h, w)."""
        branches = [conv(x) for conv in self.convs]
        pooled: Tensor = self.pool(x)
        if self._settings.pool_window is None:
            branches.append(pooled.expand(-1, -1, *x.shape[-2:]))
        else:
            branches.append(resize_like(pooled, x, align_corners=self._settings.align_corners))
        result: Tensor = self.project(torch.cat(branches, dim=1))
        return result


class WindowMean(nn.Module):
    """Means over a window that slides within the map by one cell."""

    def __init__(self, window: tuple[int, int]) -> None:
        super().__init__()
        self.window = window

    def forward(self, x: Tensor) -> Tensor:
        """Map (N, C, h, w) to (N, C, h − window height + 1, w − window width + 1)."""
        height, width = min(self.window[0], x.shape[-2]), min(self.window[1], x.shape[-1])
        # Columns first, then rows: the same means with a sixteenth of the additions of one two-dimensional window.
        columns = functional.avg_pool2d(x, (height, 1), stride=1)
        return functional.avg_pool2d(columns, (1, width), stride=1)


class DeepLabV3Plus(nn.Module):
    """Encoder, atrous pyramid, and a decoder that concatenates the stride-4 features and the upsampled pyramid."""

    #: Stride of the logits.
    stride: Final = 4

    def __init__(self, settings: DeepLabSettings, num_classes: int) -> None:
        super().__init__()
        #: Resampling of logits to the picture's size.
        self.align_corners = settings.align_corners
        self.backbone = ResNet(settings.backbone)
        low, *_, high = self.backbone.channels
        self.aspp = AtrousPyramid(high, settings)
        self.low_level = conv_norm_relu(low, settings.low_level_channels, 1)
        channels = settings.pyramid_channels + settings.low_level_channels
        decoder: list[nn.Module] = []
        for _ in range(settings.decoder_convs):
            if settings.separable:
                decoder += separable_conv_relu(channels, settings.decoder_channels)
            else:
                decoder += conv_norm_relu(channels, settings.decoder_channels, 3)
            channels = settings.decoder_channels
        self.decoder = nn.Sequential(*decoder)
        self.classifier = nn.Conv2d(settings.decoder_channels, num_classes, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Map a normalised picture (N, 3, H, W), H and W multiples of 32, to logits (N, classes, H / 4, W / 4)."""
        low, _, _, high = self.backbone(x)
        low = self.low_level(low)
        high = resize_like(self.aspp(high), low, align_corners=self.align_corners)
        logits: Tensor = self.classifier(self.decoder(torch.cat([low, high], dim=1)))
        return logits
