"""Specimens of the shipped engines and functions: a class has one, and classes that are known to be alike agree."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from valerie.labels import PERSON
from valerie.perception.running.engines.processor import multiplies_bf16
from valerie.perception.shipped import FUNCTIONS
from valerie.pipeline.functions.probe import probe_engine, probe_function, probe_inference
from valerie.pipeline.functions.specimen_making import picture
from valerie.plugins import create_function
from valerie.runs.products.pins import BOUNDS, AnyOffer
from valerie.runs.products.specimens import agree, specimen_key
from valerie.testing.blank import BlankRenderer


@pytest.mark.parametrize("engine", ["raster", "pyrender", "blank"])
def test_an_engine_and_its_truth_pass_make_one_specimen_each_again_and_again(engine: str) -> None:
    first: dict[str, bytes] = {}
    again: dict[str, bytes] = {}
    offers = probe_engine(engine, first)
    probe_engine(engine, again)
    assert set(first) == {specimen_key(offer) for offer in offers}
    assert first == again
    assert all(60 <= len(data) < 12_000 for data in first.values())


def in_precision(
    monkeypatch: pytest.MonkeyPatch, function: str, precision: str, threads: int
) -> tuple[AnyOffer, bytes]:
    monkeypatch.setenv("VALERIE_INFER_PRECISION", precision)
    monkeypatch.setenv("VALERIE_INFER_THREADS", str(threads))
    specimens: dict[str, bytes] = {}
    (offer,) = probe_function(function, specimens)
    return offer, specimens[specimen_key(offer)]


@pytest.mark.parametrize("function", FUNCTIONS)
def test_threads_and_precisions_of_a_shipped_function_agree_and_its_other_weights_do_not(
    function: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, mine = in_precision(monkeypatch, function, "fp32", 1)
    in_bf16 = [("bf16", 1)] if multiplies_bf16() else []  # elsewhere OpenVINO refuses it
    for precision, threads in [("fp32", 4), *in_bf16]:
        offer, theirs = in_precision(monkeypatch, function, precision, threads)
        assert offer.numeric_class != model.numeric_class
        stored = {specimen_key(model): mine, specimen_key(offer): theirs}
        assert agree(model, offer, stored, BOUNDS), (precision, threads)
    (other,) = (name for name in FUNCTIONS if name != function)
    strange, theirs = in_precision(monkeypatch, other, "fp32", 4)
    as_ours = strange.model_copy(update={"digest": getattr(model, "digest", ""), "name": function})
    assert not agree(model, as_ours, {specimen_key(model): mine, specimen_key(as_ours): theirs}, BOUNDS)


@pytest.mark.parametrize("function", FUNCTIONS)
def test_the_picture_shows_a_person_to_the_shipped_functions(function: str) -> None:
    assert (create_function(function).predict(picture()) == PERSON.train_id).sum() > 200


def test_inference_engines_make_a_specimen_and_http_functions_none(monkeypatch: pytest.MonkeyPatch) -> None:
    specimens: dict[str, bytes] = {}
    (offer,) = probe_inference("onnxruntime/fp32", specimens)
    assert set(specimens) == {specimen_key(offer)}
    monkeypatch.setenv("VALERIE_HTTP_FUNCTIONS", "127.0.0.1:1")
    (http,) = probe_inference("http", specimens)
    assert specimen_key(http) not in specimens


#: Probe a function that openvino runs; print what is new to the stored keys, and whether torch was loaded.
PROBE = """
import json, sys
from valerie.pipeline.functions.probe import probe_function
from valerie.runs.products.specimens import specimen_key
stored = dict.fromkeys(sys.argv[1:], b"")
(offer,) = probe_function("semantic-fpn-small", stored)
print(json.dumps([specimen_key(offer), sorted(stored.keys() - set(sys.argv[1:])), "torch" in sys.modules]))
"""


def test_a_worker_whose_specimen_is_stored_starts_without_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALERIE_INFER_DEVICE", "cpu")

    def probed(*stored: str) -> tuple[str, list[str], bool]:
        command = [sys.executable, "-c", PROBE, *stored]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        key, new, torch = json.loads(done.stdout)
        return key, new, torch

    key, new, torch = probed()
    assert (new, torch) == ([key], True)
    assert probed(key) == (key, [], False)


def test_an_engine_that_cannot_make_a_specimen_is_offered_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no picture")

    monkeypatch.setattr("valerie.testing.blank.BlankRenderer.full", broken)
    specimens: dict[str, bytes] = {}
    engine, truth = probe_engine("blank", specimens)
    assert set(specimens) == {specimen_key(truth)}
    assert engine.name == "blank"


def test_a_path_tracer_makes_no_picture_when_a_worker_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object) -> None:
        raise AssertionError("a picture")

    monkeypatch.setattr("valerie.plugins.create_renderer", lambda _: BlankRenderer())
    monkeypatch.setattr("valerie.testing.blank.BlankRenderer.full", forbidden)
    specimens: dict[str, bytes] = {}
    engine, truth = probe_engine("cycles", specimens)
    assert (engine.name, set(specimens)) == ("cycles", {specimen_key(truth)})
