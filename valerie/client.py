"""A small client of the REST API: typed where the command line needs it, with problems as readable errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar
from urllib.parse import quote

import httpx
from pydantic import BaseModel, ConfigDict, ValidationError

from valerie.errors import InvalidInput, TransientError, ValerieError


class ServerProblemError(ValerieError):
    """The server refused: an RFC 9457 problem document.

    Attributes:
        status: HTTP status.
        title: kind of error, e.g. ``Unknown name``.
        detail: what the server said, field, value and limit included.
    """

    def __init__(self, status: int, title: str, detail: str) -> None:
        self.status, self.title, self.detail = status, title, detail
        super().__init__(detail or title)

    @property
    def is_callers_fault(self) -> bool:
        """Whether another request, not another server, would help."""
        return 400 <= self.status < 500


class ServerUnavailableError(TransientError):
    """No server answers at the address, or it broke off."""


class _Read(BaseModel):
    # A newer server may say more.
    model_config = ConfigDict(frozen=True, extra="ignore")


Model = TypeVar("Model", bound=_Read)


class StageProgress(_Read):
    """One stage: counts, rate (per second) and remaining seconds; None while nothing is known."""

    done: int
    total: int
    failed: int
    running: int
    rate_per_s: float
    eta_s: float | None = None


class VariantProgress(_Read):
    """Variants of the spec, those that were given to the queues, and those that are illegal."""

    total: int
    fed: int
    rejected: int


class Progress(_Read):
    """How far a run is."""

    state: str
    reason: str | None = None
    variants: VariantProgress
    stages: dict[str, StageProgress]
    updated_at: float | None = None


class Run(_Read):
    """A run as the list shows it."""

    id: str
    name: str
    state: str
    reason: str | None = None
    variant_count: int
    rejected_count: int = 0
    created_at: str
    started_at: str | None = None
    finished_at: str | None = None


class Client:
    """One server; a context manager.

    Every method may raise `ServerUnavailableError` and `ServerProblemError`.
    """

    def __init__(self, url: str, *, token: str | None = None, transport: httpx.BaseTransport | None = None) -> None:
        """Connect lazily.

        Args:
            url: e.g. ``http://127.0.0.1:8700``.
            token: bearer token, where the server wants one.
            transport: another way to the server, for tests.

        Raises:
            InvalidInput: ``url`` is no address.
        """
        self.url = _address(url)
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        timeout = httpx.Timeout(30.0, connect=5.0)
        # A proxy of the environment must not see what goes to this machine.
        local = httpx.URL(self.url).host in ("127.0.0.1", "localhost", "::1")
        self._http = httpx.Client(
            base_url=self.url, headers=headers, timeout=timeout, transport=transport, trust_env=not local
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._http.close()

    def plan(self, spec: bytes) -> dict[str, Any]:
        """What a spec would cost."""
        return self._document("POST", "/v1/plan", content=spec, headers=_SPEC)

    def submit(self, spec: bytes, *, idempotency_key: str | None = None) -> Run:
        """Start a run of a spec (YAML or JSON text)."""
        headers = {**_SPEC, **({"Idempotency-Key": idempotency_key} if idempotency_key else {})}
        return self._read(Run, "POST", "/v1/runs", content=spec, headers=headers)

    def runs(self, *, limit: int = 20) -> Iterator[Run]:
        """Runs, newest first."""
        cursor: str | None = None
        while limit > 0:
            parameters: dict[str, str | int] = {"limit": min(limit, 100), **({"cursor": cursor} if cursor else {})}
            page = self._document("GET", "/v1/runs", params=parameters)
            for item in page["items"]:
                yield _validated(Run, item)
            limit -= len(page["items"])
            cursor = page.get("next")
            if not cursor:
                return

    def run(self, run_id: str) -> Run:
        """One run."""
        return self._read(Run, "GET", f"/v1/runs/{run_id}")

    def spec(self, run_id: str) -> dict[str, Any]:
        """The spec of a run."""
        found: dict[str, Any] = self._document("GET", f"/v1/runs/{run_id}")["spec"]
        return found

    def progress(self, run_id: str) -> Progress:
        """How far a run is."""
        return self._read(Progress, "GET", f"/v1/runs/{run_id}/progress")

    def failures(self, run_id: str) -> list[dict[str, Any]]:
        """What failed for good, with stage, error and attempts."""
        found: list[dict[str, Any]] = self._send("GET", f"/v1/runs/{run_id}/failures", params={"limit": 1000}).json()
        return found

    def summary(self, run_id: str) -> dict[str, Any]:
        """The summary document of an ended run."""
        return self._document("GET", f"/v1/runs/{run_id}/summary")

    def report(self, run_id: str) -> bytes:
        """The self-contained HTML report of an ended run."""
        return self._send("GET", f"/v1/runs/{run_id}/report").content

    def cancel(self, run_id: str) -> Run:
        """Stop a run; what is done stays."""
        return self._read(Run, "POST", f"/v1/runs/{run_id}/cancel")

    def resume(self, run_id: str) -> Run:
        """Let a paused or cancelled run go on."""
        return self._read(Run, "POST", f"/v1/runs/{run_id}/resume")

    def retry(self, run_id: str) -> Run:
        """Try again what failed for good."""
        return self._read(Run, "POST", f"/v1/runs/{run_id}/retry")

    def delete(self, run_id: str) -> None:
        """Delete an ended run."""
        self._send("DELETE", f"/v1/runs/{run_id}")

    def functions(self) -> list[dict[str, Any]]:
        """Functions under test with their cards."""
        found: list[dict[str, Any]] = self._send("GET", "/v1/functions").json()
        return found

    def function(self, reference: str) -> dict[str, Any]:
        """One function with its card and document."""
        return self._document("GET", f"/v1/functions/{quote(reference)}")

    def function_payload(self, reference: str) -> bytes:
        """The file of a registered function."""
        return self._send("GET", f"/v1/functions/{quote(reference)}/payload").content

    def register_function(
        self, texts: Mapping[str, str], payload: Path | None = None, *, filename: str | None = None
    ) -> tuple[dict[str, Any], bool]:
        """Register a function; what is registered, and whether it is new.

        Args:
            texts: ``document``, ``name``, ``engine``, ``precision``: what is known.
            payload: its file.
            filename: what the file is called; None: its own name.
        """
        fields: list[tuple[str, Any]] = [(name, (None, text)) for name, text in texts.items()]
        # Converting and trying out a large network takes minutes.
        patient = httpx.Timeout(3600.0, connect=5.0)
        if payload is None:
            response = self._send("POST", "/v1/functions", files=fields, timeout=patient)
        else:
            with payload.open("rb") as stream:
                fields.append(("payload", (filename or payload.name, stream)))
                response = self._send("POST", "/v1/functions", files=fields, timeout=patient)
        return response.json(), response.status_code == httpx.codes.CREATED

    def remove_function(self, reference: str) -> None:
        """Remove one version of a registered function."""
        self._send("DELETE", f"/v1/functions/{quote(reference)}")

    def frames(self, run_id: str) -> Iterator[dict[str, Any]]:
        """Frames of a run in order, with their states."""
        cursor: str | None = None
        while True:
            parameters: dict[str, str | int] = {"limit": 1000, **({"cursor": cursor} if cursor else {})}
            page = self._document("GET", f"/v1/runs/{run_id}/frames", params=parameters)
            yield from page["items"]
            cursor = page.get("next")
            if not cursor:
                return

    def picture(self, frame_id: str, *, sensor: str | None = None) -> bytes:
        """What functions see of a frame, as PNG."""
        parameters = {"kind": "picture", **({"sensor": sensor} if sensor else {})}
        return self._send("GET", f"/v1/frames/{frame_id}/image", params=parameters).content

    def annotation(self, frame_id: str, kind: str) -> bytes:
        """An annotation of a frame, as a file that ``numpy.load`` reads."""
        return self._send("GET", f"/v1/frames/{frame_id}/annotations/{quote(kind, safe='')}").content

    def put_prediction(
        self, frame_id: str, data: bytes, *, function: str | None = None, sensor: str | None = None
    ) -> bool:
        """Upload the label map of a frame (PNG); return whether it is new."""
        parameters = {name: value for name, value in (("function", function), ("sensor", sensor)) if value}
        path = f"/v1/frames/{quote(frame_id)}/prediction"
        headers = {"Content-Type": "image/png"}
        return bool(self._document("PUT", path, params=parameters, content=data, headers=headers)["new"])

    def _read(self, model: type[Model], method: str, path: str, **options: Any) -> Model:
        return _validated(model, self._document(method, path, **options))

    def _document(self, method: str, path: str, **options: Any) -> dict[str, Any]:
        found: dict[str, Any] = self._send(method, path, **options).json()
        return found

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


def _address(url: str) -> str:
    """An address without the slash at its end."""
    try:
        parsed = httpx.URL(url)
        usable = parsed.scheme in ("http", "https") and bool(parsed.host)
    except httpx.InvalidURL:
        usable = False
    if not usable:
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
            502, "Unexpected answer", f"the server's answer is not understood: {place}: {first['msg']}"
        ) from None
