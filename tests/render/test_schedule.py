"""The schedule is fair between clients and fresh within one."""

from __future__ import annotations

import pytest

from tigas_render.schedule import FairSchedule


def drain(schedule: FairSchedule[str]) -> list[str]:
    return [schedule.pop() for _ in range(len(schedule))]


def test_clients_take_turns_however_much_one_of_them_asks() -> None:
    schedule: FairSchedule[str] = FairSchedule(depth=4)
    for work in ("a1", "a2", "a3"):
        schedule.push("a", work)
    schedule.push("b", "b1")
    schedule.push("c", "c1")
    assert drain(schedule) == ["a3", "b1", "c1", "a2", "a1"]


def test_a_client_that_was_just_served_goes_to_the_end_of_the_line() -> None:
    schedule: FairSchedule[str] = FairSchedule(depth=4)
    schedule.push("a", "a1")
    schedule.push("b", "b1")
    assert schedule.pop() == "a1"
    schedule.push("a", "a2")
    assert drain(schedule) == ["b1", "a2"]


def test_the_newest_wins_when_a_clients_queue_is_full() -> None:
    schedule: FairSchedule[str] = FairSchedule(depth=2)
    assert [schedule.push("a", work) for work in ("a1", "a2", "a3")] == [None, None, "a1"]
    assert drain(schedule) == ["a3", "a2"]
    assert len(schedule) == 0


def test_withdrawn_work_is_not_served() -> None:
    schedule: FairSchedule[str] = FairSchedule(depth=4)
    schedule.push("a", "a1")
    schedule.push("b", "b1")
    assert schedule.remove("a", "a1")
    assert not schedule.remove("a", "a1")
    assert not schedule.remove("unknown", "a1")
    assert drain(schedule) == ["b1"]
    with pytest.raises(IndexError):
        schedule.pop()
