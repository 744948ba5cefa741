"""The engine of a registered function: the fastest that agrees with the reference."""

import numpy as np
import pytest

from valerie.perception.running import choice
from valerie.perception.running.engines.openvino_engine import OpenVinoEngine
from valerie.perception.shipped import FUNCTIONS, file_document, function_path


def differing(by: float):
    """A copy of OpenVINO's engine whose logits are off by so much."""

    class Differing(OpenVinoEngine):
        def answer(self, piece):
            return super().answer(piece) + np.float32(by)

    return Differing


@pytest.mark.parametrize("name", FUNCTIONS)
def test_an_engine_whose_logits_agree_is_taken_and_the_reason_is_on_the_card(name: str) -> None:
    path = function_path(name)
    document = choice.agreeing_choice(file_document(name, path), path).applied(file_document(name, path))
    assert (document.engine, document.precision) == ("openvino", "fp32")
    reason = "openvino, the fastest whose logits agree with torch to 0.001"
    assert document.card().provenance["engine chosen"] == reason


def test_an_engine_whose_logits_differ_by_more_is_not(write_function, monkeypatch) -> None:
    path = write_function("semantic-fpn-small")
    monkeypatch.setattr("valerie.perception.running.engines.openvino_engine.OpenVinoEngine", differing(0.01))
    chosen = choice.agreeing_choice(file_document("f", path), path)
    assert chosen.engine == "onnxruntime"


def test_the_reference_remains_where_no_other_agrees(write_onnx, monkeypatch) -> None:
    document, path = write_onnx({})
    assert choice.agreeing_choice(document, path).engine == "openvino"
    monkeypatch.setattr("valerie.perception.running.engines.openvino_engine.OpenVinoEngine", differing(0.01))
    chosen = choice.agreeing_choice(document, path)
    assert chosen == ("onnxruntime", "fp32", "onnxruntime, the reference: openvino differs from it by more than 0.001")


def test_an_engine_that_is_missing_is_left_out_with_its_reason(write_onnx, monkeypatch) -> None:
    document, path = write_onnx({})
    monkeypatch.setitem(__import__("sys").modules, "valerie.perception.running.engines.openvino_engine", None)
    chosen = choice.agreeing_choice(document, path)
    assert chosen.engine == "onnxruntime"
    assert "openvino does not run it here" in chosen.reason


def test_a_graphics_card_runs_networks_in_torch_and_the_card_says_so(write_function, monkeypatch) -> None:
    path = write_function("semantic-fpn-small")
    monkeypatch.setattr(choice, "uses_gpu", lambda device: device == "cuda")
    chosen = choice.agreeing_choice(file_document("f", path), path, device="cuda")
    assert chosen == ("torch", "fp32", "torch uses the graphics card")


def test_onnx_files_are_compared_beside_a_graphics_card_too(write_onnx, monkeypatch) -> None:
    document, path = write_onnx({})
    monkeypatch.setattr(choice, "uses_gpu", lambda _: True)
    assert choice.agreeing_choice(document, path, device="cuda").engine == "openvino"
