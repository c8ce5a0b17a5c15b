"""What a service knows of whoever sends it a request: the network that it is from, and when the request arrived."""

from __future__ import annotations

import ipaddress
from functools import lru_cache

ARRIVED = "arrived"
"""Where an ASGI scope's `state` says when a request arrived, in seconds of the monotonic clock."""


@lru_cache(maxsize=4096)
def client_network(host: str) -> str:
    """Whom to count an address with: an IPv4 address stands for itself, an IPv6 address for its /64.

    What is no address, such as a test's stand-in for one, stands for itself, too.
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
