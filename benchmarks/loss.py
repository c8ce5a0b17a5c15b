"""Latency of frames over a bottleneck, by congestion controller: the real sender on a simulated clock, without sockets.

    python -m benchmarks.loss [--case 1pct-100ms …] [--controller westwood …] [--seeds 3] [--seconds 20]

A client of aioquic's requests frames of one size at a fixed rate, with as many requests in flight as a round trip
needs. Latency is from the request to the frame's last byte. Packets are lost at random in both directions, and where
the bottleneck's queue is full. `bulk` is a download beside the frames, with NewReno or aioquic's CUBIC.
"""

from __future__ import annotations

import argparse
import heapq
import itertools
import math
import os
import random
import ssl
import statistics
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from typing import Any

from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.connection import QuicConnection
from aioquic.quic.events import StreamDataReceived

from tigas_render.transport.aioquic_ext.congestion import RENO
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection
from tigas_render.transport.aioquic_ext.westwood import WESTWOOD
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.shared_port import Edge

CUBIC = "cubic"
CONTROLLERS = {"reno": RENO, "westwood": WESTWOOD}
CERTIFICATE = Certificate.create([], datetime.now(UTC))
CLIENT, SERVER = ("192.0.2.1", 1000), ("192.0.2.2", 2000)
HEADERS = 28
"""Bytes of UDP and IPv4 headers."""
REQUEST = 350
"""Bytes of a request for a frame."""
WARM_UP_S = 3.0


@dataclass(frozen=True)
class Case:
    """A bottleneck and the frames that cross it."""

    mbps: float
    rtt_ms: float
    loss: float
    """Share of packets, in each direction."""
    queue_ms: float
    frame: int
    """Bytes."""
    bulk: str | None = None
    """Congestion controller of a download beside the frames."""


CASES = {
    "20M-100ms-1%": Case(20, 100, 0.01, 100, 25_000),
    "5M-100ms-1%": Case(5, 100, 0.01, 100, 9_000),
    "4M-100ms-1%-overload": Case(4, 100, 0.01, 100, 20_000),
    "20M-100ms-3%": Case(20, 100, 0.03, 100, 25_000),
    "20M-20ms-1%": Case(20, 20, 0.01, 50, 50_000),
    "20M-100ms": Case(20, 100, 0, 100, 25_000),
    "5M-20ms-deep": Case(5, 20, 0, 500, 15_000),
    "5M-20ms-deep-overload": Case(5, 20, 0, 500, 25_000),
    "10M-40ms-shallow-overload": Case(10, 40, 0, 30, 50_000),
    "10M-40ms-policer": Case(10, 40, 0, 4, 25_000),
    "10M-40ms-beside-bulk": Case(10, 40, 0, 200, 12_000, bulk=RENO),
    "10M-40ms-saturating-beside-bulk": Case(10, 40, 0, 200, 60_000, bulk=RENO),
    "10M-40ms-beside-cubic": Case(10, 40, 0, 200, 12_000, bulk=CUBIC),
    "10M-40ms-saturating-beside-cubic": Case(10, 40, 0, 200, 60_000, bulk=CUBIC),
    "20M-100ms-saturating-beside-cubic": Case(20, 100, 0, 100, 100_000, bulk=CUBIC),
}
FPS = 30


class Link:
    """One direction: a rate, a queue in bytes, a delay and random loss."""

    def __init__(self, mbps: float, delay: float, loss: float, queue_ms: float, random_source: random.Random) -> None:
        self._rate = mbps * 1e6 / 8
        self._delay = delay
        self._loss = loss
        self._queue = max(3 * 1500.0, self._rate * queue_ms / 1000)
        self._random = random_source
        self._free_at = 0.0

    def arrival(self, now: float, size: int) -> float | None:
        """When a packet arrives, if it does."""
        if max(0.0, self._free_at - now) * self._rate + size > self._queue:
            return None
        self._free_at = max(self._free_at, now) + size / self._rate
        return None if self._random.random() < self._loss else self._free_at + self._delay


@dataclass
class Flow:
    """A client, its server, and the received bytes and latencies (seconds)."""

    client: QuicConnection
    server: QuicConnection
    answer: Callable[[QuicConnection, int], None]
    latencies: list[float] = field(default_factory=list)
    received: int = 0
    waiting: dict[int, float] = field(default_factory=dict)


class Simulation:
    """Plays flows over a bottleneck."""

    def __init__(self, case: Case, controller: str, seed: int) -> None:
        source = random.Random(seed)
        delay = case.rtt_ms / 2000
        self._case = case
        self._down = Link(case.mbps, delay, case.loss, case.queue_ms, source)
        self._up = Link(10, delay, case.loss, 1000, source)
        self._events: list[tuple[float, int, Callable[[float], None]]] = []
        self._order = itertools.count()
        self.frames = self._flow(CONTROLLERS[controller], os.urandom(case.frame))
        self.bulk = self._flow(case.bulk, bytes(60_000_000)) if case.bulk else None

    def run(self, seconds: float) -> None:
        """Play from the handshake on."""
        self._at(1.0, self._request_frame)
        if self.bulk is not None:
            bulk = self.bulk
            self._at(1.0, lambda now: self._request(bulk, now))
        while self._events and self._events[0][0] <= seconds:
            now, _, event = heapq.heappop(self._events)
            event(now)

    def _at(self, time: float, event: Callable[[float], None]) -> None:
        heapq.heappush(self._events, (time, next(self._order), event))

    def _flow(self, controller: str, body: bytes) -> Flow:
        settings: dict[str, Any] = {"alpn_protocols": ["bench"], "idle_timeout": 600}
        client = QuicConnection(
            configuration=QuicConfiguration(
                verify_mode=ssl.CERT_NONE, max_data=1 << 30, max_stream_data=1 << 28, **settings
            )
        )
        client.connect(SERVER, now=0.0)
        ours = partial(ServerQuicConnection, edge=Edge(), reset_token=lambda cid: bytes(16))
        server = (QuicConnection if controller == CUBIC else ours)(
            configuration=QuicConfiguration(
                is_client=False,
                certificate=CERTIFICATE.x509,
                private_key=CERTIFICATE.private_key,
                max_datagram_size=1452,
                congestion_control_algorithm=controller,
                **settings,
            ),
            original_destination_connection_id=client.original_destination_connection_id,
        )
        flow = Flow(client, server, lambda quic, stream: quic.send_stream_data(stream, body, end_stream=True))
        self._at(0.0, lambda now: self._send(flow, client, now))
        return flow

    def _request_frame(self, now: float) -> None:
        if len(self.frames.waiting) < math.ceil(self._case.rtt_ms / 1000 * FPS) + 3:
            self._request(self.frames, now)
        self._at(now + 1 / FPS, self._request_frame)

    def _request(self, flow: Flow, now: float) -> None:
        stream = flow.client.get_next_available_stream_id()
        flow.client.send_stream_data(stream, bytes(REQUEST), end_stream=True)
        flow.waiting[stream] = now
        self._send(flow, flow.client, now)

    def _send(self, flow: Flow, sender: QuicConnection, now: float) -> None:
        is_client = sender is flow.client
        receiver, link, source = (flow.server, self._up, CLIENT) if is_client else (flow.client, self._down, SERVER)
        for data, _ in sender.datagrams_to_send(now):
            if (arrival := link.arrival(now, len(data) + HEADERS)) is not None:
                self._at(arrival, lambda at, data=data: self._receive(flow, receiver, data, source, at))  # type: ignore[misc]
        if (timer := sender.get_timer()) is not None:
            self._at(max(timer, now) + 1e-6, lambda at: self._expire(flow, sender, at))

    def _receive(self, flow: Flow, receiver: QuicConnection, data: bytes, source: Any, now: float) -> None:
        receiver.receive_datagram(data, source, now)
        self._react(flow, receiver, now)

    def _expire(self, flow: Flow, connection: QuicConnection, now: float) -> None:
        if (timer := connection.get_timer()) is not None and timer <= now:
            connection.handle_timer(now)
            self._react(flow, connection, now)

    def _react(self, flow: Flow, connection: QuicConnection, now: float) -> None:
        while (event := connection.next_event()) is not None:
            if not isinstance(event, StreamDataReceived):
                continue
            if connection is flow.client:
                flow.received += len(event.data)
                if event.end_stream and (begun := flow.waiting.pop(event.stream_id)) > WARM_UP_S:
                    flow.latencies.append(now - begun)
            elif event.end_stream:
                flow.answer(connection, event.stream_id)
        self._send(flow, connection, now)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--case", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--controller", nargs="+", choices=CONTROLLERS, default=list(CONTROLLERS))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20)
    arguments = parser.parse_args()
    print(f"{'case':32} {'controller':10} {'p50':>6} {'p95':>6} {'p99 ms':>7} {'frames/s':>8}  bulk Mbit/s")
    for name in arguments.case:
        for controller in arguments.controller:
            latencies: list[float] = []
            rates: list[float] = []
            bulk: list[float] = []
            for seed in range(arguments.seeds):
                simulation = Simulation(CASES[name], controller, seed)
                simulation.run(arguments.seconds)
                latencies += simulation.frames.latencies
                rates.append(len(simulation.frames.latencies) / (arguments.seconds - WARM_UP_S))
                if simulation.bulk is not None:
                    bulk.append(simulation.bulk.received * 8e-6 / (arguments.seconds - 1))
            *_, p99 = quantiles = statistics.quantiles([1000 * each for each in latencies], n=100)
            share = f"{statistics.mean(bulk):10.1f}" if bulk else ""
            print(
                f"{name:32} {controller:10} {quantiles[49]:6.0f} {quantiles[94]:6.0f} {p99:7.0f}"
                f" {statistics.mean(rates):8.1f}  {share}",
                flush=True,
            )


if __name__ == "__main__":
    main()
