"""The operator's OpenID provider: where it signs users in, and who an ID token of it is about."""

from __future__ import annotations

import re
import threading
from http import HTTPStatus
from time import monotonic
from typing import Any, Final, NamedTuple, cast

import httpx
from joserfc import jwt
from joserfc.errors import JoseError
from joserfc.jwk import KeySet
from starlette.exceptions import HTTPException

from valerie.access import PROJECT, Role
from valerie.errors import TransientError
from valerie.plain import JsonObject
from valerie.settings import Settings

#: Signatures with public keys only: a client's secret must not sign what it accepts.
_ALGORITHMS: Final = (
    "RS256",
    "RS384",
    "RS512",
    "PS256",
    "PS384",
    "PS512",
    "ES256",
    "ES384",
    "ES512",
    "EdDSA",
    "Ed25519",
)
_TIMEOUT_S: Final = 5.0
#: The provider's document and keys are read again after this time; for a signature by an unknown key, after the shorter one.
_KEPT_S: Final = 3600.0
AGAIN_S: Final = 60.0
#: Difference between the provider's clock and this one's that does not count.
_LEEWAY_S: Final = 30


class Identity(NamedTuple):
    """A user of the provider: the owner of the tokens that it gets here, their role and their project."""

    owner: str
    role: Role
    project: str


class _Known(NamedTuple):
    metadata: JsonObject
    keys: KeySet
    at: float


class IdentityProvider:
    """Client of one provider (OpenID Connect Core 1.0, Discovery 1.0), for the threads of the server.

    Methods raise `TransientError` if the provider does not answer as the standard says.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._lock = threading.Lock()
        self._read: _Known | None = None

    @property
    def page(self) -> str:
        """Address to which a browser goes to sign in."""
        return str(self._known().metadata["authorization_endpoint"])

    def redeem(self, code: str, verifier: str, redirect_uri: str) -> str:
        """Exchange the code that the provider sent back through a browser for an ID token.

        Args:
            code: from the provider.
            verifier: secret of the browser that asked for the code (RFC 7636).
            redirect_uri: address to which the provider sent the code.

        Raises:
            HTTPException: 401, the provider refuses the code.
        """
        form = {
            "grant_type": "authorization_code",
            "code": code,
            "code_verifier": verifier,
            "redirect_uri": redirect_uri,
        }
        form["client_id"] = self._settings.oidc_client
        if self._settings.oidc_secret is not None:
            form["client_secret"] = self._settings.oidc_secret.get_secret_value()
        status, answer = self._exchange("POST", str(self._known().metadata["token_endpoint"]), form)
        if status != HTTPStatus.OK or not isinstance(token := answer.get("id_token"), str):
            raise _refused(f"the provider refuses the code: {answer.get('error', status)}")
        return token

    def identity(self, token: str, *, nonce: str | None) -> Identity:
        """Return the user that an ID token is about.

        Args:
            token: signed by the provider for `Settings.oidc_client`.
            nonce: of the browser's request; None if the token came another way.

        Raises:
            HTTPException: 401, the token is not valid; 403, none of the user's groups has a role.
        """
        claims = self._claims(token)
        expected: dict[str, Any] = {"iss": {"essential": True, "value": self._settings.oidc_issuer}}
        expected |= {"aud": {"essential": True, "value": self._settings.oidc_client}, "exp": {"essential": True}}
        if nonce is not None:
            expected["nonce"] = {"essential": True, "value": nonce}
        try:
            jwt.JWTClaimsRegistry(leeway=_LEEWAY_S, **expected).validate(claims)
        except JoseError as error:
            raise _refused(f"the ID token is not valid: {error}") from None
        if claims.get("azp", self._settings.oidc_client) != self._settings.oidc_client:
            raise _refused("the ID token was issued to another client")
        owner = claims.get(self._settings.oidc_owner)
        if not isinstance(owner, str) or not 0 < len(owner) <= 200 or not owner.isprintable():
            raise _refused(f"the ID token has no usable claim {self._settings.oidc_owner}")
        role = self._role(claims)
        return Identity(owner, role, "" if role is Role.ADMIN else self._project(claims))

    def _project(self, claims: JsonObject) -> str:
        """Return a user's project; empty if users have none."""
        if not self._settings.oidc_project:
            return ""
        project = claims.get(self._settings.oidc_project)
        if not isinstance(project, str) or not re.fullmatch(PROJECT, project):
            raise HTTPException(
                HTTPStatus.FORBIDDEN, f"the ID token names no usable project ({self._settings.oidc_project})"
            )
        return project

    def _role(self, claims: JsonObject) -> Role:
        """Return the highest role of a user's groups."""
        groups = claims.get(self._settings.oidc_groups, [])
        listed = groups if isinstance(groups, list) else [groups]
        roles = [role for group, role in self._settings.oidc_role_of_group.items() if group == "*" or group in listed]
        if not roles:
            raise HTTPException(HTTPStatus.FORBIDDEN, "none of your groups has a role here")
        return max(roles, key=list(Role).index)

    def _claims(self, token: str) -> JsonObject:
        """Return the claims of a token with a good signature; read the keys again if they may have changed."""
        for latest in (_KEPT_S, AGAIN_S):
            known = self._known(latest)
            try:
                return cast("JsonObject", jwt.decode(token, known.keys, algorithms=_ALGORITHMS).claims)
            except (JoseError, ValueError):
                continue
        raise _refused("the ID token is not signed by the provider")

    def _known(self, latest: float = _KEPT_S) -> _Known:
        """Return metadata and keys of the provider, at most ``latest`` seconds old."""
        with self._lock:
            if self._read is None or monotonic() - self._read.at >= latest:
                metadata = self._get(f"{self._settings.oidc_issuer.rstrip('/')}/.well-known/openid-configuration")
                if metadata.get("issuer") != self._settings.oidc_issuer:
                    raise self._mute(f"it calls itself {metadata.get('issuer')}")
                if missing := {"authorization_endpoint", "token_endpoint", "jwks_uri"} - metadata.keys():
                    raise self._mute(f"its document lacks {', '.join(sorted(missing))}")
                try:
                    keys = KeySet.import_key_set(cast("Any", self._get(str(metadata["jwks_uri"]))))
                except (JoseError, ValueError, KeyError, TypeError) as error:
                    raise self._mute(f"its keys cannot be read: {error}") from None
                self._read = _Known(metadata, keys, monotonic())
            return self._read

    def _get(self, url: str) -> JsonObject:
        status, answer = self._exchange("GET", url)
        if status != HTTPStatus.OK:
            raise self._mute(f"{url} answered with status {status}")
        return answer

    def _exchange(self, method: str, url: str, form: dict[str, str] | None = None) -> tuple[int, JsonObject]:
        try:
            response = httpx.request(method, url, data=form, timeout=_TIMEOUT_S)
            answer = response.json()
        except (httpx.HTTPError, httpx.InvalidURL, ValueError) as error:
            raise self._mute(f"{url}: {error or type(error).__name__}") from None
        if not isinstance(answer, dict):
            raise self._mute(f"{url} did not answer with an object")
        return response.status_code, answer

    def _mute(self, reason: str) -> TransientError:
        return TransientError(
            f"the OpenID provider {self._settings.oidc_issuer} does not answer as it should: {reason}"
        )


def _refused(reason: str) -> HTTPException:
    return HTTPException(HTTPStatus.UNAUTHORIZED, reason)
