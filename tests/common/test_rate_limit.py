"""A burst is free, a flood is not, and no client is remembered for longer than necessary."""

from __future__ import annotations

from tigas_common.rate_limit import RateLimit


def test_a_burst_is_allowed_and_then_the_rate() -> None:
    limit = RateLimit[str]()
    assert [limit.allows("a", 100.0, 2.0, 1.5) for _ in range(5)] == [True, True, True, False, False]
    assert [limit.allows("a", 100.5, 2.0, 1.5) for _ in range(2)] == [True, False]
    assert [limit.allows("a", 200.0, 2.0, 1.5) for _ in range(4)] == [True, True, True, False]


def test_each_client_has_a_limit_of_its_own() -> None:
    limit = RateLimit[str]()
    assert limit.allows("a", 100.0, 1.0, 1.0)
    assert not limit.allows("a", 100.0, 1.0, 1.0)
    assert limit.allows("b", 100.0, 1.0, 1.0)


def test_the_delay_is_how_long_a_client_has_to_wait() -> None:
    limit = RateLimit[str]()
    limit.use("a", 100.0, 2.0, 7)
    assert limit.delay("a", 100.0, 2.0, 1.5) == 2.5
    assert not limit.allows("a", 102.25, 2.0, 1.5)
    assert limit.allows("a", 102.5, 2.0, 1.5)


def test_a_quiet_client_is_forgotten() -> None:
    limit = RateLimit[str]()
    for number in range(1000):
        assert limit.allows(f"{number}", 100.0 + 0.01 * number, 10.0, 1.0)
    assert len(limit) <= 11
