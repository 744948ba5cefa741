"""Residual networks as feature extractors (He et al. 2016, doi:10.1109/CVPR.2016.90).

Parameter names are the usual ones of this family (``conv1``, ``bn1``, ``layer1.0.conv1`` …). The stride sits on the 3×3
convolution of a bottleneck. A smaller output stride keeps the resolution of the last stage and dilates its convolutions
instead (Chen et al. 2017, arXiv:1706.05587).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from torch import Tensor, nn

from valerie.errors import InvalidInput

#: depth to (bottleneck blocks?, blocks per stage)
_STAGES: Final[dict[int, tuple[bool, tuple[int, int, int, int]]]] = {
    10: (False, (1, 1, 1, 1)),
    18: (False, (2, 2, 2, 2)),
    34: (False, (3, 4, 6, 3)),
    50: (True, (3, 4, 6, 3)),
    101: (True, (3, 4, 23, 3)),
}


@dataclass(frozen=True, slots=True)
class ResNetSettings:
    """Size of a ResNet.

    Attributes:
        depth: 10, 18, 34, 50 or 101.
        width: channels of the stem; 64 is the paper's, 32 half of it.
        output_stride: 32, or 16 with a dilated last stage.
    """

    depth: int
    width: int = 64
    output_stride: int = 32


class BasicBlock(nn.Module):
    """Two 3×3 convolutions around a shortcut."""

    expansion: Final = 1

    def __init__(self, channels_in: int, channels: int, stride: int, dilation: int, shortcut: nn.Module | None) -> None:
        super().__init__()
        self.conv1 = _conv3x3(channels_in, channels, stride, dilation)
        self.bn1 = nn.BatchNorm2d(channels)
        self.conv2 = _conv3x3(channels, channels, 1, dilation)
        self.bn2 = nn.BatchNorm2d(channels)
        self.relu = nn.ReLU(inplace=True)
        self.downsample = shortcut

    def forward(self, x: Tensor) -> Tensor:
        """(N, C, H, W) to (N, channels, H / stride, W / stride)."""
        kept: Tensor = x if self.downsample is None else self.downsample(x)
        x = self.relu(self.bn1(self.conv1(x)))
        x = self.bn2(self.conv2(x))
        result: Tensor = self.relu(x + kept)
        return result


class Bottleneck(nn.Module):
    """1×1, 3×3 and 1×1 convolutions around a shortcut; the last widens fourfold."""

    expansion: Final = 4

    def __init__(self, channels_in: int, channels: int, stride: int, dilation: int, shortcut: nn.Module | None) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels_in, channels, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(channels)
        self.conv2 = _conv3x3(channels, channels, stride, dilation)
        self.bn2 = nn.BatchNorm2d(channels)
        self.conv3 = nn.Conv2d(channels, channels * 4, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(channels * 4)
        self.relu = nn.ReLU(inplace=True)
        self.downsample = shortcut

    def forward(self, x: Tensor) -> Tensor:
        """(N, C, H, W) to (N, 4 × channels, H / stride, W / stride)."""
        kept: Tensor = x if self.downsample is None else self.downsample(x)
        x = self.relu(self.bn1(self.conv1(x)))
        x = self.relu(self.bn2(self.conv2(x)))
        x = self.bn3(self.conv3(x))
        result: Tensor = self.relu(x + kept)
        return result


class ResNet(nn.Module):
    """A ResNet without its classifier.

    Raises:
        InvalidInput: a depth or an output stride that does not exist.
    """

    def __init__(self, settings: ResNetSettings) -> None:
        super().__init__()
        if settings.depth not in _STAGES:
            raise InvalidInput("no such ResNet", field="depth", value=settings.depth, limit=sorted(_STAGES))
        if settings.output_stride not in (16, 32):
            raise InvalidInput(
                "no such output stride", field="output_stride", value=settings.output_stride, limit="16 or 32"
            )
        bottleneck, blocks = _STAGES[settings.depth]
        self._block: type[BasicBlock] | type[Bottleneck] = Bottleneck if bottleneck else BasicBlock
        width = settings.width
        self.conv1 = nn.Conv2d(3, width, 7, stride=2, padding=3, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.relu = nn.ReLU(inplace=True)
        self.maxpool = nn.MaxPool2d(3, stride=2, padding=1)
        dilated = settings.output_stride == 16
        self._channels = width
        self.layer1 = self._stage(width, blocks[0], stride=1)
        self.layer2 = self._stage(width * 2, blocks[1], stride=2)
        self.layer3 = self._stage(width * 4, blocks[2], stride=2)
        self.layer4 = self._stage(width * 8, blocks[3], stride=1 if dilated else 2, dilation=2 if dilated else 1)
        #: Channels of the four feature maps.
        self.channels = tuple(width * factor * self._block.expansion for factor in (1, 2, 4, 8))
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """(N, 3, H, W) to four feature maps at strides 4, 8, 16 and the output stride."""
        x = self.maxpool(self.relu(self.bn1(self.conv1(x))))
        c2: Tensor = self.layer1(x)
        c3: Tensor = self.layer2(c2)
        c4: Tensor = self.layer3(c3)
        c5: Tensor = self.layer4(c4)
        return c2, c3, c4, c5

    def _stage(self, channels: int, blocks: int, *, stride: int, dilation: int = 1) -> nn.Sequential:
        made: list[nn.Module] = []
        for index in range(blocks):
            first_stride = stride if index == 0 else 1
            out = channels * self._block.expansion
            shortcut = None
            if first_stride != 1 or self._channels != out:
                shortcut = nn.Sequential(
                    nn.Conv2d(self._channels, out, 1, stride=first_stride, bias=False), nn.BatchNorm2d(out)
                )
            # The first block of a dilated stage still sees the finer grid of the stage before.
            block_dilation = 1 if index == 0 else dilation
            made.append(self._block(self._channels, channels, first_stride, block_dilation, shortcut))
            self._channels = out
        return nn.Sequential(*made)


def _conv3x3(channels_in: int, channels: int, stride: int, dilation: int) -> nn.Conv2d:
    return nn.Conv2d(channels_in, channels, 3, stride=stride, padding=dilation, dilation=dilation, bias=False)
