"""Retry tokens prove an address, and clients of a stopped server are reset by the next one, and no others."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tigas_render.transport.stateless import (
    MIN_RESET,
    RESET_TOKEN_LENGTH,
    RESETS_PER_S,
    RETRY_TOKEN_S,
    RetryPackets,
    StatelessResets,
)

ADDRESS = ("192.0.2.1", 4433)
KEY, CID = bytes(32), bytes(8)


def test_a_retry_token_is_for_one_address_one_id_and_a_while() -> None:
    retries = RetryPackets()
    token = retries.create_token(ADDRESS, b"original", b"retry", now=100.0)
    assert retries.validate(token, ADDRESS, b"retry", now=100.0 + RETRY_TOKEN_S) == b"original"
    assert retries.validate(token, ADDRESS, b"retry", now=100.1 + RETRY_TOKEN_S) is None
    for address, cid in ((("192.0.2.2", 4433), b"retry"), (("192.0.2.1", 4434), b"retry"), (ADDRESS, b"other")):
        assert retries.validate(token, address, cid, now=100.0) is None
    for forged in (b"", b"short", token[:-1], token[:-1] + bytes([token[-1] ^ 1]), bytes(len(token))):
        assert retries.validate(forged, ADDRESS, b"retry", now=100.0) is None
    assert RetryPackets().validate(token, ADDRESS, b"retry", now=100.0) is None


def test_the_next_server_on_the_port_makes_the_same_reset_tokens_and_no_other_does() -> None:
    token = StatelessResets(KEY, 4433).token(CID)
    assert StatelessResets(KEY, 4433).token(CID) == token
    assert len(token) == RESET_TOKEN_LENGTH
    assert token not in (
        StatelessResets(KEY, 4434).token(CID),
        StatelessResets(bytes(31) + b"1", 4433).token(CID),
        StatelessResets(KEY, 4433).token(bytes(7) + b"1"),
    )


@given(size=st.integers(MIN_RESET + 1, 1500))
def test_a_reset_looks_like_a_packet_and_is_shorter_than_what_it_answers(size: int) -> None:
    resets = StatelessResets(KEY, 4433)
    packet = resets.create(size, CID, now=0.0)
    assert packet is not None
    assert MIN_RESET <= len(packet) < size
    assert packet[0] & 0xC0 == 0x40, "a short header"
    assert packet.endswith(resets.token(CID))


@pytest.mark.parametrize("size", [9, MIN_RESET])
def test_what_is_too_short_to_be_answered_by_something_shorter_is_not(size: int) -> None:
    assert StatelessResets(KEY, 4433).create(size, CID, now=0.0) is None


def test_a_flood_is_not_answered_with_one() -> None:
    resets = StatelessResets(KEY, 4433)
    packets = [resets.create(1200, CID, now=5 + number / 1000) for number in range(1000)]
    assert sum(packet is not None for packet in packets) == RESETS_PER_S
    assert resets.create(1200, CID, now=6.0) is not None
