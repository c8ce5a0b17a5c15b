"""aioquic's connection with bounded memory, and what the rest of the transport wants to know of it.

Together with `bulk` and `h3` this is the one place that reaches into aioquic's private attributes; see
`aioquic_version`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from aioquic.quic.configuration import SMALLEST_MAX_DATAGRAM_SIZE
from aioquic.quic.connection import MAX_STREAM_DATA_FRAME_CAPACITY
from aioquic.quic.packet import QuicFrameType
from aioquic.quic.packet_builder import QuicPacketBuilder
from aioquic.quic.recovery import QuicPacketSpace
from aioquic.quic.stream import QuicStream

from tigas_render.transport.bulk import SHORT_HEADER, BulkQuicConnection
from tigas_render.transport.cids import Edge
from tigas_render.transport.stream_credit import StreamCredit

DATAGRAM_HEADER = 1 + 2
"""Bytes of a DATAGRAM frame before its data: type and length."""
BLACK_HOLE_PROBES = 2
"""Probe timeouts in a row after which datagrams above QUIC's minimum size are suspected of being lost on the way."""


class ServerQuicConnection(BulkQuicConnection):
    """A server's connection."""

    def __init__(self, *, edge: Edge, reset_token: Callable[[bytes], bytes], **arguments: Any) -> None:
        """Connection ids name the `edge`, and `reset_token` gives their tokens of stateless resets; the rest is
        aioquic's.
        """
        super().__init__(**arguments)
        self._edge = edge
        self._reset_token = reset_token
        self._finish_connection_ids()
        self.host_cid = self._local_initial_source_connection_id = self._host_cids[0].cid
        self._begun: set[int] = set()
        self._local_max_streams_bidi = StreamCredit(self._local_max_streams_bidi, lambda: self._loss._rtt_smoothed)

    def _replenish_connection_ids(self) -> None:
        super()._replenish_connection_ids()
        self._finish_connection_ids()

    def _finish_connection_ids(self) -> None:
        for connection_id in self._host_cids:
            connection_id.cid = self._edge.named(connection_id.cid)
            connection_id.stateless_reset_token = self._reset_token(connection_id.cid)

    # -- receiving ---------------------------------------------------------------------------------------------------

    def _get_or_create_stream(self, frame_type: int, stream_id: int) -> QuicStream:
        stream = super()._get_or_create_stream(frame_type, stream_id)
        if not stream.receiver.starting_offset():
            self._begun.add(stream_id)
        return stream

    def take_begun(self) -> set[int]:
        """The streams that something has come for whose first byte had not been there before; of each once.

        aioquic says nothing of what is kept for a stream until that byte has come.
        """
        begun, self._begun = self._begun, set()
        return begun

    def has_gap(self, stream_id: int) -> bool:
        """Whether a stream's first byte has not come."""
        stream = self._streams.get(stream_id)
        return stream is not None and not stream.receiver.starting_offset() and not stream.receiver.is_finished

    def _has_control_frames(self, stream: QuicStream) -> bool:
        return super()._has_control_frames(stream) or (
            self._window_to_announce(stream) != stream.max_stream_data_local_sent
        )

    def _window_to_announce(self, stream: QuicStream) -> int:
        """A client may be one window ahead of what has arrived in order."""
        limit = stream.receiver.starting_offset() + (window := self._configuration.max_stream_data)
        if (
            stream.max_stream_data_local
            and not stream.receiver.is_finished
            and limit - stream.max_stream_data_local >= window // 2
        ):
            return limit
        return stream.max_stream_data_local

    def _write_stream_limits(self, builder: QuicPacketBuilder, space: QuicPacketSpace, stream: QuicStream) -> None:
        """Announce a stream's window.

        aioquic doubles the window whenever half of it was *reached*, so that a few bytes sent at ever higher offsets
        make it allocate without bound.
        """
        assert stream.stream_id is not None
        stream.max_stream_data_local = self._window_to_announce(stream)
        if stream.max_stream_data_local_sent != stream.max_stream_data_local:
            buffer = builder.start_frame(
                QuicFrameType.MAX_STREAM_DATA,
                capacity=MAX_STREAM_DATA_FRAME_CAPACITY,
                handler=self._on_max_stream_data_delivery,
                handler_args=(stream,),
            )
            buffer.push_uint_var(stream.stream_id)
            buffer.push_uint_var(stream.max_stream_data_local)
            stream.max_stream_data_local_sent = stream.max_stream_data_local

    # -- sending -----------------------------------------------------------------------------------------------------

    def unsent(self, stream_id: int) -> int:
        """Bytes of a stream that wait to be sent for the first time."""
        stream = self._streams.get(stream_id)
        return 0 if stream is None else stream.sender._buffer_stop - stream.sender.highest_offset

    def unsent_total(self) -> tuple[int, int]:
        """Bytes of all streams that wait: for the network, and for the network or a client that does not read."""
        network = total = 0
        for stream in self._streams.values():
            sender = stream.sender
            if not sender.buffer_is_empty:
                unsent = sender._buffer_stop - sender.highest_offset
                total += unsent
                if sender.highest_offset < stream.max_stream_data_remote:
                    network += unsent
        return network, total

    def can_write(self, stream_id: int) -> bool:
        """Whether a stream still takes data: it is open, was not finished, and neither side has reset it."""
        stream = self._streams.get(stream_id)
        return (
            stream is not None
            and stream.sender._buffer_fin is None
            and stream.sender._reset_error_code is None
            and not stream.sender.is_finished
        )

    def is_receiving(self, stream_id: int) -> bool:
        """Whether the client may still send on a stream."""
        stream = self._streams.get(stream_id)
        return stream is not None and not stream.receiver.is_finished

    # -- datagrams ---------------------------------------------------------------------------------------------------

    @property
    def max_datagram_payload(self) -> int:
        """The longest data that fits in a DATAGRAM frame of one packet, in bytes; 0 if the client takes none.

        A longer one would stay at the head of aioquic's queue for ever and hold up all others.
        """
        remote = self._remote_max_datagram_frame_size or 0
        packet = self._max_datagram_size - SHORT_HEADER - len(self._peer_cid.cid)
        return max(0, min(remote, packet) - DATAGRAM_HEADER)

    @property
    def datagram_room(self) -> int:
        """How many full datagrams may be handed over now without waiting in a queue that nobody can take back."""
        room = (self._loss.congestion_window - self._loss.bytes_in_flight) // self._max_datagram_size
        return max(0, room - len(self._datagrams_pending))

    # -- path MTU ----------------------------------------------------------------------------------------------------

    def handle_timer(self, now: float) -> None:
        """As aioquic's, and fall back to the size that every QUIC path carries when nothing gets through any more."""
        super().handle_timer(now)
        if self._loss._pto_count >= BLACK_HOLE_PROBES and self._max_datagram_size > SMALLEST_MAX_DATAGRAM_SIZE:
            self._max_datagram_size = SMALLEST_MAX_DATAGRAM_SIZE
            limit = self.max_datagram_payload
            fitting = [data for data in self._datagrams_pending if len(data) <= limit]
            self._datagrams_pending.clear()
            self._datagrams_pending.extend(fitting)

    # -- state -------------------------------------------------------------------------------------------------------

    @property
    def is_established(self) -> bool:
        """Whether the handshake is complete; before that, whatever has arrived is early data that may be a replay."""
        return self._handshake_complete
