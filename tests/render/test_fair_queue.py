"""The schedule is fair between addresses, between an address's sessions, and fresh within one."""

from __future__ import annotations

from collections import defaultdict

import pytest

from tigas_render.fair_queue import MIN_KEPT, FairQueue, FairSchedule
from tigas_render.frame import Client

A, B, C = (Client(name, "only") for name in "abc")
CLIENTS = {"a": A, "b": B, "c": C}


def waiting(*work: str) -> FairSchedule[str]:
    schedule: FairSchedule[str] = FairSchedule(depth=4)
    for name in work:
        schedule.push(CLIENTS[name[0]], name, 1.0)
    return schedule


def drain(schedule: FairSchedule[str]) -> list[str]:
    """All work in turn, a second each."""
    order = []
    for _ in range(len(schedule)):
        work = schedule.pop()
        assert work is not None
        order.append(work)
        schedule.start_turn(CLIENTS[order[-1][0]], 1.0)
    return order


def used(costs: dict[Client, float], seconds: float, known: bool = True) -> dict[Client, float]:
    """Shares of clients that send the next request after each answer. `costs`: seconds per frame."""
    schedule: FairSchedule[Client] = FairSchedule(depth=4)
    for one, cost in costs.items():
        schedule.push(one, one, cost if known else 0.001)
    used: dict[Client, float] = defaultdict(float)
    while sum(used.values()) < seconds:
        client = schedule.pop()
        assert client is not None
        cost = costs[client]
        schedule.start_turn(client, cost if known else 0.001)
        schedule.charge(client, 0.0 if known else cost - 0.001)
        used[client] += cost
        schedule.push(client, client, cost if known else 0.001)
    return used


def test_clients_take_turns_however_much_one_of_them_asks() -> None:
    assert drain(waiting("a1", "a2", "a3", "b1", "c1")) == ["a3", "b1", "c1", "a2", "a1"]


def test_a_client_that_was_just_served_goes_to_the_end_of_the_line() -> None:
    schedule = waiting("a1", "b1")
    assert schedule.pop() == "a1"
    schedule.start_turn(A, 1.0)
    schedule.push(A, "a2", 1.0)
    assert drain(schedule) == ["b1", "a2"]


def test_the_newest_wins_when_a_clients_queue_is_full() -> None:
    schedule: FairSchedule[str] = FairSchedule(depth=2)
    assert [schedule.push(A, work, 1.0) for work in ("a1", "a2", "a3")] == [None, None, "a1"]
    assert drain(schedule) == ["a3", "a2"]
    assert len(schedule) == 0


def test_withdrawn_and_obsolete_work_is_not_served() -> None:
    schedule = waiting("a1", "b1", "a2", "a3", "a4")
    assert schedule.remove(A, "a4")
    assert not schedule.remove(A, "a4")
    assert not schedule.remove(C, "a4")
    assert sorted(schedule.remove_if(A, lambda work: work != "a2")) == ["a1", "a3"]
    assert schedule.remove_if(C, lambda work: True) == []
    assert sorted(drain(schedule)) == ["a2", "b1"]
    assert schedule.pop() is None


@pytest.mark.parametrize("known", [True, False], ids=["known before", "known afterwards"])
def test_who_asks_for_large_frames_gets_fewer_of_them(known: bool) -> None:
    shares = used({A: 2.0, B: 0.05, C: 0.1}, 600, known)
    for client in (A, B, C):
        assert shares[client] == pytest.approx(200, abs=2.5)


def test_many_sessions_of_one_address_get_no_more_than_one_of_another() -> None:
    hostile = [Client("a", f"session {number}") for number in range(136)]
    shares = used(dict.fromkeys(hostile, 0.15) | {B: 0.05}, 300)
    assert shares[B] == pytest.approx(150, abs=1)
    assert {round(shares[session] / 0.15) for session in hostile} <= {7, 8}, "and they share alike"


@pytest.mark.parametrize("address", ["a", "b", "{}"], ids=["another address", "the same address", "many addresses"])
def test_a_session_for_every_request_is_no_way_to_jump_the_queue(address: str) -> None:
    schedule: FairSchedule[str] = FairSchedule(depth=4)
    for _ in range(100):
        schedule.push(B, "b", 1.0)
        schedule.pop()
        schedule.start_turn(B, 1.0)
    schedule.push(B, "b", 1.0)
    strangers = (Client(address.format(number), f"session {number}") for number in range(1000))
    for number, stranger in enumerate(strangers):
        schedule.push(stranger, "a", 1.0)
        if number % 2 and schedule.pop() == "b":
            assert number < 10
            return
        schedule.start_turn(stranger, 1.0)
    pytest.fail("it was never served")


@pytest.mark.parametrize(
    ("before", "work", "first"),
    [([A] * 100, "abab", "ab"), ([B, *[A] * 100], "ababab", "aabb")],
    ids=["time used alone is not owed", "unused time is not saved up"],
)
def test_only_clients_that_wait_compete(before: list[Client], work: str, first: str) -> None:
    schedule = waiting()
    for client in before:
        schedule.push(client, "x", 1.0)
        schedule.pop()
        schedule.start_turn(client, 1.0)
    for each in work:
        schedule.push(CLIENTS[each], each, 1.0)
    assert sorted(drain(schedule)[: len(first)]) == list(first)


def test_work_that_is_refused_costs_no_turn() -> None:
    schedule = waiting("a1", "a2", "b1")
    assert [schedule.pop(), schedule.pop()] == ["a2", "a1"]


def test_how_much_waits_and_whether_others_wait() -> None:
    schedule = waiting("a1", "a2")
    assert not schedule.has_other_viewers(A)
    assert schedule.has_other_viewers(B)
    schedule.push(Client("a", "other"), "a3", 1.0)
    assert schedule.has_other_viewers(A)
    assert (schedule.waiting_count("a"), schedule.waiting_count("b")) == (3, 0)


def test_a_viewers_other_connection_is_not_another_viewer() -> None:
    schedule: FairSchedule[str] = FairSchedule(2)
    schedule.push(Client("a", "viewer/1"), "a1", 1.0)
    assert not schedule.has_other_viewers(Client("a", "viewer/2"))
    assert schedule.has_other_viewers(Client("a", "neighbour/2"))


def test_clients_that_have_gone_are_forgotten() -> None:
    schedule: FairSchedule[int] = FairSchedule(depth=4)
    for number in range(10 * MIN_KEPT):
        for client in (Client(f"address {number}", "only"), Client("address", f"session {number}")):
            schedule.push(client, number, 0.1)
            schedule.pop()
            schedule.start_turn(client, 0.1)
    kept = [schedule._addresses, *schedule._sessions.values()]
    assert sum(len(turns._starts) for turns in kept) < 3 * MIN_KEPT


def test_equals_are_served_in_the_order_in_which_they_came() -> None:
    turns = FairQueue()
    for name in "yzx":
        turns.add(name, 1.0)
    assert turns.peek() == "y"


def test_some_addresses_and_costly_work_can_be_passed_over() -> None:
    schedule = waiting("a1", "b1")
    schedule.push(C, "c1", 0.1)
    assert schedule.pop({"a", "b", "c"}) is None
    assert schedule.pop({"c"}, max_cost=0.5) is None
    assert schedule.pop(max_cost=0.5) == "c1"
    assert schedule.pop({"a"}) == "b1"
    assert drain(schedule) == ["a1"]


def test_among_an_addresss_sessions_the_next_ones_cost_counts() -> None:
    """Its large frame's turn would end late, so it waits; but its other session's small one does not."""
    schedule = waiting("b1")
    schedule.push(A, "large", 9.0)
    schedule.push(Client("a", "other"), "small", 0.5)
    assert [schedule.pop() for _ in range(3)] == ["small", "b1", "large"]
