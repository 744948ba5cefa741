"""A small client of the REST API for the command line, with typed answers and readable errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar
from urllib.parse import quote

import httpx
from pydantic import BaseModel, JsonValue, ValidationError

from valerie.answers import (
    Answer,
    Failure,
    Frame,
    Function,
    Mark,
    NextBatch,
    Progress,
    Quota,
    RegisteredFunction,
    Run,
    RunDetail,
    RunSummary,
    Study,
)
from valerie.errors import InvalidInput, TransientError, ValerieError
from valerie.runs.products.states import Priority

if TYPE_CHECKING:
    from valerie.runs.forecasting.plan import Plan


class ServerProblemError(ValerieError):
    """A problem that the server reported as an RFC 9457 document.

    Attributes:
        status: HTTP status.
        title: kind of error, e.g. ``Unknown name``.
        detail: message with field, value and limit.
    """

    def __init__(self, status: int, title: str, detail: str) -> None:
        self.status, self.title, self.detail = status, title, detail
        super().__init__(detail or title)

    @property
    def is_callers_fault(self) -> bool:
        """True if the request is at fault, not the server."""
        return 400 <= self.status < 500


class ServerUnavailableError(TransientError):
    """No server answers at the address, or the connection broke."""


Model = TypeVar("Model", bound=BaseModel)


class _Page(Answer):
    items: list[JsonValue]
    next: str | None


class _Uploaded(Answer):
    new: bool


class _Spec(Answer):
    annotations: tuple[str, ...]


class _RunWithSpec(Answer):
    spec: _Spec


class Client:
    """A connection to one server; a context manager.

    Every method may raise `ServerUnavailableError` and `ServerProblemError`.
    """

    def __init__(self, url: str, *, token: str | None = None, transport: httpx.BaseTransport | None = None) -> None:
        """Prepare the connection, which opens with the first request.

        Args:
            url: address of the server, e.g. ``http://127.0.0.1:8700``.
            token: bearer token, if the server requires one.
            transport: replaces the network, for tests.

        Raises:
            InvalidInput: ``url`` is not the address of a server.
        """
        self.url = _address(url)
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        timeout = httpx.Timeout(30.0, connect=5.0)
        # Requests to this machine must not go through a proxy from the environment.
        local = httpx.URL(self.url).host in ("127.0.0.1", "localhost", "::1")
        self._http = httpx.Client(
            base_url=self.url, headers=headers, timeout=timeout, transport=transport, trust_env=not local
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._http.close()

    def plan(self, spec: bytes) -> Plan:
        """Return the size and cost of a spec (YAML or JSON text)."""
        from valerie.runs.forecasting.plan import Plan

        return self._read(Plan, "POST", "/v1/plan", content=spec, headers=_SPEC)

    def submit(
        self,
        spec: bytes,
        *,
        idempotency_key: str | None = None,
        priority: Priority = Priority.NORMAL,
        deadline: datetime | None = None,
    ) -> Run:
        """Start a run of a spec (YAML or JSON text)."""
        headers = {**_SPEC, **({"Idempotency-Key": idempotency_key} if idempotency_key else {})}
        query = {"priority": priority.value} | ({"deadline": deadline.isoformat()} if deadline else {})
        return self._read(Run, "POST", "/v1/runs", content=spec, headers=headers, params=query)

    def runs(self, *, limit: int = 20, tag: str | None = None) -> Iterator[Run]:
        """Yield runs, newest first; with ``tag`` only those that carry it."""
        filters = {} if tag is None else {"tag": tag}
        return islice(self._pages(Run, "/v1/runs", page_size=min(limit, 100), **filters), limit)

    def quotas(self) -> list[Quota]:
        """Return the caller's quotas and those of its project; for the operator those of all that have runs."""
        return self._read_all(Quota, "GET", "/v1/quotas")

    def marks(self, run_id: str) -> list[Mark]:
        """Return the tags and notes on a run, its frames and its findings."""
        return self._read_all(Mark, "GET", f"/v1/runs/{run_id}/marks")

    def put_mark(self, run_id: str, mark: Mark) -> list[Mark]:
        """Replace the tags and the note of a run, a frame or a finding; return all marks of the run."""
        return self._read_all(Mark, "PUT", f"/v1/runs/{run_id}/marks", json=mark.model_dump(mode="json"))

    def run(self, run_id: str) -> Run:
        """Return a run."""
        return self._read(Run, "GET", f"/v1/runs/{run_id}")

    def annotations(self, run_id: str) -> tuple[str, ...]:
        """Return the kinds of annotations that the spec of a run requests."""
        return self._read(_RunWithSpec, "GET", f"/v1/runs/{run_id}").spec.annotations

    def progress(self, run_id: str) -> Progress:
        """Return the progress of a run."""
        return self._read(Progress, "GET", f"/v1/runs/{run_id}/progress")

    def failures(self, run_id: str) -> list[Failure]:
        """Return the products of a run that failed for good, at most 1000."""
        return self._read_all(Failure, "GET", f"/v1/runs/{run_id}/failures", params={"limit": 1000})

    def summary(self, run_id: str) -> RunSummary:
        """Return summary, findings and verdicts of an ended run."""
        return self._read(RunSummary, "GET", f"/v1/runs/{run_id}/summary")

    def detail(self, run_id: str) -> RunDetail:
        """Return spec and pins of a run."""
        return self._read(RunDetail, "GET", f"/v1/runs/{run_id}")

    def evaluations(self, run_id: str) -> bytes:
        """Return the long table of a run, as Parquet."""
        return self._send("GET", f"/v1/runs/{run_id}/evaluations", params={"format": "parquet"}).content

    def rows(self, run_id: str, where: str = "") -> bytes:
        """Return the rows of a run for which an expression holds, as an Arrow stream; empty: all."""
        parameters = {"run": run_id, "where": where, "format": "arrow"}
        return self._send("GET", "/v1/explore/rows", params=parameters).content

    def report(self, run_id: str) -> bytes:
        """Return the self-contained HTML report of an ended run."""
        return self._send("GET", f"/v1/runs/{run_id}/report").content

    def cancel(self, run_id: str) -> Run:
        """Stop a run. Finished products remain."""
        return self._read(Run, "POST", f"/v1/runs/{run_id}/cancel")

    def resume(self, run_id: str) -> Run:
        """Continue a paused or cancelled run."""
        return self._read(Run, "POST", f"/v1/runs/{run_id}/resume")

    def retry(self, run_id: str) -> Run:
        """Retry the products of a run that failed for good."""
        return self._read(Run, "POST", f"/v1/runs/{run_id}/retry")

    def delete(self, run_id: str) -> None:
        """Delete an ended run."""
        self._send("DELETE", f"/v1/runs/{run_id}")

    def plan_study(self, document: bytes) -> NextBatch:
        """Return the first batch of a study (YAML or JSON text) and its price."""
        return self._read(NextBatch, "POST", "/v1/studies/plan", content=document, headers=_SPEC)

    def begin_study(self, document: bytes) -> Study:
        """Start a study (YAML or JSON text)."""
        return self._read(Study, "POST", "/v1/studies", content=document, headers=_SPEC)

    def studies(self) -> Iterator[Study]:
        """Yield the newest studies, at most 20, newest first."""
        return islice(self._pages(Study, "/v1/studies", page_size=20), 20)

    def study(self, study_id: str) -> Study:
        """Return a study with its batches."""
        return self._read(Study, "GET", f"/v1/studies/{quote(study_id)}")

    def next_batch(self, study_id: str) -> NextBatch:
        """Return the newest open batch of a study."""
        return self._read(NextBatch, "GET", f"/v1/studies/{quote(study_id)}/next")

    def accept_batch(self, study_id: str, *, count: int | None = None) -> Study:
        """Accept the proposed batch of a study, with ``count`` variants instead of the proposed number if not None."""
        parameters = {} if count is None else {"count": count}
        return self._read(Study, "POST", f"/v1/studies/{quote(study_id)}/accept", params=parameters)

    def set_study_mode(self, study_id: str, *, by_hand: bool) -> Study:
        """Set from now on if a person accepts each batch."""
        return self._read(Study, "POST", f"/v1/studies/{quote(study_id)}/mode", params={"by_hand": by_hand})

    def stop_study(self, study_id: str) -> Study:
        """End a study with its present result."""
        return self._read(Study, "POST", f"/v1/studies/{quote(study_id)}/stop")

    def resume_study(self, study_id: str) -> Study:
        """Continue a paused study."""
        return self._read(Study, "POST", f"/v1/studies/{quote(study_id)}/resume")

    def study_report(self, study_id: str) -> bytes:
        """Return the self-contained HTML report of a study."""
        return self._send("GET", f"/v1/studies/{quote(study_id)}/report").content

    def functions(self) -> list[Function]:
        """Return the functions under test with their cards."""
        return self._read_all(Function, "GET", "/v1/functions")

    def function(self, reference: str) -> Function:
        """Return a function with its card and document."""
        return self._read(Function, "GET", f"/v1/functions/{quote(reference)}")

    def function_payload(self, reference: str) -> bytes:
        """Return the file of a registered function."""
        return self._send("GET", f"/v1/functions/{quote(reference)}/payload").content

    def register_function(self, texts: Mapping[str, str], payload: Path | None = None) -> RegisteredFunction:
        """Register a function with its file, if any, from any of ``document``, ``name``, ``engine``, ``precision``."""
        fields: list[tuple[str, Any]] = [(name, (None, text)) for name, text in texts.items()]
        # Converting and testing a large network may take minutes.
        timeout = httpx.Timeout(3600.0, connect=5.0)
        if payload is None:
            response = self._send("POST", "/v1/functions", files=fields, timeout=timeout)
        else:
            with payload.open("rb") as stream:
                fields.append(("payload", (payload.name, stream)))
                response = self._send("POST", "/v1/functions", files=fields, timeout=timeout)
        function = _validated(Function, response.json())
        return RegisteredFunction(function, response.status_code == httpx.codes.CREATED)

    def remove_function(self, reference: str) -> None:
        """Remove one version of a registered function."""
        self._send("DELETE", f"/v1/functions/{quote(reference)}")

    def frames(self, run_id: str) -> Iterator[Frame]:
        """Yield the frames of a run, in order."""
        return self._pages(Frame, f"/v1/runs/{run_id}/frames", page_size=1000)

    def picture(self, frame_id: str, *, sensor: str | None = None) -> bytes:
        """Return the picture of a frame as PNG."""
        parameters = {"kind": "picture", **_view(None, sensor)}
        return self._send("GET", f"/v1/frames/{frame_id}/image", params=parameters).content

    def labels(self, frame_id: str, *, function: str | None = None, sensor: str | None = None) -> bytes:
        """Return the label ids of a frame as PNG of 8 bits: the truth, or the prediction of a function."""
        parameters = _view(function, sensor)
        return self._send("GET", f"/v1/frames/{frame_id}/labels", params=parameters).content

    def annotation(self, frame_id: str, kind: str) -> bytes:
        """Return an annotation of a frame as a file for ``numpy.load``."""
        return self._send("GET", f"/v1/frames/{frame_id}/annotations/{quote(kind, safe='')}").content

    def put_prediction(
        self, frame_id: str, data: bytes, *, function: str | None = None, sensor: str | None = None
    ) -> bool:
        """Upload the label map of a frame (PNG); return True if it is new."""
        parameters = _view(function, sensor)
        path = f"/v1/frames/{quote(frame_id)}/prediction"
        headers = {"Content-Type": "image/png"}
        return self._read(_Uploaded, "PUT", path, params=parameters, content=data, headers=headers).new

    def _read(self, model: type[Model], method: str, path: str, **options: Any) -> Model:
        return _validated(model, self._send(method, path, **options).json())

    def _read_all(self, model: type[Model], method: str, path: str, **options: Any) -> list[Model]:
        return [_validated(model, item) for item in self._send(method, path, **options).json()]

    def _pages(self, model: type[Model], path: str, *, page_size: int, **filters: str) -> Iterator[Model]:
        """Yield the items of all pages. A page is read when its first item is needed."""
        cursor: str | None = ""
        while cursor is not None:
            parameters: dict[str, str | int] = {"limit": page_size, **filters, **({"cursor": cursor} if cursor else {})}
            page = self._read(_Page, "GET", path, params=parameters)
            yield from (_validated(model, item) for item in page.items)
            cursor = page.next

    def _send(self, method: str, path: str, **options: Any) -> httpx.Response:
        try:
            response = self._http.request(method, path, **options)
        except httpx.HTTPError as error:
            raise ServerUnavailableError(
                f"no server answers at {self.url} ({error}); start one with `valerie up`, or name another with --url"
            ) from error
        if response.is_success:
            return response
        raise _problem(response)


_SPEC = {"Content-Type": "application/yaml"}


def _view(function: str | None, sensor: str | None) -> dict[str, str]:
    """Return the query parameters of a frame's labels or picture."""
    return {name: value for name, value in (("function", function), ("sensor", sensor)) if value}


def _address(url: str) -> str:
    """Return an address without a trailing slash."""
    try:
        address = httpx.URL(url)
        is_address = address.scheme in ("http", "https") and bool(address.host)
    except httpx.InvalidURL:
        is_address = False
    if not is_address:
        raise InvalidInput("not the address of a server", field="url", value=url, limit="http://HOST:PORT or https://…")
    return url.rstrip("/")


def _problem(response: httpx.Response) -> ServerProblemError:
    try:
        document = response.json()
        title, detail = str(document.get("title", "")), str(document.get("detail", ""))
    except (ValueError, AttributeError):
        title, detail = response.reason_phrase, response.text[:300]
    if response.status_code == httpx.codes.UNAUTHORIZED:
        detail = f"{detail}; set VALERIE_API_TOKEN to the server's token"
    return ServerProblemError(response.status_code, title, detail)


def _validated(model: type[Model], document: object) -> Model:
    try:
        return model.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ServerProblemError(
            502, "Unexpected answer", f"the server sent an unexpected answer: {place}: {first['msg']}"
        ) from None
