"""The number of hosts: more at once, fewer slowly, and no viewer is disconnected."""

from __future__ import annotations

from typing import TypeAlias

import pytest

from tests.cluster.hosts import host
from tigas_cluster.fleet import HostState
from tigas_cluster.scaling import LASTING_S, SETTLED_S, Plan, Scaler
from tigas_cluster.settings import HostRange

CALM_S, GRACE_S = 300.0, 600.0


class Scene:
    """A scaler, its clock, and the hosts' reports."""

    def __init__(self, allowed: str = "1..8") -> None:
        self.now = 0.0
        self.scaler = Scaler(HostRange.parse(allowed), CALM_S, GRACE_S, lambda: self.now)

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


Step: TypeAlias = tuple[float, list[HostState]]
"""Seconds that hosts are in a state."""
BUSY, FULL = host("a", 70, queue_age_s=0.3), host("a", 100, full=5.0)


@pytest.mark.parametrize(
    ("allowed", "steps", "wanted"),
    [
        ("2..8", [(0, [])], 2),
        ("1..8", [(3600, [host("a", 60)])], 1),
        ("1..8", [(LASTING_S / 2, [BUSY])], 1),
        ("1..8", [(LASTING_S / 2, [BUSY]), (LASTING_S, [BUSY])], 2),
        ("1..8", [(LASTING_S / 2, [BUSY]), (LASTING_S, [host("a", 70, full=5.0)])], 2),
        ("1..8", [(LASTING_S / 2, [BUSY]), (0, [host("a", 5)])] * 20, 1),
        ("1..8", [(LASTING_S, [FULL]), (1, [host("a", 70), host("b", 90)])], 2),
        ("1..8", [(LASTING_S, [FULL]), (1, [host("a", 95), host("b", 90)])], 3),  # before either is full
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
    assert scene.after(LASTING_S, BUSY).wanted == 2
    assert scene.after(120, BUSY, starting=1).wanted == 2


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


@pytest.mark.parametrize(
    ("before", "steps"),
    [
        (3, [(GRACE_S / 2, 3, False), (0, 0, True)]),
        (0, [(SETTLED_S / 2, 0, False), (SETTLED_S, 0, True)]),
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
    plan = draining(3).after(LASTING_S, host("a", 60, full=5.0), host("b", 3, draining=True))
    assert plan == Plan(2, frozenset(), frozenset())


def draining(viewers: int) -> Scene:
    """A host `b` that has just begun to drain."""
    scene = Scene()
    scene.after(1, host("a", 60))
    scene.after(CALM_S, host("a", 20), host("b", viewers))
    assert scene.scaler.plan([host("a", 20), host("b", viewers)]).draining == {"b"}
    return scene
