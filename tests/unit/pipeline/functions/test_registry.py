"""Registered functions: written once, found by name and digest, kept while a run needs them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.world.blank import SMALL, Pipeline
from valerie.db import functions
from valerie.db.engine import reading, writing
from valerie.db.functions import FunctionRow
from valerie.errors import Conflict, InvalidInput, NotFound, UnknownName
from valerie.perception.documents.function import FunctionDocument, parse_function
from valerie.perception.running.engine_function import EngineFunction
from valerie.perception.running.small_network import small_onnx
from valerie.pipeline.control import gc, lifecycle
from valerie.pipeline.functions import registry
from valerie.pipeline.functions.catalog import function as catalogued
from valerie.pipeline.functions.probe import probe_engine, probe_function, probe_inference
from valerie.pipeline.functions.references import open_pinned, open_reference
from valerie.pipeline.retraining.dataset_evaluation import run_side
from valerie.pipeline.work.replay import replay_frame
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pins import AnyOffer
from valerie.storage.keys import FUNCTIONS, function_key

CLASS = "onnxruntime/fp32"


@pytest.fixture(scope="session")
def engine_offer() -> AnyOffer:
    (offer,) = probe_inference(CLASS)
    return offer


@pytest.fixture
def served(pipeline: Pipeline, engine_offer: AnyOffer) -> Pipeline:
    """A worker that offers the blank engine, the blank function and one inference engine, before anything is registered."""
    pipeline.offer("w", *probe_engine("blank"), *probe_function("blank"), engine_offer)
    return pipeline


def register(pipeline: Pipeline, folder: Path, **entries: Any) -> FunctionRow:
    document, payload = small_onnx(folder, engine="onnxruntime", **entries)
    return registry.register(pipeline.context, document, payload)[0]


def found(pipeline: Pipeline, reference: str) -> FunctionRow:
    with reading(pipeline.context.engine) as connection:
        return registry.find(connection, reference)


def named(*references: str) -> dict[str, Any]:
    return {**SMALL, "functions": list(references)}


class TestTheRegistry:
    def test_the_same_document_again_is_the_same_version(self, pipeline: Pipeline, tmp_path: Path) -> None:
        document, payload = small_onnx(tmp_path)
        first, new = registry.register(pipeline.context, document, payload)
        again, new_again = registry.register(pipeline.context, document, payload)
        assert (new, new_again) == (True, False)
        assert again == first
        assert first.version == 1

    def test_a_function_that_cannot_say_person_is_not_registered(self, pipeline: Pipeline, tmp_path: Path) -> None:
        mute = {"classes": ["road", "human"], "class_map": {"human": "void"}}
        with pytest.raises(
            InvalidInput, match=r"output\.class_map: no class of the function is a person.*human: person"
        ):
            register(pipeline, tmp_path, output=mute)
        with reading(pipeline.context.engine) as connection:
            assert functions.every(connection) == []

    def test_another_document_is_the_next_version_and_both_stay(self, pipeline: Pipeline, tmp_path: Path) -> None:
        first = register(pipeline, tmp_path)
        second = register(pipeline, tmp_path, provenance={"trained": "longer"})
        assert (first.version, second.version) == (1, 2)
        assert found(pipeline, "small") == second
        assert found(pipeline, first.reference) == first

    def test_two_names_share_one_file(self, pipeline: Pipeline, tmp_path: Path) -> None:
        one, two = register(pipeline, tmp_path), register(pipeline, tmp_path, name="other")
        assert one.digest == two.digest
        assert len(list(pipeline.context.store.list(FUNCTIONS))) == 1
        registry.remove(pipeline.context, one.reference)
        assert registry.read_payload(pipeline.context, two.document)
        registry.remove(pipeline.context, two.reference)
        assert not list(pipeline.context.store.list(FUNCTIONS))

    def test_names_of_installed_functions_cannot_be_taken(self, pipeline: Pipeline, tmp_path: Path) -> None:
        for name in ("semantic-fpn-small", "blank"):
            with pytest.raises(Conflict, match=f"the name '{name}' belongs to"):
                register(pipeline, tmp_path, name=name)

    def test_a_file_that_the_document_does_not_name_is_refused(self, pipeline: Pipeline, tmp_path: Path) -> None:
        document, payload = small_onnx(tmp_path)
        payload.write_bytes(payload.read_bytes() + b"\0")
        with pytest.raises(InvalidInput, match=r"payload\.sha256: not the file that the document names"):
            registry.register(pipeline.context, document, payload)
        assert not list(pipeline.context.store.list(FUNCTIONS))

    def test_an_unknown_name_comes_with_near_matches(self, pipeline: Pipeline, tmp_path: Path) -> None:
        register(pipeline, tmp_path, name="street-net")
        with pytest.raises(UnknownName, match="did you mean street-net"):
            found(pipeline, "stret-net")
        with pytest.raises(InvalidInput, match="unknown function 'stret-net'; did you mean street-net"):
            pipeline.submit(named("stret-net"))

    @pytest.mark.parametrize("prefix", ["", "12", "xyzxyz", "ABCDEF", "0" * 33])
    def test_a_malformed_digest_is_refused(self, pipeline: Pipeline, tmp_path: Path, prefix: str) -> None:
        register(pipeline, tmp_path)
        with pytest.raises(InvalidInput, match="not the first characters of a digest"):
            found(pipeline, f"small@{prefix}")

    def test_a_digest_that_no_version_has_is_not_found(self, pipeline: Pipeline, tmp_path: Path) -> None:
        register(pipeline, tmp_path)
        with pytest.raises(NotFound, match="there is no version of the function small@000000"):
            found(pipeline, "small@000000")

    def test_garbage_collection_keeps_registered_functions(self, pipeline: Pipeline, tmp_path: Path) -> None:
        kept = register(pipeline, tmp_path)
        pipeline.context.store.put(function_key("0" * 64, "onnx"), b"of an upload that was cut off")
        assert gc.collect(pipeline.context).objects == 0
        assert gc.collect(pipeline.context, now=datetime.now(UTC) + timedelta(days=1)).objects == 1
        assert registry.read_payload(pipeline.context, kept.document)


class TestARun:
    def test_pins_the_newest_version_and_ends_with_its_results(self, served: Pipeline, tmp_path: Path) -> None:
        register(served, tmp_path)
        newest = register(served, tmp_path, provenance={"trained": "longer"})
        run = served.submit(named("small"))
        assert served.run(run) == "completed"
        pin = served.row(run).pins.functions["small"]
        assert (pin.digest, pin.kind) == (newest.digest, "onnx")
        assert pin.numeric_class.startswith("onnxruntime-")
        assert pin.card.name == "small"
        assert [product.verdict for product in replay_frame(served.context, FrameKey(run, 0, 1))] == ["equal"] * 5

    def test_keeps_its_version_when_a_newer_one_comes(self, served: Pipeline, tmp_path: Path) -> None:
        first = register(served, tmp_path)
        run = served.submit(named("small"))
        served.step()
        register(served, tmp_path, provenance={"trained": "longer"})
        assert served.run(run) == "completed"
        assert served.row(run).pins.functions["small"].digest == first.digest

    def test_compares_two_versions_of_one_name(self, served: Pipeline, tmp_path: Path) -> None:
        one, two = register(served, tmp_path), register(served, tmp_path, input={"mean": [0.4, 0.4, 0.4]})
        run = served.submit(named(one.reference, two.reference))
        assert served.run(run) == "completed"
        assert served.made()["prediction"] == 2 * 24

    def test_that_adds_a_function_only_infers(self, served: Pipeline, tmp_path: Path) -> None:
        served.run(served.submit())
        served.made()
        register(served, tmp_path)
        assert served.run(served.submit(named("blank", "small"))) == "completed"
        assert served.made() == {"prediction": 24, "evaluation": 24}

    def test_waits_for_a_worker_with_the_engine_and_says_so(self, served: Pipeline, tmp_path: Path) -> None:
        document, payload = small_onnx(tmp_path, precision="bf16")
        registry.register(served.context, document, payload)
        run = served.submit(named("small"))
        served.step()
        assert "waiting for an inference worker with openvino/bf16 (for the function 'small')" in served.row(run).reason

    def test_of_a_function_that_was_removed_before_it_started_fails(self, pipeline: Pipeline, tmp_path: Path) -> None:
        version = register(pipeline, tmp_path)
        run = pipeline.submit(named("small"))
        pipeline.step()
        assert pipeline.state(run) == "submitted"
        with pytest.raises(Conflict, match=run):
            registry.remove(pipeline.context, version.reference)
        with writing(pipeline.context.engine) as connection:  # as when both happened at the same time
            functions.remove(connection, "small", version.digest)
        assert pipeline.run(run) == "failed"
        assert "unknown registered function 'small'" in pipeline.row(run).reason

    def test_that_is_retried_after_its_version_was_removed_has_recorded_failures(
        self, served: Pipeline, tmp_path: Path
    ) -> None:
        version = register(served, tmp_path)
        run = served.submit(named("small"))
        served.step()
        with pytest.raises(Conflict, match=f"is needed by runs that have not ended: {run}"):
            registry.remove(served.context, version.reference)
        lifecycle.cancel(served.context, run)
        registry.remove(served.context, version.reference)
        lifecycle.resume(served.context, run)
        assert served.run(run) == "completed-with-failures"
        failed = [product for product in served.products() if product.kind == "prediction"]
        assert {product.state for product in failed} == {"failed"}
        assert all("it was removed" in product.error.message for product in failed)

    def test_is_served_although_the_copy_on_this_machine_is_damaged(self, served: Pipeline, tmp_path: Path) -> None:
        version = register(served, tmp_path)
        payload = version.document.payload
        assert payload is not None
        copy = served.settings.data_dir / "functions" / f"{payload.sha256}.onnx"
        copy.parent.mkdir()
        copy.write_bytes(b"\0" * payload.bytes)
        assert served.run(served.submit(named("small"))) == "completed"

    def test_of_a_damaged_store_fails_with_the_reason(self, served: Pipeline, tmp_path: Path) -> None:
        version = register(served, tmp_path)
        (key,) = [info.key for info in served.context.store.list(FUNCTIONS)]
        assert version.document.payload is not None
        served.context.store.put(key, b"\0" * version.document.payload.bytes, replace=True)
        run = served.submit(named("small"))
        assert served.run(run) == "completed-with-failures"
        error = next(product.error for product in served.products() if product.kind == "prediction")
        assert error.type == "CorruptArtifact"


def test_removing_needs_a_digest(pipeline: Pipeline, tmp_path: Path) -> None:
    register(pipeline, tmp_path)
    with pytest.raises(InvalidInput, match="does not identify a version"):
        registry.remove(pipeline.context, "small")


def test_the_catalog_shows_the_classes_and_the_workers_of_a_function(served: Pipeline, tmp_path: Path) -> None:
    version = register(served, tmp_path, output={"classes": ["street", "person"], "class_map": {"street": "void"}})
    shown = catalogued(served.context, "small")
    assert shown.classes == ("person",)
    assert shown.unmapped == ("street",)
    assert shown.judged_by == ("person",)
    assert len(shown.numeric_classes) == 1
    assert FunctionDocument.model_validate(shown.document) == version.document


def test_documents_without_a_file_are_registered_too(pipeline: Pipeline) -> None:
    text = "name: elsewhere\nkind: http\noptions: {url: 'http://models.example:8000/predict'}"
    version, new = registry.register(pipeline.context, parse_function(text), None)
    assert new
    with pytest.raises(NotFound, match="file of the function"):
        registry.read_payload(pipeline.context, version.document)


def test_a_registered_function_is_opened_by_its_name_for_other_uses(pipeline: Pipeline, tmp_path: Path) -> None:
    version = register(pipeline, tmp_path)
    function = open_reference(version.reference, context=pipeline.context)
    labels = function.predict(np.full((8, 8, 3), 20, np.uint8))
    assert set(np.unique(labels).tolist()) == {11}, "dark pixels are persons"
    with pytest.raises(UnknownName, match="unknown function 'smal'; did you mean small"):
        open_reference("smal", context=pipeline.context)


class TestBesideARun:
    """A data set that is evaluated beside a run is predicted by the functions that the run pinned."""

    def test_the_version_that_the_run_saw_is_opened_and_not_the_newest(self, served: Pipeline, tmp_path: Path) -> None:
        first = register(served, tmp_path)
        run = served.submit(named("small"))
        assert served.run(run) == "completed"
        newest = register(served, tmp_path, provenance={"trained": "longer"})
        side = run_side(served.context, run, "small")
        with closing(open_pinned(side.called, side.pin, context=served.context)) as function:
            assert function.card.digest == first.digest != newest.digest
            assert function.numeric_class == side.pin.numeric_class
        assert run_side(served.context, run, first.reference).called == "small"
        with pytest.raises(UnknownName, match="unknown function of the run"):
            run_side(served.context, run, newest.reference)

    def test_another_numeric_class_is_refused(self, served: Pipeline, tmp_path: Path) -> None:
        register(served, tmp_path)
        run = served.submit(named("small"))
        assert served.run(run) == "completed"
        side = run_side(served.context, run, "small")
        threads = served.settings.inference_threads + 1
        with pytest.raises(Conflict, match=rf"runs as .*-t{threads} here; the run pinned .* of the same numeric class"):
            open_pinned(side.called, side.pin, context=served.context, threads=threads)

    def test_another_revision_is_refused(
        self, served: Pipeline, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        register(served, tmp_path)
        run = served.submit(named("small"))
        assert served.run(run) == "completed"
        side = run_side(served.context, run, "small")
        monkeypatch.setattr(EngineFunction, "revision", EngineFunction.revision + 1)
        with pytest.raises(Conflict, match=f"is in revision {EngineFunction.revision} here; the run pinned"):
            open_pinned(side.called, side.pin, context=served.context)

    def test_a_removed_version_is_named(self, served: Pipeline, tmp_path: Path) -> None:
        version = register(served, tmp_path)
        run = served.submit(named("small"))
        assert served.run(run) == "completed"
        registry.remove(served.context, version.reference)
        side = run_side(served.context, run, "small")
        with pytest.raises(NotFound, match="it was removed"):
            open_pinned(side.called, side.pin, context=served.context)

    def test_a_run_that_has_not_started_has_no_pinned_functions(self, pipelines: Callable[..., Pipeline]) -> None:
        pipeline = pipelines(workers=False)
        run = pipeline.submit()
        with pytest.raises(Conflict, match="has not started yet"):
            run_side(pipeline.context, run, "blank")
