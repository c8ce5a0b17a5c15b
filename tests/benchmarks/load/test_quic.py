"""Answers are counted, in any order of their parts."""

from __future__ import annotations

import random

import pytest
from aioquic.quic.packet import QuicStreamFrame

from benchmarks.load.quic import HEAD, Answer

BODY = random.Random(1).randbytes(20_000)
PARTS = [(start, BODY[start : start + 1400]) for start in range(0, len(BODY), 1400)]


def deliver(parts: list[tuple[int, bytes]]) -> tuple[int, bytes | None]:
    """Number of parts taken, and the contents of the event."""
    answer = Answer(4)
    for count, (start, data) in enumerate(parts, 1):
        event = answer.handle_frame(QuicStreamFrame(data=data, offset=start, fin=start + len(data) == len(BODY)))
        if event is not None:
            assert answer.is_finished
            assert answer.highest_offset == len(BODY)
            return count, event.data
    return len(parts), None


def test_the_event_comes_with_the_last_part_and_has_the_beginning() -> None:
    assert deliver(PARTS) == (len(PARTS), BODY[:HEAD])


@pytest.mark.parametrize("seed", range(10))
def test_parts_may_come_in_any_order_and_twice(seed: int) -> None:
    parts = PARTS * 2
    random.Random(seed).shuffle(parts)
    firsts = {start: number for number, (start, _) in reversed(list(enumerate(parts, 1)))}
    assert deliver(parts) == (max(firsts.values()), BODY[:HEAD])


@pytest.mark.parametrize("lost", [0, 7, len(PARTS) - 1])
def test_without_all_parts_there_is_no_event(lost: int) -> None:
    assert deliver(PARTS[:lost] + PARTS[lost + 1 :])[1] is None
