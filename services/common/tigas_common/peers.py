"""Facts about the sender of a request: its network, and the request's arrival time."""

from __future__ import annotations

import ipaddress
from functools import lru_cache

ARRIVED = "arrived"
"""Key of the request's arrival time in an ASGI scope's `state`, in seconds of the monotonic clock."""


@lru_cache(maxsize=4096)
def client_network(host: str) -> str:
    """Key for counting an address: an IPv4 address itself, the /64 of an IPv6 address.

    Other text, such as a test's placeholder, is its own key.
    """
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped is None:
            return str(ipaddress.IPv6Network((address, 64), strict=False))
        address = address.ipv4_mapped
    return str(address)
