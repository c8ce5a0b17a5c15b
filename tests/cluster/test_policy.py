"""Where viewers are sent, and the number of hosts: more at once, fewer slowly, and no viewer is disconnected."""

from __future__ import annotations

from collections import Counter
from typing import TypeAlias

import pytest

from tests.cluster.hosts import host
from tigas_cluster.fleet import HostState
from tigas_cluster.policy import COUNT_DELAY_S, MIN_DRAIN_S, SCALE_UP_DELAY_S, HostChooser, Scaler, ScalingPlan
from tigas_cluster.settings import HostRange
from tigas_common.placement import WIDEN_S, rank_names

CALM_S, GRACE_S = 300.0, 600.0
NAMES = ("a", "b", "c")
FIRST, SECOND, THIRD = rank_names("garden", NAMES)


class Choosing:
    """A choice of hosts, and its clock."""

    def __init__(self) -> None:
        self.now = 100.0
        self.choice = HostChooser(lambda: self.now)

    def __call__(self, *hosts: HostState, scene: str = "garden", **viewer: str) -> str:
        chosen = self.choice.choose(scene, hosts, **viewer)
        assert chosen is not None
        return chosen.name


@pytest.fixture
def choose() -> Choosing:
    return Choosing()


def test_without_hosts_there_is_none(choose: Choosing) -> None:
    assert choose.choice.choose("garden", []) is None


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
    choose.now += COUNT_DELAY_S + 0.1
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


class Scene:
    """A scaler, its clock, and the hosts' reports."""

    def __init__(self, allowed: str = "1..8") -> None:
        self.now = 0.0
        self.scaler = Scaler(HostRange.parse(allowed), CALM_S, GRACE_S, lambda: self.now)

    def after(self, seconds: float, *hosts: HostState, starting: int = 0) -> ScalingPlan:
        """The plan after the hosts have been in this state for some time."""
        self.scaler.plan(hosts, starting)
        self.now += seconds
        return self.scaler.plan(hosts, starting)


@pytest.mark.parametrize(("text", "expected"), [("3", HostRange(3, 3)), ("1..8", HostRange(1, 8))])
def test_a_range_is_a_number_or_two(text: str, expected: HostRange) -> None:
    assert HostRange.parse(text) == expected


@pytest.mark.parametrize("text", ["", "0", "-1", "4..2", "0..2", "1..", "1-8", "1..99999", "two"])
def test_what_is_no_range_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(ValueError, match="is neither a number of hosts nor MIN"):
        HostRange.parse(text)


Step: TypeAlias = tuple[float, list[HostState]]
"""Seconds that hosts are in a state."""
BUSY, FULL = host("a", 70, queue_age_s=0.3), host("a", 100, full=5.0)


@pytest.mark.parametrize(
    ("allowed", "steps", "wanted"),
    [
        ("2..8", [(0, [])], 2),
        ("1..8", [(3600, [host("a", 60)])], 1),
        ("1..8", [(SCALE_UP_DELAY_S / 2, [BUSY])], 1),
        ("1..8", [(SCALE_UP_DELAY_S / 2, [BUSY]), (SCALE_UP_DELAY_S, [BUSY])], 2),
        ("1..8", [(SCALE_UP_DELAY_S / 2, [BUSY]), (SCALE_UP_DELAY_S, [host("a", 70, full=5.0)])], 2),
        ("1..8", [(SCALE_UP_DELAY_S / 2, [BUSY]), (0, [host("a", 5)])] * 20, 1),
        ("1..8", [(SCALE_UP_DELAY_S, [FULL]), (1, [host("a", 70), host("b", 90)])], 2),
        ("1..8", [(SCALE_UP_DELAY_S, [FULL]), (1, [host("a", 95), host("b", 90)])], 3),  # before either is full
        ("1..2", [(3600, [FULL, host("b", 100, full=5.0)])], 2),
        ("1..8", [(1, [host("a", 20), host("b", 20)]), (60, [host("a", 20)])], 2),
    ],
    ids=[
        "an empty cluster gets the fewest",
        "a host that has room is enough",
        "pressed for a moment",
        "pressed for a while",
        "full for a while",
        "pauses",
        "what a full host held is known",
        "and more than that are there",
        "never more than allowed",
        "a lost one is replaced",
    ],
)
def test_as_many_are_wanted_as_viewers_need(allowed: str, steps: list[Step], wanted: int) -> None:
    scene = Scene(allowed)
    plans = [scene.after(seconds, *hosts) for seconds, hosts in steps]
    assert plans[-1].wanted == wanted


def test_one_that_is_starting_is_waited_for() -> None:
    scene = Scene()
    assert scene.after(SCALE_UP_DELAY_S, BUSY).wanted == 2
    assert scene.after(120, BUSY, starting=1).wanted == 2


def test_hosts_that_were_there_already_are_kept_at_first() -> None:
    assert Scene().after(CALM_S / 2, host("a"), host("b"), host("c")) == ScalingPlan(3, frozenset(), frozenset())


def test_the_host_with_the_fewest_viewers_drains_after_a_calm_while() -> None:
    scene = Scene()
    scene.after(1, host("a", 60), host("b", 50))
    assert scene.after(CALM_S - 1, host("a", 20), host("b", 3)).draining == set()
    plan = scene.after(1, host("a", 20), host("b", 3))
    assert plan == ScalingPlan(1, frozenset({"b"}), frozenset())


def test_what_the_others_could_not_hold_stays() -> None:
    scene = Scene()
    scene.after(1, host("a", 60), host("b", 50))
    assert scene.after(3600, host("a", 30), host("b", 25)).draining == set()


def test_one_after_the_other() -> None:
    scene = Scene()
    scene.after(1, host("a", 60))
    hosts = [host(name) for name in "abcd"]
    assert scene.after(CALM_S, *hosts).draining == {"a"}
    assert scene.after(CALM_S / 2, *hosts[1:]).draining == set()
    assert scene.after(CALM_S / 2, *hosts[1:]).draining == {"b"}


@pytest.mark.parametrize(
    ("before", "steps"),
    [
        (3, [(GRACE_S / 2, 3, False), (0, 0, True)]),
        (0, [(MIN_DRAIN_S / 2, 0, False), (MIN_DRAIN_S, 0, True)]),
        (3, [(GRACE_S, 1, True)]),
    ],
    ids=["viewers leave", "viewers may be on their way", "a viewer never leaves"],
)
def test_a_draining_host_ends(before: int, steps: list[tuple[float, int, bool]]) -> None:
    scene = draining(before)
    for seconds, viewers, ends in steps:
        plan = scene.after(seconds, host("a", 20), host("b", viewers, draining=True))
        assert plan.ending == ({"b"} if ends else set())


def test_a_host_that_drains_comes_back_before_there_is_another() -> None:
    plan = draining(3).after(SCALE_UP_DELAY_S, host("a", 60, full=5.0), host("b", 3, draining=True))
    assert plan == ScalingPlan(2, frozenset(), frozenset())


def draining(viewers: int) -> Scene:
    """A host `b` that has just begun to drain."""
    scene = Scene()
    scene.after(1, host("a", 60))
    scene.after(CALM_S, host("a", 20), host("b", viewers))
    assert scene.scaler.plan([host("a", 20), host("b", viewers)]).draining == {"b"}
    return scene
