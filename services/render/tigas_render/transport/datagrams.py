"""Frames in QUIC datagrams: cut to pieces, sent once, and dropped as soon as a newer frame is ready."""

from __future__ import annotations

import struct

from tigas_render.transport.webtransport import WebTransportSession

FRAGMENT_HEADER = struct.Struct("!IHH")
"""seq, the fragment's number from 0, number of fragments."""
MAX_FRAGMENTS = 0xFFFF


def fragments(seq: int, answer: bytes, max_datagram: int) -> list[bytes]:
    """Cut an answer into datagrams of at most `max_datagram` bytes, header included.

    All but the last carry equally much. Raises ValueError if it takes more than 65,535 of them.
    """
    size = max_datagram - FRAGMENT_HEADER.size
    count = max(1, -(-len(answer) // size))
    if count > MAX_FRAGMENTS:
        raise ValueError(f"{len(answer)} bytes take more than {MAX_FRAGMENTS} datagrams.")
    return [
        FRAGMENT_HEADER.pack(seq, number, count) + answer[number * size : (number + 1) * size]
        for number in range(count)
    ]


class DatagramSender:
    """Sends a session's frames, the newest only: at most one frame's fragments ever wait."""

    def __init__(self, session: WebTransportSession) -> None:
        self._session = session
        self._turns = 0
        self._newest = 0

    @property
    def can_send(self) -> bool:
        """Whether the client takes datagrams at all."""
        return self._session.max_datagram > FRAGMENT_HEADER.size

    def next_turn(self) -> int:
        """A number for a request in the order of arrival."""
        self._turns += 1
        return self._turns

    def send_frame(self, turn: int, seq: int, answer: bytes) -> None:
        """Send a frame in place of whatever waits, unless a newer request of the session was answered already."""
        if turn < self._newest:
            return
        self._newest = turn
        waiting = self._session.outgoing
        waiting.clear()
        waiting.extend(fragments(seq, answer, self._session.max_datagram))
        self._session.flush()

    def send_problem(self, seq: int, answer: bytes) -> None:
        """Send a short answer ahead of the frame that is on its way, which stays good."""
        self._session.urgent.extend(fragments(seq, answer, self._session.max_datagram))
        self._session.flush()
