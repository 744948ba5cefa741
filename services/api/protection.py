"""What stands between the network and the endpoints: the token, the size of a body, and headers for browsers."""

from __future__ import annotations

import hmac
import re
from http import HTTPStatus
from urllib.parse import urlsplit

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.api.problems import INVALID_INPUT, problem
from valerie.settings import Settings

#: Answered without a token: what a load balancer asks. The dashboard's files hold no data; its page asks for the token.
_OPEN_PATHS = ("/healthz", "/readyz")
_OPEN_PREFIXES = ("/dashboard",)

#: No more digits than any limit has: a longer number would only cost time.
_NUMBER = re.compile(r"[0-9]{1,15}", re.ASCII)
_FUNCTIONS = "/v1/functions"
_PREDICTION = re.compile(r"/v1/frames/[^/]+/prediction")
#: An uncompressed label map of 8K and its surroundings.
_PREDICTION_BYTES = 1 << 25
_LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")

_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-frame-options", b"SAMEORIGIN"),
)


class Protection:
    """ASGI middleware: bearer token (compared in constant time), body limit, safe headers."""

    def __init__(self, app: ASGIApp, *, settings: Settings) -> None:
        self._app = app
        self._token = settings.api_token.get_secret_value().encode() if settings.api_token else None
        self._limit = settings.max_body_bytes
        self._function_limit = (settings.max_function_mb << 20) + self._limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one connection."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = {name.lower() for name, _ in message.get("headers", [])}
                message["headers"] = [*message.get("headers", []), *(one for one in _HEADERS if one[0] not in given)]
            await send(message)

        await self._guarded(scope, receive, with_headers)

    async def _guarded(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope)
        if not self._authorized(request):
            refusal = problem(
                HTTPStatus.UNAUTHORIZED, "Unauthorized", "a bearer token is needed (Authorization header)"
            )
            refusal.headers["WWW-Authenticate"] = "Bearer"
            await refusal(scope, receive, send)
            return
        if self._foreign(request):
            refusal = problem(
                HTTPStatus.FORBIDDEN, "Forbidden", "requests of another site's pages, or to another name, are refused"
            )
            await refusal(scope, receive, send)
            return
        limit = self._limit_of(request)
        declared = request.headers.get("content-length", "0")
        if not _NUMBER.fullmatch(declared) or int(declared) > limit:
            await _too_large(declared, limit)(scope, receive, send)
            return
        if limit > self._limit:
            await self._app(scope, _counted(receive, limit), send)
            return
        body = await self._body(receive)
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

        await self._app(scope, replay, send)

    def _limit_of(self, request: Request) -> int:
        """Longest body of this request: files of functions and label maps are longer than documents."""
        if request.method == "POST" and request.url.path == _FUNCTIONS:
            return self._function_limit
        if request.method == "PUT" and _PREDICTION.fullmatch(request.url.path):
            return max(_PREDICTION_BYTES, self._limit)
        return self._limit

    def _authorized(self, request: Request) -> bool:
        path = request.url.path
        if self._token is None or path in _OPEN_PATHS or path == "/" or path.startswith(_OPEN_PREFIXES):
            return True
        scheme, _, given = request.headers.get("authorization", "").partition(" ")
        return scheme.lower() == "bearer" and hmac.compare_digest(given.strip().encode(), self._token)

    def _foreign(self, request: Request) -> bool:
        """Whether a web page of another origin, or a name that was bound to this address, asks (without a token)."""
        if self._token is not None:
            return False
        host, origin = request.headers.get("host", ""), request.headers.get("origin")
        try:
            name = urlsplit(f"//{host}").hostname or ""
            elsewhere = origin is not None and urlsplit(origin).netloc != host
        except ValueError:  # "[": not an address at all
            return True
        return name not in _LOOPBACK_NAMES or elsewhere

    async def _body(self, receive: Receive) -> bytes | None:
        """The whole body, or None as soon as it is longer than the limit (a stream declares no length)."""
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


def _counted(receive: Receive, limit: int) -> Receive:
    """A large body goes through piece by piece; the endpoint that reads it is stopped when it is longer than announced."""
    size = 0

    async def counting() -> Message:
        nonlocal size
        message = await receive()
        size += len(message.get("body", b""))
        if size > limit:
            raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"the request body is too large; limit: {limit}")
        return message

    return counting


def _too_large(value: str, limit: int) -> Response:
    return problem(
        HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
        INVALID_INPUT,
        f"the request body is too large: {value} bytes; limit: {limit}",
        errors=[{"field": "body", "message": "too large", "value": value, "limit": limit}],
    )
