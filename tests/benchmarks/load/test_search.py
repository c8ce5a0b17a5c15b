"""The largest number that holds, found in few tries."""

from __future__ import annotations

import pytest

from benchmarks.load.search import search


def found(capacity: int, first: int = 4, most: int = 400) -> tuple[int, list[int]]:
    """The result of a search for `capacity`, and the numbers tried."""
    looking, tried = search(first, most), []
    try:
        viewers = next(looking)
        while True:
            tried.append(viewers)
            viewers = looking.send(viewers <= capacity)
    except StopIteration as end:
        return end.value, tried


@pytest.mark.parametrize("capacity", [*range(20), 71, 100, 150, 399, 400])
def test_it_is_found_within_a_twentieth(capacity: int) -> None:
    value, tried = found(capacity)
    assert 0.95 * capacity - 1 <= value <= capacity
    assert len(tried) == len(set(tried)) <= 14
    assert max(tried) <= 400


def test_nothing_above_the_most_is_tried() -> None:
    assert found(1000, most=50) == (50, [4, 8, 16, 32, 50])


def test_one_that_holds_nothing() -> None:
    assert found(0) == (0, [4, 2, 1])
