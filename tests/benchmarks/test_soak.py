"""The verdict of the soak: which processes are flat."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from benchmarks.soak import SETTLE_S, Sample, changes

Figure = Callable[[float], float]


def samples(megabytes: Figure, files: Figure = lambda _: 20, *, start: int = 1, minutes: int = 30) -> list[Sample]:
    """A process's samples every half a minute."""
    times = [30.0 * i for i in range(2 * minutes)]
    return [Sample(at, "render", start, megabytes(at / 60), int(files(at / 60))) for at in times]


@pytest.mark.parametrize(
    ("megabytes", "files", "flat"),
    [
        (lambda _: 200, lambda _: 20, True),
        (lambda minute: 150 if minute < SETTLE_S / 60 else 200, lambda _: 20, True),  # its start does not count
        (lambda minute: 200 + 40 * (minute % 6 == 0), lambda _: 20, True),  # nor single peaks
        (lambda minute: 200 + 2 * minute, lambda _: 20, False),
        (lambda minute: 2000 + 2 * minute, lambda _: 20, True),  # a few per cent
        (lambda _: 200, lambda minute: 20 + minute, False),
    ],
)
def test_a_process_is_flat_unless_its_memory_or_files_grow(megabytes: Figure, files: Figure, flat: bool) -> None:
    (change,) = changes(samples(megabytes, files))
    assert change.flat == flat


def test_each_start_of_a_process_is_compared_with_itself() -> None:
    both = [*samples(lambda _: 400), *samples(lambda _: 200, start=2), *samples(lambda _: 100, start=3, minutes=2)]
    assert [(one.start, one.flat) for one in changes(both)] == [(1, True), (2, True)]
