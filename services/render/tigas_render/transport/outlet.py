"""Where a connection's streams and sessions send: no faster than the network and the client take it."""

from __future__ import annotations

import asyncio
import struct
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from aioquic.buffer import encode_uint_var
from aioquic.h3.connection import FrameType
from aioquic.h3.events import Headers

from tigas_common.errors import InvalidRequest
from tigas_common.wire.render import RenderRequest
from tigas_render.admission.connections import Usage
from tigas_render.admission.limits import Limits
from tigas_render.frame import obsoletes
from tigas_render.transport.aioquic_ext.h3 import ServerH3Connection
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection

CHUNK = 64 * 1024
"""Bytes handed to QUIC at a time."""
FRAGMENT_HEADER = struct.Struct("!IHH")
"""seq, the fragment's number from 0, number of fragments."""
MAX_FRAGMENTS = 0xFFFF
MAX_URGENT = 64
"""Datagrams of one session that may wait ahead of others."""
SESSION_ID_BYTES = 8
"""The most that the session's id takes of a datagram."""
MIN_DATAGRAM = 100
"""Bytes that a client's datagrams must be able to hold for frames to be sent in them."""


class StreamClosed(ConnectionError):
    """The client has cancelled the stream or disconnected."""


class Writer:
    """State shared by all outlets of one connection."""

    def __init__(
        self,
        quic: ServerQuicConnection,
        h3: ServerH3Connection,
        limits: Limits,
        usage: Usage,
        transmit_soon: Callable[[], None],
    ) -> None:
        """usage: resource usage of the client's address, in which waiting answers are counted."""
        self.quic = quic
        self.h3 = h3
        self.limits = limits
        self._usage = usage
        self.transmit_soon = transmit_soon
        self.waiting: dict[int, Callable[[], None]] = {}
        """Callbacks of writers that wait for room, by stream."""
        self.handing_over: list[Callable[[], bool]] = []
        """`hand_over` of everything that waits to be handed to QUIC."""
        self.closed = False

    def room(self, stream_id: int) -> int:
        """Bytes that a stream may hand to QUIC now: none, or at least a chunk."""
        network, total = self.quic.unsent_total()
        used = max(self.quic.unsent(stream_id), network)
        room = min(self.limits.unsent - used, self.limits.unread_answers - total)
        return max(room, CHUNK) if room > 0 else 0

    def hold(self, size: int) -> bool:
        """Count bytes of an answer that waits, until `let_go`; False, and nothing counted, if the address has too many.

        An answer may wait alone, however long it is.
        """
        waiting = self._usage.waiting
        if waiting and waiting + size > self.limits.waiting_per_address:
            return False
        self._usage.waiting += size
        return True

    def let_go(self, size: int) -> None:
        self._usage.waiting -= size

    def wake(self) -> None:
        """Resume writers with room, oldest stream first."""
        for stream_id in sorted(self.waiting):
            if not self.quic.can_write(stream_id) or self.room(stream_id):
                self.waiting[stream_id]()

    def hand_over(self) -> bool:
        """Give QUIC as many frames and datagrams as it can send soon; whether any are left."""
        self.handing_over = [hand_over for hand_over in self.handing_over if hand_over()]
        return bool(self.handing_over)

    def hand_over_soon(self, hand_over: Callable[[], bool]) -> None:
        """Call this, at once and whenever there may be room, until it returns False because nothing is left."""
        if hand_over not in self.handing_over:
            self.handing_over.append(hand_over)
        self.transmit_soon()

    def close(self) -> None:
        """Resume all writers, which then find the connection closed."""
        self.closed = True
        for go_on in list(self.waiting.values()):
            go_on()


class Outlet:
    """The server's side of one stream. Writes to an ended stream are dropped."""

    def __init__(self, writer: Writer, stream_id: int) -> None:
        self.stream_id = stream_id
        self.limits = writer.limits
        self.writer = writer

    @property
    def is_open(self) -> bool:
        """Whether the server's side is neither finished nor reset."""
        return self.writer.quic.can_write(self.stream_id)

    def send_headers(self, headers: Headers) -> None:
        if self.is_open:
            self.writer.h3.send_headers(self.stream_id, headers)
            self.writer.transmit_soon()

    async def send_data(self, data: memoryview) -> None:
        """Send a part of an HTTP body; waits while the network or the client cannot keep up.

        data: must not change until then. Raises StreamClosed if the client has cancelled, disconnected, or not read for
        too long, or its address has too many answers waiting.
        """
        if not data:
            return
        sent = asyncio.Event()
        header = encode_uint_var(FrameType.DATA) + encode_uint_var(len(data))
        sending = _Sending(self, [header, data], sent.set)
        sending.go_on()
        try:
            await sent.wait()
        finally:
            sending.stop()
        if sending.parts:
            raise StreamClosed

    def finish(self, parts: Sequence[bytes | memoryview], ended: Callable[[], None]) -> None:
        """Send bytes and end the stream; then call `ended`, also on failure.

        The parts need not be kept: data that the network or the client cannot take yet is copied.
        """
        _Sending(self, list(parts), ended, ends_stream=True).go_on()

    def end(self) -> None:
        if self.is_open:
            self.writer.quic.send_stream_data(self.stream_id, b"", end_stream=True)
            self.writer.h3.finished(self.stream_id)
            self.writer.transmit_soon()

    def set_unread(self, size: int) -> None:
        """Count received bytes that wait for the application; the client may send more once they are read."""
        self.writer.quic.set_unread(self.stream_id, size)
        if not size and self.writer.quic.is_receiving(self.stream_id):
            self.writer.transmit_soon()

    def stop_reading(self, error_code: int) -> None:
        """Ask the client to send no more."""
        if self.writer.quic.is_receiving(self.stream_id):
            self.writer.quic.stop_stream(self.stream_id, error_code)
            self.writer.transmit_soon()

    def abort(self, error_code: int) -> None:
        """End both directions, unless ended already."""
        self.stop_reading(error_code)
        if self.is_open:
            self.writer.quic.reset_stream(self.stream_id, error_code)
            self.writer.transmit_soon()
        self.writer.h3.finished(self.stream_id)


@dataclass(slots=True, eq=False)
class _Sending:
    """Bytes on their way to QUIC."""

    outlet: Outlet
    parts: list[bytes | memoryview]
    """Not handed over yet."""
    ended: Callable[[], None]
    """Called at the end of all work."""
    ends_stream: bool = False
    """Whether nothing follows; then the caller does not keep the parts."""
    stalled: asyncio.TimerHandle | None = None
    held: int = 0
    """Bytes counted as waiting."""

    def go_on(self) -> None:
        """Hand over as much as fits, and wait for room for the rest."""
        self.stop_waiting()
        writer, stream_id = self.outlet.writer, self.outlet.stream_id
        while self.parts and not writer.closed and self.outlet.is_open:
            room = writer.room(stream_id)
            if not room:
                if not self.held:
                    size = sum(map(len, self.parts))
                    if not writer.hold(size):
                        break
                    self.held = size
                if self.ends_stream:
                    self.parts = [bytes(part) for part in self.parts]
                writer.waiting[stream_id] = self.go_on
                self.stalled = asyncio.get_running_loop().call_later(writer.limits.stall_timeout, self.give_up)
                return
            while self.parts and room:
                part = self.parts.pop(0)
                if len(part) > room:
                    self.parts.insert(0, part[room:])
                    part = part[:room]
                writer.quic.send_stream_data(stream_id, part)  # type: ignore[arg-type]  # any buffer
                room -= len(part)
            writer.transmit_soon()
        self.stop()
        if self.ends_stream and not self.parts and not writer.closed:
            self.outlet.end()
        self.ended()

    def stop_waiting(self) -> None:
        if self.stalled is not None:
            self.stalled.cancel()
            self.stalled = None
            del self.outlet.writer.waiting[self.outlet.stream_id]

    def stop(self) -> None:
        """Do not go on by itself any more."""
        self.stop_waiting()
        self.outlet.writer.let_go(self.held)
        self.held = 0

    def give_up(self) -> None:
        """The client does not read."""
        self.stop()
        self.ended()


class WaitingFrame(NamedTuple):
    """An answer on a stream that is not handed to QUIC yet."""

    request: RenderRequest
    size: int
    """In bytes."""
    send: Callable[[], None]
    refuse: Callable[[], None]


class NewestFrames:
    """A session's frames on streams while the congestion window is full, as it is for the first round trips.

    They wait here, where the newest of a view takes the place of older ones, which would arrive late and hold it up.
    Those are refused when it leaves, so that the client requests no more than the link carries.
    """

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._waiting: deque[WaitingFrame] = deque()
        self._refused: list[Callable[[], None]] = []

    @property
    def may_leave(self) -> bool:
        """Whether a frame need not wait."""
        return not self._waiting and self._writer.quic.has_room

    def wait(self, frame: WaitingFrame) -> None:
        """Send a frame as soon as there is room, unless a newer one of its view is there by then."""
        if not self._writer.hold(frame.size):
            frame.refuse()
            return
        frames = [*self._waiting, frame]
        self._waiting.clear()
        for each in frames:
            if any(obsoletes(other.request, each.request) for other in frames):
                self._refused.append(each.refuse)
                self._writer.let_go(each.size)
            else:
                self._waiting.append(each)
        self._writer.hand_over_soon(self.hand_over)

    def hand_over(self) -> bool:
        """As `Writer.hand_over`."""
        while self._waiting and self._writer.quic.has_room:
            frame = self._waiting.popleft()
            self._writer.let_go(frame.size)
            frame.send()
            refused, self._refused = self._refused, []
            for refuse in refused:
                refuse()
        return bool(self._waiting)

    def close(self) -> None:
        self._writer.let_go(sum(frame.size for frame in self._waiting))
        self._waiting.clear()
        self._refused.clear()


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
            self._writer.hand_over_soon(self.hand_over)

    def send_problem(self, seq: int, answer: bytes) -> None:
        """Send a short answer ahead of the frame that is on its way, which stays good.

        Beyond the limit, the oldest are dropped.
        """
        self._urgent.extend(fragments(seq, answer, self._max_size))
        self._writer.hand_over_soon(self.hand_over)

    def hand_over(self) -> bool:
        """As `Writer.hand_over`. A datagram that has become too long for the path is dropped."""
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
