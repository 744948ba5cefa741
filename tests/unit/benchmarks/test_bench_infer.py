"""The reference of every engine's cost and labels: the network in torch alone, on the same frames."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from benchmarks.bench_infer import LARGE, MODES, eager, table
from valerie.perception.networks.architectures import ARCHITECTURES
from valerie.perception.running.opening import open_function
from valerie.perception.shipped import FUNCTIONS, file_document, function_path


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
    labels = eager(path, threads=1)(picture)
    assert (labels == expected).mean() > 0.9999


def test_the_large_networks_are_the_papers_two_at_their_strides() -> None:
    backbones = [ARCHITECTURES[name].backbone for name in LARGE]
    assert [(backbone.depth, backbone.stem, backbone.output_stride) for backbone in backbones] == [
        (101, "deep", 8),
        (101, "deep", 32),
    ]


def test_the_table_names_strides_and_sizes_and_gives_speed_ups_of_the_large_networks() -> None:
    def rows(stride: int, given: list[int]) -> dict[str, dict[str, object]]:
        engines: dict[str, dict[str, object]] = {
            f"{engine} {precision}": {"cpu_s_per_frame": 10 / (1 + number), "speed_up": 1.0 + number}
            for number, (engine, precision) in enumerate(MODES)
        }
        engines["eager fp32"] |= {"output_stride": stride, "given": given}
        return engines | {"openvino fp16": {"not_here": "another precision on this processor"}}

    lines = table({LARGE[0]: rows(8, [1920, 1088]), FUNCTIONS[0]: rows(16, [1600, 896])})
    assert lines[0] == (
        "| CPU seconds per frame | `deeplabv3plus-r101c-os8`, output stride 8, given 1920 × 1088 | "
        "`deeplabv3plus-small`, output stride 16, given 1600 × 896 |"
    )
    assert lines[2:4] == ["| eager fp32 | 10 | 10 |", "| torch fp32 | 5 (2.00 ×) | 5 |"]
    assert "| openvino fp16 | – | – |" in lines
    assert len(lines) == 2 + len(MODES)
