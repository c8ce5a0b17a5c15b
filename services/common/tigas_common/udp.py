"""A UDP socket on the event loop: reads all waiting datagrams at once, sends in batches, and waits while it is full.

Sending dominates a Python QUIC server's time in the kernel, so datagrams of one size to one address leave in a single
system call (segmentation offload, udp(7) on Linux). Received ones carry the kernel's timestamp (SO_TIMESTAMPNS,
socket(7)): under load a datagram waits longest in the socket, and deadlines include that time. Answers leave from the
address to which the client wrote (ip(7), ipv6(7)): a machine may have several, and browsers drop answers from others.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import socket
import struct
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

logger = logging.getLogger(__name__)

Address = tuple[Any, ...]
Datagram = tuple[bytes, Address]
Ancillary = tuple[int, int, bytes]
"""A control message: level, kind and data."""


class Peer(Address):
    """A sender's address, with the local address to which it wrote and from which answers leave."""

    reply_ancillary: tuple[Ancillary, ...] = ()
    """The control message that selects the local address."""


SOCKET_BUFFER = 8 << 20
"""Requested socket buffer of each direction in bytes; the kernel applies its own limits."""
DRAIN_S = 0.0005
"""Seconds of reading datagrams before other work gets a turn."""
MAX_BACKLOG, MAX_BACKLOG_S = 4096, 1.0
"""Maximum number of batches waiting for room in the socket, and their maximum age in seconds. Older ones are dropped,
which QUIC treats as loss.
"""
MAX_DATAGRAM = 65_535
SO_RCVBUFFORCE, SO_SNDBUFFORCE = 33, 32

SO_TIMESTAMPNS = 35
"""Socket option and control message of Linux."""
_TIMESPEC = struct.Struct("@ll")

IP_PKTINFO, IPV6_RECVPKTINFO, IPV6_PKTINFO = 8, 49, 50
"""Constants of Linux."""
_PKTINFO = struct.Struct("@i4s4s")
"""Interface, local address for answers, and destination address in the header."""
_PKTINFO6 = struct.Struct("@16si")
ANCILLARY_SPACE = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_PKTINFO6.size)
"""Space for received control messages, in bytes."""

SOL_UDP, UDP_SEGMENT = 17, 103
MAX_SEGMENTS = 40
"""Below the kernel's limit, 64 in older kernels (UDP_MAX_SEGMENTS)."""
MAX_BATCH = 64_000
"""Bytes; to the kernel, a batch is one UDP payload until it is cut into segments."""
BATCH_REFUSED = frozenset((errno.EINVAL, errno.EIO, errno.EMSGSIZE, errno.ENOPROTOOPT, errno.EOPNOTSUPP))
"""Errors of a kernel that cannot cut a batch: an old kernel, a device without checksums, IPsec, or a small path MTU.
The latter is EMSGSIZE from Linux 6.14 on and EINVAL before."""
BATCH_RETRY_S, MAX_REFUSED = 60.0, 1024
"""Seconds for which an address gets single datagrams after a refused batch, and the number of addresses remembered."""

NO_IPV6 = (errno.EAFNOSUPPORT, errno.EADDRNOTAVAIL)
"""Kernel errors for an IPv6 address on a machine without IPv6."""


def bind_all(host: str, port: int) -> list[socket.socket]:
    """The sockets of a port, from `bind`. For `localhost` they are 127.0.0.1 and, with IPv6, ::1, as QUIC does not fall
    back from one to the other.
    """
    if host != "localhost":
        return [bind(host, port)]
    sockets = [bind("127.0.0.1", port)]
    try:
        sockets.append(bind("::1", sockets[0].getsockname()[1]))
    except OSError as error:
        if error.errno not in NO_IPV6:
            sockets[0].close()
            raise
    return sockets


def bind(host: str, port: int) -> socket.socket:
    """A non-blocking UDP socket. `::` is dual-stack, and becomes 0.0.0.0 on a machine without IPv6.

    Raises OSError if the address cannot be bound, and socket.gaierror (an OSError) if the host is unknown.
    """
    if host == "::":
        try:
            return _bind(socket.AF_INET6, ("::", port, 0, 0))
        except OSError as error:
            if error.errno not in NO_IPV6:
                raise
            host = "0.0.0.0"
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    return _bind(family, address)


def bind_shared(sock: socket.socket) -> socket.socket:
    """Another socket with the same address; the kernel distributes datagrams among them.

    The first one was bound exclusively, so the port belongs to us.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    return _bind(sock.family, sock.getsockname(), shared=True)


def _bind(family: int, address: Address, *, shared: bool = False) -> socket.socket:
    sock = socket.socket(family, socket.SOCK_DGRAM)
    try:
        sock.setblocking(False)
        if shared:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        if family == socket.AF_INET6:
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        for forced, option in ((SO_SNDBUFFORCE, socket.SO_SNDBUF), (SO_RCVBUFFORCE, socket.SO_RCVBUF)):
            try:
                sock.setsockopt(socket.SOL_SOCKET, forced, SOCKET_BUFFER)  # needs CAP_NET_ADMIN
            except OSError:
                sock.setsockopt(socket.SOL_SOCKET, option, SOCKET_BUFFER)
        enable_timestamps(sock)
        if address[0] in ("0.0.0.0", "::"):
            _enable_destinations(sock)
        sock.bind(address)
    except BaseException:
        sock.close()
        raise
    return sock


class UdpEndpoint:
    """Sends and receives on one socket, of which it takes ownership."""

    def __init__(
        self,
        sock: socket.socket,
        received: Callable[[bytes, Address, float], None],
        drained: Callable[[], None],
        refused: Callable[[], None] = lambda: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """received: gets each datagram, its sender, and its arrival in seconds of the monotonic clock.

        drained: called when no more datagrams wait, to answer them all at once. refused: called for each batch that the
        kernel refuses.
        """
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._received = received
        self._drained = drained
        self._refused = refused
        self._clock = clock
        self._backlog: deque[tuple[list[bytes], Address, float]] = deque(maxlen=MAX_BACKLOG)
        """Batches waiting for room in the socket, with the time since when they wait."""
        self._singly_until: dict[Address, float] = {}
        """When to try batches again, for addresses with refused batches, in order."""
        self._empty_at = time.monotonic()
        self._loop.add_reader(sock.fileno(), self._read)

    def send(self, datagrams: list[Datagram]) -> None:
        """Send now, or as soon as the socket has room. Datagrams refused by the network are dropped."""
        pending = group_datagrams(datagrams)
        if self._backlog:
            self._wait(pending)
            return
        for batch, address in pending:
            if not self._send(batch, address):
                self._wait([(batch, address), *pending])
                self._loop.add_writer(self._sock.fileno(), self._flush)

    def close(self) -> None:
        """Close the socket and drop waiting batches."""
        fd = self._sock.fileno()
        if fd < 0:
            return
        self._loop.remove_reader(fd)
        self._loop.remove_writer(fd)
        self._sock.close()
        self._backlog.clear()

    def _read(self) -> None:
        try:
            until = (now := time.monotonic()) + DRAIN_S
            while now < until:
                data, ancillary, _, address = self._sock.recvmsg(MAX_DATAGRAM, ANCILLARY_SPACE)
                now = time.monotonic()
                stamp = kernel_timestamp_ns(ancillary)
                self._received(
                    data, sender_address(address, ancillary), arrival_time(stamp, time.time_ns(), now, self._empty_at)
                )
        except BlockingIOError:
            self._empty_at = time.monotonic()
        except InterruptedError:
            pass
        except OSError as error:  # such as an ICMP error for an earlier datagram
            logger.debug("UDP receive failed: %s", error)
        self._drained()

    def _wait(self, pending: Iterable[tuple[list[bytes], Address]]) -> None:
        now = time.monotonic()
        self._backlog.extend((batch, address, now) for batch, address in pending)

    def _flush(self) -> None:
        oldest = time.monotonic() - MAX_BACKLOG_S
        while self._backlog:
            batch, address, since = self._backlog[0]
            if since >= oldest and not self._send(batch, address):
                return
            self._backlog.popleft()
        self._loop.remove_writer(self._sock.fileno())

    def _send(self, batch: list[bytes], address: Address) -> bool:
        """Send a batch. Returns False if the socket is full."""
        if len(batch) > 1 and self._can_batch(address):
            try:
                self._sock.sendmsg(batch, (*segment_size_message(batch), *reply_ancillary(address)), 0, address)
            except (BlockingIOError, InterruptedError):
                return False
            except OSError as error:
                if error.errno not in BATCH_REFUSED:
                    logger.debug("UDP send to %s failed: %s", address, error)
                    return True
                self._disable_batches(address)
            else:
                return True
        return self._send_singly(batch, address)

    def _can_batch(self, address: Address) -> bool:
        until = self._singly_until.get(address)
        if until is None:
            return True
        if until > self._clock():
            return False
        del self._singly_until[address]
        return True

    def _disable_batches(self, address: Address) -> None:
        """Send single datagrams to an address for some time, as its path probably refuses batches."""
        self._refused()
        if len(self._singly_until) >= MAX_REFUSED:
            del self._singly_until[next(iter(self._singly_until))]
        self._singly_until[address] = self._clock() + BATCH_RETRY_S

    def _send_singly(self, batch: list[bytes], address: Address) -> bool:
        while batch:
            try:
                self._sock.sendmsg(batch[:1], reply_ancillary(address), 0, address)
            except (BlockingIOError, InterruptedError):
                return False
            except OSError as error:
                logger.debug("UDP send to %s failed: %s", address, error)
            del batch[0]
        return True


def group_datagrams(datagrams: Sequence[Datagram]) -> Iterator[tuple[list[bytes], Address]]:
    """Group consecutive datagrams that may leave in one call: same address and size; only the last may be shorter."""
    start = 0
    while start < len(datagrams):
        first, address = datagrams[start]
        size = total = len(first)
        stop = start + 1
        while stop < len(datagrams) and stop - start < MAX_SEGMENTS:
            data, to = datagrams[stop]
            if to != address or len(data) > size or total + len(data) > MAX_BATCH:
                break
            total += len(data)
            stop += 1
            if len(data) < size:
                break
        yield [data for data, _ in datagrams[start:stop]], address
        start = stop


def segment_size_message(batch: Sequence[bytes]) -> list[Ancillary]:
    """The control message with the segment size of a batch."""
    return [(SOL_UDP, UDP_SEGMENT, struct.pack("=H", len(batch[0])))]


def enable_timestamps(sock: socket.socket) -> None:
    """Enable the kernel's timestamps, where available."""
    with contextlib.suppress(OSError):
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)


def _enable_destinations(sock: socket.socket) -> None:
    """Enable destination addresses on a socket bound to all addresses, where available."""
    if sys.platform != "linux":
        return
    level, option = (
        (socket.IPPROTO_IPV6, IPV6_RECVPKTINFO) if sock.family == socket.AF_INET6 else (socket.IPPROTO_IP, IP_PKTINFO)
    )
    with contextlib.suppress(OSError):
        sock.setsockopt(level, option, 1)


def sender_address(address: Address, ancillary: Sequence[Ancillary]) -> Address:
    """A datagram's sender, with the local address to which it wrote if the control messages include it."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.IPPROTO_IP, IP_PKTINFO) and len(data) == _PKTINFO.size:
            _, ours, _ = _PKTINFO.unpack(data)
            info = _PKTINFO.pack(0, ours, bytes(4))  # the routing table chooses the interface
        elif (level, kind) == (socket.IPPROTO_IPV6, IPV6_PKTINFO) and len(data) == _PKTINFO6.size:
            ours, _ = _PKTINFO6.unpack(data)
            info = _PKTINFO6.pack(ours, 0)
        else:
            continue
        address = Peer(address)
        address.reply_ancillary = ((level, kind, info),)
        return address
    return address


def reply_ancillary(address: Address) -> tuple[Ancillary, ...]:
    """Control messages for datagrams to an address."""
    return address.reply_ancillary if isinstance(address, Peer) else ()


def kernel_timestamp_ns(ancillary: Sequence[Ancillary]) -> int | None:
    """The kernel timestamp in a datagram's control messages, in nanoseconds of the real-time clock."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, SO_TIMESTAMPNS) and len(data) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            return int(seconds) * 1_000_000_000 + int(nanoseconds)
    return None


def arrival_time(stamp: int | None, real_ns: int, now: float, empty_at: float) -> float:
    """Arrival of a datagram, in seconds of the monotonic clock.

    real_ns, now: the two clocks, read together. empty_at: when the socket was last seen empty, a lower bound for
    anything read now, even if the real-time clock was stepped since.
    """
    if stamp is None:
        return now
    return min(now, max(empty_at, now - (real_ns - stamp) / 1e9))
