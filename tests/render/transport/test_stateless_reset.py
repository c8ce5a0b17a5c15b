"""Clients of a stopped server are reset by the next one, and no others."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tigas_render.transport.stateless_reset import MAX_PER_SECOND, MIN_LENGTH, TOKEN_LENGTH, StatelessResets

KEY, CID = bytes(32), bytes(8)


def test_the_next_server_on_the_port_makes_the_same_tokens_and_no_other_does() -> None:
    token = StatelessResets(KEY, 4433).token(CID)
    assert StatelessResets(KEY, 4433).token(CID) == token
    assert len(token) == TOKEN_LENGTH
    assert token not in (
        StatelessResets(KEY, 4434).token(CID),
        StatelessResets(bytes(31) + b"1", 4433).token(CID),
        StatelessResets(KEY, 4433).token(bytes(7) + b"1"),
    )


@given(size=st.integers(MIN_LENGTH + 1, 1500))
def test_a_reset_looks_like_a_packet_and_is_shorter_than_what_it_answers(size: int) -> None:
    resets = StatelessResets(KEY, 4433)
    answer = resets.answer(size, CID, now=0.0)
    assert answer is not None
    assert MIN_LENGTH <= len(answer) < size
    assert answer[0] & 0xC0 == 0x40, "a short header"
    assert answer.endswith(resets.token(CID))


@pytest.mark.parametrize("size", [9, MIN_LENGTH])
def test_what_is_too_short_to_be_answered_by_something_shorter_is_not(size: int) -> None:
    assert StatelessResets(KEY, 4433).answer(size, CID, now=0.0) is None


def test_a_flood_is_not_answered_with_one() -> None:
    resets = StatelessResets(KEY, 4433)
    answers = [resets.answer(1200, CID, now=5 + packet / 1000) for packet in range(1000)]
    assert sum(answer is not None for answer in answers) == MAX_PER_SECOND
    assert resets.answer(1200, CID, now=6.0) is not None
