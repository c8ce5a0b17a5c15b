"""aioquic's HTTP/3 connection with bounded header sections.

Together with `quic` and `bulk` this is the one place that reaches into aioquic's private attributes; see
`aioquic_version`.
"""

from __future__ import annotations

from aioquic.h3.connection import ErrorCode, H3Connection, ProtocolError, Setting
from aioquic.h3.events import Headers

MAX_FIELD_SECTION = 16 * 1024
"""Bytes of a request's fields, names and values, and 32 for each (RFC 9114, 4.2.2); browsers send about 1,500."""
MAX_ENCODER_TABLE = 4096
"""Bytes of the fields that we remember in order to send them in short, whatever the client has room for."""


class ExcessiveLoad(ProtocolError):
    """The client sends more than anybody needs to; ends its connection."""

    error_code = ErrorCode.H3_EXCESSIVE_LOAD


class ServerH3Connection(H3Connection):
    """A server's HTTP/3 connection."""

    def _init_connection(self) -> None:
        # Without a dynamic table a byte stands for some hundred bytes at most; with one, for as many as it holds
        self._max_table_capacity = self._blocked_streams = 0
        self._decoder = type(self._decoder)(0, 0)
        super()._init_connection()

    def _get_local_settings(self) -> dict[int, int]:
        return super()._get_local_settings() | {Setting.MAX_FIELD_SECTION_SIZE: MAX_FIELD_SECTION}

    def _validate_settings(self, settings: dict[int, int]) -> None:
        super()._validate_settings(settings)
        capacity = settings.get(Setting.QPACK_MAX_TABLE_CAPACITY, 0)
        settings[Setting.QPACK_MAX_TABLE_CAPACITY] = min(capacity, MAX_ENCODER_TABLE)

    def _decode_headers(self, stream_id: int, frame_data: bytes | None) -> Headers:
        if frame_data is not None and len(frame_data) > MAX_FIELD_SECTION:
            raise ExcessiveLoad(f"A header section has more than {MAX_FIELD_SECTION} bytes")
        headers = super()._decode_headers(stream_id, frame_data)
        if sum(len(name) + len(value) + 32 for name, value in headers) > MAX_FIELD_SECTION:
            raise ExcessiveLoad(f"A header section has more than {MAX_FIELD_SECTION} bytes")
        return headers

    def finished(self, stream_id: int) -> None:
        """Forget a stream that was ended below HTTP/3, as WebTransport's are; aioquic would keep its state."""
        stream = self._stream.get(stream_id)
        if stream is not None:
            stream.sending_ended = True
            if stream.is_ended():
                del self._stream[stream_id]

    @property
    def control_stream_id(self) -> int:
        """The stream that GOAWAY is sent on."""
        assert self._local_control_stream_id is not None
        return self._local_control_stream_id
