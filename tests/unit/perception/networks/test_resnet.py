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


@pytest.mark.parametrize(("output_stride", "last"), [(16, 4), (32, 2)])
def test_features_have_the_promised_strides_and_channels(output_stride: int, last: int) -> None:
    network = ResNet(ResNetSettings(10, width=8, output_stride=output_stride)).eval()
    maps = network(torch.zeros(1, 3, 64, 96))
    assert [tuple(m.shape[1:]) for m in maps] == [(8, 16, 24), (16, 8, 12), (32, 4, 6), (64, last, last * 3 // 2)]
    assert network.channels == (8, 16, 32, 64)


def test_a_dilated_stage_has_the_weights_of_the_plain_one() -> None:
    shapes = [
        {k: v.shape for k, v in ResNet(ResNetSettings(50, width=8, output_stride=s)).state_dict().items()}
        for s in (16, 32)
    ]
    assert shapes[0] == shapes[1]


@pytest.mark.parametrize("settings", [ResNetSettings(19), ResNetSettings(18, output_stride=8)])
def test_what_does_not_exist_is_refused(settings: ResNetSettings) -> None:
    with pytest.raises(InvalidInput, match="no such"):
        ResNet(settings)
