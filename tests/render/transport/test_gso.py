"""Datagrams that may leave in one call are sent in one call."""

from __future__ import annotations

import pytest

from tigas_render.transport.gso import MAX_BATCH, MAX_SEGMENTS, batches

A, B = ("192.0.2.1", 1), ("192.0.2.1", 2)


@pytest.mark.parametrize(
    ("sizes", "expected"),
    [
        ([], []),
        ([100], [[100]]),
        ([1452] * 3, [[1452] * 3]),
        ([1452, 1452, 30, 1452], [[1452, 1452, 30], [1452]]),
        ([30, 1452, 1452], [[30], [1452, 1452]]),
        ([100] * (MAX_SEGMENTS + 1), [[100] * MAX_SEGMENTS, [100]]),
        ([MAX_BATCH // 4] * 5, [[MAX_BATCH // 4] * 4, [MAX_BATCH // 4]]),
    ],
)
def test_a_batch_has_one_size_but_for_its_last(sizes: list[int], expected: list[list[int]]) -> None:
    result = list(batches([(bytes(size), A) for size in sizes]))
    assert [[len(data) for data in batch] for batch, _ in result] == expected


def test_a_batch_has_one_address() -> None:
    result = list(batches([(b"1", A), (b"2", B), (b"3", B), (b"4", A)]))
    assert result == [([b"1"], A), ([b"2", b"3"], B), ([b"4"], A)]
