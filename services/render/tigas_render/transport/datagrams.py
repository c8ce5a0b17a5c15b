"""Frames in QUIC datagrams: cut to pieces, sent once, and dropped as soon as a newer frame is ready."""

from __future__ import annotations

import struct
from collections import deque

from aioquic.buffer import encode_uint_var

from tigas_common.errors import InvalidRequest
from tigas_common.wire.render import RenderRequest
from tigas_render.transport.outlet import Writer

FRAGMENT_HEADER = struct.Struct("!IHH")
"""seq, the fragment's number from 0, number of fragments."""
MAX_FRAGMENTS = 0xFFFF
MAX_URGENT = 64
"""Datagrams of one session that may wait ahead of others."""
SESSION_ID_BYTES = 8
"""The most that the session's id takes of a datagram."""
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


class Datagrams:
    """A session's frames in datagrams, the newest only: at most one frame's fragments ever wait.

    They wait here, where they can be taken back, until the network has room.
    """

    def __init__(self, writer: Writer, session_id: int) -> None:
        """session_id: the id of the stream that opened the session."""
        self._writer = writer
        self._prefix = encode_uint_var(session_id // 4)  # RFC 9297, 2.1
        self._waiting: deque[bytes] = deque()
        self._urgent: deque[bytes] = deque(maxlen=MAX_URGENT)
        self._requests = 0
        self._newest_sent = 0

    @property
    def _max_size(self) -> int:
        """The longest datagram that fits in a packet now, in bytes; it may shrink with the path."""
        return self._writer.quic.max_datagram_payload - SESSION_ID_BYTES

    @property
    def can_send(self) -> bool:
        """Whether the client takes datagrams at all."""
        return self._max_size > FRAGMENT_HEADER.size

    def check(self, request: RenderRequest) -> None:
        """Raises InvalidRequest if datagrams cannot carry the answer."""
        if self._max_size < MIN_DATAGRAM:
            raise InvalidRequest("Your datagrams are too small for frames: send the request on a stream.")
        if request.video is not None:
            raise InvalidRequest("format: h264 needs a stream, as a video's frames refer to each other.")

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
            self._waiting = deque(fragments(seq, answer, self._max_size))
            self._send_soon()

    def send_problem(self, seq: int, answer: bytes) -> None:
        """Send a short answer ahead of the frame that is on its way, which stays good.

        Beyond the limit, the oldest are dropped.
        """
        self._urgent.extend(fragments(seq, answer, self._max_size))
        self._send_soon()

    def hand_over(self) -> bool:
        """As `Writer.hand_over_datagrams`. A datagram that has become too long for the path is dropped."""
        quic = self._writer.quic
        for queue in (self._urgent, self._waiting):
            while queue and quic.datagram_room:
                data = self._prefix + queue.popleft()
                if len(data) <= quic.max_datagram_payload:
                    quic.send_datagram_frame(data)
        return bool(self._urgent or self._waiting)

    def close(self) -> None:
        self._waiting.clear()
        self._urgent.clear()

    def _send_soon(self) -> None:
        if self.hand_over not in self._writer.with_datagrams:
            self._writer.with_datagrams.append(self.hand_over)
        self._writer.transmit_soon()
