"""Small parts that both networks are made of."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional


def conv_bn_relu(channels_in: int, channels: int, kernel: int, *, dilation: int = 1) -> nn.Sequential:
    """A convolution that keeps the resolution, batch normalisation, ReLU."""
    padding = dilation * (kernel // 2)
    return nn.Sequential(
        nn.Conv2d(channels_in, channels, kernel, padding=padding, dilation=dilation, bias=False),
        nn.BatchNorm2d(channels),
        nn.ReLU(inplace=True),
    )


def resize_like(x: Tensor, like: Tensor) -> Tensor:
    """Bilinear resampling of (N, C, h, w) to the height and width of ``like``, pixel centres at halves."""
    return functional.interpolate(x, size=like.shape[-2:], mode="bilinear", align_corners=False)
