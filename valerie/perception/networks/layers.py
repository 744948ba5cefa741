"""Building blocks of both networks."""

from __future__ import annotations

from typing import Final, Literal

from torch import Tensor, nn
from torch.nn import functional

#: Batch normalisation, or group normalisation with 32 groups.
Norm = Literal["batch", "group"]

_GROUPS: Final = 32


def norm_layer(kind: Norm, channels: int) -> nn.Module:
    """Build the normalisation of a map with ``channels`` channels."""
    return nn.BatchNorm2d(channels) if kind == "batch" else nn.GroupNorm(_GROUPS, channels)


def conv_norm_relu(
    channels_in: int, channels: int, kernel: int, *, stride: int = 1, dilation: int = 1, norm: Norm = "batch"
) -> nn.Sequential:
    """Build a convolution, padded so that only its stride changes the resolution, then normalisation and ReLU."""
    padding = dilation * (kernel // 2)
    return nn.Sequential(
        nn.Conv2d(channels_in, channels, kernel, stride=stride, padding=padding, dilation=dilation, bias=False),
        norm_layer(norm, channels),
        nn.ReLU(inplace=True),
    )


def separable_conv_relu(channels_in: int, channels: int, *, dilation: int = 1) -> nn.Sequential:
    """Build a depthwise 3×3 convolution, then a 1×1 convolution, each with batch normalisation and ReLU."""
    depthwise = nn.Conv2d(
        channels_in, channels_in, 3, padding=dilation, dilation=dilation, groups=channels_in, bias=False
    )
    return nn.Sequential(
        depthwise, nn.BatchNorm2d(channels_in), nn.ReLU(inplace=True), *conv_norm_relu(channels_in, channels, 1)
    )


def resize_like(x: Tensor, like: Tensor, *, align_corners: bool = False) -> Tensor:
    """Resample (N, C, h, w) bilinearly to the height and width of ``like``.

    Pixel centres are at halves; with ``align_corners`` the outermost pixel centres coincide instead.
    """
    return functional.interpolate(x, size=like.shape[-2:], mode="bilinear", align_corners=align_corners)
