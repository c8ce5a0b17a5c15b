"""Where a server listens: HOST:PORT."""

from __future__ import annotations

import ipaddress
import re
import socket
from dataclasses import dataclass


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
            raise ValueError(f"{text!r} has no host; to listen on every address write 0.0.0.0:{port}")
        return cls(host, int(port))

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    @property
    def reachable_host(self) -> str:
        """A host name under which this machine reaches itself, for URLs shown to people."""
        try:
            unspecified = ipaddress.ip_address(self.host).is_unspecified
        except ValueError:
            return self.host
        if unspecified or ipaddress.ip_address(self.host).is_loopback:
            return "localhost"
        return f"[{self.host}]" if ":" in self.host else self.host

    def listen(self, unread_s: float) -> socket.socket:
        """A TCP socket that listens here.

        A peer that takes nothing of what is sent to it for `unread_s` seconds loses its connection (on Linux).
        Raises OSError.
        """
        family, kind, protocol, _, target = socket.getaddrinfo(
            self.host, self.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listener = socket.socket(family, kind, protocol)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if hasattr(socket, "TCP_USER_TIMEOUT"):  # connections that are accepted inherit it
                listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(unread_s * 1000))
            listener.bind(target)
            listener.listen(1024)
        except OSError:
            listener.close()
            raise
        return listener
