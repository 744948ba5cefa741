import numpy as np
import pytest
import torch

from valerie.errors import InvalidInput, UnknownName
from valerie.perception.importing.network_weights import filled_network, load_network, tensor_shapes
from valerie.perception.networks.architectures import build_network


@pytest.mark.parametrize("architecture", ["deeplabv3plus-small", "semantic-fpn-small"])
def test_a_loaded_network_computes_as_the_saved_one_rounded_to_half_precision(
    write_function, architecture: str
) -> None:
    path = write_function(architecture, seed=3)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(3)
        original = build_network(architecture).eval()
    with torch.no_grad():
        for tensor in [*original.parameters(), *original.buffers()]:
            tensor.copy_(tensor.half())
    loaded, header = load_network(path)
    x = torch.rand(1, 3, 64, 96)
    with torch.inference_mode():
        assert torch.equal(loaded(x), original(x))
    assert header.architecture == architecture


def test_a_loaded_network_runs_in_single_precision_without_gradients(write_function) -> None:
    network, _ = load_network(write_function())
    assert {p.dtype for p in network.parameters()} == {torch.float32}
    assert not any(p.requires_grad for p in network.parameters())
    assert not network.training


def test_loading_does_not_move_the_random_generator(write_function) -> None:
    path = write_function()
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    load_network(path)
    assert torch.equal(torch.rand(3), expected)


def test_a_missing_tensor_is_named(write_function) -> None:
    with pytest.raises(InvalidInput, match=r"predictor\.bias is missing"):
        load_network(write_function(drop=["predictor.bias"]))


def test_an_unknown_tensor_is_named(write_function) -> None:
    with pytest.raises(InvalidInput, match="extra is unknown"):
        load_network(write_function(tensors={"extra": np.zeros(1)}))


def test_a_tensor_of_another_shape_is_named_with_both_shapes(write_function) -> None:
    with pytest.raises(InvalidInput, match=r"predictor\.bias is \[7\] instead of \[19\]"):
        load_network(write_function(tensors={"predictor.bias": np.zeros(7)}))


def test_the_weights_of_another_architecture_are_refused_with_a_count(write_function) -> None:
    wrong = write_function("semantic-fpn-small", named="deeplabv3plus-small")
    with pytest.raises(InvalidInput, match=r"is missing.*more"):
        load_network(wrong)


def test_an_unknown_architecture_in_the_header_is_refused(write_function) -> None:
    with pytest.raises(UnknownName, match="u-net"):
        load_network(write_function(named="u-net"))


def test_a_network_with_other_classes_is_filled_with_its_own_tensors() -> None:
    random = np.random.default_rng(1)
    shapes = tensor_shapes("semantic-fpn-small", 2)
    tensors = {name: random.random(shape, np.float32) for name, shape in shapes.items()}
    network = filled_network("semantic-fpn-small", tensors, 2)
    assert shapes["predictor.weight"] == (2, 64, 1, 1)
    assert all(np.array_equal(network.state_dict()[name].numpy(), array) for name, array in tensors.items())


def test_filled_networks_do_not_share_memory_with_the_tensors() -> None:
    tensors = {name: np.zeros(shape, np.float32) for name, shape in tensor_shapes("semantic-fpn-small", 2).items()}
    network = filled_network("semantic-fpn-small", tensors, 2)
    tensors["predictor.bias"][:] = 1.0
    assert not network.state_dict()["predictor.bias"].any()
