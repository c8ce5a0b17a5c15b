"""Protection of 1-RTT packets (RFC 9001, 5) in batches, with little Python code per packet."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from aioquic._crypto import CryptoError
from aioquic.quic.crypto import CryptoContext
from aioquic.quic.packet import decode_packet_number
from cryptography.exceptions import InvalidTag

NUMBER_BYTES = 2
"""Bytes of the packet numbers that we send."""
SAMPLE_BYTES = 16
_SAMPLE = slice(4 - NUMBER_BYTES, 4 - NUMBER_BYTES + SAMPLE_BYTES)
_MASK = struct.Struct("!BH13x")
KEY_PHASE = 0x04


def seal(crypto: CryptoContext, first: int, cid: bytes, number: int, payloads: Sequence[bytes]) -> list[bytes]:
    """Seal payloads as packets with consecutive numbers from `number`. first: the first byte before protection."""
    assert crypto.aead is not None
    assert crypto.hp is not None
    header = struct.Struct(f"!B{len(cid)}sH").pack
    encrypt, nonce = crypto.aead._aead.encrypt, crypto.aead._iv
    sealed = [
        encrypt((nonce ^ at).to_bytes(12, "big"), payload, header(first, cid, at & 0xFFFF))
        for at, payload in enumerate(payloads, number)
    ]
    masks = _header_masks(crypto, [each[_SAMPLE] for each in sealed])
    return [
        header(first ^ first_mask & 0x1F, cid, at & 0xFFFF ^ number_mask) + each
        for (at, each), (first_mask, number_mask) in zip(
            enumerate(sealed, number), _MASK.iter_unpack(masks), strict=True
        )
    ]


def _header_masks(crypto: CryptoContext, samples: Sequence[bytes]) -> bytes:
    """Header protection masks of the samples, 16 bytes each, of which the first five are used."""
    assert crypto.hp is not None
    if crypto.hp._is_chacha20:
        return b"".join(crypto.hp._mask(sample).ljust(SAMPLE_BYTES) for sample in samples)
    return crypto.hp._encryptor.update(b"".join(samples))


def open_packet(crypto: CryptoContext, data: bytes, cid_bytes: int, expected: int) -> tuple[int, bytes, int] | None:
    """The first byte, payload and number of a packet; None if it is in another key phase.

    Raises CryptoError if it was not sealed with this key.
    """
    start = 1 + cid_bytes
    assert crypto.aead is not None
    assert crypto.hp is not None
    if len(data) < start + 4 + SAMPLE_BYTES:
        raise CryptoError("The packet is too short.")
    mask = crypto.hp._mask(data[start + 4 : start + 4 + SAMPLE_BYTES])
    first = data[0] ^ mask[0] & 0x1F
    if (first & KEY_PHASE) >> 2 != crypto.key_phase:
        return None
    stop = start + (size := (first & 0x03) + 1)
    truncated = int.from_bytes(data[start:stop], "big") ^ int.from_bytes(mask[1 : 1 + size], "big")
    number = decode_packet_number(truncated, 8 * size, expected)
    header = b"%c%b%b" % (first, data[1:start], truncated.to_bytes(size, "big"))
    try:
        payload = crypto.aead._aead.decrypt((crypto.aead._iv ^ number).to_bytes(12, "big"), data[stop:], header)
    except InvalidTag:
        raise CryptoError("The packet was not sealed with this key.") from None
    return first, payload, number
