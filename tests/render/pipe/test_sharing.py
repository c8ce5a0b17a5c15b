"""Sessions are shared out evenly, and stay where they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from tigas_render.pipe.sharing import GONE_S, Sharing


def ask(sharing: Sharing, sessions: Sequence[int], engines: Sequence[str], now: float = 0.0) -> dict[int, str]:
    return {session: sharing.choose(session, engines, now) for session in sessions}


def test_engines_have_as_many_sessions_each_and_sessions_stay() -> None:
    sharing = Sharing()
    first = ask(sharing, range(31), ("a", "b", "c"))
    assert sorted(Counter(first.values()).values()) == [10, 10, 11]
    assert ask(sharing, range(31), ("a", "b", "c")) == first


def test_a_new_engine_takes_its_part_and_no_more_sessions_move_than_have_to() -> None:
    sharing = Sharing()
    before = ask(sharing, range(30), ("a", "b"))
    after = ask(sharing, range(30), ("a", "b", "c"))
    assert set(Counter(after.values()).values()) == {10}
    assert sum(before[session] != after[session] for session in range(30)) == 10
    assert ask(sharing, range(30), ("a", "b", "c")) == after


def test_the_sessions_of_an_engine_that_is_gone_are_shared_out() -> None:
    sharing = Sharing()
    before = ask(sharing, range(30), ("a", "b", "c"))
    after = ask(sharing, range(30), ("a", "b"))
    assert set(Counter(after.values()).values()) == {15}
    assert all(after[session] == engine for session, engine in before.items() if engine != "c")


def test_sessions_that_ask_no_more_do_not_count() -> None:
    sharing = Sharing()
    ask(sharing, range(10), ("a", "b"))
    assert sharing.forget(GONE_S / 2)
    assert not sharing.forget(GONE_S)
    assert Counter(ask(sharing, range(10, 14), ("a", "b"), GONE_S).values()) == {"a": 2, "b": 2}
