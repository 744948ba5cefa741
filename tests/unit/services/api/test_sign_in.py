"""Sign-in by an OpenID provider: a token for its users, and for nobody else."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from time import time
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

import httpx
import pytest
from joserfc import jwt
from joserfc.jwk import ECKey, OctKey

from services.api import identity_provider
from services.api.app import create_app
from tests.world.openid import CLIENT, SECRET, OpenIdProvider, openid_provider
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.errors import InvalidInput
from valerie.settings import load_settings

TOKEN = "correct-horse-battery"
HOME = "http://127.0.0.1/dashboard/"
#: The challenge is that of RFC 7636, appendix B.
VERIFIER = "dBjftJeZ4CVP-mB92K27uhbUJU1p1r_wW1gFWFOEjXk"
CHALLENGE = "E9Melhoa2OwvFrEMTJguCHaoeK1t8URWbuGJSstw-cM"


@pytest.fixture
def provider() -> Iterator[OpenIdProvider]:
    with openid_provider() as one:
        yield one


@pytest.fixture
def api(provider: OpenIdProvider, tmp_path: Path) -> Iterator[httpx.Client]:
    settings = settings_of(
        tmp_path,
        api_token=TOKEN,
        oidc_issuer=provider.issuer,
        oidc_client=CLIENT,
        oidc_secret=SECRET,
        oidc_roles="validators=runner,leads=admin",
    )
    with served(create_app(settings, control=False)) as client:
        yield client


def posted(api: httpx.Client, token: str) -> httpx.Response:
    return api.post("/v1/sign-in", json={"id_token": token})


def authorized(api: httpx.Client, secret: str) -> dict[str, Any]:
    return dict(api.get("/v1/access", headers={"Authorization": f"Bearer {secret}"}).raise_for_status().json())


def test_a_pipelines_id_token_brings_a_token_with_the_users_name_and_role(
    api: httpx.Client, provider: OpenIdProvider
) -> None:
    issued = posted(api, provider.token()).raise_for_status().json()
    assert (issued["owner"], issued["role"]) == ("ada", "runner")
    assert authorized(api, issued["secret"])["role"] == "runner"
    listed = api.get("/v1/tokens", headers={"Authorization": f"Bearer {TOKEN}"}).json()
    assert [(token["owner"], token["scopes"]) for token in listed] == [("ada", [])]


def asked_code(api: httpx.Client, nonce: str) -> str:
    offer = api.get("/v1/sign-in").json()
    query = {
        "client_id": offer["client"],
        "redirect_uri": HOME,
        "state": "s",
        "nonce": nonce,
        "code_challenge": CHALLENGE,
    }
    sent = httpx.get(f"{offer['page']}?{urlencode(query)}", trust_env=False)
    return parse_qs(urlsplit(sent.headers["location"]).query)["code"][0]


def test_a_code_is_worth_nothing_without_the_secrets_of_the_browser_that_asked(api: httpx.Client) -> None:
    good = {"verifier": VERIFIER, "nonce": "n", "redirect_uri": HOME}
    for wrong in ({"verifier": VERIFIER[::-1]}, {"nonce": "another"}, {"redirect_uri": "http://127.0.0.1/"}):
        refused = api.post("/v1/sign-in", json={"code": asked_code(api, "n"), **good, **wrong})
        assert refused.status_code == 401, refused.text
    code = asked_code(api, "n")
    assert api.post("/v1/sign-in", json={"code": code, **good}).status_code == 201
    assert api.post("/v1/sign-in", json={"code": code, **good}).status_code == 401


def encoded(part: dict[str, Any]) -> str:
    return base64.urlsafe_b64encode(json.dumps(part).encode()).rstrip(b"=").decode()


def test_an_id_token_that_is_not_the_providers_for_this_server_is_refused(
    api: httpx.Client, provider: OpenIdProvider
) -> None:
    another = ECKey.generate_key("P-256", {"kid": "first"})
    claims = {"iss": provider.issuer, "aud": CLIENT, "exp": int(time()) + 300, "sub": "ada", "groups": ["leads"]}
    unsigned = ".".join([*(encoded(part) for part in ({"alg": "none"}, claims)), ""])
    by_secret = jwt.encode({"alg": "HS256"}, claims, OctKey.import_key(SECRET * 4), algorithms=["HS256"])
    wrong = {
        "signature": provider.token(key=another),
        "no signature": unsigned,
        "a shared secret's signature": by_secret,
        "issuer": provider.token(iss="https://other.example"),
        "audience": provider.token(aud="another-server"),
        "client": provider.token(aud=[CLIENT, "other"], azp="other"),
        "expired": provider.token(exp=int(time()) - 60),
        "no end": provider.token(exp=None),
        "no name": provider.token(sub=None),
        "a name with a line break": provider.token(sub="ada\nroot"),
        "no token": "x.y.z",
    }
    for what, token in wrong.items():
        answer = posted(api, token)
        assert (answer.status_code, answer.headers["Content-Type"]) == (401, "application/problem+json"), what
    assert api.get("/v1/tokens", headers={"Authorization": f"Bearer {TOKEN}"}).json() == []


def test_the_highest_role_of_the_groups_counts_and_without_one_nobody_gets_in(
    api: httpx.Client, provider: OpenIdProvider
) -> None:
    assert posted(api, provider.token(groups=["validators", "leads"])).json()["role"] == "admin"
    assert posted(api, provider.token(groups="validators")).json()["role"] == "runner"
    for groups in (["others"], [], None, {"leads": 1}):
        refused = posted(api, provider.token(groups=groups))
        assert (refused.status_code, refused.json()["detail"]) == (403, "none of your groups has a role here")


def test_a_new_key_of_the_provider_is_read_and_strangers_do_not_make_it_read_again_and_again(
    api: httpx.Client, provider: OpenIdProvider, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert posted(api, provider.token()).status_code == 201
    provider.key = ECKey.generate_key("P-256", {"kid": "second"})
    for _ in range(3):
        assert posted(api, provider.token()).status_code == 401, "its keys were read a moment ago"
    assert provider.reads == 1
    monkeypatch.setattr(identity_provider, "AGAIN_S", 0.0)
    assert posted(api, provider.token()).status_code == 201
    assert provider.reads == 2


def test_a_provider_that_does_not_answer_is_named_and_other_tokens_work(tmp_path: Path) -> None:
    with openid_provider() as gone:
        issuer = gone.issuer
    settings = settings_of(tmp_path, api_token=TOKEN, oidc_issuer=issuer, oidc_client=CLIENT, oidc_roles="*=viewer")
    with served(create_app(settings, control=False)) as client:
        answer = client.get("/v1/sign-in")
        assert answer.status_code == 503
        assert f"the OpenID provider {issuer} does not answer" in answer.json()["detail"]
        assert authorized(client, TOKEN)["role"] == "admin"


def test_a_server_without_a_provider_offers_none(tmp_path: Path) -> None:
    with served(create_app(settings_of(tmp_path, api_token=TOKEN), control=False)) as client:
        assert client.get("/v1/sign-in").json() == {"page": None, "client": None}
        answer = posted(client, "x")
        assert answer.status_code == 404
        assert "VALERIE_OIDC_ISSUER" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("changed", "field"),
    [
        ({"oidc_issuer": "http://id.example"}, "VALERIE_OIDC_ISSUER"),
        ({"oidc_client": ""}, "VALERIE_OIDC_CLIENT"),
        ({"oidc_roles": ""}, "VALERIE_OIDC_ROLES"),
        ({"oidc_roles": "validators=boss"}, "VALERIE_OIDC_ROLES"),
        ({"api_token": ""}, "VALERIE_API_TOKEN"),
    ],
)
def test_settings_that_would_let_nobody_or_everybody_in_are_refused(changed: dict[str, str], field: str) -> None:
    good = {"oidc_issuer": "https://id.example", "oidc_client": CLIENT, "oidc_roles": "*=viewer", "api_token": TOKEN}
    with pytest.raises(InvalidInput, match=field):
        load_settings({}, **{**good, **changed})


@pytest.mark.parametrize("body", [{}, {"code": "c"}, {"id_token": "t", "code": "c"}, {"id_token": "t" * 30_000}])
def test_a_request_without_one_proof_is_refused(api: httpx.Client, body: dict[str, str]) -> None:
    assert api.post("/v1/sign-in", json=body).status_code == 422


def test_a_claim_names_the_project_of_everybody_but_admins(provider: OpenIdProvider, tmp_path: Path) -> None:
    settings = settings_of(
        tmp_path,
        api_token=TOKEN,
        oidc_issuer=provider.issuer,
        oidc_client=CLIENT,
        oidc_roles="validators=runner,leads=admin",
        oidc_project="department",
    )
    with served(create_app(settings, control=False)) as api:
        member = posted(api, provider.token(department="radar")).raise_for_status().json()
        assert (member["project"], authorized(api, member["secret"])["project"]) == ("radar", "radar")
        admin = posted(api, provider.token(department="radar", groups=["leads"])).raise_for_status().json()
        assert (admin["role"], admin["project"]) == ("admin", "")
        for nothing in (None, "", "Radar and Camera", ["radar"]):
            refused = posted(api, provider.token(department=nothing))
            assert refused.status_code == 403
            assert "department" in refused.json()["detail"]
