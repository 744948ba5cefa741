"""From pictures to label maps: normalise, pad, run the network, upsample its logits, take the largest."""

from __future__ import annotations

from typing import Final, TypeVar

import torch
from torch import Tensor, nn
from torch.nn import functional

#: Height and width are padded to multiples of this: the coarsest stride of the networks.
ALIGNMENT: Final = 32

Module = TypeVar("Module", bound=nn.Module)


def in_channels_last(network: Module) -> Module:
    """The network with its weights in channels-last memory order: a fifth less CPU time, the same labels."""
    moved: Module = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # missing in torch's types
    return moved


def normalised(pictures: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """(N, H, W, 3) uint8 sRGB to (N, 3, H, W) float32 ``(x / 255 − mean) / std``, in channels-last memory order."""
    values = pictures.permute(0, 3, 1, 2).to(torch.float32)
    scaled = values.sub_(255.0 * mean.view(1, 3, 1, 1)).div_(255.0 * std.view(1, 3, 1, 1))
    return scaled.contiguous(memory_format=torch.channels_last)


def label_maps(network: nn.Module, pictures: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """Train ids of whole pictures of any size.

    The picture's last row and column are repeated up to the next multiple of 32, logits are resampled bilinearly to the
    padded size, and what was padded is cut off: pixel (0, 0) stays pixel (0, 0).

    Args:
        network: gives logits at a quarter of the resolution.
        pictures: (N, H, W, 3) uint8 sRGB on the network's device.
        mean: (3,) float32 on that device.
        std: (3,) float32 on that device.

    Returns:
        (N, H, W) uint8 train ids; of equal logits the smaller train id wins.
    """
    height, width = pictures.shape[1:3]
    down, right = -height % ALIGNMENT, -width % ALIGNMENT
    padded = functional.pad(normalised(pictures, mean, std), (0, right, 0, down), mode="replicate")
    logits: Tensor = network(padded)
    full = functional.interpolate(logits, size=padded.shape[-2:], mode="bilinear", align_corners=False)
    return full[:, :, :height, :width].argmax(dim=1).to(torch.uint8)
