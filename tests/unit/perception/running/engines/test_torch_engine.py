import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import save
from torch import nn

from valerie.errors import InferenceError, InvalidInput, MissingDependency
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import parse_function
from valerie.perception.networks.architectures import build_network
from valerie.perception.running.engine_function import EngineFunction
from valerie.perception.running.engines.modules import open_module
from valerie.perception.running.engines.torch_engine import TorchEngine
from valerie.perception.running.opening import open_function
from valerie.perception.shipped import file_document
from valerie.testing.perception import PerceptionContract


@pytest.fixture(autouse=True)
def _restore_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def opened(path: Path, *, threads: int = 1) -> PerceptionFunction:
    return open_function(file_document("f", path), path, threads=threads)


class _Contract(PerceptionContract):
    architecture: str

    @pytest.fixture
    def function(self, write_function) -> Iterator[PerceptionFunction]:
        function = opened(write_function(self.architecture, seed=2))
        yield function
        function.close()


class TestDeepLab(_Contract):
    architecture = "deeplabv3plus-small"


class TestSemanticFpn(_Contract):
    architecture = "semantic-fpn-small"


def test_the_numeric_class_names_version_kernels_and_threads(write_function) -> None:
    function = opened(write_function(), threads=2)
    isa = torch.backends.cpu.get_cpu_capability().lower()
    assert function.numeric_class == f"torch-{torch.__version__.split('+')[0]}-cpu-fp32-{isa}-t2"


def test_the_card_carries_the_provenance_of_the_file(write_function) -> None:
    card = opened(write_function(provenance={"seed": "4"})).card
    assert card.provenance == {"seed": "4"}
    assert (card.name, card.architecture, card.precision, card.engine) == ("f", "semantic-fpn-small", "fp32", "torch")


@pytest.mark.parametrize("shape", [(0, 8, 3), (8, 8), (8, 8, 4)])
def test_arrays_that_are_not_pictures_are_refused(write_function, shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInput, match="not a picture"):
        opened(write_function()).predict(np.zeros(shape, np.uint8))


class Watched(nn.Module):
    """A network that remembers the sizes of its batches, or fails."""

    def __init__(self, network: nn.Module, *, fails: bool = False) -> None:
        super().__init__()
        self.network, self.fails = network, fails
        self.batches: list[int] = []

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        if self.fails:
            raise RuntimeError("could not allocate")
        self.batches.append(x.shape[0])
        logits: torch.Tensor = self.network(x)
        return logits


def watched(
    path: Path, *, batch_size: int = 1, fails: bool = False, **changes: object
) -> tuple[EngineFunction, Watched]:
    """Return the function of a file that takes as many pictures at once as on some GPU, and its network."""
    document = file_document("f", path)
    document = document.model_copy(update={"input": document.input.model_copy(update=changes)})
    network = Watched(open_module(document, path), fails=fails)
    engine = TorchEngine(network, document, threads=1, device="cpu")
    engine.batch_size = batch_size
    return EngineFunction(document, engine, digest=document.digest), network


def test_a_failure_inside_torch_becomes_an_inference_error(write_function) -> None:
    function, _ = watched(write_function(), fails=True)
    with pytest.raises(InferenceError, match=r"f: torch failed.*could not allocate"):
        function.predict(np.zeros((8, 8, 3), np.uint8))


def pictures(count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(count)
    return [
        np.kron(rng.integers(0, 256, (5, 7, 3), dtype=np.uint8), np.ones((10, 10, 1), np.uint8)) for _ in range(count)
    ]


@pytest.mark.parametrize("taken", [{}, {"size": (64, 32), "mode": "tile", "multiple_of": 1, "overlap": 8}])
def test_pictures_have_the_same_labels_together_and_alone(write_function, taken: dict) -> None:
    function, _ = watched(write_function(), batch_size=4, **taken)
    batch = pictures(5)
    together = function.predict_many(batch)
    assert len(together) == 5
    for picture, labels in zip(batch, together, strict=True):
        np.testing.assert_array_equal(labels, function.predict(picture))


def test_pictures_of_different_sizes_cannot_be_predicted_together(write_function) -> None:
    with pytest.raises(InvalidInput, match="different sizes"):
        opened(write_function()).predict_many([np.zeros((8, 8, 3), np.uint8), np.zeros((8, 9, 3), np.uint8)])


def test_no_pictures_have_no_labels(write_function) -> None:
    assert opened(write_function()).predict_many([]) == []


def test_an_incomplete_batch_is_filled_so_that_the_kernels_stay_the_same(write_function) -> None:
    function, network = watched(write_function(), batch_size=4)
    function.predict_many(pictures(5))
    assert network.batches == [4, 4]


def test_a_missing_gpu_is_named(write_function, monkeypatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    path = write_function()
    document = file_document("f", path)
    with pytest.raises(MissingDependency, match="no GPU 'cuda:1'"):
        open_function(document, path, device="cuda:1")
    assert "-cpu-" in open_function(document, path, device="auto").numeric_class


def test_bf16_is_another_numeric_class_with_almost_the_same_labels(write_function) -> None:
    path = write_function(seed=2)
    document = file_document("f", path)
    half = open_function(document.model_copy(update={"precision": "bf16"}), path)
    assert half.card.precision == "bf16"
    assert "-cpu-bf16-" in half.numeric_class
    (picture,) = pictures(1)
    # A requirement: the logits of random weights are close to each other, those of a trained network are not.
    assert (half.predict(picture) == open_function(document, path).predict(picture)).mean() > 0.9


def test_fp16_is_refused_on_a_processor(write_function) -> None:
    path = write_function()
    document = file_document("f", path).model_copy(update={"precision": "fp16"})
    with pytest.raises(MissingDependency, match="no fp16 on processors"):
        open_function(document, path, device="cpu")


@pytest.mark.parametrize("classes", [("person",), ("not", "person")])
def test_a_network_with_classes_of_its_own(tmp_path, classes: tuple[str, ...]) -> None:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(1)
        state = build_network("semantic-fpn-small", len(classes)).state_dict()
    data = save({name: value.numpy() for name, value in state.items() if not name.endswith("num_batches_tracked")})
    path = tmp_path / "own.safetensors"
    path.write_bytes(data)
    payload = {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data), "format": "safetensors"}
    fields = {"name": "own", "kind": "network", "architecture": "semantic-fpn-small", "input": {"multiple_of": 32}}
    labels = {}
    for engine in ("torch", "onnxruntime"):
        document = parse_function({**fields, "engine": engine, "output": {"classes": list(classes)}}, payload=payload)
        function = open_function(document, path)
        labels[engine] = function.predict(pictures(1)[0])
        function.close()
    assert set(np.unique(labels["torch"])) <= {11, 255}
    # A requirement: rounding may turn pixels on an edge.
    assert (labels["torch"] == labels["onnxruntime"]).mean() > 0.999
