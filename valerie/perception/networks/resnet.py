"""Residual networks as feature extractors (He et al. 2016, doi:10.1109/CVPR.2016.90).

Parameter names are the usual ones of this family (``conv1``, ``bn1``, ``layer1.0.conv1`` …). A smaller output stride keeps
the resolution of the last stages and dilates their convolutions instead (Chen et al. 2017, arXiv:1706.05587).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from torch import Tensor, nn

from valerie.errors import InvalidInput
from valerie.perception.networks.layers import conv_norm_relu

#: Depth to (True for bottleneck blocks, blocks per stage).
_STAGES: Final[dict[int, tuple[bool, tuple[int, int, int, int]]]] = {
    10: (False, (1, 1, 1, 1)),
    18: (False, (2, 2, 2, 2)),
    34: (False, (3, 4, 6, 3)),
    50: (True, (3, 4, 6, 3)),
    101: (True, (3, 4, 23, 3)),
}

#: Output stride to (stride, dilation) of each stage.
_RESOLUTIONS: Final[dict[int, tuple[tuple[int, int], ...]]] = {
    8: ((1, 1), (2, 1), (1, 2), (1, 4)),
    16: ((1, 1), (2, 1), (2, 1), (1, 2)),
    32: ((1, 1), (2, 1), (2, 1), (2, 1)),
}


@dataclass(frozen=True, slots=True)
class ResNetSettings:
    """Size and kind of a ResNet.

    Attributes:
        depth: 10, 18, 34, 50 or 101.
        width: channels within the first stage's blocks; 64 in the paper.
        output_stride: 32, 16 with a dilated last stage, or 8 with two dilated stages.
        stem: one 7×7 convolution, or three 3×3 ones (the "deep" stem of ResNet-C, He et al. 2019, arXiv:1812.01187).
        stem_channels: channels of the stem's result (half as many within a deep stem); None: ``width``.
        stride_in_1x1: a bottleneck halves the resolution in its first 1×1 convolution, as the first ResNets in Caffe do; if
            False, in its 3×3 convolution.
        last_dilations: dilation of each block of the last stage ("multi-grid"); None: from `output_stride`, where the first
            block of a dilated stage still has the dilation of the stage before.
        dilate_both: in a dilated stage of a ResNet of depth 34 or less, both convolutions of a block are dilated; if False,
            only the first.
    """

    depth: int
    width: int = 64
    output_stride: int = 32
    stem: Literal["plain", "deep"] = "plain"
    stem_channels: int | None = None
    stride_in_1x1: bool = False
    last_dilations: tuple[int, ...] | None = None
    dilate_both: bool = True


class BasicBlock(nn.Module):
    """Two 3×3 convolutions around a shortcut."""

    expansion: Final = 1

    def __init__(
        self,
        channels_in: int,
        channels: int,
        stride: int,
        dilation: int,
        shortcut: nn.Module | None,
        *,
        dilate_both: bool = True,
    ) -> None:
        super().__init__()
        self.conv1 = _conv3x3(channels_in, channels, stride, dilation)
        self.bn1 = nn.BatchNorm2d(channels)
        self.conv2 = _conv3x3(channels, channels, 1, dilation if dilate_both else 1)
        self.bn2 = nn.BatchNorm2d(channels)
        self.relu = nn.ReLU(inplace=True)
        self.downsample = shortcut

    def forward(self, x: Tensor) -> Tensor:
        """Map (N, C, H, W) to (N, channels, H / stride, W / stride)."""
        shortcut: Tensor = x if self.downsample is None else self.downsample(x)
        x = self.relu(self.bn1(self.conv1(x)))
        x = self.bn2(self.conv2(x))
        result: Tensor = self.relu(x + shortcut)
        return result


class Bottleneck(nn.Module):
    """1×1, 3×3 and 1×1 convolutions around a shortcut; the last widens fourfold."""

    expansion: Final = 4

    def __init__(
        self,
        channels_in: int,
        channels: int,
        stride: int,
        dilation: int,
        shortcut: nn.Module | None,
        *,
        stride_in_1x1: bool = False,
    ) -> None:
        super().__init__()
        stride_1x1, stride_3x3 = (stride, 1) if stride_in_1x1 else (1, stride)
        self.conv1 = nn.Conv2d(channels_in, channels, 1, stride=stride_1x1, bias=False)
        self.bn1 = nn.BatchNorm2d(channels)
        self.conv2 = _conv3x3(channels, channels, stride_3x3, dilation)
        self.bn2 = nn.BatchNorm2d(channels)
        self.conv3 = nn.Conv2d(channels, channels * 4, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(channels * 4)
        self.relu = nn.ReLU(inplace=True)
        self.downsample = shortcut

    def forward(self, x: Tensor) -> Tensor:
        """Map (N, C, H, W) to (N, 4 × channels, H / stride, W / stride)."""
        shortcut: Tensor = x if self.downsample is None else self.downsample(x)
        x = self.relu(self.bn1(self.conv1(x)))
        x = self.relu(self.bn2(self.conv2(x)))
        x = self.bn3(self.conv3(x))
        result: Tensor = self.relu(x + shortcut)
        return result


class ResNet(nn.Module):
    """A ResNet without its classifier.

    Raises:
        InvalidInput: an unknown depth or output stride, or not one dilation per block.
    """

    def __init__(self, settings: ResNetSettings) -> None:
        super().__init__()
        if settings.depth not in _STAGES:
            raise InvalidInput("no such ResNet", field="depth", value=settings.depth, limit=sorted(_STAGES))
        if settings.output_stride not in _RESOLUTIONS:
            raise InvalidInput(
                "no such output stride",
                field="output_stride",
                value=settings.output_stride,
                limit=sorted(_RESOLUTIONS),
            )
        self._settings = settings
        bottleneck, blocks = _STAGES[settings.depth]
        self._expansion = Bottleneck.expansion if bottleneck else BasicBlock.expansion
        self._channels = settings.stem_channels or settings.width
        if settings.stem == "plain":
            self.conv1 = nn.Conv2d(3, self._channels, 7, stride=2, padding=3, bias=False)
            self.bn1 = nn.BatchNorm2d(self._channels)
        else:
            half = self._channels // 2
            self.stem = nn.Sequential(
                *conv_norm_relu(3, half, 3, stride=2),
                *conv_norm_relu(half, half, 3),
                *conv_norm_relu(half, self._channels, 3),
            )
        self.relu = nn.ReLU(inplace=True)
        self.maxpool = nn.MaxPool2d(3, stride=2, padding=1)
        dilations = [
            (dilation // 2 or 1,) + (dilation,) * (count - 1)
            for (_, dilation), count in zip(_RESOLUTIONS[settings.output_stride], blocks, strict=True)
        ]
        if settings.last_dilations is not None:
            if len(settings.last_dilations) != blocks[-1]:
                raise InvalidInput(
                    "one dilation per block of the last stage",
                    field="last_dilations",
                    value=settings.last_dilations,
                    limit=blocks[-1],
                )
            dilations[-1] = settings.last_dilations
        strides = [stride for stride, _ in _RESOLUTIONS[settings.output_stride]]
        self.layer1, self.layer2, self.layer3, self.layer4 = (
            self._stage(settings.width * factor, strides[stage], dilations[stage])
            for stage, factor in enumerate((1, 2, 4, 8))
        )
        #: Channels of the four feature maps.
        self.channels = tuple(settings.width * factor * self._expansion for factor in (1, 2, 4, 8))
        for module in self.modules():
            # The meta device has no weights to draw, and trying would make torch load its compiler.
            if isinstance(module, nn.Conv2d) and not module.weight.is_meta:
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Map (N, 3, H, W) to four feature maps at strides 4, 8, 16 and 32, none coarser than the output stride."""
        x = self.stem(x) if self._settings.stem == "deep" else self.relu(self.bn1(self.conv1(x)))
        x = self.maxpool(x)
        c2: Tensor = self.layer1(x)
        c3: Tensor = self.layer2(c2)
        c4: Tensor = self.layer3(c3)
        c5: Tensor = self.layer4(c4)
        return c2, c3, c4, c5

    def _stage(self, channels: int, stride: int, dilations: tuple[int, ...]) -> nn.Sequential:
        blocks: list[nn.Module] = []
        for index, dilation in enumerate(dilations):
            first_stride = stride if index == 0 else 1
            out = channels * self._expansion
            shortcut = None
            if first_stride != 1 or self._channels != out:
                shortcut = nn.Sequential(
                    nn.Conv2d(self._channels, out, 1, stride=first_stride, bias=False), nn.BatchNorm2d(out)
                )
            blocks.append(self._block(channels, first_stride, dilation, shortcut))
            self._channels = out
        return nn.Sequential(*blocks)

    def _block(self, channels: int, stride: int, dilation: int, shortcut: nn.Module | None) -> nn.Module:
        if self._expansion == BasicBlock.expansion:
            both = self._settings.dilate_both
            return BasicBlock(self._channels, channels, stride, dilation, shortcut, dilate_both=both)
        in_1x1 = self._settings.stride_in_1x1
        return Bottleneck(self._channels, channels, stride, dilation, shortcut, stride_in_1x1=in_1x1)


def _conv3x3(channels_in: int, channels: int, stride: int, dilation: int) -> nn.Conv2d:
    return nn.Conv2d(channels_in, channels, 3, stride=stride, padding=dilation, dilation=dilation, bias=False)
