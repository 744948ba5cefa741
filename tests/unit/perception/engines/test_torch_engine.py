from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from valerie.errors import InferenceError, InvalidInput
from valerie.perception.base import PerceptionFunction
from valerie.perception.catalog import file_document
from valerie.perception.functions import open_function
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
def test_something_that_is_no_picture_is_refused(write_function, shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInput, match="not a picture"):
        opened(write_function()).predict(np.zeros(shape, np.uint8))


def test_a_failure_inside_torch_becomes_an_inference_error(write_function, monkeypatch) -> None:
    function = opened(write_function())

    def fail(_: torch.Tensor) -> torch.Tensor:
        raise RuntimeError("could not allocate")

    monkeypatch.setattr(function._engine._module, "forward", fail)
    with pytest.raises(InferenceError, match=r"f: torch failed.*could not allocate"):
        function.predict(np.zeros((8, 8, 3), np.uint8))
