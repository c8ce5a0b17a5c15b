"""Packets sealed in a batch equal those sealed one by one by aioquic."""

from __future__ import annotations

import pytest
from aioquic._crypto import CryptoError
from aioquic.quic.crypto import CryptoContext
from aioquic.quic.packet import QuicProtocolVersion
from aioquic.tls import CipherSuite

from tigas_render.transport.aioquic_ext.protection import open_packet, seal

CID = bytes(range(8))
FIRST = 0x41
"""A short header with a packet number of two bytes."""
SUITES = [
    CipherSuite.AES_128_GCM_SHA256,
    CipherSuite.AES_256_GCM_SHA384,
    CipherSuite.CHACHA20_POLY1305_SHA256,
]


def crypto(suite: CipherSuite = SUITES[0], secret: bytes = bytes(48)) -> CryptoContext:
    context = CryptoContext()
    context.setup(cipher_suite=suite, secret=secret, version=QuicProtocolVersion.VERSION_1)
    return context


@pytest.mark.parametrize("suite", SUITES)
@pytest.mark.parametrize("number", [0, 0xFFFE, 0x123456])
def test_a_batch_is_what_aioquic_seals_packet_by_packet(suite: CipherSuite, number: int) -> None:
    payloads = [bytes(range(size % 256)) + bytes(size) for size in (2, 60, 1400)]
    singly = [
        crypto(suite).encrypt_packet(bytes([FIRST]) + CID + (at & 0xFFFF).to_bytes(2, "big"), payload, at)
        for at, payload in enumerate(payloads, number)
    ]
    assert seal(crypto(suite), FIRST, CID, number, payloads) == singly


@pytest.mark.parametrize("suite", SUITES)
@pytest.mark.parametrize("number", [0, 0xFFFE, 0x123456])
def test_what_was_sealed_is_opened(suite: CipherSuite, number: int) -> None:
    (packet,) = seal(crypto(suite), FIRST, CID, number, [b"frames"])
    assert open_packet(crypto(suite), packet, len(CID), max(0, number - 3)) == (FIRST, b"frames", number)


def test_a_packet_of_another_key_phase_is_told_apart() -> None:
    (packet,) = seal(crypto(), FIRST | 0x04, CID, 1, [b"frames"])
    assert open_packet(crypto(), packet, len(CID), 1) is None


@pytest.mark.parametrize("spoil", [lambda data: data[:-1] + b"x", lambda data: data[:20], lambda data: data[:1]])
def test_a_spoilt_packet_is_refused(spoil: object) -> None:
    assert callable(spoil)
    (packet,) = seal(crypto(), FIRST, CID, 1, [b"frames"])
    with pytest.raises(CryptoError):
        open_packet(crypto(), spoil(packet), len(CID), 1)
