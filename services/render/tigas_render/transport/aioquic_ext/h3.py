"""aioquic's HTTP/3 connection with bounded frames and header sections."""

from __future__ import annotations

from contextlib import suppress

from aioquic._buffer import Buffer, BufferReadError
from aioquic.h3.connection import ErrorCode, FrameType, H3Connection, H3Stream, ProtocolError, Setting
from aioquic.h3.events import H3Event, Headers, WebTransportStreamDataReceived
from aioquic.quic.events import QuicEvent, StreamDataReceived

MAX_FIELD_SECTION = 8 * 1024
"""Maximum bytes of a request's headers, counting 32 extra for each (RFC 9114, 4.2.2); browsers send about 1,500."""
FRAME_LIMITS = {int(FrameType.HEADERS): MAX_FIELD_SECTION, int(FrameType.SETTINGS): 1024, int(FrameType.MAX_PUSH_ID): 8}
"""Maximum bytes of the frame types that are buffered until complete; others are passed on or skipped as they arrive."""
MAX_ENCODER_TABLE = 4096
"""Maximum size in bytes of our dynamic table for outgoing headers, even if the client allows more."""


WEBTRANSPORT_STREAM = b"\x40\x41"
"""First bytes of a bidirectional WebTransport stream; the session's id follows."""


class ExcessiveLoad(ProtocolError):
    """The client sends more than any legitimate client needs to. Ends its connection."""

    error_code = ErrorCode.H3_EXCESSIVE_LOAD


class ServerH3Connection(H3Connection):
    """A server's HTTP/3 connection."""

    def _init_connection(self) -> None:
        # With a dynamic table, a byte from the client could expand to a whole entry; without, to about a hundred bytes
        self._max_table_capacity = self._blocked_streams = 0
        self._decoder = type(self._decoder)(0, 0)
        super()._init_connection()

    def _get_local_settings(self) -> dict[int, int]:
        return super()._get_local_settings() | {Setting.MAX_FIELD_SECTION_SIZE: MAX_FIELD_SECTION}

    def _validate_settings(self, settings: dict[int, int]) -> None:
        super()._validate_settings(settings)
        capacity = settings.get(Setting.QPACK_MAX_TABLE_CAPACITY, 0)
        settings[Setting.QPACK_MAX_TABLE_CAPACITY] = min(capacity, MAX_ENCODER_TABLE)

    def _check_request_or_push_frame_type(self, frame_type: int, stream: H3Stream) -> None:
        super()._check_request_or_push_frame_type(frame_type, stream)
        _check_frame_size(frame_type, stream)

    def _check_control_frame_type(self, frame_type: int) -> None:
        super()._check_control_frame_type(frame_type)
        assert self._peer_control_stream_id is not None
        _check_frame_size(frame_type, self._stream[self._peer_control_stream_id])

    def _decode_headers(self, stream_id: int, frame_data: bytes | None) -> Headers:
        headers = super()._decode_headers(stream_id, frame_data)
        if sum(len(name) + len(value) + 32 for name, value in headers) > MAX_FIELD_SECTION:
            raise ExcessiveLoad(f"A header section has more than {MAX_FIELD_SECTION} bytes")
        return headers

    def handle_event(self, event: QuicEvent) -> list[H3Event]:
        """Like aioquic's method, but keeps no state for WebTransport streams that arrive whole, as requests do."""
        if (
            isinstance(event, StreamDataReceived)
            and event.end_stream
            and event.data[:2] == WEBTRANSPORT_STREAM
            and event.stream_id % 4 == 0
            and event.stream_id not in self._stream
            and not self._is_done
        ):
            with suppress(BufferReadError):
                buffer = Buffer(data=event.data[2:10])
                session_id = buffer.pull_uint_var()
                data = event.data[2 + buffer.tell() :]
                return [WebTransportStreamDataReceived(data, event.stream_id, True, session_id)]
        return super().handle_event(event)

    def discard_stream(self, stream_id: int) -> None:
        """Forget a stream that was ended below HTTP/3, like WebTransport streams; aioquic would keep its state."""
        stream = self._stream.get(stream_id)
        if stream is not None:
            stream.sending_ended = True
            if stream.is_ended():
                del self._stream[stream_id]

    def has_partial_frame(self, stream_id: int) -> bool:
        """Whether a stream has an incomplete frame or frame header."""
        stream = self._stream.get(stream_id)
        return stream is not None and (bool(stream.buffer) or stream.frame_type in FRAME_LIMITS)

    @property
    def control_stream_id(self) -> int:
        """The stream that GOAWAY is sent on."""
        assert self._local_control_stream_id is not None
        return self._local_control_stream_id


def _check_frame_size(frame_type: int, stream: H3Stream) -> None:
    """Raise ExcessiveLoad if a frame's header announces too large a frame."""
    if stream.frame_size is not None and stream.frame_size > FRAME_LIMITS.get(frame_type, stream.frame_size):
        raise ExcessiveLoad(f"A frame of type {frame_type} has more than {FRAME_LIMITS[frame_type]} bytes")
