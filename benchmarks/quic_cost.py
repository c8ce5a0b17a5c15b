"""Processor time of a QUIC connection that sends frames: ours against aioquic's own, without sockets.

    python -m benchmarks.quic_cost [--blocks 10] [--frames 30] [--bytes 23000 197000]

A client of aioquic's requests a frame every 20 ms of a simulated clock and reads it, 1 ms away from either server; only
the servers are timed. They take turns block by block; a block counts with its median, which is robust against other
processes on the machine.
"""

from __future__ import annotations

import argparse
import os
import ssl
import statistics
import time
from datetime import UTC, datetime
from typing import Any

from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.connection import QuicConnection

from benchmarks.frame_cost import interval
from tigas_render.transport.aioquic_ext.congestion import RENO
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.shared_port import Edge

CLIENT, SERVER = ("192.0.2.1", 1000), ("192.0.2.2", 2000)
DELAY = 0.0005
"""One way, in seconds."""
INTERVAL = 0.02
REQUEST = bytes(350)
CERTIFICATE = Certificate.create([], datetime.now(UTC))


class Pair:
    """A client and a server on a simulated clock."""

    def __init__(self, name: str) -> None:
        self.now = 0.0
        self.spent = 0.0
        """Seconds of the server's processor time."""
        self._has_news = False
        """Whether the server has something to send that no datagram has brought."""
        self.client = QuicConnection(
            configuration=QuicConfiguration(
                alpn_protocols=["bench"], verify_mode=ssl.CERT_NONE, max_data=1 << 24, max_stream_data=1 << 24
            )
        )
        self.client.connect(SERVER, now=0.0)
        arguments: dict[str, Any] = {
            "configuration": QuicConfiguration(
                is_client=False,
                alpn_protocols=["bench"],
                certificate=CERTIFICATE.x509,
                private_key=CERTIFICATE.private_key,
                congestion_control_algorithm=RENO if name == "ours" else "reno",
                max_datagram_size=1452,
            ),
            "original_destination_connection_id": self.client.original_destination_connection_id,
        }
        self.server = (
            ServerQuicConnection(edge=Edge(), reset_token=lambda cid: bytes(16), **arguments)
            if name == "ours"
            else QuicConnection(**arguments)
        )
        self.play(until=1.0)

    def frame(self, body: bytes) -> float:
        """Seconds of the server's processor that a frame costs."""
        spent, start = self.spent, self.now
        stream_id = self.client.get_next_available_stream_id()
        self.client.send_stream_data(stream_id, REQUEST, end_stream=True)
        self.play(until=start + 2 * DELAY)
        self.server.send_stream_data(stream_id, body, end_stream=True)
        self._has_news = True
        self.play(until=start + INTERVAL)
        while stream_id in self.client._streams:
            self.play(until=self.now + INTERVAL)
        return self.spent - spent

    def play(self, until: float) -> None:
        """Let time pass, half a round trip at a time."""
        while self.now < until:
            sent = self.client.datagrams_to_send(self.now)
            answers = self._serve([data for data, _ in sent])
            self.now += 2 * DELAY
            for data, _ in answers:
                self.client.receive_datagram(data, SERVER, self.now)
            timer = self.client.get_timer()
            if timer is not None and timer <= self.now:
                self.client.handle_timer(self.now)
            while self.client.next_event() is not None:
                pass

    def _serve(self, datagrams: list[bytes]) -> list[tuple[bytes, Any]]:
        server, now = self.server, self.now + DELAY
        begun = time.thread_time()
        for data in datagrams:
            server.receive_datagram(data, CLIENT, now)
        timer = server.get_timer() if server._network_paths else None
        if timer is not None and timer <= now:
            server.handle_timer(now)
            self._has_news = True
        answers = server.datagrams_to_send(now) if datagrams or self._has_news else []
        self._has_news = False
        self.spent += time.thread_time() - begun
        while server.next_event() is not None:
            pass
        return answers


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--blocks", type=int, default=10)
    parser.add_argument("--frames", type=int, default=30, help="of a block")
    parser.add_argument("--bytes", type=int, nargs="+", default=[23_000, 197_000], help="of a frame")
    arguments = parser.parse_args()
    print(f"µs of the processor a frame, {arguments.blocks} medians of {arguments.frames} frames (95 %)")
    for size in arguments.bytes:
        body = os.urandom(size)
        pairs = {name: Pair(name) for name in ("aioquic", "ours")}
        costs: dict[str, list[float]] = {name: [] for name in pairs}
        for pair in pairs.values():
            for _ in range(arguments.frames):
                pair.frame(body)
        for _ in range(arguments.blocks):
            for name, pair in pairs.items():
                frames = [pair.frame(body) for _ in range(arguments.frames)]
                costs[name].append(statistics.median(frames) * 1e6)
        for name, each in costs.items():
            print(f"{size:9,} bytes  {name:7} {interval(each)}")
        ratios = [ours / stock for ours, stock in zip(costs["ours"], costs["aioquic"], strict=True)]
        print(f"{size:9,} bytes  ratio   {interval(ratios)}", flush=True)


if __name__ == "__main__":
    main()
