"""Limits on rates, on concurrent work, and on slow senders."""

from __future__ import annotations

import itertools
from contextlib import ExitStack

import pytest

from tigas_common.errors import Overloaded
from tigas_common.limits import ConcurrencyLimit, IdleTimeout, RateLimit


def test_a_burst_is_allowed_and_then_the_rate() -> None:
    limit = RateLimit[str]()
    assert [limit.try_acquire("a", 100.0, 2.0, 1.5) for _ in range(5)] == [True, True, True, False, False]
    assert [limit.try_acquire("a", 100.5, 2.0, 1.5) for _ in range(2)] == [True, False]
    assert [limit.try_acquire("a", 200.0, 2.0, 1.5) for _ in range(4)] == [True, True, True, False]


def test_each_client_has_a_limit_of_its_own() -> None:
    limit = RateLimit[str]()
    assert limit.try_acquire("a", 100.0, 1.0, 1.0)
    assert not limit.try_acquire("a", 100.0, 1.0, 1.0)
    assert limit.try_acquire("b", 100.0, 1.0, 1.0)


def test_the_delay_is_how_long_a_client_has_to_wait() -> None:
    limit = RateLimit[str]()
    limit.consume("a", 100.0, 2.0, 7)
    assert limit.delay_s("a", 100.0, 2.0, 1.5) == 2.5
    assert not limit.try_acquire("a", 102.25, 2.0, 1.5)
    assert limit.try_acquire("a", 102.5, 2.0, 1.5)


def test_a_quiet_client_is_forgotten() -> None:
    limit = RateLimit[str]()
    for number in range(1000):
        assert limit.try_acquire(f"{number}", 100.0 + 0.01 * number, 10.0, 1.0)
    assert len(limit) <= 11


BUSY = Overloaded("Try again later.")


def test_clients_share_the_total_and_keep_to_their_own_limit() -> None:
    limit = ConcurrencyLimit(3, 2)
    with ExitStack() as running:
        running.enter_context(limit.acquire("a", BUSY))
        with limit.acquire("a", BUSY), pytest.raises(Overloaded), limit.acquire("a", BUSY):
            pass
        running.enter_context(limit.acquire("b", BUSY))
        running.enter_context(limit.acquire("c", BUSY))
        with pytest.raises(Overloaded), limit.acquire("d", BUSY):
            pass
    with limit.acquire("d", BUSY):
        pass


def test_a_refused_or_finished_client_is_forgotten() -> None:
    limit = ConcurrencyLimit(1, 1)
    with limit.acquire("a", BUSY), pytest.raises(Overloaded), limit.acquire("b", BUSY):
        pass
    assert dict(limit._running) == {}


SECONDS, RATE = 30, 500


def survived_s(every_s: float, size: int, until_s: float = 10_000) -> float:
    """Seconds until a sender of this many bytes at this interval times out."""
    timeout = IdleTimeout(SECONDS, RATE, now=1000.0)
    for part in itertools.count(1):
        now = 1000.0 + part * every_s
        if now >= min(timeout.expires_at, 1000.0 + until_s):
            return min(timeout.expires_at - 1000.0, until_s)
        timeout.extend(size, now)
    raise AssertionError


@pytest.mark.parametrize(
    ("every_s", "size", "least_s", "most_s"),
    [
        pytest.param(10_000, 1, SECONDS, SECONDS, id="silence"),
        pytest.param(0.25, 1500, 10_000, 10_000, id="an upload at 50 kbit/s"),
        pytest.param(25, 64_000, 10_000, 10_000, id="a link that is out for a while"),
        pytest.param(1, 1, 0, SECONDS + 1, id="a trickle"),
        pytest.param(1, RATE // 2, 0, 2 * SECONDS + 2, id="half the rate"),
    ],
)
def test_a_sender_times_out_by_silence_or_below_the_rate(
    every_s: float, size: int, least_s: float, most_s: float
) -> None:
    assert least_s <= survived_s(every_s, size) <= most_s


def test_what_came_fast_buys_no_silence() -> None:
    timeout = IdleTimeout(SECONDS, RATE, now=0.0)
    timeout.extend(100_000_000, now=1.0)
    assert timeout.expires_at == 1.0 + SECONDS
