"""Admission of clients by POST while the server is full, and how often a session may ask."""

from __future__ import annotations

import pytest

from tests.render.admission.chosen_load import ChosenLoad
from tigas_common.errors import AskedTooOften, ServerFull
from tigas_render.admission.load import Load
from tigas_render.admission.viewers import MAX_NAMES_PER_ADDRESS, STAY_S, HttpViewers, RequestRate
from tigas_render.frame import Client

EAGER, POLITE = Client("192.0.2.1", "session 1"), Client("192.0.2.1", "session 2")


def test_who_is_in_goes_on_and_others_are_told_when_to_come_back() -> None:
    now = 100.0
    load = ChosenLoad()
    viewers = HttpViewers(load, lambda: now)
    viewers.admit("192.0.2.1")
    load.is_full = True
    with pytest.raises(ServerFull) as refused:
        viewers.admit("192.0.2.2")
    assert refused.value.retry_after_s == 5.0
    for _ in range(3):
        now += STAY_S - 1
        viewers.admit("192.0.2.1")
    now += STAY_S + 1
    with pytest.raises(ServerFull):
        viewers.admit("192.0.2.1")
    assert load.viewers == 0
    assert load.state.refused == 2
    load.is_full = False
    viewers.admit("192.0.2.2")
    assert load.viewers == 1


def test_who_comes_behind_a_gateway_is_refused_as_others_are() -> None:
    load = ChosenLoad()
    viewers = HttpViewers(load, lambda: 0.0)
    viewers.admit("192.0.2.1", "first")
    load.is_full = True
    viewers.admit("192.0.2.1", "first")
    for name in ("second", ""):
        with pytest.raises(ServerFull):
            viewers.admit("192.0.2.1", name)
    assert load.viewers == 1


def test_an_address_has_only_so_many_viewers_whatever_it_calls_them() -> None:
    now = 0.0
    load = ChosenLoad()
    viewers = HttpViewers(load, lambda: now)
    names = {viewers.admit("192.0.2.1", str(number)) for number in range(3 * MAX_NAMES_PER_ADDRESS)}
    assert names == {"", *map(str, range(MAX_NAMES_PER_ADDRESS))}
    assert load.viewers == MAX_NAMES_PER_ADDRESS + 1
    viewers.admit("192.0.2.2", "0")
    now += STAY_S + 1
    viewers.admit("192.0.2.2", "0")
    assert load.viewers == 1
    viewers.admit("192.0.2.1", "one more")
    assert load.viewers == 2


class Asking:
    """A limit of 240 requests a second, and a clock."""

    def __init__(self, load: Load) -> None:
        self.now = 100.0
        self.rate = RequestRate(load, 240, lambda: self.now)

    def is_allowed(self, client: Client = EAGER) -> bool:
        try:
            self.rate.check(client)
        except AskedTooOften:
            return False
        return True

    def allowed(self, per_s: float, client: Client = EAGER, seconds: float = 10) -> float:
        """Allowed requests per second at a given rate of requests."""
        count = 0
        for _ in range(round(per_s * seconds)):
            self.now += 1 / per_s
            count += self.is_allowed(client)
        return count / seconds


def test_who_asks_a_thousand_times_a_second_gets_the_limit_and_harms_nobody_else() -> None:
    asking = Asking(Load())
    assert asking.allowed(1000) == pytest.approx(240, rel=0.05)
    assert asking.allowed(60, POLITE) == 60
    while asking.is_allowed():
        pass
    with pytest.raises(AskedTooOften, match="more than 240 requests a second"):
        asking.rate.check(EAGER)


def test_a_busy_server_allows_what_it_tells_with_some_slack() -> None:
    load = ChosenLoad()
    asking = Asking(load)
    load.rate = 20.0
    assert asking.rate.announced_rate == 20.0
    assert asking.allowed(20) == 20
    assert 20 < asking.allowed(60) < 30
    load.rate = None
    assert asking.allowed(60) == pytest.approx(60, rel=0.05)


def test_requests_that_the_network_has_gathered_are_allowed() -> None:
    load = ChosenLoad()
    load.rate = 5.0
    asking = Asking(load)
    for _ in range(5):
        assert all(asking.is_allowed() for _ in range(4))
        asking.now += 0.8
