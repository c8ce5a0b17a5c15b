"""Signals that end the lab and the demo."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest

from tigas_testbed.cli import _told_to_stop

ENDS = (signal.SIGINT, signal.SIGTERM)


@pytest.fixture
def handlers() -> Iterator[None]:
    """Restores the handlers."""
    before = [signal.getsignal(number) for number in ENDS]
    yield
    for number, handler in zip(ENDS, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.timeout(10)
@pytest.mark.usefixtures("handlers")
def test_signals_while_the_event_is_locked_end_the_wait() -> None:
    stop = _told_to_stop()
    with stop._cond:  # type: ignore[attr-defined]  # as in the midst of a wait
        for number in ENDS:
            signal.raise_signal(number)
    assert stop.wait(5)
