"""Whole functions of every engine on pictures whose labels are known: nothing may be shifted on the way in or out.

The network answers with the share of each of four colours in a cell, so the label of a pixel is the colour of which the
resampled picture has most there: known without any code of this program.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import InputDocument, parse_function
from valerie.perception.running.adaptation import plan
from valerie.perception.running.opening import open_function
from valerie.pipeline.functions.import_job import payload_of

COLOURS = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 0, 0]], np.uint8)
CLASSES = ["road", "car", "person", "sky"]
TRAIN_IDS = np.array([0, 13, 11, 10], np.uint8)
HEIGHT, WIDTH = 90, 150

#: Every way into a network.
WAYS: dict[str, dict[str, Any]] = {
    "pad to multiples": {"multiple_of": 32},
    "pad to a size": {"size": [160, 96]},
    "tile": {"size": [96, 64], "mode": "tile", "overlap": 12},
    "shrink by a whole number": {"size": [50, 30], "mode": "resize"},
    "shrink by fractions": {"size": [64, 44], "mode": "resize"},
    "grow": {"size": [224, 160], "mode": "resize"},
    "grow in height, shrink in width": {"size": [120, 112], "mode": "resize"},
    "longest side": {"multiple_of": 32, "longest_side": 128},
    "longest side of another shape": {"multiple_of": 8, "longest_side": 60},
}
ENGINES = pytest.mark.parametrize("engine", ["torch", "openvino", "onnxruntime"])
EVERY_WAY = pytest.mark.parametrize("way", WAYS)


class Shares(nn.Module):
    """Red, green, blue and what is missing to white's share of one, in cells of ``stride`` × ``stride`` pixels."""

    def __init__(self, stride: int) -> None:
        super().__init__()
        self.pool = nn.AvgPool2d(stride)
        self.mix = nn.Conv2d(3, 4, 1)
        self.mix.weight.data = torch.tensor([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [-1, -1, -1]]).view(4, 3, 1, 1)
        self.mix.bias.data = torch.tensor([0.0, 0.0, 0.0, 1.0])

    def forward(self, x: Tensor) -> Tensor:
        logits: Tensor = self.mix(self.pool(x))
        return logits


Open = Callable[..., PerceptionFunction]


@pytest.fixture
def open_shares(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Open]:
    """Opens that network as any other: ``open_shares("openvino", {"multiple_of": 32}, stride=4)``."""
    path = tmp_path / "shares.safetensors"
    path.write_bytes(b"the weights are in this test")
    payload = payload_of(path, "safetensors").model_dump()
    functions = []

    def opened(engine: str, taken: dict[str, Any], *, stride: int = 1) -> PerceptionFunction:
        network = Shares(stride).eval().requires_grad_(requires_grad=False)
        monkeypatch.setattr("valerie.perception.running.engines.modules.open_module", lambda *_: network)
        fields = {"name": "shares", "kind": "network", "architecture": "shares", "engine": engine}
        document = parse_function({**fields, "input": taken, "output": {"classes": CLASSES}}, payload=payload)
        functions.append(open_function(document, path))
        return functions[-1]

    yield opened
    for function in functions:
        function.close()


def bands(length: int) -> NDArray[np.uint8]:
    """Colours of (length,) pixels: bands of 15 to 23, with ends at no multiple of anything, and what is left."""
    return np.repeat(np.uint8([0, 1, 2, 3, 1, 0, 3, 2]), [17, 19, 15, 23, 16, 23, 18, length])[:length]


def pools(way: str) -> int:
    """Return the coarsest stride of the network's answer from which bands come back exactly.

    Interpolated between the means of cells, a straight edge moves by at most 0.086 cells: by less than half a pixel where cells
    are smaller than 5.8.
    """
    piece = plan(InputDocument.model_validate(WAYS[way]), HEIGHT, WIDTH).piece
    cell = max(HEIGHT / piece.height, WIDTH / piece.width)
    return max(stride for stride in (1, 2, 4) if stride * cell < 5.8)


@ENGINES
@EVERY_WAY
def test_bands_come_back_exactly_through_every_adaptation(open_shares: Open, engine: str, way: str) -> None:
    function = open_shares(engine, WAYS[way], stride=pools(way))
    upright = np.broadcast_to(bands(WIDTH), (HEIGHT, WIDTH))
    lying = np.broadcast_to(bands(HEIGHT)[:, None], (HEIGHT, WIDTH))
    for colours in (upright, lying, upright[:, ::-1], lying[::-1]):
        np.testing.assert_array_equal(function.predict(COLOURS[colours]), TRAIN_IDS[colours])


def overlaps(many: int, few: int) -> NDArray[np.float64]:
    """(few, many): of each of few equal parts of a line, the share that each of many equal parts has."""
    starts, ends = np.arange(few) / few, (np.arange(few) + 1) / few
    others = np.arange(many + 1) / many
    shared = np.minimum(ends[:, None], others[1:]) - np.maximum(starts[:, None], others[:-1])
    return np.maximum(shared, 0.0) * few


def between(few: int, many: int) -> NDArray[np.float64]:
    """(many, few): weights of straight lines between the middles of few equal parts, at the middles of many."""
    places = (np.arange(many) + 0.5) / many * few - 0.5
    return np.maximum(1.0 - np.abs(np.clip(places, 0, few - 1)[:, None] - np.arange(few)), 0.0)


@ENGINES
@pytest.mark.parametrize(
    ("way", "stride"),
    [
        ("shrink by a whole number", 1),
        ("shrink by fractions", 4),
        ("grow", 1),
        ("longest side", 4),
        ("longest side of another shape", 2),
    ],
)
def test_a_resampled_frame_has_the_labels_of_means_and_straight_lines_between_them(
    open_shares: Open, engine: str, way: str, stride: int
) -> None:
    colours = np.kron(np.random.default_rng(3).integers(0, 4, (13, 19)), np.ones((7, 8), int))[:HEIGHT, :WIDTH]
    shares = np.eye(4)[colours]
    piece = plan(InputDocument.model_validate(WAYS[way]), HEIGHT, WIDTH).piece
    for axis, (own, other) in enumerate(zip((HEIGHT, WIDTH), piece, strict=True)):
        there = overlaps(own, other) if other <= own else between(own, other)
        back = between(other // stride, own) @ overlaps(other, other // stride)
        shares = np.moveaxis(np.tensordot(back @ there, shares, axes=(1, axis)), 0, axis)
    highest = np.sort(shares, axis=2)
    clear = highest[..., 3] - highest[..., 2] > 2 / 255  # pictures hold whole numbers
    labels = open_shares(engine, WAYS[way], stride=stride).predict(COLOURS[colours])
    np.testing.assert_array_equal(labels[clear], TRAIN_IDS[shares.argmax(axis=2)][clear])
    assert clear.mean() > 0.95  # or little would be compared


@ENGINES
@pytest.mark.parametrize("way", ["pad to multiples", "pad to a size", "tile"])
def test_frames_that_are_not_resampled_come_back_pixel_for_pixel(open_shares: Open, engine: str, way: str) -> None:
    colours = np.random.default_rng(5).integers(0, 4, (HEIGHT, WIDTH))
    np.testing.assert_array_equal(open_shares(engine, WAYS[way]).predict(COLOURS[colours]), TRAIN_IDS[colours])
