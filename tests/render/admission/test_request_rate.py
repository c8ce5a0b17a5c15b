"""How often a session may ask."""

from __future__ import annotations

import pytest

from tigas_common.errors import AskedTooOften
from tigas_render.admission.load import Load
from tigas_render.admission.request_rate import RequestRate
from tigas_render.frame import Client

EAGER, POLITE = Client("192.0.2.1", "session 1"), Client("192.0.2.1", "session 2")


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class ToldLoad(Load):
    """Loads chosen by the test."""

    told: float | None = None

    @property
    def requests_per_s(self) -> float | None:
        return self.told


@pytest.fixture
def clock() -> Clock:
    return Clock()


def allowed(rate: RequestRate, clock: Clock, per_s: float, client: Client = EAGER, seconds: float = 10) -> float:
    """Allowed requests per second at a given rate of requests."""
    count = 0
    for _ in range(round(per_s * seconds)):
        clock.now += 1 / per_s
        count += rate.allows(client)
    return count / seconds


def test_who_asks_a_thousand_times_a_second_gets_the_limit_and_harms_nobody_else(clock: Clock) -> None:
    rate = RequestRate(Load(), 240, clock)
    assert allowed(rate, clock, 1000) == pytest.approx(240, rel=0.05)
    assert allowed(rate, clock, 60, POLITE) == 60
    while rate.allows(EAGER):
        pass
    with pytest.raises(AskedTooOften, match="more than 240 times"):
        rate.check(EAGER)


def test_a_busy_server_allows_what_it_tells_with_some_slack(clock: Clock) -> None:
    load = ToldLoad()
    rate = RequestRate(load, 240, clock)
    load.told = 20.0
    assert rate.told == 20.0
    assert allowed(rate, clock, 20) == 20
    assert 20 < allowed(rate, clock, 60) < 30
    load.told = None
    assert allowed(rate, clock, 60) == pytest.approx(60, rel=0.05)


def test_requests_that_the_network_has_gathered_are_allowed(clock: Clock) -> None:
    load = ToldLoad()
    load.told = 5.0
    rate = RequestRate(load, 240, clock)
    for _ in range(5):
        assert all(rate.allows(EAGER) for _ in range(4))
        clock.now += 0.8
