"""An OpenID provider on loopback, which signs everybody in at once."""

from __future__ import annotations

import base64
import hashlib
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import time
from typing import Any
from urllib.parse import urlencode

from joserfc import jwt
from joserfc.jwk import ECKey
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from tests.world.serving import served

CLIENT = "valerie"
SECRET = "the client's own"


@dataclass
class OpenIdProvider:
    """A provider of one user.

    Attributes:
        issuer: its address.
        claims: of the user, in every ID token.
        key: signs ID tokens; the first of those that it publishes.
        reads: requests of its keys.
    """

    issuer: str = ""
    claims: dict[str, Any] = field(default_factory=lambda: {"sub": "ada", "groups": ["validators"]})
    key: ECKey = field(default_factory=lambda: ECKey.generate_key("P-256", {"kid": "first"}))
    reads: int = 0
    _asked: dict[str, dict[str, str]] = field(default_factory=dict)

    def token(self, *, key: ECKey | None = None, **claims: Any) -> str:
        """Return an ID token; a claim of None is left out."""
        whole = {"iss": self.issuer, "aud": CLIENT, "exp": int(time()) + 300, **self.claims, **claims}
        used = key or self.key
        header = {"alg": "ES256", "kid": used.kid}
        return jwt.encode(header, {name: value for name, value in whole.items() if value is not None}, used)

    async def document(self, request: Request) -> Response:
        places = {"authorization_endpoint": "/authorize", "token_endpoint": "/token", "jwks_uri": "/keys"}
        return JSONResponse({"issuer": self.issuer, **{name: f"{self.issuer}{path}" for name, path in places.items()}})

    async def keys(self, request: Request) -> Response:
        self.reads += 1
        return JSONResponse({"keys": [self.key.as_dict(private=False)]})

    async def authorize(self, request: Request) -> Response:
        query = dict(request.query_params)
        code = secrets.token_hex(8)
        self._asked[code] = query
        return RedirectResponse(f"{query['redirect_uri']}?{urlencode({'code': code, 'state': query['state']})}")

    async def exchange(self, request: Request) -> Response:
        form = {name: str(value) for name, value in (await request.form()).items()}
        asked = self._asked.pop(form["code"], None)  # a code is good once
        challenge = (
            base64.urlsafe_b64encode(hashlib.sha256(form["code_verifier"].encode()).digest()).rstrip(b"=").decode()
        )
        wanted = asked and (asked["code_challenge"], asked["client_id"], asked["redirect_uri"], SECRET)
        if (challenge, form["client_id"], form["redirect_uri"], form.get("client_secret")) != wanted:
            return JSONResponse({"error": "invalid_grant"}, 400)
        assert asked is not None
        return JSONResponse({"id_token": self.token(nonce=asked["nonce"])})


@contextmanager
def openid_provider() -> Iterator[OpenIdProvider]:
    provider = OpenIdProvider()
    routes = [
        Route("/.well-known/openid-configuration", provider.document),
        Route("/keys", provider.keys),
        Route("/authorize", provider.authorize),
        Route("/token", provider.exchange, methods=["POST"]),
    ]
    with served(Starlette(routes=routes)) as client:
        provider.issuer = str(client.base_url).rstrip("/")
        yield provider
