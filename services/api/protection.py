"""Protection of all endpoints: bearer token, limits of the body in bytes and time, headers for browsers."""

from __future__ import annotations

import asyncio
import hmac
import re
from http import HTTPStatus
from urllib.parse import urlsplit

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.api.audit import Audit
from services.api.problems import INVALID_INPUT, problem
from services.api.rates import RateLimit
from valerie.access import OPERATOR, SECRET_PREFIX, Caller
from valerie.errors import TransientError
from valerie.pipeline.control.tokens import caller_of
from valerie.settings import LOOPBACK, Settings

#: Paths that need no token: probes of load balancers, and sign-in, which gives one. The dashboard's files contain no data; its
#: page asks for the token.
_OPEN_PATHS = ("/healthz", "/readyz", "/v1/sign-in")
_OPEN_PREFIXES = ("/dashboard",)

#: A length with more digits exceeds every limit; converting it would only cost time.
_NUMBER = re.compile(r"[0-9]{1,15}", re.ASCII)
_FUNCTIONS = "/v1/functions"
_PREDICTION = re.compile(r"/v1/frames/[^/]+/prediction")
#: Room for an uncompressed label map in 8K.
_PREDICTION_BYTES = 1 << 25

_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-frame-options", b"SAMEORIGIN"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


class Protection:
    """ASGI middleware: the role of the bearer token, limits of the body, safe headers."""

    def __init__(self, app: ASGIApp, *, settings: Settings) -> None:
        self._app = app
        self._token = settings.api_token.get_secret_value().encode() if settings.api_token else None
        self._limit = settings.max_body_bytes
        self._seconds = settings.body_seconds
        self._audit = Audit()
        self._rates = RateLimit(settings.requests_per_minute)
        self._function_limit = (settings.max_function_mb << 20) + self._limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one connection."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = message.get("headers", [])
                present = {name.lower() for name, _ in headers}
                message["headers"] = [*headers, *((name, text) for name, text in _HEADERS if name not in present)]
            await send(message)

        try:
            await self._guarded(scope, receive, with_headers)
        except TransientError as error:
            refusal = problem(HTTPStatus.SERVICE_UNAVAILABLE, "Temporarily unavailable", str(error))
            await refusal(scope, receive, with_headers)

    async def _guarded(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope)
        caller = request.state.caller = await self._caller(request)
        limit = self._limit_of(request)
        refusal = await self._refusal(request, caller, limit)
        if refusal is not None:
            await refusal(scope, receive, send)
            return
        if limit > self._limit:
            await self._audit.watched(self._app, scope, _counted(receive, limit, self._seconds), send, caller)
            return
        try:
            async with asyncio.timeout(self._seconds):
                body = await self._body(receive)
        except TimeoutError:
            await problem(HTTPStatus.REQUEST_TIMEOUT, "Request timeout", _too_slow(self._seconds))(scope, receive, send)
            return
        if body is None:
            await _too_large("a longer stream", limit)(scope, receive, send)
            return

        sent = False

        async def replay() -> Message:
            nonlocal sent
            if sent:
                return await receive()
            sent = True
            return {"type": "http.request", "body": body, "more_body": False}

        await self._audit.watched(self._app, scope, replay, send, caller)

    async def _refusal(self, request: Request, caller: Caller | None, limit: int) -> Response | None:
        """Return the answer to a request that is refused before its body is read; None if it is not."""
        address = request.client.host if request.client else ""
        if seconds := self._rates.wait_for(f"address {address}" if caller is None else caller.name):
            refusal = problem(
                HTTPStatus.TOO_MANY_REQUESTS, "Too many requests", f"the limit is reached; again in {seconds} s"
            )
            refusal.headers["Retry-After"] = str(seconds)
            return refusal
        if caller is None and not _is_open(request.url.path):
            await run_in_threadpool(self._audit.refused, request, None, HTTPStatus.UNAUTHORIZED)
            refusal = problem(
                HTTPStatus.UNAUTHORIZED, "Unauthorized", "a valid bearer token is needed (Authorization header)"
            )
            refusal.headers["WWW-Authenticate"] = "Bearer"
            return refusal
        if self._foreign(request):
            await run_in_threadpool(self._audit.refused, request, caller, HTTPStatus.FORBIDDEN)
            detail = "requests from pages of other sites, or to another host name, are refused"
            return problem(HTTPStatus.FORBIDDEN, "Forbidden", detail)
        declared = request.headers.get("content-length", "0")
        if not _NUMBER.fullmatch(declared) or int(declared) > limit:
            return _too_large(declared, limit)
        return None

    def _limit_of(self, request: Request) -> int:
        """Return the limit of this request's body in bytes, which is higher for files of functions and label maps."""
        if request.method == "POST" and request.url.path == _FUNCTIONS:
            return self._function_limit
        if request.method == "PUT" and _PREDICTION.fullmatch(request.url.path):
            return max(_PREDICTION_BYTES, self._limit)
        return self._limit

    async def _caller(self, request: Request) -> Caller | None:
        """Return the caller by the request's token; None if it needs a valid token and has none."""
        if self._token is None:
            return OPERATOR
        scheme, _, rest = request.headers.get("authorization", "").partition(" ")
        if scheme.lower() != "bearer":
            return None
        secret = rest.strip()
        if hmac.compare_digest(secret.encode(), self._token):
            return OPERATOR
        if not secret.startswith(SECRET_PREFIX) or _is_open(request.url.path):
            return None
        return await run_in_threadpool(caller_of, request.app.state.context, secret)

    def _foreign(self, request: Request) -> bool:
        """Return True if the request comes from a page of another origin or was sent to a foreign host name.

        A name bound to this address would let such a page read answers (DNS rebinding). A page may load pictures without
        naming its origin; browsers then say that the request is none of this server's pages. Following a link is allowed.
        With a token, no page can do any of this.
        """
        if self._token is not None:
            return False
        host, origin = request.headers.get("host", ""), request.headers.get("origin")
        try:
            name = urlsplit(f"//{host}").hostname or ""
            elsewhere = origin is not None and urlsplit(origin).netloc != host
        except ValueError:  # not an address, such as "["
            return True
        embedded = request.headers.get("sec-fetch-site") in ("cross-site", "same-site") and not (
            request.headers.get("sec-fetch-mode") == "navigate" and request.method in ("GET", "HEAD")
        )
        return name not in LOOPBACK or elsewhere or embedded

    async def _body(self, receive: Receive) -> bytes | None:
        """Return the whole body, or None once it exceeds the limit, as a stream without a declared length may."""
        parts: list[bytes] = []
        size = 0
        while True:
            message = await receive()
            if message["type"] != "http.request":
                return b"".join(parts)
            parts.append(message.get("body", b""))
            size += len(parts[-1])
            if size > self._limit:
                return None
            if not message.get("more_body", False):
                return b"".join(parts)


def _is_open(path: str) -> bool:
    return path in _OPEN_PATHS or path == "/" or path.startswith(_OPEN_PREFIXES)


def _counted(receive: Receive, limit: int, seconds: float) -> Receive:
    """Return a receiver for large bodies, which stops an endpoint that reads more bytes or waits longer for a part."""
    size = 0
    whole = False

    async def counting() -> Message:
        nonlocal size, whole
        try:
            # Behind the body only the end of the connection is left to wait for.
            async with asyncio.timeout(None if whole else seconds):
                message = await receive()
        except TimeoutError:
            raise HTTPException(HTTPStatus.REQUEST_TIMEOUT, _too_slow(seconds)) from None
        whole = not message.get("more_body", False)
        size += len(message.get("body", b""))
        if size > limit:
            raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"the request body is too large; limit: {limit}")
        return message

    return counting


def _too_slow(seconds: float) -> str:
    return f"the request body did not arrive in time; limit: {seconds:g} s"


def _too_large(value: str, limit: int) -> Response:
    return problem(
        HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
        INVALID_INPUT,
        f"the request body is too large: {value} bytes; limit: {limit}",
        errors=[{"field": "body", "message": "too large", "value": value, "limit": limit}],
    )
