"""Which host a viewer is sent to."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.cluster.hosts import host
from tigas_cluster.choice import SETTLED_S, Choice
from tigas_cluster.fleet import HostState
from tigas_common.placement import WIDEN_S, ranked

NAMES = ("a", "b", "c")
FIRST, SECOND, THIRD = ranked("garden", NAMES)


class Choosing:
    """A choice of hosts, and its clock."""

    def __init__(self) -> None:
        self.now = 100.0
        self.choice = Choice(lambda: self.now)

    def __call__(self, *hosts: HostState, scene: str = "garden", **viewer: str) -> str:
        """The name of the chosen one."""
        chosen = self.choice.host(scene, hosts, **viewer)
        assert chosen is not None
        return chosen.name


@pytest.fixture
def choose() -> Choosing:
    return Choosing()


def test_without_hosts_there_is_none(choose: Choosing) -> None:
    assert choose.choice.host("garden", []) is None


def test_all_viewers_of_a_scene_share_a_host_however_many_others_are_idle(choose: Choosing) -> None:
    hosts = [host(name, viewers=50 if name == FIRST else 0) for name in NAMES]
    assert {choose(*hosts) for _ in range(20)} == {FIRST}
    assert len({choose(*hosts, scene=f"scene {number}") for number in range(30)}) == 3


def test_a_popular_scene_gets_another_host_and_new_viewers_go_where_fewer_are(choose: Choosing) -> None:
    hosts = [host(name, viewers=50 if name == FIRST else 0, queue_age_s=0.5 * (name == FIRST)) for name in NAMES]
    assert choose(*hosts) == FIRST
    for _ in range(20):
        choose.now += WIDEN_S / 10
        chosen = choose(*hosts)
    assert chosen == SECOND


def test_viewers_on_their_way_count_before_hosts_have_counted_them(choose: Choosing) -> None:
    hosts = [host(name, queue_age_s=0.5) for name in NAMES]
    for _ in range(40):  # until the scene is everywhere
        choose.now += WIDEN_S / 10
        choose(*hosts)
    choose.now += SETTLED_S + 0.1
    assert Counter(choose(*hosts) for _ in range(30)) == dict.fromkeys(NAMES, 10)


def test_a_full_host_gets_nobody_new_and_keeps_those_it_has(choose: Choosing) -> None:
    hosts = [host(name, full=5.0 if name == FIRST else None) for name in NAMES]
    assert {choose(*hosts) for _ in range(9)} == {SECOND}, "the scene is wanted on one more host, not on all"
    assert choose(*hosts, at=FIRST) == FIRST


def test_if_all_are_full_it_is_the_one_that_has_room_first(choose: Choosing) -> None:
    hosts = [host(FIRST, full=5.0), host(SECOND, full=2.0), host(THIRD, full=4.0)]
    assert choose(*hosts) == SECOND
    assert choose(*hosts, avoid=SECOND) == THIRD


def test_a_draining_host_gets_nobody_and_loses_those_it_has(choose: Choosing) -> None:
    hosts = [host(name, draining=name == FIRST) for name in NAMES]
    assert choose(*hosts) == choose(*hosts, at=FIRST) == SECOND
    assert choose(*hosts, at=THIRD) == THIRD
    assert choose(host(FIRST, draining=True), at=FIRST) == FIRST, "there is no other"


def test_a_viewer_that_could_not_get_in_is_sent_elsewhere_unless_there_is_nothing_else(choose: Choosing) -> None:
    assert choose(*map(host, NAMES), avoid=FIRST) == SECOND
    assert choose(host(FIRST), avoid=FIRST) == FIRST
    assert choose(host(FIRST), host(SECOND, full=5.0), avoid=FIRST) == SECOND


def test_viewers_of_a_host_that_is_gone_meet_on_the_next(choose: Choosing) -> None:
    hosts = [host(name) for name in NAMES if name != FIRST]
    assert {choose(*hosts, at=FIRST) for _ in range(20)} == {SECOND}
