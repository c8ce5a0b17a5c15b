"""Being inside a network namespace: sockets that are made there stay there, and so do threads."""

from __future__ import annotations

import ctypes
import functools
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from tigas_common.topology import WEBTRANSPORT
from tigas_testbed.namespaces import GATEWAY_ADDRESS, Lab, Role

_LIBC = ctypes.CDLL(None, use_errno=True)
_CLONE_NEWNET = 0x40000000
_SO_TIMESTAMPNS = 35
GATEWAY = (GATEWAY_ADDRESS, WEBTRANSPORT.number)
"""Where a client's datagrams go; the gateway leads them to the same port of the service."""
LAYER_2 = 42
"""Bytes that Ethernet, IP and UDP add to a datagram."""
ATTEMPTS, QUIET_WAIT_S = 4, 10
"""Of a measurement on a busy machine, and how long it waits for a quiet one."""


@contextmanager
def inside(lab: Lab, role: Role) -> Iterator[None]:
    """Run this thread in a namespace of the lab, as a context manager."""
    with Path("/proc/thread-self/ns/net").open() as before:
        with Path("/run/netns", lab.namespace(role)).open() as namespace:
            _enter(namespace.fileno())
        try:
            yield
        finally:
            _enter(before.fileno())


def _enter(namespace: int) -> None:
    if _LIBC.setns(namespace, _CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), "setns")


def udp(lab: Lab, role: Role, port: int = 0) -> socket.socket:
    with inside(lab, role):
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("0.0.0.0", port))
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8_000_000)
    made.settimeout(1)
    return made


def server_socket(lab: Lab) -> socket.socket:
    """A UDP socket of the service, the gateway's destination for clients' datagrams."""
    return udp(lab, "service", WEBTRANSPORT.number)


@contextmanager
def thread(work: Callable[[threading.Event], None]) -> Iterator[None]:
    """Run `work` in a thread; it ends when its event is set."""
    stop = threading.Event()
    running = threading.Thread(target=work, args=(stop,))
    running.start()
    try:
        yield
    finally:
        stop.set()
        running.join()


@contextmanager
def echo_server(lab: Lab) -> Iterator[None]:
    """Sends every datagram back, from the service."""
    with server_socket(lab) as server:

        def echo(stop: threading.Event) -> None:
            server.settimeout(0.1)
            while not stop.is_set():
                with suppress(TimeoutError):
                    data, peer = server.recvfrom(2048)
                    server.sendto(data, peer)

        with thread(echo):
            yield


@contextmanager
def flood(lab: Lab, peer: tuple[str, int], sender: socket.socket, rate_kbps: float, size: int) -> Iterator[None]:
    """Sends datagrams of `size` bytes at a steady rate (as tc counts it) until the context ends."""
    packet = bytes(size)
    per_second = rate_kbps * 125 / (size + LAYER_2)

    def send(stop: threading.Event) -> None:
        start, sent = time.monotonic(), 0
        while not stop.is_set():
            due = int((time.monotonic() - start) * per_second)
            for _ in range(min(due - sent, 200)):
                with suppress(OSError):  # the sender's own buffer may be full
                    sender.sendto(packet, peer)
            sent = due
            time.sleep(0.002)

    with thread(send):
        yield


class Receiver:
    """Collects the time (s, of time.monotonic) and size (bytes, layer 2) of every datagram, as the kernel saw them."""

    def __init__(self, lab: Lab) -> None:
        self.socket = udp(lab, "client")
        self.socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self.arrivals: list[tuple[float, int]] = []

    @contextmanager
    def collecting(self) -> Iterator[None]:
        offset = time.clock_gettime(time.CLOCK_REALTIME) - time.monotonic()

        def collect(stop: threading.Event) -> None:
            self.socket.settimeout(0.1)
            while not stop.is_set():
                with suppress(TimeoutError):
                    data, ancillary, _, _ = self.socket.recvmsg(2048, 64)
                    seconds, nanoseconds = struct.unpack("qq", ancillary[0][2])
                    self.arrivals.append((seconds + nanoseconds * 1e-9 - offset, len(data) + LAYER_2))

        with thread(collect):
            yield

    def count(self, payload: int) -> int:
        """Number of datagrams of this size received."""
        return sum(size == payload + LAYER_2 for _, size in self.arrivals)

    def kbps(self, start: float, end: float) -> float:
        """Received rate over a time span, kbit/s."""
        return sum(size for at, size in self.arrivals if start <= at < end) * 8e-3 / (end - start)


def retried_on_a_busy_machine(test: Callable[..., None]) -> Callable[..., None]:
    """Gives a measurement four attempts: on a busy machine one can be wrong, but a wrong link is wrong every time.

    All but the first wait for the machine to be quiet.
    """

    @functools.wraps(test)
    def attempts(*arguments: object, **named: object) -> None:
        for _ in range(ATTEMPTS - 1):
            with suppress(AssertionError):
                return test(*arguments, **named)
            end = time.monotonic() + QUIET_WAIT_S
            while time.monotonic() < end and psutil.cpu_times_percent(0.25).idle < 50:
                pass
        return test(*arguments, **named)

    return attempts
