"""A fast path for a client's most common packets, 1-RTT packets on the active path.

aioquic still handles the frames in them, and all other packets.
"""

from __future__ import annotations

from copy import copy
from typing import Any

from aioquic._crypto import CryptoError
from aioquic.quic.connection import (
    END_STATES,
    QuicConnection,
    QuicConnectionError,
    QuicNetworkPath,
    QuicReceiveContext,
)
from aioquic.quic.crypto import CryptoContext
from aioquic.quic.recovery import MAX_ACK_RANGES, QuicPacketSpace
from aioquic.tls import Epoch

from tigas_render.transport.aioquic_ext.protection import open_packet
from tigas_render.transport.aioquic_ext.recovery import BatchRecovery

ACK_DELAY = 0.015
"""Seconds for which a request's acknowledgement waits to be sent together with the frame: less than the 25 ms that
QUIC clients assume by default (RFC 9000, 18.2).
"""
LONG_HEADER, RESERVED, SPIN = 0x80, 0x18, 0x20
KEY_PACKETS = 1 << 22
"""Number of packets sealed with one key: half the limit for AES-GCM (RFC 9001, 6.6)."""


class ReceivingQuicConnection(QuicConnection):
    """A connection that opens common packets without aioquic."""

    _loss: BatchRecovery

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._migrated_from: QuicNetworkPath | None = None
        """The previous path of a client that has moved to a path not validated yet."""
        self._secret: bytes | None = None
        self._secret_since = 0
        """Number of the first packet sealed with this secret's keys."""
        self._old_keys: CryptoContext | None = None
        self._old_keys_until = 0.0

    def receive_datagram(self, data: bytes, addr: Any, now: float) -> None:
        if not self._is_on_fast_path(data, addr):
            self._receive_on_slow_path(data, addr, now)
            return
        space = self._spaces[Epoch.ONE_RTT]
        try:
            opened = open_packet(
                self._cryptos[Epoch.ONE_RTT].recv, data, len(self.host_cid), space.expected_packet_number
            )
        except CryptoError:
            return
        if opened is None:
            opened = self._open_with_old_keys(data, space.expected_packet_number, now)
        if opened is None or opened[0] & RESERVED:  # a new key, or an error that ends the connection
            self._receive_on_slow_path(data, addr, now)
            return
        first, payload, number = opened
        if number not in space.received_packets:
            self._handle_packet(first, payload, number, space, now)

    def _update_keys_if_due(self, now: float) -> None:
        """Start a key update when one is due and the client has acknowledged the current keys (RFC 9001, 6.1).

        The old keys are kept because aioquic drops them at once, although the client uses them until it learns of the
        update.
        """
        crypto = self._cryptos[Epoch.ONE_RTT]
        if crypto.send.secret is not self._secret:
            self._secret, self._secret_since = crypto.send.secret, self._packet_number
        if (
            self._packet_number - self._secret_since >= KEY_PACKETS
            and self._spaces[Epoch.ONE_RTT].largest_acked_packet >= self._secret_since
            and self._handshake_confirmed
        ):
            self._old_keys, self._old_keys_until = copy(crypto.recv), now + 3 * self._loss.get_probe_timeout()
            self.request_key_update()

    def _open_with_old_keys(self, data: bytes, expected: int, now: float) -> tuple[int, bytes, int] | None:
        if self._old_keys is None or now > self._old_keys_until:
            return None
        try:
            return open_packet(self._old_keys, data, len(self.host_cid), expected)
        except CryptoError:
            return None

    def _is_on_fast_path(self, data: bytes, addr: Any) -> bool:
        return (
            self._handshake_confirmed
            and self._state not in END_STATES
            and self._network_paths[0].addr == addr
            and self._network_paths[0].is_validated
            and len(data) > len(self.host_cid)
            and not data[0] & LONG_HEADER
            and data[1 : 1 + len(self.host_cid)] == self.host_cid
            and not self._cryptos[Epoch.ZERO_RTT].recv.is_valid()
        )

    def _receive_on_slow_path(self, data: bytes, addr: Any, now: float) -> None:
        """Let aioquic handle a datagram, and complete the client's move to another path once the path is validated."""
        before = self._network_paths[0] if self._network_paths else None
        super().receive_datagram(data, addr, now)
        if before is not None and before.is_validated and before is not self._network_paths[0]:
            self._migrated_from = self._migrated_from or before
        if self._migrated_from is not None and self._network_paths[0].is_validated:
            self._complete_migration(self._migrated_from, now)
            self._migrated_from = None

    def _complete_migration(self, old: QuicNetworkPath, now: float) -> None:
        """Drop all other paths, and the old path's measurements if the client's address has changed.

        A change of the port alone is a NAT rebinding: the route is the same, so the congestion window and the round
        trip are kept (RFC 9000, 9.4).
        """
        for path in self._network_paths[1:]:
            if path.peer_cid is not None:
                self._retire_peer_cid(path.peer_cid)
        del self._network_paths[1:]
        if self._network_paths[0].addr[0] != old.addr[0]:
            self._loss.reset_path_state(now)

    def _handle_packet(self, first: int, payload: bytes, number: int, space: QuicPacketSpace, now: float) -> None:
        """Do what aioquic does with a packet that is neither a duplicate nor from another path."""
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
            # Immediately for every second packet, and for a packet that reveals a gap (RFC 9000, 13.2.1 and 13.2.2)
            space.ack_at = now + ACK_DELAY if in_order and space.ack_at is None else now
