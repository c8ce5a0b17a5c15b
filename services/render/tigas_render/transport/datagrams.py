"""Frames in QUIC datagrams: cut to pieces, sent once, and dropped as soon as a newer frame is ready."""

from __future__ import annotations

import struct

from tigas_common.errors import InvalidRequest
from tigas_render.transport.outlet import DatagramOutlet

FRAGMENT_HEADER = struct.Struct("!IHH")
"""seq, the fragment's number from 0, number of fragments."""
MAX_FRAGMENTS = 0xFFFF
MIN_DATAGRAM = 100
"""Bytes that a client's datagrams must be able to hold for frames to be sent in them."""


def fragments(seq: int, answer: bytes, max_datagram: int) -> list[bytes]:
    """Cut an answer into datagrams of at most `max_datagram` bytes, header included.

    All but the last carry equally much. Raises InvalidRequest if it takes more than 65,535 of them.
    """
    size = max_datagram - FRAGMENT_HEADER.size
    count = max(1, -(-len(answer) // size))
    if count > MAX_FRAGMENTS:
        raise InvalidRequest(f"The frame does not fit into {MAX_FRAGMENTS:,} datagrams: request it on a stream.")
    return [
        FRAGMENT_HEADER.pack(seq, number, count) + answer[number * size : (number + 1) * size]
        for number in range(count)
    ]


class DatagramSender:
    """Sends a session's frames, the newest only: at most one frame's fragments ever wait."""

    def __init__(self, outlet: DatagramOutlet) -> None:
        self._outlet = outlet
        self._requests = 0
        self._newest_sent = 0

    @property
    def can_send(self) -> bool:
        """Whether the client takes datagrams at all."""
        return self._outlet.max_size > FRAGMENT_HEADER.size

    def check_size(self) -> None:
        """Raises InvalidRequest if the client's datagrams are too small for frames."""
        if self._outlet.max_size < MIN_DATAGRAM:
            raise InvalidRequest("Your datagrams are too small for frames: send the request on a stream.")

    def next_request(self) -> int:
        """The number of a request in the order of arrival, from 1."""
        self._requests += 1
        return self._requests

    def send_frame(self, request: int, seq: int, answer: bytes) -> None:
        """Send a frame in place of waiting ones, unless a newer request of the session was answered already.

        Raises InvalidRequest if it takes too many datagrams.
        """
        if request >= self._newest_sent:
            self._newest_sent = request
            self._outlet.replace(fragments(seq, answer, self._outlet.max_size))

    def send_problem(self, seq: int, answer: bytes) -> None:
        """Send a short answer ahead of the frame that is on its way, which stays good."""
        self._outlet.send_first(fragments(seq, answer, self._outlet.max_size))
