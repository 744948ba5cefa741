"""Behind a proxy: whose word for a client's address counts."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.api.app import create_app
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.errors import InvalidInput

TOKEN = "correct-horse-battery"


def recorded(folder: Path, forwarded: str, **settings: object) -> str:
    """The address in the audit log of a change that came with a header."""
    with served(create_app(settings_of(folder, api_token=TOKEN, **settings), control=False), token=TOKEN) as client:
        client.delete("/v1/runs/r0", headers={"X-Forwarded-For": forwarded})
        address: str = client.get("/v1/audit").json()[-1]["address"]
        return address


@pytest.mark.parametrize(
    ("trusted", "forwarded", "address"),
    [
        ("127.0.0.1", "203.0.113.7", "203.0.113.7"),
        ("10.0.0.2,127.0.0.0/8", "203.0.113.7", "203.0.113.7"),
        # What a client has claimed stands before what the proxy adds.
        ("127.0.0.1", "198.51.100.1, 203.0.113.7", "203.0.113.7"),
        ("127.0.0.1,203.0.113.7", "198.51.100.1, 203.0.113.7", "198.51.100.1"),
        ("10.0.0.2", "203.0.113.7", "127.0.0.1"),
        ("", "203.0.113.7", "127.0.0.1"),
    ],
)
def test_only_a_trusted_proxy_says_who_the_client_is(
    tmp_path: Path, trusted: str, forwarded: str, address: str
) -> None:
    assert recorded(tmp_path, forwarded, trusted_proxies=trusted) == address


def test_strangers_behind_a_proxy_have_rates_of_their_own_and_nobody_invents_an_address(tmp_path: Path) -> None:
    for trusted, expected in (("127.0.0.1", [401, 401]), ("", [401, 429])):
        settings = settings_of(tmp_path, api_token=TOKEN, requests_per_minute=1, trusted_proxies=trusted)
        with served(create_app(settings, control=False)) as client:
            answers = [client.get("/v1/runs", headers={"X-Forwarded-For": f"203.0.113.{n}"}) for n in (1, 2)]
        assert [answer.status_code for answer in answers] == expected


@pytest.mark.parametrize("entry", ["*", "proxy.example", "10.0.0.1/8"])
def test_what_is_no_address_is_refused_by_name(tmp_path: Path, entry: str) -> None:
    with pytest.raises(InvalidInput, match="VALERIE_TRUSTED_PROXIES"):
        settings_of(tmp_path, trusted_proxies=entry)
