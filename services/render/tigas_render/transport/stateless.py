"""Stateless answers to packets that belong to no connection, and the tokens in them."""

from __future__ import annotations

import hashlib
import hmac
import os
import struct

from aioquic.quic.configuration import SMALLEST_MAX_DATAGRAM_SIZE
from aioquic.quic.crypto import CryptoPair
from aioquic.quic.packet import QuicErrorCode, QuicFrameType, QuicHeader, QuicPacketType, encode_quic_retry
from aioquic.quic.packet_builder import QuicPacketBuilder
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from tigas_common.udp import Address
from tigas_render.transport.shared_port import Edge

RETRY_TOKEN_S = 10.0
"""Seconds in which a client must return with its token."""
RETRY_CID_LENGTH = 8
RETRY_KEY_LENGTH = 16
NONCE_LENGTH = 12

RESET_TOKEN_LENGTH = 16
MIN_RESET = 5 + RESET_TOKEN_LENGTH
"""Minimum length in bytes of a reset, which must look like a packet with a short header."""
MAX_RESET = 43
"""Maximum length in bytes; a longer reset has no benefit."""
RESETS_PER_S = 100


class RetryPackets:
    """Retry packets (RFC 9000, 8.1.2), with tokens by which a client proves that it can receive at its address.

    A server under a flood of first packets requires a token before it spends memory on a handshake. Servers with the
    same key accept each other's tokens.
    """

    def __init__(self, key: bytes | None = None) -> None:
        """key: RETRY_KEY_LENGTH bytes; random by default."""
        self._aead = AESGCM(key or os.urandom(RETRY_KEY_LENGTH))

    def create(self, header: QuicHeader, address: Address, now: float, edge: Edge | None = None) -> bytes:
        """The Retry packet for a first packet with this header. edge: the one to return to; None for any."""
        source_cid = os.urandom(RETRY_CID_LENGTH)
        if edge is not None:
            source_cid = edge.mark_cid(source_cid)
        return encode_quic_retry(
            version=header.version or 0,
            source_cid=source_cid,
            destination_cid=header.source_cid,
            original_destination_cid=header.destination_cid,
            retry_token=self.create_token(address, header.destination_cid, source_cid, now),
        )

    def create_token(self, address: Address, original_cid: bytes, retry_cid: bytes, now: float) -> bytes:
        """The token that a client must send with its next first packet."""
        nonce = os.urandom(NONCE_LENGTH)
        return nonce + self._aead.encrypt(nonce, struct.pack("!d", now) + original_cid, _retry_aad(address, retry_cid))

    def validate(self, token: bytes, address: Address, retry_cid: bytes, now: float) -> bytes | None:
        """The connection id that the client chose originally; None if the token is invalid for it or too old."""
        try:
            content = self._aead.decrypt(token[:NONCE_LENGTH], token[NONCE_LENGTH:], _retry_aad(address, retry_cid))
        except (InvalidTag, ValueError):
            return None
        (made,) = struct.unpack_from("!d", content)
        return content[8:] if 0 <= now - made <= RETRY_TOKEN_S else None


def _retry_aad(address: Address, retry_cid: bytes) -> bytes:
    return repr(address[:2]).encode() + b"|" + retry_cid


class StatelessResets:
    """Stateless resets (RFC 9000, 10.3), by which a restarted server ends the lost connections of earlier clients.

    Without a reset, a client keeps sending until its idle timeout. Tokens are derived from the key, the port and the
    connection id; the port prevents two servers with the same key from ending each other's connections.
    """

    def __init__(self, key: bytes, port: int) -> None:
        self._key = hashlib.sha256(key + port.to_bytes(2, "big")).digest()
        self._second = 0
        self._sent = 0

    def token(self, cid: bytes) -> bytes:
        """The reset token of a connection id, which proves that a reset comes from this server."""
        return hmac.digest(self._key, cid, "sha256")[:RESET_TOKEN_LENGTH]

    def create(self, size: int, cid: bytes, now: float) -> bytes | None:
        """The reset for a packet of `size` bytes for an unknown connection; None for a very short packet, or if there
        have been too many. It is shorter than the packet, so that two endpoints cannot keep resetting each other.
        """
        length = min(size - 1, MAX_RESET)
        if length < MIN_RESET:
            return None
        if int(now) != self._second:
            self._second, self._sent = int(now), 0
        if self._sent >= RESETS_PER_S:
            return None
        self._sent += 1
        filling = bytearray(os.urandom(length - RESET_TOKEN_LENGTH))
        filling[0] = 0x40 | filling[0] & 0x3F
        return bytes(filling) + self.token(cid)


def refusal_packet(header: QuicHeader, reason: str) -> bytes:
    """The Initial packet that refuses a connection, with CONNECTION_REFUSED and a short reason (RFC 9000, 5.2.2).

    header: of the client's first packet, which is far larger than the refusal.
    """
    version, text = header.version, reason.encode()
    assert version is not None
    crypto = CryptoPair()
    crypto.setup_initial(cid=header.destination_cid, is_client=False, version=version)
    builder = QuicPacketBuilder(
        host_cid=os.urandom(len(header.destination_cid)),
        peer_cid=header.source_cid,
        version=version,
        is_client=False,
        max_datagram_size=SMALLEST_MAX_DATAGRAM_SIZE,
    )
    builder.start_packet(QuicPacketType.INITIAL, crypto)
    frame = builder.start_frame(QuicFrameType.TRANSPORT_CLOSE, capacity=1 + 8 + 1 + 2 + len(text))
    for number in (QuicErrorCode.CONNECTION_REFUSED, QuicFrameType.PADDING, len(text)):
        frame.push_uint_var(number)
    frame.push_bytes(text)
    [datagram], _ = builder.flush()
    return datagram
