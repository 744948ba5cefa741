import socket

import pytest

from valerie.addresses import allowed_target, parse_allowed
from valerie.errors import InvalidInput, NoAnswer

URL = "http://127.0.0.1:8000/predict?scale=1"


@pytest.fixture
def names(monkeypatch):
    """A name service of the test's own: name to addresses."""
    table: dict[str, list[str]] = {}

    def look_up(host: str, port: int, **_: object) -> list[tuple]:
        if host not in table:
            raise socket.gaierror("unknown")
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (address, port)) for address in table[host]]

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    table["127.0.0.1"] = ["127.0.0.1"]
    return table


def target(url: str, *entries: str):
    return allowed_target(url, parse_allowed(entries))


def test_no_address_is_allowed_by_default(names) -> None:
    with pytest.raises(InvalidInput, match=r"not on the operator's list.*got 127\.0\.0\.1:8000"):
        target(URL)


def test_a_host_is_allowed_by_name_and_port(names) -> None:
    names["models.example"] = ["10.0.0.7"]
    address = target("https://Models.example:8443/a", "models.example:8443")
    assert address == ("models.example", 8443, "/a", "10.0.0.7", True)


@pytest.mark.parametrize("entry", ["127.0.0.0/8", "127.0.0.0/8:8000", "127.0.0.1:8000", "0.0.0.0/0"])
def test_a_network_allows_the_addresses_in_it(names, entry: str) -> None:
    assert target(URL, entry).path == "/predict?scale=1"


@pytest.mark.parametrize("entry", ["10.0.0.0/8", "127.0.0.0/8:8001", "127.0.0.1:80", "localhost:8000"])
def test_everything_else_is_refused(names, entry: str) -> None:
    with pytest.raises(InvalidInput, match="not on the operator's list"):
        target(URL, entry)


def test_a_name_in_a_network_that_is_not_listed_is_refused(names) -> None:
    names["public.example"] = ["169.254.169.254"]
    with pytest.raises(InvalidInput, match="not on the operator's list"):
        target("http://public.example:8000/", "10.0.0.0/8")


def test_the_allowed_one_of_several_addresses_is_taken(names) -> None:
    names["models.example"] = ["192.168.0.1", "10.2.3.4"]
    assert target("http://models.example/", "10.0.0.0/8").address == "10.2.3.4"


def test_the_port_follows_from_the_scheme(names) -> None:
    assert target("http://127.0.0.1", "127.0.0.0/8").port == 80
    assert target("https://127.0.0.1", "127.0.0.0/8").port == 443


def test_ipv6_networks_stand_in_brackets_when_they_have_a_port(names) -> None:
    (entry,) = parse_allowed(["[fd00::/8]:8000"])
    assert (str(entry.network), entry.port) == ("fd00::/8", 8000)


def test_a_host_without_address_is_an_inference_error(names) -> None:
    with pytest.raises(NoAnswer, match=r"gone\.example has no address"):
        target("http://gone.example:1/", "gone.example:1")


@pytest.mark.parametrize(
    "url",
    ["ftp://a/b", "file:///etc/passwd", "//a/b", "http://", "http://u:p@a/", "http://a/#x", "http://a:x/", "http://a/ b",
     "http://a/\r\nX: y"],
)  # fmt: skip
def test_urls_that_are_not_plain_are_refused(names, url: str) -> None:
    with pytest.raises(InvalidInput, match=r"options\.url"):
        target(url, "0.0.0.0/0", "a:80")


@pytest.mark.parametrize("entry", ["models.example", "models.example:0", "10.0.0.0/33", "a:99999", ":80", "10.0.0.1/8"])
def test_a_meaningless_entry_of_the_list_is_refused(entry: str) -> None:
    with pytest.raises(InvalidInput, match=r"addresses\.0: neither host and port nor a network"):
        parse_allowed([entry])


@pytest.mark.parametrize(
    "address",
    [
        "127.0.0.1",
        "10.0.0.7",
        "172.16.0.1",
        "192.168.1.1",
        "169.254.169.254",
        "100.64.0.1",
        "0.0.0.0",
        "224.0.0.1",
        "::1",
        "fe80::1%eth0",
        "fd00::7",
        "::ffff:10.0.0.7",
        # Gateways to IPv4 (NAT64, 6to4) would pass a connection on to the address inside.
        "64:ff9b::10.0.0.7",
        "2002:a00:7::1",
        "::10.0.0.7",
        "fec0::7",
    ],
)
def test_a_public_name_that_leads_to_a_private_address_is_refused(names, address: str) -> None:
    names["hooks.example"] = [address]
    with pytest.raises(InvalidInput, match=r"not on the operator's list.*limit: VALERIE_WEBHOOK_NETWORKS"):
        allowed_target("https://hooks.example/", (), setting="VALERIE_WEBHOOK_NETWORKS", public=True)


@pytest.mark.parametrize(
    ("address", "listed"),
    [("93.184.215.14", ()), ("10.0.0.7", ("10.0.0.0/8",)), ("64:ff9b::93.184.215.14", ()), ("2606:4700::1111", ())],
)
def test_a_public_address_and_a_listed_private_one_are_allowed(names, address: str, listed: tuple[str, ...]) -> None:
    names["hooks.example"] = [address]
    assert allowed_target("https://hooks.example/", parse_allowed(listed), public=True).address == address
