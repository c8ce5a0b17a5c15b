"""Hosts, as `Host` and `Origin` name them: which are loopback, which an address, which a name of the own network."""

from __future__ import annotations

import re
from ipaddress import IPv4Address, IPv6Address, ip_address

_NAME = r"(?P<name>\[[0-9a-f:.]+\]|[0-9a-z._-]+)(:[0-9]{1,5})?"
_HOST = re.compile(_NAME, re.IGNORECASE | re.ASCII)
_ORIGIN = re.compile(f"https?://{_NAME}", re.IGNORECASE | re.ASCII)
NETWORK_SUFFIXES = (".local", ".internal", ".home.arpa")
"""Names that no public server gives (RFC 6762, RFC 8375, ICANN's .internal)."""


def host_of(text: str) -> str | None:
    """The name or address in `HOST` or `HOST:PORT`, in small letters and without brackets; None if it is neither."""
    return _name(_HOST, text)


def host_of_origin(text: str) -> str | None:
    """The same for an origin, `http://HOST:PORT`; None for `null` and other non-origins."""
    return _name(_ORIGIN, text)


def is_address(host: str) -> bool:
    """Whether a host is an address, which no name server can make lead elsewhere."""
    return _address(host) is not None


def is_loopback(host: str) -> bool:
    """Whether a host is this machine to itself."""
    address = _address(host)
    return host == "localhost" or host.endswith(".localhost") if address is None else address.is_loopback


def is_network_name(host: str) -> bool:
    """Whether only the own network can give this name."""
    return "." not in host or host.endswith(NETWORK_SUFFIXES)


def _name(pattern: re.Pattern[str], text: str) -> str | None:
    found = pattern.fullmatch(text)
    return found["name"].lower().strip("[]").removesuffix(".") if found else None


def _address(host: str) -> IPv4Address | IPv6Address | None:
    try:
        return ip_address(host)
    except ValueError:
        return None
