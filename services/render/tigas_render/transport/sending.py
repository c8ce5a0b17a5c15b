"""Sending on a connection's streams and sessions, no faster than the network and the client accept data."""

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
from tigas_render.frame import supersedes
from tigas_render.transport.aioquic_ext.h3 import ServerH3Connection
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection

CHUNK = 64 * 1024
"""Minimum number of bytes handed to QUIC at a time."""
FRAGMENT_HEADER = struct.Struct("!IHH")
"""seq, fragment number from 0, number of fragments."""
MAX_FRAGMENTS = 0xFFFF
MAX_URGENT = 64
"""Maximum number of a session's datagrams that wait ahead of its frames."""
SESSION_ID_BYTES = 8
"""Maximum size of the session id in a datagram."""
MIN_DATAGRAM = 100
"""Minimum size in bytes of a client's datagrams for frames to be sent in them."""


class StreamClosed(ConnectionError):
    """The client has cancelled the stream or disconnected."""


class SendScheduler:
    """State shared by all writers of one connection."""

    def __init__(
        self,
        quic: ServerQuicConnection,
        h3: ServerH3Connection,
        limits: Limits,
        usage: Usage,
        transmit_soon: Callable[[], None],
    ) -> None:
        """usage: resource usage of the client's address, including its waiting answers."""
        self.quic = quic
        self.h3 = h3
        self.limits = limits
        self._usage = usage
        self.transmit_soon = transmit_soon
        self.blocked: dict[int, Callable[[], None]] = {}
        """Callbacks of streams that wait for room, by stream id."""
        self.flushers: list[Callable[[], bool]] = []
        """The `flush` functions of frames and datagrams that wait to be handed to QUIC."""
        self.closed = False

    def room(self, stream_id: int) -> int:
        """Number of bytes that a stream may hand to QUIC now: 0, or at least CHUNK."""
        network, total = self.quic.total_unsent_bytes()
        used = max(self.quic.unsent_bytes(stream_id), network)
        room = min(self.limits.unsent - used, self.limits.unread_answers - total)
        return max(room, CHUNK) if room > 0 else 0

    def reserve(self, size: int) -> bool:
        """Count bytes of a waiting answer until `release`. Returns False, uncounted, if the address has too many.

        An address's only waiting answer may have any size.
        """
        waiting = self._usage.waiting_bytes
        if waiting and waiting + size > self.limits.waiting_per_address:
            return False
        self._usage.waiting_bytes += size
        return True

    def release(self, size: int) -> None:
        self._usage.waiting_bytes -= size

    def resume_streams(self) -> None:
        """Resume the streams that have room again, oldest first."""
        for stream_id in sorted(self.blocked):
            if not self.quic.can_write(stream_id) or self.room(stream_id):
                self.blocked[stream_id]()

    def flush(self) -> bool:
        """Give QUIC as many frames and datagrams as it can send soon. Returns whether any are left."""
        self.flushers = [flush for flush in self.flushers if flush()]
        return bool(self.flushers)

    def schedule_flush(self, flush: Callable[[], bool]) -> None:
        """Call `flush` soon, and again whenever there may be room, until it returns False: nothing is left."""
        if flush not in self.flushers:
            self.flushers.append(flush)
        self.transmit_soon()

    def close(self) -> None:
        """Resume all waiting streams, which then find the connection closed."""
        self.closed = True
        for send in list(self.blocked.values()):
            send()


class StreamWriter:
    """The server's side of one stream. Writes to an ended stream are dropped."""

    def __init__(self, scheduler: SendScheduler, stream_id: int) -> None:
        self.stream_id = stream_id
        self.limits = scheduler.limits
        self.scheduler = scheduler

    @property
    def is_open(self) -> bool:
        """Whether the server's side of the stream is neither finished nor reset."""
        return self.scheduler.quic.can_write(self.stream_id)

    def send_headers(self, headers: Headers) -> None:
        if self.is_open:
            self.scheduler.h3.send_headers(self.stream_id, headers)
            self.scheduler.transmit_soon()

    async def send_data(self, data: memoryview) -> None:
        """Send a part of an HTTP body, waiting while the network or the client cannot keep up.

        data: must not change before this returns. Raises StreamClosed if the client has cancelled, disconnected or
        stopped reading for too long, or if its address has too many waiting answers.
        """
        if not data:
            return
        sent = asyncio.Event()
        header = encode_uint_var(FrameType.DATA) + encode_uint_var(len(data))
        write = _PendingWrite(self, [header, data], sent.set)
        write.send()
        try:
            await sent.wait()
        finally:
            write.cancel()
        if write.parts:
            raise StreamClosed

    def finish(self, parts: Sequence[bytes | memoryview], on_done: Callable[[], None]) -> None:
        """Send bytes and end the stream; then call `on_done`, even on failure.

        The caller may release the parts at once: data that the network or the client cannot accept yet is copied.
        """
        _PendingWrite(self, list(parts), on_done, ends_stream=True).send()

    def end(self) -> None:
        if self.is_open:
            self.scheduler.quic.send_stream_data(self.stream_id, b"", end_stream=True)
            self.scheduler.h3.discard_stream(self.stream_id)
            self.scheduler.transmit_soon()

    def set_unread_bytes(self, size: int) -> None:
        """Set the number of received bytes that wait for the application; reading them lets the client send more."""
        self.scheduler.quic.set_unread_bytes(self.stream_id, size)
        if not size and self.scheduler.quic.is_receiving(self.stream_id):
            self.scheduler.transmit_soon()

    def stop_reading(self, error_code: int) -> None:
        """Ask the client to stop sending."""
        if self.scheduler.quic.is_receiving(self.stream_id):
            self.scheduler.quic.stop_stream(self.stream_id, error_code)
            self.scheduler.transmit_soon()

    def abort(self, error_code: int) -> None:
        """End both directions, unless they have ended already."""
        self.stop_reading(error_code)
        if self.is_open:
            self.scheduler.quic.reset_stream(self.stream_id, error_code)
            self.scheduler.transmit_soon()
        self.scheduler.h3.discard_stream(self.stream_id)


@dataclass(slots=True, eq=False)
class _PendingWrite:
    """Bytes on their way to QUIC."""

    writer: StreamWriter
    parts: list[bytes | memoryview]
    """The data that has not been handed over yet."""
    on_done: Callable[[], None]
    """Called when all is handed over, or on failure."""
    ends_stream: bool = False
    """Whether to end the stream afterwards. If so, the caller does not keep the parts, so they are copied to wait."""
    stall_timer: asyncio.TimerHandle | None = None
    reserved: int = 0
    """Number of bytes counted as waiting."""

    def send(self) -> None:
        """Hand over as much as fits, and wait for room for the rest."""
        self.unblock()
        scheduler, stream_id = self.writer.scheduler, self.writer.stream_id
        while self.parts and not scheduler.closed and self.writer.is_open:
            room = scheduler.room(stream_id)
            if not room:
                if not self.reserved:
                    size = sum(map(len, self.parts))
                    if not scheduler.reserve(size):
                        break
                    self.reserved = size
                if self.ends_stream:
                    self.parts = [bytes(part) for part in self.parts]
                scheduler.blocked[stream_id] = self.send
                self.stall_timer = asyncio.get_running_loop().call_later(scheduler.limits.stall_timeout, self.time_out)
                return
            while self.parts and room:
                part = self.parts.pop(0)
                if len(part) > room:
                    self.parts.insert(0, part[room:])
                    part = part[:room]
                scheduler.quic.send_stream_data(stream_id, part)  # type: ignore[arg-type]  # any buffer
                room -= len(part)
            scheduler.transmit_soon()
        self.cancel()
        if self.ends_stream and not self.parts and not scheduler.closed:
            self.writer.end()
        self.on_done()

    def unblock(self) -> None:
        if self.stall_timer is not None:
            self.stall_timer.cancel()
            self.stall_timer = None
            del self.writer.scheduler.blocked[self.writer.stream_id]

    def cancel(self) -> None:
        """Stop sending, and stop counting the bytes that wait."""
        self.unblock()
        self.writer.scheduler.release(self.reserved)
        self.reserved = 0

    def time_out(self) -> None:
        """Stop sending because the client does not read."""
        self.cancel()
        self.on_done()


class PendingFrame(NamedTuple):
    """A stream's answer that has not been handed to QUIC yet."""

    request: RenderRequest
    size: int
    """Size in bytes."""
    send: Callable[[], None]
    refuse: Callable[[], None]


class LatestFrames:
    """A session's frames for streams while the congestion window is full, as in the first round trips.

    While they wait here, a view's newest frame replaces older ones, which would arrive late and delay it. The older
    ones are refused only when the newest leaves, so that the client does not request more than the link can carry.
    """

    def __init__(self, scheduler: SendScheduler) -> None:
        self._scheduler = scheduler
        self._waiting: deque[PendingFrame] = deque()
        self._refused: list[Callable[[], None]] = []

    @property
    def can_send(self) -> bool:
        """Whether a frame may be sent without waiting."""
        return not self._waiting and self._scheduler.quic.has_congestion_room

    def enqueue(self, frame: PendingFrame) -> None:
        """Send a frame as soon as there is room, unless a newer frame of its view replaces it before."""
        if not self._scheduler.reserve(frame.size):
            frame.refuse()
            return
        frames = [*self._waiting, frame]
        self._waiting.clear()
        for each in frames:
            if any(supersedes(other.request, each.request) for other in frames):
                self._refused.append(each.refuse)
                self._scheduler.release(each.size)
            else:
                self._waiting.append(each)
        self._scheduler.schedule_flush(self.flush)

    def flush(self) -> bool:
        """Send the frames for which there is room. Returns whether any are left."""
        while self._waiting and self._scheduler.quic.has_congestion_room:
            frame = self._waiting.popleft()
            self._scheduler.release(frame.size)
            frame.send()
            refused, self._refused = self._refused, []
            for refuse in refused:
                refuse()
        return bool(self._waiting)

    def close(self) -> None:
        self._scheduler.release(sum(frame.size for frame in self._waiting))
        self._waiting.clear()
        self._refused.clear()


def split_into_datagrams(seq: int, answer: bytes, max_datagram: int) -> list[bytes]:
    """Split an answer into datagrams of at most `max_datagram` bytes, including their headers.

    All but the last are equally large. Raises InvalidRequest if this takes more than 65,535 of them.
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
    """A session's newest frame as datagrams: at most one frame's fragments wait at any time.

    They wait here, where they can still be withdrawn, until the network has room.
    """

    def __init__(self, scheduler: SendScheduler, session_id: int) -> None:
        """session_id: the id of the stream that opened the session."""
        self._scheduler = scheduler
        self._prefix = encode_uint_var(session_id // 4)  # RFC 9297, 2.1
        self._waiting: deque[bytes] = deque()
        self._urgent: deque[bytes] = deque(maxlen=MAX_URGENT)
        self._requests = 0
        self._newest_sent = 0

    @property
    def _max_size(self) -> int:
        """Size in bytes of the largest datagram that fits in a packet now, which may shrink with the path."""
        return self._scheduler.quic.max_datagram_payload - SESSION_ID_BYTES

    @property
    def can_send(self) -> bool:
        """Whether the client accepts datagrams at all."""
        return self._max_size > FRAGMENT_HEADER.size

    def check(self, request: RenderRequest) -> None:
        """Raise InvalidRequest if datagrams cannot carry the answer."""
        if self._max_size < MIN_DATAGRAM:
            raise InvalidRequest("Your datagrams are too small for frames: send the request on a stream.")
        if request.video is not None:
            raise InvalidRequest("format: h264 needs a stream, as a video's frames refer to each other.")

    def next_request_number(self) -> int:
        """Return the next request's number, counting from 1 in the order of arrival."""
        self._requests += 1
        return self._requests

    def send_frame(self, request: int, seq: int, answer: bytes) -> None:
        """Send a frame in place of the waiting one, unless a newer request of the session has been answered already.

        Raises InvalidRequest if the frame takes too many datagrams.
        """
        if request >= self._newest_sent:
            self._newest_sent = request
            self._waiting = deque(split_into_datagrams(seq, answer, self._max_size))
            self._scheduler.schedule_flush(self.flush)

    def send_error(self, seq: int, answer: bytes) -> None:
        """Send a short answer ahead of the waiting frame, which is still sent.

        If more than MAX_URGENT datagrams wait, the oldest are dropped.
        """
        self._urgent.extend(split_into_datagrams(seq, answer, self._max_size))
        self._scheduler.schedule_flush(self.flush)

    def flush(self) -> bool:
        """Send the datagrams for which there is room, dropping any that no longer fit the path's packets.

        Returns whether any are left.
        """
        quic = self._scheduler.quic
        for queue in (self._urgent, self._waiting):
            while queue and quic.sendable_datagrams:
                data = self._prefix + queue.popleft()
                if len(data) <= quic.max_datagram_payload:
                    quic.send_datagram_frame(data)
        return bool(self._urgent or self._waiting)

    def close(self) -> None:
        self._waiting.clear()
        self._urgent.clear()
