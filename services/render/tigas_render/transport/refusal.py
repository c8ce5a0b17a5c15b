"""The answer to a client's first packet that opens no connection: a close, instead of silence (RFC 9000, 5.2.2)."""

from __future__ import annotations

import os

from aioquic.quic.configuration import SMALLEST_MAX_DATAGRAM_SIZE
from aioquic.quic.crypto import CryptoPair
from aioquic.quic.packet import QuicErrorCode, QuicFrameType, QuicHeader, QuicPacketType
from aioquic.quic.packet_builder import QuicPacketBuilder


def encode_refusal(header: QuicHeader, reason: str) -> bytes:
    """The Initial packet that refuses the connection of `header`, with CONNECTION_REFUSED and a short reason.

    It is far smaller than the packet it answers, and leaves no state.
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
