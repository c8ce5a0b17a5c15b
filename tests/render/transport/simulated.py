"""A client's and our server's QUIC connection in one process, on a simulated clock and a network that a test spoils."""

from __future__ import annotations

import random
import ssl
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.connection import QuicConnection
from aioquic.quic.events import DatagramFrameReceived, QuicEvent, StreamDataReceived

from tests.render.transport.client import CERTIFICATE
from tigas_render.transport.aioquic_ext.congestion import RENO
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection
from tigas_render.transport.shared_port import Edge

CLIENT, SERVER = ("192.0.2.1", 1000), ("192.0.2.2", 2000)
DELAY = 0.02
"""One way, in seconds."""
TIMER_SLACK = 1e-6
"""Timers fire a little late, as real ones do: aioquic's sums of floats may not be due at the exact moment."""

Drop = Callable[[str, bytes], bool]
"""Whether the network loses a datagram; called with the sender (`client`, `server`) and the bytes."""


class Simulation:
    """Call `run` after every change; it plays until both ends are quiet, or until a given time."""

    def __init__(self, reset_delay: Callable[[float], float] = lambda now: 0.0, congestion_control: str = RENO) -> None:
        self.now = 0.0
        self.address = CLIENT
        """Where the client's datagrams come from."""
        self.drop: Drop = lambda sender, data: False
        self.sent: list[tuple[float, str, int]] = []
        """(time, sender, bytes) of every datagram, the lost ones too."""
        self.streams: dict[int, bytearray] = defaultdict(bytearray)
        """Received by the client, as are `ended` streams, in order, and datagrams."""
        self.ended: list[int] = []
        self.datagrams: list[bytes] = []
        self.uploads: dict[int, bytearray] = defaultdict(bytearray)
        """Received by the server."""
        common: dict[str, Any] = {"alpn_protocols": ["test"], "max_datagram_frame_size": 65536, "idle_timeout": 600}
        self.client = QuicConnection(
            configuration=QuicConfiguration(
                server_name="localhost",
                verify_mode=ssl.CERT_NONE,
                max_data=1 << 24,
                max_stream_data=1 << 24,
                **common,
            )
        )
        self.client.connect(SERVER, now=0.0)
        self.server = ServerQuicConnection(
            edge=Edge(),
            reset_token=lambda cid: bytes(16),
            reset_delay=reset_delay,
            configuration=QuicConfiguration(
                is_client=False,
                certificate=CERTIFICATE.x509,
                private_key=CERTIFICATE.private_key,
                congestion_control_algorithm=congestion_control,
                max_datagram_size=1452,
                max_stream_data=64 * 1024,
                **common,
            ),
            original_destination_connection_id=self.client.original_destination_connection_id,
        )
        self._flying: list[tuple[float, str, bytes]] = []
        self.run()
        assert self.server.is_established

    def run(self, until: float = float("inf"), step: Callable[[], None] = lambda: None) -> None:
        """Play; `step` is called after every moment in which something happened."""
        while True:
            self._send("client", self.client)
            if self.server._network_paths:
                self._send("server", self.server)
            moments = [arrival for arrival, _, _ in self._flying]
            for connection in (self.client, self.server):
                timer = connection.get_timer() if connection._network_paths else None
                if timer is not None and timer != connection._close_at:
                    moments.append(timer + TIMER_SLACK)
            if not moments or min(moments) > until:
                self.now = max(self.now, until) if until != float("inf") else self.now
                return
            self.now = max(self.now, min(moments))
            for connection in (self.client, self.server):
                timer = connection.get_timer() if connection._network_paths else None
                if timer is not None and timer <= self.now:
                    connection.handle_timer(self.now)
            arrived = [item for item in self._flying if item[0] <= self.now]
            self._flying = [item for item in self._flying if item[0] > self.now]
            for _, sender, data in arrived:
                if sender == "client":
                    self.server.receive_datagram(data, self.address, self.now)
                else:
                    self.client.receive_datagram(data, SERVER, self.now)
            self._events()
            step()

    def play(self, seconds: float) -> None:
        self.run(until=self.now + seconds)

    def lose(self, share: float) -> None:
        """Lose this share of the datagrams from now on."""
        generator = random.Random(5)
        self.drop = lambda sender, data: generator.random() < share

    def open(self, size: int = 1) -> int:
        """The client opens a stream with this many bytes of request, and ends its side."""
        stream_id = self.client.get_next_available_stream_id()
        self.client.send_stream_data(stream_id, bytes(size), end_stream=True)
        return stream_id

    def answer_all(self, bodies: list[bytes]) -> list[int]:
        """Open a stream for each body, let the requests arrive, and answer them all at once."""
        streams = [self.open() for _ in bodies]
        self.run()
        for stream_id, body in zip(streams, bodies, strict=True):
            self.server.send_stream_data(stream_id, body, end_stream=True)
        return streams

    def exchange(self, count: int = 1, size: int = 100_000, step: Callable[[], None] = lambda: None) -> None:
        """Answers that arrive whole."""
        bodies = frames(count, size)
        streams = self.answer_all(bodies)
        self.run(step=step)
        assert [bytes(self.streams[stream_id]) for stream_id in streams] == bodies

    def _send(self, sender: str, connection: QuicConnection) -> None:
        for data, address in connection.datagrams_to_send(self.now):
            self.sent.append((self.now, sender, len(data)))
            if address in (self.address, SERVER) and not self.drop(sender, data):
                self._flying.append((self.now + DELAY, sender, data))

    def _events(self) -> None:
        while (event := self.client.next_event()) is not None:
            self._client_event(event)
        while (event := self.server.next_event()) is not None:
            if isinstance(event, StreamDataReceived):
                self.uploads[event.stream_id] += event.data

    def _client_event(self, event: QuicEvent) -> None:
        if isinstance(event, StreamDataReceived):
            self.streams[event.stream_id] += event.data
            if event.end_stream:
                self.ended.append(event.stream_id)
        elif isinstance(event, DatagramFrameReceived):
            self.datagrams.append(event.data)


def frames(count: int, size: int = 100_000) -> list[bytes]:
    """This many answers."""
    generator = random.Random(4)
    return [generator.randbytes(size) for _ in range(count)]
