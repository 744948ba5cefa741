import torch

from valerie.perception.networks.deeplabv3plus import AtrousPyramid


def test_the_pyramid_keeps_the_resolution_and_sees_the_whole_image() -> None:
    pyramid = AtrousPyramid(4, 8, (6, 12, 18)).eval()
    x = torch.zeros(1, 4, 50, 60)
    far = x.clone()
    far[..., 49, 59] = 1.0  # further than any dilated kernel reaches from (0, 0)
    assert pyramid(x).shape == (1, 8, 50, 60)
    assert not torch.equal(pyramid(x)[..., 0, 0], pyramid(far)[..., 0, 0])


def test_the_branches_have_the_given_dilation_rates() -> None:
    pyramid = AtrousPyramid(4, 8, (6, 12, 18))
    assert [conv[0].dilation[0] for conv in pyramid.convs] == [1, 6, 12, 18]
