from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
from opentelemetry.proto.trace.v1.trace_pb2 import Span, Status

from tests.world.blank import Pipeline
from valerie.errors import InvalidInput, TransientError
from valerie.settings import load_settings


class Collector(ThreadingHTTPServer):
    """A collector of traces on this machine."""

    def __init__(self) -> None:
        spans: list[Span] = []

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                for resource in ExportTraceServiceRequest.FromString(body).resource_spans:
                    spans.extend(span for scope in resource.scope_spans for span in scope.spans)
                self.send_response(200)
                self.end_headers()

            def log_message(self, *_: object) -> None:
                pass

        super().__init__(("127.0.0.1", 0), Handler)
        self.spans = spans

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/v1/traces"


@pytest.fixture
def collector() -> Iterator[Collector]:
    with Collector() as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def attribute(span: Span, name: str) -> str:
    return next(item.value.string_value for item in span.attributes if item.key == f"valerie.{name}")


def traced(pipelines: Callable[..., Pipeline], collector: Collector, **settings: object) -> Pipeline:
    return pipelines(traces_url=collector.url, **settings)


def test_each_frame_has_one_trace_over_all_queues(pipelines: Callable[..., Pipeline], collector: Collector) -> None:
    pipeline = traced(pipelines, collector)
    run_id = pipeline.submit()
    assert pipeline.run(run_id) == "completed"
    pipeline.context.traces.close()
    traces = defaultdict(list)
    for span in collector.spans:
        traces[span.trace_id].append(span)
    assert len(traces) == 24
    for spans in traces.values():
        (root,) = [span for span in spans if not span.parent_span_id]
        assert root.name == "frame"
        assert attribute(root, "run") == run_id
        assert {attribute(span, "frame") for span in spans} == {attribute(root, "frame")}
        products = [span for span in spans if span is not root]
        assert all(span.parent_span_id == root.span_id for span in products)
        assert all(
            root.start_time_unix_nano <= span.start_time_unix_nano <= span.end_time_unix_nano for span in products
        )
        assert {"layer", "truth", "prediction", "evaluation"} <= {span.name for span in products}
    digests = [attribute(span, "product") for span in collector.spans if span.name != "frame"]
    assert sorted(digests) == sorted(digest for maker in pipeline.makers.values() for _, digest in maker.made)


def test_a_failed_attempt_is_an_error(pipelines: Callable[..., Pipeline], collector: Collector) -> None:
    pipeline = traced(pipelines, collector)
    failures = []

    def fail_once(job: object) -> None:
        if not failures:
            failures.append(job)
            raise TransientError("lost")

    pipeline.makers["infer"].before = fail_once  # type: ignore[index]
    pipeline.run(pipeline.submit())
    pipeline.context.traces.close()
    wrong = [span for span in collector.spans if span.status.code == Status.STATUS_CODE_ERROR]
    assert [attribute(span, "product") for span in wrong] == [failures[0].digest]  # type: ignore[attr-defined]


def test_all_processes_trace_the_same_share_of_the_frames(
    pipelines: Callable[..., Pipeline], collector: Collector
) -> None:
    pipeline = traced(pipelines, collector, traces_share=0.5)
    pipeline.run(pipeline.submit())
    pipeline.context.traces.close()
    frames = {attribute(span, "frame") for span in collector.spans if span.name == "frame"}
    assert 0 < len(frames) < 24
    assert {attribute(span, "frame") for span in collector.spans} == frames


def test_an_address_that_is_none_is_refused() -> None:
    with pytest.raises(InvalidInput, match="VALERIE_TRACES_URL"):
        load_settings({}, traces_url="collector:4318")
