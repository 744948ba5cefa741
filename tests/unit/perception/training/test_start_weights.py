"""Start files from the weights of any network of ours: the same logits, in the channels and units of training."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from valerie.errors import InvalidInput
from valerie.perception.documents.function import FunctionDocument, parse_function
from valerie.perception.importing.function_file import read_tensors
from valerie.perception.importing.network_weights import filled_network, load_network
from valerie.perception.shipped import file_document
from valerie.perception.training.start_weights import start_file


@pytest.fixture
def network(write_function: Callable[..., Path]) -> Callable[..., tuple[FunctionDocument, Path]]:
    def make(**entries: Any) -> tuple[FunctionDocument, Path]:
        path = write_function("semantic-fpn-small")
        return file_document("net", path).model_copy(update=entries), path

    return make


def logits(network: torch.nn.Module, values: np.ndarray) -> torch.Tensor:
    with torch.inference_mode():
        return network(torch.from_numpy(values.astype(np.float32)).permute(2, 0, 1)[None])


def test_blue_first_and_8_bit_values_become_red_first_and_the_unit_without_changing_a_logit(network, tmp_path) -> None:
    mean, std = np.array([103.53, 116.28, 123.675]), np.array([57.375, 57.12, 58.395])
    document, payload = network()
    theirs = document.input.model_copy(
        update={"mean": tuple(mean), "std": tuple(std), "scale": "1", "channel_order": "bgr"}
    )
    path = tmp_path / "start.safetensors"
    path.write_bytes(start_file(document.model_copy(update={"input": theirs}), payload))
    begun, header = load_network(path)
    picture = np.random.default_rng(3).integers(0, 256, (64, 96, 3))
    original = filled_network(document.architecture, read_tensors(payload))
    expected = logits(original, (picture[..., ::-1] - mean) / std)
    scores = logits(begun, (picture / 255 - np.array(header.mean)) / np.array(header.std))
    assert torch.allclose(scores, expected, atol=1e-4)


def test_a_function_file_is_its_own_start_file(network, tmp_path: Path) -> None:
    document, payload = network()
    path = tmp_path / "start.safetensors"
    path.write_bytes(start_file(document, payload))
    before, after = load_network(payload), load_network(path)
    assert (after[1].mean, after[1].std) == (before[1].mean, before[1].std)
    pairs = zip(before[0].state_dict().values(), after[0].state_dict().values(), strict=True)
    assert all(torch.equal(one, other) for one, other in pairs)


def test_a_network_with_other_classes_is_refused(network) -> None:
    document, payload = network()
    swapped = parse_function(
        {**document.model_dump(mode="json"), "output": {"classes": [*document.output.classes[1:], "road"]}}
    )
    with pytest.raises(InvalidInput, match="19 classes of Cityscapes in their order"):
        start_file(swapped, payload)


def test_only_networks_can_be_trained(write_onnx) -> None:
    with pytest.raises(InvalidInput, match=r"own architectures.*tenths, kind onnx"):
        start_file(*write_onnx())
