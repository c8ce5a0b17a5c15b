"""A fast path for what a client sends most: 1-RTT packets on the path that is in use.

aioquic still handles their frames, and whatever else arrives. Together with `quic`, `bulk`, `protection`, `recovery`
and `h3` this is the one place that reaches into aioquic's private attributes.
"""

from __future__ import annotations

from typing import Any

from aioquic._crypto import CryptoError
from aioquic.quic.connection import END_STATES, QuicConnection, QuicConnectionError, QuicReceiveContext
from aioquic.quic.recovery import MAX_ACK_RANGES, QuicPacketSpace
from aioquic.tls import Epoch

from tigas_render.transport.protection import open_packet

ACK_DELAY = 0.015
"""Seconds that a request's acknowledgement waits for the frame to take it along; below the 25 ms that QUIC's clients
expect unless they are told otherwise (RFC 9000, 18.2)."""
LONG_HEADER, RESERVED, SPIN = 0x80, 0x18, 0x20


class ReceivingQuicConnection(QuicConnection):
    """A server's connection that opens usual packets itself."""

    def receive_datagram(self, data: bytes, addr: Any, now: float) -> None:
        """As aioquic's."""
        if not self._is_usual(data, addr):
            super().receive_datagram(data, addr, now)
            return
        space = self._spaces[Epoch.ONE_RTT]
        try:
            opened = open_packet(
                self._cryptos[Epoch.ONE_RTT].recv, data, len(self.host_cid), space.expected_packet_number
            )
        except CryptoError:
            return
        if opened is None or opened[0] & RESERVED:  # a new key, or an error that ends the connection
            super().receive_datagram(data, addr, now)
            return
        first, payload, number = opened
        if number not in space.received_packets:
            self._opened(first, payload, number, space, now)

    def _is_usual(self, data: bytes, addr: Any) -> bool:
        return (
            self._handshake_confirmed
            and self._state not in END_STATES
            and len(self._network_paths) == 1
            and self._network_paths[0].addr == addr
            and self._network_paths[0].is_validated
            and len(data) > len(self.host_cid)
            and not data[0] & LONG_HEADER
            and data[1 : 1 + len(self.host_cid)] == self.host_cid
            and not self._cryptos[Epoch.ZERO_RTT].recv.is_valid()
        )

    def _opened(self, first: int, payload: bytes, number: int, space: QuicPacketSpace, now: float) -> None:
        """What aioquic does with a packet that is neither a duplicate nor from another path."""
        in_order = number == space.largest_received_packet + 1
        if number > space.expected_packet_number:
            space.expected_packet_number = number + 1
        if number > self._spin_highest_pn:
            self._spin_bit = bool(first & SPIN)
            self._spin_highest_pn = number
        context = QuicReceiveContext(
            epoch=Epoch.ONE_RTT,
            host_cid=self.host_cid,
            network_path=self._network_paths[0],
            quic_logger_frames=None,
            time=now,
            version=None,
        )
        try:
            is_ack_eliciting, _ = self._payload_received(context, payload)
        except QuicConnectionError as error:
            self._logger.warning(error)
            self.close(error_code=error.error_code, frame_type=error.frame_type, reason_phrase=error.reason_phrase)
            return
        if self._state in END_STATES or self._close_pending:
            return
        self._close_at = now + self._idle_timeout()
        self._ack_eliciting_sent_since_receipt = False
        if number > space.largest_received_packet:
            space.largest_received_packet = number
            space.largest_received_time = now
        space.ack_queue.add(number)
        space.received_packets.add(number)
        if len(space.ack_queue) > MAX_ACK_RANGES:
            space.ack_queue.shift()
        if is_ack_eliciting:
            # At once for every second packet, and for one that shows that another is missing (RFC 9000, 13.2.1 and 2)
            space.ack_at = now + ACK_DELAY if in_order and space.ack_at is None else now
