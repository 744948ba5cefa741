import pytest
import torch

from valerie.errors import UnknownName
from valerie.perception.networks.architectures import ARCHITECTURES, build_network

SMALL = ["deeplabv3plus-small", "semantic-fpn-small"]


@pytest.mark.parametrize("architecture", SMALL)
def test_logits_have_19_classes_at_a_quarter_of_the_resolution(architecture: str) -> None:
    network = build_network(architecture).eval()
    with torch.inference_mode():
        assert network(torch.zeros(2, 3, 96, 160)).shape == (2, 19, 24, 40)
    assert network.stride == 4


@pytest.mark.parametrize("architecture", SMALL)
def test_a_small_network_fits_ten_megabytes_in_half_precision(architecture: str) -> None:
    state = build_network(architecture).state_dict()
    assert sum(tensor.numel() * 2 for tensor in state.values()) < 9_500_000


@pytest.mark.parametrize("architecture", SMALL)
def test_every_parameter_takes_part_in_the_result(architecture: str) -> None:
    network = build_network(architecture).train()
    network(torch.rand(2, 3, 64, 64)).square().mean().backward()
    unused = [name for name, p in network.named_parameters() if p.grad is None]
    assert unused == []


@pytest.mark.parametrize("architecture", SMALL)
def test_a_far_pixel_can_change_a_logit(architecture: str) -> None:
    torch.manual_seed(0)
    network = build_network(architecture).eval()
    picture = torch.rand(1, 3, 256, 256, requires_grad=True)
    network(picture)[0, :, 32, 32].sum().backward()
    assert picture.grad is not None
    assert picture.grad[0, :, 8, 8].abs().sum() > 0


def test_deeplab_at_the_published_size_has_the_parameters_of_the_reference_implementation() -> None:
    with torch.device("meta"):
        network = build_network("deeplabv3plus-r101")
    # 58.7 million: ResNet-101, ASPP of ordinary convolutions with 256 channels, 48 low-level channels
    assert 58_600_000 < sum(p.numel() for p in network.parameters()) < 58_800_000


@pytest.mark.parametrize("architecture", sorted(set(ARCHITECTURES) - {*SMALL}))
def test_every_full_size_architecture_has_logits_of_any_number_of_classes(architecture: str) -> None:
    with torch.device("meta"):
        logits = build_network(architecture, 5).eval()(torch.empty(1, 3, 64, 96))
    assert logits.shape == (1, 5, 16, 24)


def test_an_unknown_architecture_names_its_neighbours() -> None:
    with pytest.raises(UnknownName, match="semantic-fpn-small"):
        build_network("semantic-fpn-smal")


def test_every_architecture_can_be_built() -> None:
    with torch.device("meta"):
        assert all(build_network(name).stride == 4 for name in ARCHITECTURES)
