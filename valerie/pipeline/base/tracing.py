"""OpenTelemetry traces: one for each frame, from the control loop that feeds it to the worker that evaluates it.

Ids follow from names. The root span of a frame has ids made of the frame's id, so that each process knows the parent of its
spans, and messages carry none.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable
from contextvars import ContextVar
from typing import TYPE_CHECKING, Final

from valerie.errors import MissingDependency
from valerie.runs.products.frame_keys import FrameKey
from valerie.settings import Settings

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import SpanProcessor, TracerProvider

    from valerie.db.claiming import Job
from valerie.db.publishing import Finished

#: Time that a process collects spans before it sends them, milliseconds. A process that is killed loses them.
_COLLECTED_MS: Final = 1_000
#: Trace id and span id of the root span that is being started.
_ROOT: ContextVar[tuple[int, int] | None] = ContextVar("root", default=None)


class Traces:
    """Writes the spans of frames and products; nothing without a provider.

    Args:
        provider: from `provider_with`.
    """

    def __init__(self, provider: TracerProvider | None = None) -> None:
        self._provider = provider
        self._tracer = None if provider is None else provider.get_tracer("valerie")

    def frames(self, frames: Iterable[FrameKey]) -> None:
        """Write the root spans of frames that were fed."""
        if self._tracer is None:
            return
        for frame in frames:
            _ROOT.set(_ids(frame))
            self._tracer.start_span(
                "frame", attributes={"valerie.run": frame.run_id, "valerie.frame": str(frame)}
            ).end()
        _ROOT.set(None)

    def product(self, job: Job, began_ns: int, finished: Finished | None) -> None:
        """Write the span of an attempt, which ends now. A product of several frames is in the trace of one of them.

        Args:
            job: the claimed product.
            began_ns: Unix nanoseconds.
            finished: None if the attempt failed.
        """
        if self._tracer is None:
            return
        from opentelemetry.trace import (
            NonRecordingSpan,
            SpanContext,
            Status,
            StatusCode,
            TraceFlags,
            set_span_in_context,
        )

        trace_id, span_id = _ids(job.frame.key)
        root = SpanContext(trace_id, span_id, is_remote=True, trace_flags=TraceFlags(TraceFlags.SAMPLED))
        span = self._tracer.start_span(
            job.kind.value,
            context=set_span_in_context(NonRecordingSpan(root)),
            start_time=began_ns,
            attributes={
                "valerie.run": job.frame.key.run_id,
                "valerie.frame": str(job.frame.key),
                "valerie.product": job.digest,
                "valerie.attempt": job.attempts,
            },
        )
        if finished is None:
            span.set_status(Status(StatusCode.ERROR, "see the worker's log of this product"))
        else:
            span.set_attributes({"valerie.bytes": finished.bytes, "valerie.cpu_seconds": finished.cpu_seconds})
        span.end(time.time_ns())

    def close(self) -> None:
        """Send the collected spans."""
        if self._provider is not None:
            self._provider.shutdown()


def open_traces(settings: Settings, process: str) -> Traces:
    """Return the traces that ``settings`` ask for.

    Args:
        settings: settings of the deployment.
        process: unique name of this process.

    Raises:
        MissingDependency: they ask for traces, and OpenTelemetry is not installed.
    """
    if not settings.traces_url:
        return Traces()
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError as error:
        raise MissingDependency(
            f"VALERIE_TRACES_URL needs OpenTelemetry ({error}): pip install 'valerie[traces]'"
        ) from error
    exporter = OTLPSpanExporter(endpoint=settings.traces_url)
    processor = BatchSpanProcessor(exporter, schedule_delay_millis=_COLLECTED_MS)
    return Traces(provider_with(processor, share=settings.traces_share, process=process))


def provider_with(processor: SpanProcessor, *, share: float, process: str) -> TracerProvider:
    """Return a provider of tracers.

    Args:
        processor: receives the spans.
        share: share of the frames that are traced, 0 … 1; all processes choose the same.
        process: unique name of this process.
    """
    from opentelemetry.sdk.resources import Resource
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.id_generator import RandomIdGenerator
    from opentelemetry.sdk.trace.sampling import TraceIdRatioBased

    class Ids(RandomIdGenerator):
        """Random ids, but for the root span of a frame."""

        def generate_trace_id(self) -> int:
            root = _ROOT.get()
            return super().generate_trace_id() if root is None else root[0]

        def generate_span_id(self) -> int:
            root = _ROOT.get()
            return super().generate_span_id() if root is None else root[1]

    resource = Resource.create({"service.name": "valerie", "service.instance.id": process})
    provider = TracerProvider(sampler=TraceIdRatioBased(share), resource=resource, id_generator=Ids())
    provider.add_span_processor(processor)
    return provider


def _ids(frame: FrameKey) -> tuple[int, int]:
    """Return the trace id (16 bytes) of a frame and the span id (8 bytes) of its root."""
    digest = hashlib.sha256(str(frame).encode()).digest()
    return int.from_bytes(digest[:16]), int.from_bytes(digest[16:24])
