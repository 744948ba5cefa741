"""Runs whose functions do not answer, ask for too much or take turns: every failure is counted, and nothing else is lost."""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from http.server import BaseHTTPRequestHandler
from typing import Any

import numpy as np
import orjson
import pytest
from numpy.typing import NDArray

from tests.unit.label_server import Server
from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.db import results
from valerie.db.claiming import Job
from valerie.db.engine import reading
from valerie.db.publishing import Finished
from valerie.perception.base import FunctionCard
from valerie.perception.documents.function import parse_function
from valerie.perception.running.label_png import encode_png
from valerie.pipeline.functions import registry
from valerie.pipeline.functions.loader import FunctionLoader
from valerie.runs.products.pins import Offer
from valerie.runs.products.states import Stage
from valerie.storage.keys import run_key
from valerie.testing.blank import BlankFunction

#: Two places, two cameras: 4 frames.
FOUR = spec(xs=2, ys=1)


HTTP = Offer(stage=Stage.INFER, name="http", numeric_class="http", revision=1, route="infer.http")


def failures(pipeline: Pipeline, run_id: str) -> list[results.FailedLink]:
    with reading(pipeline.context.engine) as connection:
        return results.failures(connection, run_id)


class TestAnEndpointThatDoesNotAnswerInTime:
    @pytest.fixture
    def server(self) -> Iterator[Server]:
        server = Server()
        yield server
        server.close()

    @pytest.fixture
    def run_with_a_timeout(self, server: Server, pipelines: Callable[..., Pipeline]) -> tuple[Pipeline, str]:
        """A finished run of which the endpoint left the second picture without an answer."""

        def answer(handler: BaseHTTPRequestHandler, picture: NDArray[np.uint8]) -> None:
            if len(server.requests) == 2:
                time.sleep(10)
                return
            server.send(handler, encode_png(np.zeros(picture.shape[:2], np.uint8)))

        server.answer = answer
        pipeline = pipelines(http_functions="127.0.0.0/8", max_attempts=3)
        text = {
            "name": "remote",
            "kind": "http",
            "options": {"url": server.url, "timeout_s": 2},
            "output": {"kind": "labels", "classes": ["road", "person"]},
        }
        registry.register(pipeline.context, parse_function(text), None)
        pipeline.offer("i", HTTP)
        run_id = pipeline.submit({**FOUR, "functions": ["remote", "blank"]})
        assert pipeline.run(run_id) == "completed-with-failures"
        return pipeline, run_id

    def test_is_a_counted_failure_with_its_reason_and_was_asked_once(
        self, run_with_a_timeout: tuple[Pipeline, str], server: Server
    ) -> None:
        pipeline, run_id = run_with_a_timeout
        assert len(server.requests) == 4, "each picture is sent once, answered or not"

        (lost,) = (link for link in failures(pipeline, run_id) if link.kind == "prediction")
        assert (lost.error.type, lost.error.attempts) == ("InferenceError", 1)
        assert lost.error.message.endswith(": no answer within 2 s")

        row = pipeline.row(run_id)
        assert row.reason.startswith("1 product failed for good;")
        assert row.progress.stages[Stage.INFER].failed == 1
        assert row.progress.stages[Stage.INFER].done == 7
        summary = orjson.loads(pipeline.context.store.get(run_key(run_id, "summary.json")))
        counted = {row["function"]: row["frames"] for row in summary["summary"]["rows"]}
        assert counted["remote"] == counted["blank"] - 1 == 3
        report = pipeline.context.store.get(run_key(run_id, "report.html")).decode()
        assert "no answer within 2 s" in report


class Noted(BlankFunction):
    """Records when it is opened and closed."""

    def __init__(self, name: str, book: list[str]) -> None:
        card = BlankFunction.card
        self.card = FunctionCard(name, card.digest, name, card.precision, card.engine, {})  # type: ignore[misc]
        self._book = book
        book.append(f"open {name}")

    def close(self) -> None:
        self._book.append(f"close {self.card.name}")


@pytest.mark.parametrize("count", [3, 6])
def test_the_last_networks_stay_open_and_all_are_forgotten_before_there_are_too_many(
    pipelines: Callable[..., Pipeline], monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    pipeline = pipelines(worker_max_memory_mb=65_536)  # the tests before this one may have left much in memory
    book: list[str] = []
    opened: list[weakref.ref[Noted]] = []

    def open_one(_: FunctionLoader, name: str, pin: Mapping[str, Any]) -> Noted:
        assert sum(call() is not None for call in opened) < 4, "closed ones still take memory"
        function = Noted(name, book)
        opened.append(weakref.ref(function))
        return function

    monkeypatch.setattr(FunctionLoader, "open", open_one)
    names = [f"f{number}" for number in range(count)]
    for name in names:
        text = f"{{name: {name}, kind: http, provenance: {{number: '{name}'}}, options: {{url: 'http://h:1/'}}}}"
        registry.register(pipeline.context, parse_function(text), None)
    pipeline.offer("i", HTTP)
    run_id = pipeline.submit({**FOUR, "functions": names})
    assert pipeline.run(run_id) == "completed"
    assert {entry.partition(" ")[2] for entry in book} == set(names)
    still_open: list[str] = []
    for entry in book:
        action, _, name = entry.partition(" ")
        if action == "open":
            still_open.append(name)
        else:
            assert name == still_open.pop(), "the newest is closed first"
        assert len(still_open) <= 4
    assert len(book) > count or count <= 4
    assert len(book) == count or count > 4, "each stays open"


class Ended(BaseException):
    """Stands for the end of the process."""


class Ending:
    """A maker whose process ends in the middle of one product, with a reason given before."""

    def __init__(self, maker: Any, victim: Callable[[Sequence[str]], str]) -> None:
        self._maker, self._choose = maker, victim
        self.victim = ""
        self._tell: Callable[[str], None] = lambda _: None

    def expect(self, jobs: Sequence[Job]) -> None:
        self.victim = self.victim or self._choose([job.digest for job in jobs])

    def before_end(self, tell: Callable[[str], None]) -> None:
        self._tell = tell

    def make(self, job: Job) -> Finished:
        if job.digest == self.victim:
            self._tell("f took longer than 2 s (VALERIE_INFER_SECONDS)")
            raise Ended
        finished: Finished = self._maker.make(job)
        return finished


def test_a_process_that_ends_over_one_picture_keeps_the_reason_and_costs_its_neighbours_nothing(
    pipeline: Pipeline,
) -> None:
    ending = Ending(pipeline.makers["infer"], lambda digests: digests[1])
    pipeline.makers["infer"] = ending  # type: ignore[assignment]
    run_id = pipeline.submit(FOUR)
    ends = 0
    while True:
        try:
            assert pipeline.run(run_id) == "completed-with-failures"
            break
        except Ended:
            ends += 1
    assert ends == 2, "as many as there are attempts"
    products = {product.digest: product for product in pipeline.products() if product.kind == "prediction"}
    failed = products.pop(ending.victim)
    assert (failed.state, failed.error.attempts) == ("failed", 2)
    assert failed.error.message == "f took longer than 2 s (VALERIE_INFER_SECONDS)"
    assert {(value.state, value.attempts) for value in products.values()} == {("done", 1)}
