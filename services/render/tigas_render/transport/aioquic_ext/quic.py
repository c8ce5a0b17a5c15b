"""aioquic's connection with bounded memory, and accessors for the rest of the transport."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any

from aioquic.quic.configuration import SMALLEST_MAX_DATAGRAM_SIZE
from aioquic.quic.connection import MAX_STREAM_DATA_FRAME_CAPACITY, Limit
from aioquic.quic.packet import QuicFrameType
from aioquic.quic.packet_builder import QuicDeliveryState, QuicPacketBuilder
from aioquic.quic.recovery import QuicPacketSpace
from aioquic.quic.stream import QuicStream
from aioquic.tls import Epoch

from tigas_common.udp import Datagram
from tigas_render.transport.aioquic_ext.bulk import SHORT_HEADER, BulkQuicConnection
from tigas_render.transport.shared_port import Edge

DATAGRAM_HEADER = 1 + 2
"""Header of a DATAGRAM frame in bytes: type and length."""
BLACK_HOLE_PROBES = 2
"""Probe timeouts in a row after which the path is suspected of losing datagrams above QUIC's minimum size."""
UNRESPONSIVE_S = 5.0
"""Seconds of silence after which a client that owes acknowledgements counts as gone."""
SIZE_PROBE_INTERVAL_S = 60.0
"""Seconds after which the full datagram size is tried again."""

REQUESTS_PER_S = 120.0
"""Request rate of a viewer with a fast display."""
ANSWER_TIME_S = 0.1
"""Seconds to answer a request, including the client's acknowledgement delay."""
MIN_STREAMS, MAX_STREAMS = 16, 128


def max_open_streams(round_trip_s: float) -> int:
    """Maximum number of a client's open streams: enough to send a request at any time, but not hundreds.

    A stream counts from its first packet until both sides have finished it and the client has acknowledged the whole
    answer. The next MAX_STREAMS frame takes as long again to arrive, and is delayed until half of the credit is used,
    so that it is worth sending. That makes three round trips, plus the server's time and a delayed acknowledgement.
    """
    return max(MIN_STREAMS, min(MAX_STREAMS, math.ceil(REQUESTS_PER_S * (3 * round_trip_s + ANSWER_TIME_S))))


class StreamCredit(Limit):
    """A stream limit that grows by one with each finished stream, and with the round trip, and that never falls below
    the announced value.
    """

    def __init__(self, limit: Limit, round_trip_s: Callable[[], float]) -> None:
        """limit: aioquic's limit, which this one replaces."""
        self.frame_type, self.name = limit.frame_type, limit.name
        self.used = self._finished = 0
        self._round_trip_s = round_trip_s
        self.sent = max_open_streams(0.0)

    @property
    def value(self) -> int:
        """The total number of streams that the client may have opened so far."""
        return max(self.sent, self._finished + max_open_streams(self._round_trip_s()))

    @value.setter
    def value(self, value: int) -> None:
        self._finished += value - self.value


class ServerQuicConnection(BulkQuicConnection):
    """The server's side of a connection, with bounded memory."""

    def __init__(
        self,
        *,
        edge: Edge,
        reset_token: Callable[[bytes], bytes],
        reset_delay: Callable[[float], float] = lambda now: 0.0,
        **arguments: Any,
    ) -> None:
        """edge: named by all connection ids. reset_token: returns the stateless reset token of a connection id.
        reset_delay: returns the seconds to wait before the client may open a stream in place of one that was reset; a
        result of 0 counts as a replacement. arguments: aioquic's.
        """
        super().__init__(**arguments)
        self._edge = edge
        self._reset_token = reset_token
        self._mark_connection_ids()
        self.host_cid = self._local_initial_source_connection_id = self._host_cids[0].cid
        self._gapped_streams: set[int] = set()
        self._unread: dict[int, int] = {}
        """Bytes received in order that wait for the application, by stream."""
        self._raise_at = math.inf
        """When to try the full datagram size again."""
        self._reset_delay = reset_delay
        self._withheld: deque[Limit] = deque()
        """The limits to grow later, once for each stream that was reset."""
        self._credit_at: float | None = None
        """When the next of these limits grows."""
        self._local_max_streams_bidi = StreamCredit(self._local_max_streams_bidi, lambda: self._loss._rtt_smoothed)

    def _replenish_connection_ids(self) -> None:
        super()._replenish_connection_ids()
        self._mark_connection_ids()

    def _mark_connection_ids(self) -> None:
        for connection_id in self._host_cids:
            connection_id.cid = self._edge.mark_cid(connection_id.cid)
            connection_id.stateless_reset_token = self._reset_token(connection_id.cid)

    def _replace_finished_stream(self, stream_id: int, stream: QuicStream) -> None:
        """Allow another stream in place of a finished one; at a limited rate if that was reset before its answer."""
        self._unread.pop(stream_id, None)
        if stream.sender._reset_error_code is None and stream_id % 4 == 0:
            super()._replace_finished_stream(stream_id, stream)
        else:
            self._withheld.append(self._stream_limit(stream_id))

    def _discard_finished_streams(self, now: float) -> None:
        super()._discard_finished_streams(now)
        self._credit_at = None
        while self._withheld:
            if delay := self._reset_delay(now):
                self._credit_at = now + delay
                return
            self._withheld.popleft().value += 1

    def get_timer(self) -> float | None:
        """aioquic's timer, or the time when the client may open another stream, whichever is first; None at the end."""
        due = super().get_timer()
        return due if due is None or self._credit_at is None else min(due, self._credit_at)

    def _get_or_create_stream(self, frame_type: int, stream_id: int) -> QuicStream:
        stream = super()._get_or_create_stream(frame_type, stream_id)
        if not stream.receiver.starting_offset():
            self._gapped_streams.add(stream_id)
        return stream

    def pop_gapped_streams(self) -> set[int]:
        """Return, once each, the streams that received data while their first byte was missing.

        aioquic does not report a stream's data until its first byte has arrived.
        """
        begun, self._gapped_streams = self._gapped_streams, set()
        return begun

    def has_gap(self, stream_id: int) -> bool:
        """Whether a stream's first byte has not arrived yet."""
        stream = self._streams.get(stream_id)
        return stream is not None and not stream.receiver.starting_offset() and not stream.receiver.is_finished

    def set_unread_bytes(self, stream_id: int, size: int) -> None:
        """Set the number of a stream's bytes that wait for the application; reading them opens the client's window."""
        if size:
            self._unread[stream_id] = size
        else:
            self._unread.pop(stream_id, None)

    def _has_control_frames(self, stream: QuicStream) -> bool:
        return super()._has_control_frames(stream) or (
            self._window_to_announce(stream) != stream.max_stream_data_local_sent
        )

    def _window_to_announce(self, stream: QuicStream) -> int:
        """The stream's limit, up to one window ahead of the data that the application has read.

        The connection as a whole has no such limit, with which waiting uploads would hold up requests for frames.
        """
        window = self._configuration.max_stream_data
        assert stream.stream_id is not None
        limit = stream.receiver.starting_offset() + window - self._unread.get(stream.stream_id, 0)
        if (
            stream.max_stream_data_local
            and not stream.receiver.is_finished
            and limit - stream.max_stream_data_local >= window // 2
        ):
            return limit
        return stream.max_stream_data_local

    def _write_stream_limits(self, builder: QuicPacketBuilder, space: QuicPacketSpace, stream: QuicStream) -> None:
        """Announce a stream's window.

        aioquic doubles the window whenever its middle is *reached*, so a few bytes sent at ever higher offsets would
        make it allocate memory without bound.
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

    def unsent_bytes(self, stream_id: int) -> int:
        """Bytes of a stream that have not been sent yet."""
        stream = self._streams.get(stream_id)
        return 0 if stream is None else stream.sender._buffer_stop - stream.sender.highest_offset

    def total_unsent_bytes(self) -> tuple[int, int]:
        """Unsent bytes of all streams: those that wait only for the network, and the total, including slow readers'."""
        network = total = 0
        for stream in self._streams.values():
            sender = stream.sender
            if not sender.buffer_is_empty:
                unsent = sender._buffer_stop - sender.highest_offset
                total += unsent
                if sender.highest_offset < stream.max_stream_data_remote:
                    network += unsent
        return network, total

    @property
    def has_congestion_room(self) -> bool:
        """Whether the congestion window has room for all unsent data and one more packet."""
        waiting, _ = self.total_unsent_bytes()
        return self._loss.bytes_in_flight + waiting + self._max_datagram_size <= self._loss.congestion_window

    def can_write(self, stream_id: int) -> bool:
        """Whether a stream accepts data: it is open, unfinished, and neither side has reset it."""
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

    @property
    def max_datagram_payload(self) -> int:
        """Maximum bytes of data in a DATAGRAM frame that fits in one packet; 0 if the client accepts no datagrams.

        Longer data would stay at the head of aioquic's queue forever, and block it.
        """
        remote = self._remote_max_datagram_frame_size or 0
        packet = self._max_datagram_size - SHORT_HEADER - len(self._peer_cid.cid)
        return max(0, min(remote, packet) - DATAGRAM_HEADER)

    @property
    def sendable_datagrams(self) -> int:
        """Number of full datagrams that can leave at once; others would wait in a queue and could not be withdrawn."""
        room = (self._loss.congestion_window - self._loss.bytes_in_flight) // self._max_datagram_size
        return max(0, room - len(self._datagrams_pending))

    def handle_timer(self, now: float) -> None:
        """Like aioquic's method; when all packets are lost, falls back to the size that every QUIC path supports."""
        super().handle_timer(now)
        if self._loss._pto_count >= BLACK_HOLE_PROBES and self._max_datagram_size > SMALLEST_MAX_DATAGRAM_SIZE:
            self._set_datagram_size(SMALLEST_MAX_DATAGRAM_SIZE)
            self._raise_at = now + SIZE_PROBE_INTERVAL_S
            limit = self.max_datagram_payload
            fitting = [data for data in self._datagrams_pending if len(data) <= limit]
            self._datagrams_pending.clear()
            self._datagrams_pending.extend(fitting)

    def datagrams_to_send(self, now: float) -> list[Datagram]:
        """Like aioquic's method; after a fallback, occasionally adds a probe of the full datagram size."""
        datagrams = super().datagrams_to_send(now)
        if datagrams and now >= self._raise_at and self._can_write_in_bulk():
            self._raise_at = now + SIZE_PROBE_INTERVAL_S
            datagrams.append(self._probe_full_size(now))
        return datagrams

    def _probe_full_size(self, now: float) -> Datagram:
        """A padded packet of full size that probes the path (RFC 8899).

        Loss recovery treats it as neither in flight nor ack-eliciting, because its loss says nothing about congestion
        (RFC 9000, 14.4), and nothing waits for it.
        """
        size = self._configuration.max_datagram_size
        payload = bytes([QuicFrameType.PING]).ljust(size - SHORT_HEADER - len(self._peer_cid.cid), b"\0")
        number, (datagram,) = self._seal([payload])
        self._loss.on_other_packet_sent(
            number,
            now,
            size,
            [(self._on_probe_delivery, ())],
            self._spaces[Epoch.ONE_RTT],
            is_ack_eliciting=False,
        )
        return datagram, self._network_paths[0].addr

    def _on_probe_delivery(self, delivery: QuicDeliveryState) -> None:
        if delivery == QuicDeliveryState.ACKED:
            self._set_datagram_size(self._configuration.max_datagram_size)
            self._raise_at = math.inf

    def _set_datagram_size(self, size: int) -> None:
        self._max_datagram_size = size
        self._loss.set_datagram_size(size)

    def is_unresponsive(self, now: float) -> bool:
        """Whether packets are unacknowledged and nothing has arrived for UNRESPONSIVE_S."""
        heard = self._spaces[Epoch.ONE_RTT].largest_received_time
        return self._loss._pto_count > 0 and heard is not None and now - heard > UNRESPONSIVE_S

    @property
    def is_established(self) -> bool:
        """Whether the handshake is complete; data received before that is early data and may be a replay."""
        return self._handshake_complete
