"""The router hop: forwards the services' ports from the access side to the service side while its gate is open.

Everything is in one nftables table, owned by the `nft` process that this module talks to: the kernel removes the table
when that process ends, and the process ends with ours, so that even a kill leaves no forwarding behind. (`fwd` is a
reserved word of nft, hence the names of chains.)
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tigas_common.errors import StartError
from tigas_shaper.link.commands import MARK, Channel, CommandError, Interface, try_run
from tigas_shaper.link.link import DOWN_DEVICE, UP_DEVICE

TABLE = "tigas_shaper"
IP_FORWARD = Path("/proc/sys/net/ipv4/ip_forward")


@dataclass(frozen=True, slots=True)
class Forward:
    """A port of the gateway, and its destination."""

    protocol: Literal["tcp", "udp"]
    port: int
    host: ipaddress.IPv4Address
    host_port: int

    @classmethod
    def parse(cls, text: str) -> Forward:
        """Read `tcp:PORT=HOST:PORT` or `udp:PORT=HOST:PORT`, and resolve the host's name.

        Raises ValueError with one sentence.
        """
        left, _, right = text.partition("=")
        protocol, _, port = left.partition(":")
        host, _, host_port = right.rpartition(":")
        if protocol not in ("tcp", "udp") or not host or not all(map(_is_port, (port, host_port))):
            raise ValueError(f"{text!r} is not tcp:PORT=HOST:PORT or udp:PORT=HOST:PORT")
        try:
            address = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM)[0][4][0]
        except (OSError, UnicodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "it is not a host name"
            raise ValueError(f"{host} has no IPv4 address ({reason})") from None
        return cls("tcp" if protocol == "tcp" else "udp", int(port), ipaddress.IPv4Address(address), int(host_port))


class Gateway:
    """Forwards while its gate is open; initially closed."""

    def __init__(self, nft: Channel) -> None:
        self._nft = nft

    @classmethod
    @asynccontextmanager
    async def open(cls, access: Interface, service: Interface, forwards: Sequence[Forward]) -> AsyncIterator[Gateway]:
        """A closed gateway, as a context manager. Raises StartError and CommandError."""
        async with AsyncExitStack() as stack:
            stack.enter_context(_enable_forwarding())
            nft = await stack.enter_async_context(Channel.open(("nft", "-i"), "Error:"))
            nft.write(*make_rules(access, service, forwards))
            await nft.ask("list tables ip", f"table ip {TABLE}")
            yield cls(nft)

    def open_gate(self) -> None:
        """Let packets pass. Raises CommandError."""
        self._nft.write(f"flush chain ip {TABLE} gate")

    def close_gate(self) -> None:
        with suppress(CommandError):  # once the tool has ended, its table is gone and nothing is forwarded
            self._nft.write(f"add rule ip {TABLE} gate drop")

    async def close(self) -> None:
        """Close the gate, and return once it is closed."""
        self.close_gate()
        with suppress(CommandError):
            await self.check()

    async def check(self) -> None:
        """Raise CommandError if the rules are gone."""
        await self._nft.ask("list tables ip", f"table ip {TABLE}")


def make_rules(access: Interface, service: Interface, forwards: Sequence[Forward]) -> list[str]:
    """The table, as lines for `nft -i`."""
    table = f"ip {TABLE}"
    into = f'iifname "{access}" oifname "{service}"'
    back = f'iifname "{service}" oifname "{access}"'
    return [
        f"add table {table} {{ flags owner; }}",
        f"add chain {table} gate",
        f"add rule {table} gate drop",
        f"add chain {table} incoming {{ type nat hook prerouting priority dstnat; }}",
        *(
            f'add rule {table} incoming iifname "{access}" fib daddr type local {entry.protocol} dport {entry.port} '
            f"dnat to {entry.host}:{entry.host_port}"
            for entry in forwards
        ),
        f"add chain {table} outgoing {{ type nat hook postrouting priority srcnat; }}",
        f"add rule {table} outgoing {into} ct status dnat masquerade",
        f"add chain {table} crossing {{ type filter hook forward priority filter; }}",
        f"add rule {table} crossing {into} jump gate",
        f"add rule {table} crossing {back} jump gate",
        f"add rule {table} crossing {into} ct status dnat meta mark set {MARK} accept",
        f"add rule {table} crossing {back} ct status dnat meta mark set {MARK} accept",
        f"add rule {table} crossing {into} drop",
        f"add rule {table} crossing {back} drop",
    ]


async def remove_leftovers(interfaces: Sequence[Interface]) -> None:
    """Remove what a killed shaper has left behind."""
    for interface in interfaces:
        await try_run("tc", "qdisc", "del", "dev", interface, "clsact")
        await try_run("tc", "qdisc", "del", "dev", interface, "root", "handle", "2:")
    for device in (DOWN_DEVICE, UP_DEVICE):
        await try_run("ip", "link", "del", device)


@contextmanager
def shaper_lock() -> Iterator[None]:
    """Hold the lock on shaping in this network namespace, as a context manager. Raises StartError if another shaper
    holds it.

    The lock is a Unix socket in the abstract namespace: it belongs to the network namespace, like links, and disappears
    with its process in any case.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as lock:
        try:
            lock.bind("\0tigas-shaper")
        except OSError:
            raise StartError("Another shaper is already running on this network; stop it first.") from None
        yield


@contextmanager
def _enable_forwarding() -> Iterator[None]:
    """Make the kernel forward IPv4 packets during the context."""
    before = IP_FORWARD.read_text().strip()
    if before == "1":
        yield
        return
    try:
        IP_FORWARD.write_text("1")
    except OSError:
        raise StartError(
            "The kernel does not forward packets here, and the shaper may not change that: set net.ipv4.ip_forward=1 "
            "(for a container, under `sysctls`)."
        ) from None
    try:
        yield
    finally:
        IP_FORWARD.write_text(before)


def _is_port(text: str) -> bool:
    return text.isascii() and text.isdecimal() and 0 < int(text) < 65536
