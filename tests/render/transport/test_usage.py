"""A burst is free, a flood is not, and nobody is remembered for longer than necessary."""

from __future__ import annotations

from tigas_render.transport.usage import RateLimit


def test_a_burst_is_allowed_and_then_the_rate() -> None:
    limit = RateLimit(rate=2.0, burst=3)
    assert [limit.allows("a", 100.0) for _ in range(5)] == [True, True, True, False, False]
    assert [limit.allows("a", 100.5) for _ in range(2)] == [True, False]
    assert [limit.allows("a", 200.0) for _ in range(4)] == [True, True, True, False]


def test_everybody_has_a_limit_of_their_own() -> None:
    limit = RateLimit(rate=1.0, burst=1)
    assert limit.allows("a", 100.0)
    assert not limit.allows("a", 100.0)
    assert limit.allows("b", 100.0)


def test_who_has_been_quiet_is_forgotten() -> None:
    limit = RateLimit(rate=10.0, burst=10)
    for number in range(1000):
        assert limit.allows(f"{number}", 100.0 + 0.01 * number)
    assert len(limit) <= 11
