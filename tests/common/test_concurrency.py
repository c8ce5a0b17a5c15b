"""Limits on concurrent work."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from tigas_common.concurrency import ConcurrencyLimit
from tigas_common.errors import Overloaded

BUSY = Overloaded("Try again later.")


def test_clients_share_the_total_and_keep_to_their_own_limit() -> None:
    limit = ConcurrencyLimit(3, 2)
    with ExitStack() as running:
        running.enter_context(limit.one_more("a", BUSY))
        with limit.one_more("a", BUSY), pytest.raises(Overloaded), limit.one_more("a", BUSY):
            pass
        running.enter_context(limit.one_more("b", BUSY))
        running.enter_context(limit.one_more("c", BUSY))
        with pytest.raises(Overloaded), limit.one_more("d", BUSY):
            pass
    with limit.one_more("d", BUSY):
        pass


def test_a_refused_or_finished_client_is_forgotten() -> None:
    limit = ConcurrencyLimit(1, 1)
    with limit.one_more("a", BUSY), pytest.raises(Overloaded), limit.one_more("b", BUSY):
        pass
    assert dict(limit._running) == {}
