"""The number of hosts: more at once, fewer slowly, and no viewer is disconnected."""

from __future__ import annotations

import pytest

from tests.cluster.hosts import host
from tigas_cluster.fleet import HostState
from tigas_cluster.scaling import LASTING_S, SETTLED_S, Plan, Scaler
from tigas_cluster.settings import HostRange

CALM_S, GRACE_S = 300.0, 600.0


class Scene:
    """A scaler, its clock, and the hosts' reports."""

    def __init__(self, lowest: int = 1, highest: int = 8) -> None:
        self.now = 0.0
        self.scaler = Scaler(HostRange(lowest, highest), CALM_S, GRACE_S, lambda: self.now)

    def after(self, seconds: float, *hosts: HostState, starting: int = 0) -> Plan:
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


def test_an_empty_cluster_gets_the_fewest() -> None:
    assert Scene(2, 8).after(0).wanted == 2


def test_a_host_that_has_room_is_enough() -> None:
    assert Scene().after(3600, host("a", 60)).wanted == 1


@pytest.mark.parametrize("pressed", [host("a", 70, full=5.0), host("a", 70, queue_age_s=0.3)])
def test_one_more_once_most_are_pressed_for_a_while(pressed: HostState) -> None:
    scene = Scene()
    assert scene.after(LASTING_S / 2, host("a", 70, queue_age_s=0.3)).wanted == 1
    assert scene.after(LASTING_S, pressed).wanted == 2


def test_a_pause_of_a_host_calls_for_none() -> None:
    scene = Scene()
    for _ in range(20):
        assert scene.after(LASTING_S / 2, host("a", 5, queue_age_s=0.3)).wanted == 1
        scene.after(0, host("a", 5))


def test_one_that_is_starting_is_waited_for() -> None:
    scene = Scene()
    assert scene.after(LASTING_S, host("a", 70, queue_age_s=0.3)).wanted == 2
    assert scene.after(120, host("a", 70, queue_age_s=0.3), starting=1).wanted == 2


def test_what_a_full_host_held_tells_how_many_the_next_viewers_need() -> None:
    scene = Scene()
    scene.after(LASTING_S, host("a", 100, full=5.0))
    assert scene.after(1, host("a", 70), host("b", 90)).wanted == 2
    assert scene.after(1, host("a", 95), host("b", 90)).wanted == 3  # before either is full


def test_there_are_never_more_than_allowed() -> None:
    scene = Scene(1, 2)
    hosts = [host("a", 100, full=5.0), host("b", 100, full=5.0)]
    assert scene.after(3600, *hosts).wanted == 2


def test_hosts_that_were_there_already_are_kept_at_first() -> None:
    assert Scene().after(CALM_S / 2, host("a"), host("b"), host("c")) == Plan(3, frozenset(), frozenset())


def test_the_host_with_the_fewest_viewers_drains_after_a_calm_while() -> None:
    scene = Scene()
    scene.after(1, host("a", 60), host("b", 50))
    assert scene.after(CALM_S - 1, host("a", 20), host("b", 3)).draining == set()
    plan = scene.after(1, host("a", 20), host("b", 3))
    assert plan == Plan(1, frozenset({"b"}), frozenset())


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


def draining(viewers: int) -> Scene:
    """A host `b` that has just begun to drain."""
    scene = Scene()
    scene.after(1, host("a", 60))
    scene.after(CALM_S, host("a", 20), host("b", viewers))
    assert scene.scaler.plan([host("a", 20), host("b", viewers)]).draining == {"b"}
    return scene


def test_a_host_ends_once_its_viewers_have_left() -> None:
    scene = draining(3)
    assert scene.after(GRACE_S / 2, host("a", 20), host("b", 3, draining=True)).ending == set()
    assert scene.after(0, host("a", 23), host("b", 0, draining=True)).ending == {"b"}


def test_viewers_who_are_on_their_way_are_waited_for() -> None:
    scene = draining(0)
    assert scene.after(SETTLED_S / 2, host("a", 20), host("b", 0, draining=True)).ending == set()
    assert scene.after(SETTLED_S, host("a", 20), host("b", 0, draining=True)).ending == {"b"}


def test_a_viewer_who_never_leaves_keeps_no_host() -> None:
    assert draining(3).after(GRACE_S, host("a", 20), host("b", 1, draining=True)).ending == {"b"}


def test_a_host_that_drains_comes_back_before_there_is_another() -> None:
    scene = draining(3)
    plan = scene.after(LASTING_S, host("a", 60, full=5.0), host("b", 3, draining=True))
    assert plan == Plan(2, frozenset(), frozenset())


def test_a_host_that_is_lost_is_replaced() -> None:
    scene = Scene()
    scene.after(1, host("a", 20), host("b", 20))
    assert scene.after(60, host("a", 20)).wanted == 2
