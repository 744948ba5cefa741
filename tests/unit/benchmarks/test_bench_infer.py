"""What every engine's cost and labels are compared with: the network in torch alone, given the same frames."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from benchmarks.bench_infer import LARGE, eager
from valerie.perception.catalog import FUNCTIONS, file_document, function_path
from valerie.perception.functions import open_function
from valerie.perception.networks.architectures import ARCHITECTURES


@pytest.fixture(autouse=True)
def _restore_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("width", [1640, 200], ids=["longer than its longest side", "padded"])
def test_eager_torch_gives_the_labels_of_the_reference(name: str, width: int) -> None:
    path = function_path(name)
    colours = np.random.default_rng(4).integers(0, 256, (5, width // 20, 3), dtype=np.uint8)
    picture = np.kron(colours, np.ones((15, 20, 1), np.uint8))
    function = open_function(file_document(name, path), path, threads=1, device="cpu")
    expected = function.predict(picture)
    function.close()
    found = eager(path, threads=1)(picture)
    assert (found == expected).mean() > 0.9999


def test_the_large_networks_are_the_papers_two_at_their_strides() -> None:
    backbones = [ARCHITECTURES[name].backbone for name in LARGE]
    assert [(one.depth, one.stem, one.output_stride) for one in backbones] == [(101, "deep", 8), (101, "deep", 32)]
