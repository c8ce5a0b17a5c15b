"""A UDP socket on the event loop: drains received datagrams at once, sends in batches, waits when it is full."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import time
from collections import deque
from collections.abc import Callable, Iterable

from tigas_render.transport.arrival import STAMP_SPACE, arrival, ask_for_stamps, stamp_ns
from tigas_render.transport.gso import Address, Datagram, batches, segment_size

logger = logging.getLogger(__name__)

SOCKET_BUFFER = 8 << 20
"""Requested socket buffer of each direction in bytes; the kernel applies its own limits."""
DRAIN_S = 0.0005
"""Seconds of reading datagrams before other work gets its turn."""
MAX_BACKLOG, MAX_BACKLOG_S = 4096, 1.0
"""Batches that wait for room in the socket, and for how many seconds; older ones are dropped, which QUIC treats as
loss.
"""
MAX_DATAGRAM = 65_535
SO_RCVBUFFORCE, SO_SNDBUFFORCE = 33, 32

BATCH_REFUSED = frozenset((errno.EINVAL, errno.EIO, errno.EMSGSIZE, errno.ENOPROTOOPT, errno.EOPNOTSUPP))
"""Errors of a kernel that cannot cut a batch: an old kernel, a device without checksums, IPsec, or a small path MTU,
which is EMSGSIZE from Linux 6.14 on and EINVAL before."""
BATCHES_AGAIN_S, MOST_REFUSED = 60.0, 1024
"""Seconds for which an address gets single datagrams after a refused batch, and how many addresses are remembered."""

NO_IPV6 = (errno.EAFNOSUPPORT, errno.EADDRNOTAVAIL)
"""Kernel errors for an IPv6 address on a machine without IPv6."""


def bind_all(host: str, port: int) -> list[socket.socket]:
    """The sockets of a port: for `localhost` those of 127.0.0.1 and, if there is IPv6, ::1, since QUIC does not fall
    back from one to the other; otherwise the result of `bind`.
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
    """A non-blocking UDP socket. `::` is dual-stack; without IPv6 it becomes 0.0.0.0.

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


def bind_another(sock: socket.socket) -> socket.socket:
    """Another socket of the same address; the kernel divides datagrams between them.

    The first one was bound exclusively, so that the port belongs to us.
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
        ask_for_stamps(sock)
        sock.bind(address)
    except BaseException:
        sock.close()
        raise
    return sock


class UdpEndpoint:
    """Sends and receives on one socket, which it owns from now on."""

    def __init__(
        self,
        sock: socket.socket,
        received: Callable[[bytes, Address, float], None],
        drained: Callable[[], None],
        refused: Callable[[], None] = lambda: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`received` gets each datagram, its sender, and its arrival in seconds of the monotonic clock.

        `drained` is called when no more wait, to answer them all at once; `refused` for each batch that the kernel does
        not take.
        """
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._received = received
        self._drained = drained
        self._refused = refused
        self._clock = clock
        self._backlog: deque[tuple[list[bytes], Address, float]] = deque(maxlen=MAX_BACKLOG)
        """Includes arrival times."""
        self._singly_until: dict[Address, float] = {}
        """Retry times of addresses with batches refused by the kernel, in order."""
        self._empty_at = time.monotonic()
        self._loop.add_reader(sock.fileno(), self._read)

    def send(self, datagrams: list[Datagram]) -> None:
        """Send now, or as soon as the socket has room. Batches refused by the network are dropped."""
        pending = batches(datagrams)
        if self._backlog:
            self._wait(pending)
            return
        for batch, address in pending:
            if not self._send(batch, address):
                self._wait([(batch, address), *pending])
                self._loop.add_writer(self._sock.fileno(), self._flush)

    def close(self) -> None:
        """Close the socket; waiting batches are dropped."""
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
                data, ancillary, _, address = self._sock.recvmsg(MAX_DATAGRAM, STAMP_SPACE)
                now = time.monotonic()
                self._received(data, address, arrival(stamp_ns(ancillary), time.time_ns(), now, self._empty_at))
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
        """Send a batch; False if the socket is full."""
        if len(batch) > 1 and self._takes_batches(address):
            try:
                self._sock.sendmsg(batch, segment_size(batch), 0, address)
            except (BlockingIOError, InterruptedError):
                return False
            except OSError as error:
                if error.errno not in BATCH_REFUSED:
                    logger.debug("UDP send to %s failed: %s", address, error)
                    return True
                self._refuse(address)
            else:
                return True
        return self._send_singly(batch, address)

    def _takes_batches(self, address: Address) -> bool:
        until = self._singly_until.get(address)
        if until is None:
            return True
        if until > self._clock():
            return False
        del self._singly_until[address]
        return True

    def _refuse(self, address: Address) -> None:
        """Send the address single datagrams for some time: its path probably refuses batches."""
        self._refused()
        if len(self._singly_until) >= MOST_REFUSED:
            del self._singly_until[next(iter(self._singly_until))]
        self._singly_until[address] = self._clock() + BATCHES_AGAIN_S

    def _send_singly(self, batch: list[bytes], address: Address) -> bool:
        while batch:
            try:
                self._sock.sendto(batch[0], address)
            except (BlockingIOError, InterruptedError):
                return False
            except OSError as error:
                logger.debug("UDP send to %s failed: %s", address, error)
            del batch[0]
        return True
