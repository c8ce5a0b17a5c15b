"""Addresses and host names: where a server listens, and how to read `Host`, `Origin` and peer addresses."""

from __future__ import annotations

import ipaddress
import os
import re
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

ISOLATED_VARIABLE = "TIGAS_ISOLATED"
"""Environment variable set for services in a private network namespace, where every address is local."""

_NAME = r"(?P<name>\[[0-9a-f:.]+\]|[0-9a-z._-]+)(:[0-9]{1,5})?"
_HOST = re.compile(_NAME, re.IGNORECASE | re.ASCII)
_ORIGIN = re.compile(f"https?://{_NAME}", re.IGNORECASE | re.ASCII)
NETWORK_SUFFIXES = (".local", ".internal", ".home.arpa")
"""Suffixes that no public DNS server resolves (RFC 6762, RFC 8375, ICANN's .internal)."""


@dataclass(frozen=True, slots=True)
class Address:
    """A host (name, IPv4 or IPv6 address) and a port; port 0 lets the system choose."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> Address:
        """Read `HOST:PORT`, with an IPv6 host in brackets.

        Raises ValueError with one sentence.
        """
        host, colon, port = text.rpartition(":")
        if not colon or not re.fullmatch("[0-9]{1,5}", port) or int(port) > 65535:
            raise ValueError(f"{text[:100]!r} is not HOST:PORT, such as 127.0.0.1:8080 or [::]:4433")
        host = host.removeprefix("[").removesuffix("]")
        if not host:
            raise ValueError(f"{text!r} has no host; to listen on all addresses, write 0.0.0.0:{port}")
        return cls(host, int(port))

    def __str__(self) -> str:
        return f"{bracket_host(self.host)}:{self.port}"

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach the address."""
        return is_loopback(self.host)

    @property
    def reachable_host(self) -> str:
        """The host name to use in URLs shown to people on this machine."""
        if self.is_loopback or self.host in ("0.0.0.0", "::"):
            return "localhost"
        return bracket_host(self.host)

    def listen(self, unread_s: float) -> socket.socket:
        """A listening TCP socket.

        A peer that does not read for `unread_s` seconds loses its connection (on Linux). Raises OSError.
        """
        family, kind, protocol, _, target = socket.getaddrinfo(
            self.host, self.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listener = socket.socket(family, kind, protocol)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if hasattr(socket, "TCP_USER_TIMEOUT"):  # inherited by accepted connections
                listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(unread_s * 1000))
            listener.bind(target)
            listener.listen(1024)
        except OSError:
            listener.close()
            raise
        return listener


def warn_if_open(addresses: Iterable[Address]) -> None:
    """Print a warning if other machines can reach a service on these addresses."""
    if warning := open_warning(addresses):
        print(warning)


def open_warning(addresses: Iterable[Address]) -> str | None:
    """The warning about a service that other machines can reach, or None."""
    opened = " and ".join(map(str, reachable_addresses(addresses)))
    return (
        f"Open to the network on {opened}: any machine that reaches this one can use this service." if opened else None
    )


def reachable_addresses(addresses: Iterable[Address]) -> list[Address]:
    """The addresses that other machines can reach."""
    return [] if ISOLATED_VARIABLE in os.environ else [address for address in addresses if not address.is_loopback]


def bracket_host(host: str) -> str:
    """A host as written in URLs, with IPv6 addresses in brackets."""
    return f"[{host}]" if ":" in host else host


def parse_host(text: str) -> str | None:
    """The host of `HOST` or `HOST:PORT`, in lower case and without brackets; None if the text is neither."""
    return _name(_HOST, text)


def parse_origin_host(text: str) -> str | None:
    """The host of an origin, `http://HOST:PORT`, as in `parse_host`; None for `null` and other non-origins."""
    return _name(_ORIGIN, text)


def is_address(host: str) -> bool:
    """Whether a host is an IP address, which DNS cannot redirect."""
    return _address(host) is not None


def is_loopback(host: str) -> bool:
    """Whether a host name or address is the loopback interface."""
    address = _address(host)
    return host == "localhost" or host.endswith(".localhost") if address is None else address.is_loopback


def is_network_name(host: str) -> bool:
    """Whether a host name can only be resolved on the local network."""
    return "." not in host or host.endswith(NETWORK_SUFFIXES)


@lru_cache(maxsize=4096)
def client_network(host: str) -> str:
    """Key under which to count a client: its IPv4 address, or the /64 network of its IPv6 address.

    Other text, such as a placeholder in tests, is its own key.
    """
    address = _address(host.partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped is None:
            return str(ipaddress.IPv6Network((address, 64), strict=False))
        address = address.ipv4_mapped
    return host if address is None else str(address)


def _name(pattern: re.Pattern[str], text: str) -> str | None:
    found = pattern.fullmatch(text)
    return found["name"].lower().strip("[]").removesuffix(".") if found else None


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None
