import pytest
import torch

from valerie.errors import InvalidInput
from valerie.perception.networks.resnet import ResNet, ResNetSettings


# The published sizes less the classifier, which has 1000 × (C + 1) parameters (He et al. 2016).
@pytest.mark.parametrize(
    ("depth", "parameters"),
    [
        (18, 11_689_512 - 513_000),
        (34, 21_797_672 - 513_000),
        (50, 25_557_032 - 2_049_000),
        (101, 44_549_160 - 2_049_000),
    ],
)
def test_the_parameter_count_is_the_published_one(depth: int, parameters: int) -> None:
    with torch.device("meta"):
        network = ResNet(ResNetSettings(depth))
    assert sum(p.numel() for p in network.parameters()) == parameters


@pytest.mark.parametrize(("output_stride", "last"), [(8, 8), (16, 4), (32, 2)])
def test_features_have_the_promised_strides_and_channels(output_stride: int, last: int) -> None:
    network = ResNet(ResNetSettings(10, width=8, output_stride=output_stride)).eval()
    maps = network(torch.zeros(1, 3, 64, 96))
    third = max(4, last)
    assert [tuple(m.shape[1:]) for m in maps] == [
        (8, 16, 24),
        (16, 8, 12),
        (32, third, third * 3 // 2),
        (64, last, last * 3 // 2),
    ]
    assert network.channels == (8, 16, 32, 64)


def test_a_dilated_stage_has_the_weights_of_the_plain_one() -> None:
    shapes = [
        {k: v.shape for k, v in ResNet(ResNetSettings(50, width=8, output_stride=s)).state_dict().items()}
        for s in (8, 16, 32)
    ]
    assert shapes[0] == shapes[1] == shapes[2]


def dilations(settings: ResNetSettings) -> list[list[int]]:
    """Of the 3×3 convolution of each block of each stage."""
    with torch.device("meta"):
        network = ResNet(settings)
    stages = (network.layer1, network.layer2, network.layer3, network.layer4)
    return [[block.conv2.dilation[0] for block in stage] for stage in stages]


def test_output_stride_8_dilates_the_last_two_stages_each_from_its_second_block_on() -> None:
    expected = [[1] * 3, [1] * 4, [1] + [2] * 5, [2, 4, 4]]
    assert dilations(ResNetSettings(50, output_stride=8)) == expected


def test_a_multi_grid_gives_each_block_of_the_last_stage_its_dilation() -> None:
    expected = [[1] * 3, [1] * 4, [1] * 6, [2, 4, 8]]
    assert dilations(ResNetSettings(50, output_stride=16, last_dilations=(2, 4, 8))) == expected


@pytest.mark.parametrize(("both", "second"), [(True, 4), (False, 1)])
def test_the_second_convolution_of_a_basic_block_may_stay_plain(both: bool, second: int) -> None:
    with torch.device("meta"):
        block = ResNet(ResNetSettings(18, output_stride=8, dilate_both=both)).layer4[1]
    assert (block.conv1.dilation[0], block.conv2.dilation[0]) == (4, second)


# Each 3×3 convolution has 9 · in · out parameters, each normalisation 2 per channel; the rest is the plain ResNet.
@pytest.mark.parametrize(("stem_channels", "more_in_layer1"), [(64, 0), (128, 64 * 64 + 64 * 256)])
def test_a_deep_stem_is_three_small_convolutions(stem_channels: int, more_in_layer1: int) -> None:
    with torch.device("meta"):
        plain, deep = ResNet(ResNetSettings(50)), ResNet(ResNetSettings(50, stem="deep", stem_channels=stem_channels))
    half = stem_channels // 2
    stem = 9 * (3 * half + half * half + half * stem_channels) + 2 * (half + half + stem_channels)
    plain_stem = 49 * 3 * 64 + 2 * 64
    counts = [sum(p.numel() for p in network.parameters()) for network in (plain, deep)]
    assert counts[1] - counts[0] == stem - plain_stem + more_in_layer1


def test_a_stride_may_sit_on_the_first_convolution_of_a_block() -> None:
    for in_1x1, strides in ((False, (1, 2)), (True, (2, 1))):
        with torch.device("meta"):
            block = ResNet(ResNetSettings(50, stride_in_1x1=in_1x1)).layer2[0]
        assert (block.conv1.stride[0], block.conv2.stride[0]) == strides


@pytest.mark.parametrize(
    "settings", [ResNetSettings(19), ResNetSettings(18, output_stride=4), ResNetSettings(18, last_dilations=(1, 2, 4))]
)
def test_what_does_not_exist_is_refused(settings: ResNetSettings) -> None:
    with pytest.raises(InvalidInput, match=r"no such|one dilation per block"):
        ResNet(settings)
