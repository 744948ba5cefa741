"""Bounds around functions under test: the same for every way of opening one, and lifted when it is closed."""

from __future__ import annotations

import resource
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.pipeline.test_batches import Batches
from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.errors import InferenceError, TransientError
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import parse_function
from valerie.perception.running.opening import open_function
from valerie.perception.running.small_network import small_onnx
from valerie.pipeline.functions import bounded, registry
from valerie.pipeline.functions.bounded import open_bounded
from valerie.pipeline.functions.references import open_pinned, open_reference
from valerie.settings import Settings, load_settings
from valerie.testing.blank import BlankFunction

#: Far more than the process of the tests needs.
MANY_MB = 300_000
PICTURE = np.zeros((8, 8, 3), np.uint8)


def memory_limit() -> int:
    return resource.getrlimit(resource.RLIMIT_DATA)[0]


def settings(**values: object) -> Settings:
    return load_settings({}, **{"infer_memory_mb": MANY_MB, **values})


class Hungry(BlankFunction):
    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        raise MemoryError("Unable to allocate 6.00 GiB")


class TestMemory:
    def test_is_bounded_from_opening_to_closing(self) -> None:
        before, within = memory_limit(), []

        def opening() -> PerceptionFunction:
            within.append(memory_limit())
            return BlankFunction()

        function = open_bounded(opening, settings(), name="blank")
        within.append(memory_limit())
        function.close()
        assert within == [MANY_MB << 20] * 2
        assert memory_limit() == before

    def test_is_free_again_if_opening_fails(self) -> None:
        before = memory_limit()

        def opening() -> PerceptionFunction:
            raise InferenceError("damaged")

        with pytest.raises(InferenceError, match="damaged"):
            open_bounded(opening, settings(), name="f")
        assert memory_limit() == before

    def test_an_allocation_that_fails_names_the_limit(self) -> None:
        function = open_bounded(Hungry, settings(), name="hungry")
        message = "hungry needs more memory than it may have: Unable to allocate 6.00 GiB; limit: 300000 MB"
        with pytest.raises(TransientError, match=message):
            function.predict(PICTURE)

    @pytest.mark.parametrize("reference", ["blank", "small"])
    def test_is_bounded_in_commands(self, pipelines: Callable[..., Pipeline], tmp_path: Path, reference: str) -> None:
        pipeline = pipelines(infer_memory_mb=MANY_MB)
        registry.register(pipeline.context, *small_onnx(tmp_path, engine="onnxruntime"))
        before = memory_limit()
        function = open_reference(reference, context=pipeline.context)
        assert memory_limit() == MANY_MB << 20
        function.close()
        assert memory_limit() == before

    def test_is_bounded_in_workers_and_for_what_a_run_pinned(self, pipelines: Callable[..., Pipeline]) -> None:
        before = memory_limit()
        pipeline = pipelines(infer_memory_mb=MANY_MB)
        run_id = pipeline.submit(spec(xs=1, ys=1))
        assert pipeline.run(run_id) == "completed"
        assert memory_limit() == MANY_MB << 20
        resource.setrlimit(resource.RLIMIT_DATA, (before, resource.getrlimit(resource.RLIMIT_DATA)[1]))
        open_pinned("blank", pipeline.row(run_id).pins.functions["blank"], context=pipeline.context)
        assert memory_limit() == MANY_MB << 20


class TestTime:
    @pytest.fixture
    def limits(self, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, float]]:
        """(what, seconds) of every limit that was set; none of them ends anything."""
        calls: list[tuple[str, float]] = []

        @contextmanager
        def note(seconds: float, *, what: str, before_end: object) -> Iterator[None]:
            calls.append((what, seconds))
            yield

        monkeypatch.setattr(bounded, "time_limit", note)
        return calls

    def test_is_bounded_for_opening_each_picture_and_several_together(self, limits: list[tuple[str, float]]) -> None:
        function = open_bounded(Batches, settings(infer_seconds=7), name="f")
        function.predict(PICTURE)
        function.predict_many([PICTURE] * 3)
        assert limits == [("opening f", 7), ("f", 7), ("f", 21)]

    def test_of_pictures_that_a_function_takes_one_by_one_is_bounded_for_each(
        self, limits: list[tuple[str, float]]
    ) -> None:
        function = open_bounded(BlankFunction, settings(infer_seconds=7), name="f")
        assert function.batch_size == 1
        assert len(function.predict_many([PICTURE] * 2)) == 2
        assert limits[1:] == [("f", 7)] * 2

    def test_of_an_endpoint_is_bounded_by_its_own_time_out(self, limits: list[tuple[str, float]]) -> None:
        text = "{name: remote, kind: http, options: {url: 'http://127.0.0.1:1/', timeout_s: 5}}"
        allowed = ("127.0.0.1",)
        function = open_bounded(
            lambda: open_function(parse_function(text), None, addresses=allowed), settings(), name="remote"
        )
        with pytest.raises(InferenceError, match="ConnectionRefusedError"):
            function.predict(PICTURE)
        assert limits == [("opening remote", 600), ("remote", 0)]

    def test_is_bounded_in_commands(self, pipelines: Callable[..., Pipeline], limits: list[tuple[str, float]]) -> None:
        pipeline = pipelines(infer_seconds=9)
        open_reference("blank", context=pipeline.context).predict(PICTURE)
        assert limits == [("opening blank", 9), ("blank", 9)]

    def test_is_bounded_in_workers(self, pipelines: Callable[..., Pipeline], limits: list[tuple[str, float]]) -> None:
        pipeline = pipelines(infer_seconds=9)
        assert pipeline.run(pipeline.submit(spec(xs=1, ys=1))) == "completed"
        assert limits == [("opening blank", 9)] + [("blank", 9)] * 2


ENDLESS = """
import time
from valerie.pipeline.functions.bounded import open_bounded
from valerie.settings import load_settings
from valerie.testing.blank import BlankFunction

class Endless(BlankFunction):
    def predict(self, picture):
        time.sleep(60)

settings = load_settings({}, infer_seconds=0.3)
function = open_bounded(Endless, settings, name="endless", before_end=lambda reason: print("kept:", reason, flush=True))
function.predict(None)
"""


def test_work_that_takes_too_long_ends_its_process_after_the_reason_was_recorded() -> None:
    done = subprocess.run([sys.executable, "-c", ENDLESS], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (124, "kept: endless took longer than 0.3 s\n")
    assert done.stderr == "valerie: endless took longer than 0.3 s\n"


def test_a_bounded_function_answers_as_the_function_itself() -> None:
    inner = BlankFunction()
    function = open_bounded(lambda: inner, settings(), name="blank")
    assert (function.card, function.numeric_class, function.revision) == (inner.card, inner.numeric_class, 1)
    pictures: Sequence[NDArray[np.uint8]] = np.random.default_rng(0).integers(0, 256, (2, 8, 8, 3), np.uint8)
    np.testing.assert_array_equal(function.predict(pictures[0]), inner.predict(pictures[0]))
    np.testing.assert_array_equal(
        function.predict_many(list(pictures)), [inner.predict(picture) for picture in pictures]
    )
