import torch

from valerie.perception.networks.semantic_fpn import FeaturePyramid, ScaleHead


def test_the_pyramid_adds_coarse_levels_to_the_finer_ones() -> None:
    pyramid = FeaturePyramid((4, 8), 6).eval()
    fine, coarse = torch.zeros(1, 4, 8, 8), torch.zeros(1, 8, 4, 4)
    quiet = pyramid((fine, coarse))
    loud = pyramid((fine, coarse + 1.0))
    assert [tuple(level.shape) for level in quiet] == [(1, 6, 8, 8), (1, 6, 4, 4)]
    assert not torch.equal(quiet[0], loud[0])


def test_a_finer_level_does_not_reach_a_coarser_one() -> None:
    pyramid = FeaturePyramid((4, 8), 6).eval()
    fine, coarse = torch.zeros(1, 4, 8, 8), torch.rand(1, 8, 4, 4)
    assert torch.equal(pyramid((fine, coarse))[1], pyramid((fine + 1.0, coarse))[1])


def test_a_scale_head_has_one_convolution_per_doubling_and_at_least_one() -> None:
    heads = [ScaleHead(6, 5, doublings) for doublings in range(4)]
    assert [len(head.convs) for head in heads] == [1, 1, 2, 3]
    sizes = [head.eval()(torch.zeros(1, 6, 3, 4)).shape[-2:] for head in heads]
    assert [tuple(size) for size in sizes] == [(3, 4), (6, 8), (12, 16), (24, 32)]


def test_the_heads_are_normalised_by_batch_or_in_32_groups() -> None:
    kinds = [type(ScaleHead(6, 64, 2, norm).convs[1][1]).__name__ for norm in ("batch", "group")]
    assert kinds == ["BatchNorm2d", "GroupNorm"]
    assert ScaleHead(6, 64, 2, "group").convs[1][1].num_groups == 32
