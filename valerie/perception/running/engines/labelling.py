"""Label maps of pictures in torch: normalise, run the network, upsample its logits, take the largest channel."""

from __future__ import annotations

from typing import Final, TypeVar

import torch
from torch import Tensor, nn
from torch.nn import functional

#: Height and width are padded to multiples of this: the coarsest stride of the networks.
ALIGNMENT: Final = 32

#: Channels that are upsampled at once: full-size logits of 150 classes take 1.2 GB for a full-HD frame.
_CHANNELS_AT_ONCE: Final = 32

Module = TypeVar("Module", bound=nn.Module)


def in_channels_last(network: Module) -> Module:
    """Return the network with its weights in channels-last memory order, which saves a fifth of the CPU time."""
    moved: Module = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # missing in torch's types
    return moved


def normalised(pictures: Tensor, mean: Tensor, std: Tensor, value_range: float = 255.0) -> Tensor:
    """Return ``(x / value_range − mean) / std`` of (N, H, W, 3) uint8 sRGB as (N, 3, H, W) float32, channels last in memory."""
    values = pictures.permute(0, 3, 1, 2).to(torch.float32)
    scaled = values.sub_(value_range * mean.view(1, 3, 1, 1)).div_(value_range * std.view(1, 3, 1, 1))
    return scaled.contiguous(memory_format=torch.channels_last)


def largest_channel(logits: Tensor, height: int, width: int, *, align_corners: bool = False) -> Tensor:
    """Return the largest channel at every pixel, after bilinear upsampling.

    Args:
        logits: (N, C, h, w), C at most 255.
        height, width: size of the result.
        align_corners: True if the outermost pixel centres coincide; otherwise pixel centres are at halves.

    Returns:
        (N, height, width) uint8; of equal logits the smaller channel wins.
    """
    best: Tensor | None = None
    ids = torch.empty(0)
    for first in range(0, logits.shape[1], _CHANNELS_AT_ONCE):
        some = logits[:, first : first + _CHANNELS_AT_ONCE]
        full = functional.interpolate(some, size=(height, width), mode="bilinear", align_corners=align_corners)
        if logits.shape[1] <= _CHANNELS_AT_ONCE:
            return full.argmax(dim=1).to(torch.uint8)
        values, channels = full.max(dim=1)
        channels = (channels + first).to(torch.uint8)
        if best is None:
            best, ids = values, channels
        else:
            better = values > best
            best, ids = torch.where(better, values, best), torch.where(better, channels, ids)
    return ids


def label_maps(
    network: nn.Module, pictures: Tensor, mean: Tensor, std: Tensor, *, labels: tuple[int, int] | None = None
) -> Tensor:
    """Return the train ids of whole pictures of any size.

    The last row and column are repeated up to the next multiple of 32, logits are resampled bilinearly to the padded size, and
    the padding is cut off: pixel (0, 0) stays pixel (0, 0).

    Args:
        network: returns logits in its own resolution; its ``align_corners`` determines how they are resampled.
        pictures: (N, H, W, 3) uint8 sRGB on the network's device.
        mean, std: (3,) float32 on that device.
        labels: height and width of the result, for pictures that were resampled from that size and need no padding.

    Returns:
        (N, H, W) uint8 train ids; of equal logits the smaller train id wins.
    """
    height, width = pictures.shape[1:3]
    down, right = -height % ALIGNMENT, -width % ALIGNMENT
    padded = functional.pad(normalised(pictures, mean, std), (0, right, 0, down), mode="replicate")
    aligned = bool(getattr(network, "align_corners", False))
    if labels is not None:
        return largest_channel(network(padded), *labels, align_corners=aligned)
    ids = largest_channel(network(padded), *padded.shape[-2:], align_corners=aligned)
    return ids[:, :height, :width]
