"""The operator's lists of addresses that processes may connect to. Every connection is checked against one.

A user who registers a function behind HTTP chooses its address, but the worker that calls it is inside the operator's
network. So the operator lists the addresses that may be called; the list is empty by default. A webhook is the operator's own
choice, but its name may come to mean an address inside the network, so a list has the private ones. An entry is one of

- ``models.example:8000``: this host at this port, at any IP address;
- ``10.1.0.0/16`` or ``10.1.0.0/16:8000``, ``[fd00::/8]:8000``: every host with an IP address in this
  network, at any port or at this one.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple
from urllib.parse import urlsplit

from valerie.errors import InvalidInput, NoAnswer

IpNetwork = ipaddress.IPv4Network | ipaddress.IPv6Network

#: The IPv6 addresses of the public internet, and those that a gateway translates to the IPv4 address inside (RFC 4291, RFC 6052).
_UNICAST: Final = ipaddress.IPv6Network("2000::/3")
_NAT64: Final = ipaddress.IPv6Network("64:ff9b::/96")


class Endpoint(NamedTuple):
    """A checked address to connect to.

    Attributes:
        host, port, path: parts of the URL; ``path`` includes the query.
        address: the allowed IP address. The connection uses it instead of the name, so that a changed DNS entry cannot
            redirect it.
        secure: True for TLS with a check of the host's certificate.
    """

    host: str
    port: int
    path: str
    address: str
    secure: bool


@dataclass(frozen=True, slots=True)
class Allowed:
    """One entry of the list: a host by name, or a ``network``. ``port`` 0 means any."""

    host: str
    network: IpNetwork | None
    port: int


def parse_allowed(entries: Sequence[str], *, field: str = "addresses") -> tuple[Allowed, ...]:
    """Read the operator's list.

    Raises:
        InvalidInput: an entry is neither host and port nor a network.
    """
    return tuple(_allowed(entry.strip(), f"{field}.{number}") for number, entry in enumerate(entries) if entry.strip())


def allowed_target(
    url: str,
    entries: Sequence[Allowed],
    *,
    field: str = "options.url",
    setting: str = "VALERIE_HTTP_FUNCTIONS",
    public: bool = False,
) -> Endpoint:
    """Return the target of a URL if the operator allows it.

    Args:
        entries: the operator's list.
        field: the URL's name in messages.
        setting: the list's name in messages.
        public: also allow addresses of the public internet that are not on the list.

    Raises:
        InvalidInput: not an http or https URL with a host, a URL with user or fragment, or an address that is not on the list.
        NoAnswer: the host has no address.
    """
    host, port, path, secure = parse_url(url, field=field)
    by_name = any(entry.network is None and entry.host == host and entry.port == port for entry in entries)
    networks = [entry.network for entry in entries if entry.network is not None and entry.port in (0, port)]
    if not (by_name or networks or public):
        raise _not_allowed(host, port, field, setting)
    try:
        addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except OSError as error:
        raise NoAnswer(f"{host} has no address: {error}") from None
    for *_, place in addresses:
        address = ipaddress.ip_address(str(place[0]).partition("%")[0])
        if by_name or (public and _is_public(address)) or any(address in network for network in networks):
            return Endpoint(host, port, path, str(place[0]), secure)
    raise _not_allowed(host, port, field, setting)


def parse_url(url: str, *, field: str = "options.url") -> tuple[str, int, str, bool]:
    """Split a URL into host, port, path with query, and a flag that is True for https.

    Raises:
        InvalidInput: not an http or https URL with a host, or a URL with user or fragment.
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
        parts = urlsplit("")
    if parts.scheme not in ("http", "https") or not host or parts.username is not None or parts.fragment:
        raise InvalidInput("not a usable URL", field=field, value=url, limit="http://host:port/path")
    if any(ord(letter) <= 32 or ord(letter) == 127 for letter in url):
        raise InvalidInput("a URL has no blanks or control characters", field=field, value=url)
    secure = parts.scheme == "https"
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    return host.lower(), port or (443 if secure else 80), path, secure


def _allowed(entry: str, field: str) -> Allowed:
    whole, port = entry, "0"
    if entry.startswith("["):
        whole, _, port = entry[1:].partition("]")
        port = port.removeprefix(":") or "0"
    elif entry.count(":") == 1:
        whole, _, port = entry.partition(":")
    network: IpNetwork | None
    try:
        network = ipaddress.ip_network(whole)
    except ValueError:
        network = None
    if not port.isdecimal() or int(port) > 65_535 or not whole or (network is None and ("/" in whole or port == "0")):
        raise InvalidInput(
            "neither host and port nor a network", field=field, value=entry, limit="models.example:8000 or 10.1.0.0/16"
        )
    return Allowed(whole.lower(), network, int(port))


def _is_public(address: ipaddress.IPv4Address | ipaddress.IPv6Address) -> bool:
    if isinstance(address, ipaddress.IPv4Address):
        return address.is_global and not address.is_multicast
    inside = address.ipv4_mapped or address.sixtofour
    if address in _NAT64:
        inside = ipaddress.IPv4Address(address.packed[-4:])
    return address in _UNICAST and address.is_global if inside is None else _is_public(inside)


def _not_allowed(host: str, port: int, field: str, setting: str) -> InvalidInput:
    return InvalidInput("not on the operator's list of addresses", field=field, value=f"{host}:{port}", limit=setting)
