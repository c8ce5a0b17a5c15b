"""A fast path for a frame server's most common work: packets full of one stream's data.

aioquic's packet writer examines every limit, every stream and every kind of frame for each packet. It still writes
rare frames; stream data, acknowledgements and limits are written directly into packets, a batch at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from aioquic._buffer import Buffer
from aioquic.quic.connection import END_STATES, QuicNetworkPath
from aioquic.quic.packet import PACKET_FIXED_BIT, QuicFrameType
from aioquic.quic.packet_builder import PACKET_NUMBER_SEND_SIZE, QuicDeliveryHandler, QuicPacketBuilder
from aioquic.quic.stream import QuicStream, QuicStreamSender
from aioquic.tls import Epoch

from tigas_common.udp import Datagram
from tigas_render.transport.aioquic_ext.congestion import TickPacer
from tigas_render.transport.aioquic_ext.copies import CopyQueue
from tigas_render.transport.aioquic_ext.protection import seal
from tigas_render.transport.aioquic_ext.receiving import ReceivingQuicConnection
from tigas_render.transport.aioquic_ext.recovery import BatchRecovery, CopyPacket, StreamPacket

SHORT_HEADER = 1 + PACKET_NUMBER_SEND_SIZE + 16
"""Overhead of a 1-RTT packet in bytes, without the connection id: first byte, packet number and AEAD tag."""
_STREAM = bytes([QuicFrameType.STREAM_BASE | 0x04])
"""The type of a STREAM frame with an offset that extends to the end of its packet."""
_STREAM_FIN = bytes([QuicFrameType.STREAM_BASE | 0x05])
"""The same for the last frame of a stream."""
PREAMBLE_BYTES = 600
"""Maximum size in bytes of the acknowledgements and limits ahead of a packet's stream data."""

Chunk = tuple[QuicStreamSender, int, int, bool]
"""The part of a stream that a packet carries: sender, start and end offsets, and whether the stream ends."""


class Preamble:
    """Frames that aioquic writes before a packet's stream data. It passes for a QuicPacketBuilder."""

    def __init__(self, packet_number: int) -> None:
        self.packet_number = packet_number
        self.handlers: list[tuple[QuicDeliveryHandler, Any]] = []
        """Delivery handlers of the frames."""
        self.is_ack_eliciting = False
        """Whether the frames elicit an acknowledgement."""
        self._buffer = Buffer(PREAMBLE_BYTES)

    @property
    def remaining_buffer_space(self) -> int:
        return PREAMBLE_BYTES - self._buffer.tell()

    def start_frame(
        self,
        frame_type: int,
        capacity: int = 1,
        handler: QuicDeliveryHandler | None = None,
        handler_args: Sequence[Any] = (),
    ) -> Buffer:
        """Start a frame, like QuicPacketBuilder; there is room for all frames that are written here."""
        self._buffer.push_uint_var(frame_type)
        self.is_ack_eliciting |= frame_type != QuicFrameType.ACK
        if handler is not None:
            self.handlers.append((handler, handler_args))
        return self._buffer

    @property
    def data(self) -> bytes:
        return self._buffer.data


class BulkQuicConnection(ReceivingQuicConnection):
    """A connection that writes stream data in bulk, oldest stream first, so that frames arrive one after the other."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._loss = BatchRecovery(
            congestion_control_algorithm=self._configuration.congestion_control_algorithm,
            initial_rtt=self._configuration.initial_rtt,
            max_datagram_size=self._max_datagram_size,
            peer_completed_address_validation=False,
            send_probe=self._send_probe,
            logger=self._logger,
        )
        self._pacer = self._loss._pacer = TickPacer(max_datagram_size=self._max_datagram_size)
        self._copies = CopyQueue(self._loss, self._pacer)

    def datagrams_to_send(self, now: float) -> list[Datagram]:
        self._update_keys_if_due(now)
        self._discard_finished_streams(now)
        datagrams: list[Datagram] = []
        if self._has_rare_frames():
            datagrams = super().datagrams_to_send(now)
        else:
            self._pacing_at = None
        if self._can_write_in_bulk():
            datagrams += self._write_in_bulk(now)
            datagrams += self._write_copies(now)
        return datagrams

    def _can_write_in_bulk(self) -> bool:
        return (
            self._handshake_confirmed
            and self._network_paths[0].is_validated
            and not self._probe_pending
            and not self._close_pending
            and self._state not in END_STATES
        )

    def _has_rare_frames(self) -> bool:
        """Whether frames other than stream data, acknowledgements and connection limits may have to be written."""
        return bool(
            not self._can_write_in_bulk()
            or self._network_paths[0].remote_challenges
            or any(map(self._can_probe, self._network_paths[1:]))
            or self._handshake_done_pending
            or self._retire_connection_ids
            or self._streams_blocked_pending
            or self._ping_pending
            or self._datagrams_pending
            or not self._crypto_streams[Epoch.ONE_RTT].sender.buffer_is_empty
            or any(not cid.was_sent for cid in self._host_cids)
            or any(map(self._has_control_frames, self._streams_queue))
        )

    def _can_probe(self, path: QuicNetworkPath) -> bool:
        """Whether aioquic has something to write on an inactive path, and a connection id for it."""
        return bool(
            (path.remote_challenges or not (path.is_validated or path.local_challenge_sent))
            and (path.peer_cid or self._peer_cid_available)
        )

    def _has_control_frames(self, stream: QuicStream) -> bool:
        """Whether frames other than data may have to be written for a stream."""
        return stream.receiver.stop_pending or stream.sender.reset_pending

    def _write_application(self, builder: QuicPacketBuilder, network_path: QuicNetworkPath, now: float) -> None:
        if not self._can_write_in_bulk():
            super()._write_application(builder, network_path, now)
            return
        queue = self._streams_queue
        self._streams_queue = list(filter(self._has_control_frames, queue))
        try:
            super()._write_application(builder, network_path, now)
        finally:
            self._streams_queue = queue

    def _discard_finished_streams(self, now: float) -> None:
        """Forget finished streams, and let the client open as many new ones (RFC 9000, 4.6)."""
        for stream in [stream for stream in self._streams_queue if stream.is_finished]:
            self._streams_queue.remove(stream)
            stream_id = _stream_id(stream)
            del self._streams[stream_id]
            if stream_id % 2 == 0:
                self._replace_finished_stream(stream_id, stream)

    def _replace_finished_stream(self, stream_id: int, stream: QuicStream) -> None:
        """Allow the client another stream in place of a finished one."""
        self._stream_limit(stream_id).value += 1

    def _write_in_bulk(self, now: float) -> list[Datagram]:
        """Write as many packets as may leave now, with pending acknowledgements in the first."""
        loss = self._loss
        window = (loss.congestion_window - loss.bytes_in_flight) // self._max_datagram_size
        sending = [
            stream for stream in self._streams_queue if not stream.sender.buffer_is_empty and not stream.is_blocked
        ]
        allowed = self._pacer.allowance(now, window) if sending and window > 0 else 0
        space = self._spaces[Epoch.ONE_RTT]
        announces_limits = window > 0 and self._has_limits_to_announce()
        preamble = None
        if announces_limits or (space.ack_at is not None and (allowed or space.ack_at <= now)):
            preamble = Preamble(self._packet_number)
            if space.ack_at is not None:
                self._write_ack_frame(builder=preamble, space=space, now=now)  # type: ignore[arg-type]
            if announces_limits:
                self._write_connection_limits(builder=preamble, space=space)  # type: ignore[arg-type]
        prefix = b"" if preamble is None else preamble.data
        chunks: list[Chunk] = []
        payloads: list[bytes] = []
        for stream in sorted(sending, key=_stream_id):
            if len(chunks) < allowed:
                self._split(stream, allowed - len(chunks), prefix if not chunks else b"", chunks, payloads)
        if chunks:
            self._pacer.update_after_sends(len(chunks))
        if sending and window > len(chunks) == allowed:
            left = sum(stream.sender._buffer_stop - stream.sender.next_offset for stream in sending)
            self._pacing_at = self._pacer.next_burst(now, -(-left // self._max_datagram_size)) if left else None
        if preamble is not None and not chunks:
            payloads.append(prefix)
        return self._seal_and_register(payloads, chunks, preamble, now) if payloads else []

    def _write_copies(self, now: float) -> list[Datagram]:
        """Write second copies of sent packets, once all other data has been sent."""
        if not self._copies or any(not stream.sender.buffer_is_empty for stream in self._streams_queue):
            return []
        taken = self._copies.pop_due(now)
        self._pacing_at = self._copies.next_send_time(now)
        payloads = []
        for packet in taken:
            sender = packet.sender
            assert sender._stream_id is not None
            start, stop = (at - sender._buffer_start for at in (packet.start, packet.stop))
            head = (_STREAM_FIN if packet.fin else _STREAM, _varint(sender._stream_id), _varint(packet.start))
            payloads.append(b"".join((*head, sender._buffer[start:stop])))
        if not payloads:
            return []
        number, datagrams = self._seal(payloads)
        copies = [
            CopyPacket(at, now, len(datagram), packet.sender, packet.start, packet.stop, packet.fin)
            for at, (datagram, packet) in enumerate(zip(datagrams, taken, strict=True), number)
        ]
        self._loss.on_copies_sent(copies, self._spaces[Epoch.ONE_RTT])
        path = self._network_paths[0]
        path.bytes_sent += sum(map(len, datagrams))
        return [(datagram, path.addr) for datagram in datagrams]

    def _has_limits_to_announce(self) -> bool:
        """Whether aioquic would announce a limit of the connection."""
        data = self._local_max_data
        return (
            data.used * 2 > data.value
            or data.value != data.sent
            or any(
                (more := limit.value - limit.sent) and limit.sent - limit.used < more
                for limit in (self._local_max_streams_bidi, self._local_max_streams_uni)
            )
        )

    def _split(self, stream: QuicStream, count: int, prefix: bytes, chunks: list[Chunk], payloads: list[bytes]) -> None:
        """Add a stream's chunks for at most `count` packets, and their payloads; `prefix` starts the first."""
        sender, pending = stream.sender, stream.sender._pending
        stream_id = _varint(_stream_id(stream))
        size = self._max_datagram_size - SHORT_HEADER - len(self._peer_cid.cid)
        count += len(chunks)
        with memoryview(sender._buffer) as buffer:
            while len(chunks) < count and len(pending):
                sent = sender.highest_offset
                start, stop = pending[0].start, pending[0].stop
                limit = min(
                    stop, sent + self._remote_max_data - self._remote_max_data_used, stream.max_stream_data_remote
                )
                at = start
                while len(chunks) < count and at < limit:
                    position = _varint(at)
                    end = min(limit, at + size - len(prefix) - 1 - len(stream_id) - len(position))
                    fin = end == sender._buffer_fin
                    data = buffer[at - sender._buffer_start : end - sender._buffer_start]
                    payloads.append(b"".join((prefix, _STREAM_FIN if fin else _STREAM, stream_id, position, data)))
                    chunks.append((sender, at, end, fin))
                    at, prefix = end, b""
                if at == start:  # flow control
                    return
                pending.subtract(start, at)
                sender._pending_eof &= at != sender._buffer_fin
                sender.highest_offset = max(sent, at)
                self._remote_max_data_used += sender.highest_offset - sent
        if len(chunks) < count and not len(pending) and sender._pending_eof:
            assert sender._buffer_fin is not None
            sender._pending_eof = False
            payloads.append(b"".join((prefix, _STREAM_FIN, stream_id, _varint(sender._buffer_fin))))
            chunks.append((sender, sender._buffer_fin, sender._buffer_fin, True))
        sender.buffer_is_empty = not len(pending) and not sender._pending_eof

    def _seal_and_register(
        self, payloads: list[bytes], chunks: list[Chunk], preamble: Preamble | None, now: float
    ) -> list[Datagram]:
        path, space = self._network_paths[0], self._spaces[Epoch.ONE_RTT]
        number, datagrams = self._seal(payloads)
        handlers = [] if preamble is None else preamble.handlers
        if chunks:
            packets = [
                StreamPacket(at, now, len(datagram), *chunk)
                for at, (datagram, chunk) in enumerate(zip(datagrams, chunks, strict=True), number)
            ]
            packets[0].others = handlers
            self._loss.on_stream_packets_sent(packets, space)
            self._copies.add(packets, now)
        else:
            assert preamble is not None
            self._loss.on_other_packet_sent(
                number, now, len(datagrams[0]), handlers, space, is_ack_eliciting=preamble.is_ack_eliciting
            )
        if not self._ack_eliciting_sent_since_receipt and (preamble is None or chunks or preamble.is_ack_eliciting):
            self._close_at = now + self._idle_timeout()
            self._ack_eliciting_sent_since_receipt = True
        path.bytes_sent += sum(map(len, datagrams))
        return [(datagram, path.addr) for datagram in datagrams]

    def _seal(self, payloads: list[bytes]) -> tuple[int, list[bytes]]:
        """Seal payloads. Returns the number of the first packet, and the packets."""
        crypto, number = self._cryptos[Epoch.ONE_RTT], self._packet_number
        if crypto._update_key_requested:
            crypto._update_key("local_update")
        first = PACKET_FIXED_BIT | self._spin_bit << 5 | crypto.key_phase << 2 | PACKET_NUMBER_SEND_SIZE - 1
        self._packet_number += len(payloads)
        return number, seal(crypto.send, first, self._peer_cid.cid, number, payloads)


def _stream_id(stream: QuicStream) -> int:
    assert stream.stream_id is not None
    return stream.stream_id


def _varint(value: int) -> bytes:
    """Encode a variable-length integer (RFC 9000, 16) in four or eight bytes."""
    if value < 1 << 30:
        return (value | 0x8000_0000).to_bytes(4, "big")
    return (value | 0xC000_0000_0000_0000).to_bytes(8, "big")
