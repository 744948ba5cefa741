from dataclasses import replace

import pytest
import torch
from torch import nn
from torch.nn import functional

from valerie.perception.networks.deeplabv3plus import AtrousPyramid, DeepLabSettings, DeepLabV3Plus, WindowMean
from valerie.perception.networks.resnet import ResNetSettings

TINY = DeepLabSettings(ResNetSettings(10, width=8, output_stride=16), (6, 12, 18), 8, 4, 8)


def changed(**changes) -> DeepLabSettings:
    return replace(TINY, **changes)


@pytest.mark.parametrize("changes", [{}, {"separable": True}, {"pool_window": (32, 64)}])
def test_the_pyramid_keeps_the_resolution_and_sees_the_whole_image(changes) -> None:
    torch.manual_seed(0)  # some random weights end in zeros everywhere
    pyramid = AtrousPyramid(4, changed(**changes)).eval()
    x = torch.zeros(1, 4, 30, 60)
    far = x.clone()
    far[..., 29, 59] = 1.0  # further than any dilated kernel reaches from (0, 0)
    assert pyramid(x).shape == (1, 8, 30, 60)
    assert not torch.equal(pyramid(x)[..., 0, 0], pyramid(far)[..., 0, 0])


@pytest.mark.parametrize("separable", [False, True])
def test_the_branches_have_the_given_dilation_rates(separable: bool) -> None:
    pyramid = AtrousPyramid(4, changed(separable=separable))
    assert [conv[0].dilation[0] for conv in pyramid.convs] == [1, 6, 12, 18]


def test_a_separable_pyramid_has_one_kernel_per_channel() -> None:
    pyramid = AtrousPyramid(4, changed(separable=True))
    assert [conv[0].groups for conv in pyramid.convs] == [1, 4, 4, 4]


def test_a_window_mean_is_the_mean_of_every_window() -> None:
    x = torch.rand(2, 3, 7, 9, dtype=torch.float64)
    expected = torch.stack(
        [torch.stack([x[..., i : i + 3, j : j + 4].mean((-2, -1)) for j in range(6)], -1) for i in range(5)], -2
    )
    torch.testing.assert_close(WindowMean((3, 4))(x), expected)


def test_a_window_larger_than_the_map_is_cut_to_it() -> None:
    x = torch.rand(1, 3, 4, 5)
    torch.testing.assert_close(WindowMean((32, 64))(x), functional.adaptive_avg_pool2d(x, 1))


def test_aligned_corners_are_part_of_the_network() -> None:
    torch.manual_seed(0)
    plain = DeepLabV3Plus(TINY, 3).eval()
    aligned = DeepLabV3Plus(changed(align_corners=True), 3).eval()
    aligned.load_state_dict(plain.state_dict())
    x = torch.rand(1, 3, 64, 96)
    assert aligned.align_corners
    assert not plain.align_corners
    assert not torch.equal(plain(x), aligned(x))


def test_the_decoder_has_the_given_number_of_convolutions() -> None:
    counts = [
        sum(isinstance(m, nn.Conv2d) for m in DeepLabV3Plus(changed(decoder_convs=n, separable=s), 3).decoder)
        for n, s in ((1, False), (2, False), (2, True))
    ]
    assert counts == [1, 2, 4]
