"""Where a trace is at a given time."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.shaper.fakes import trace
from tigas_shaper.playback import Playback

TRACE = trace(1, 2, 3)


def playing(*, loop: bool, since: float = 10.0) -> Playback:
    return Playback(TRACE, loop, since=since)


@pytest.mark.parametrize(
    ("loop", "now", "position", "rate", "change"),
    [
        (True, 10.0, 0, 1, 10.1),
        (True, 10.15, 150, 2, 10.2),
        (True, 10.2, 200, 3, 10.3),
        (True, 10.3, 0, 1, 10.4),
        (True, 10.95, 50, 1, 11.0),
        (False, 10.25, 250, 3, 10.3),
        (False, 10.3, 300, 3, None),
        (False, 99.0, 300, 3, None),
    ],
)
def test_position_state_and_next_change(
    loop: bool, now: float, position: float, rate: float, change: float | None
) -> None:
    playback = playing(loop=loop)
    assert playback.position_ms(now) == pytest.approx(position)
    assert playback.state(now).down_kbps == rate
    assert playback.next_change(now) == pytest.approx(change)


@given(st.floats(0, 1e6), st.floats(0, 300), st.booleans())
def test_the_next_change_is_ahead_and_changes_the_state(since: float, anchor: float, loop: bool) -> None:
    """However times round, stepping from change to change never stands still, and never skips a state."""
    playback = Playback(TRACE, loop, anchor_ms=anchor, since=since)
    now, states = since, []
    for _ in range(4):
        states.append(playback.state(now).down_kbps)
        change = playback.next_change(now)
        if change is None:
            break
        assert change > now
        now = change
    cycle = [1.0, 2.0, 3.0] * 3
    first = cycle.index(states[0])
    assert states == cycle[first : first + len(states)] or (not loop and states[-2:] == [3.0, 3.0])


def test_a_paused_trace_stays_and_goes_on_from_there() -> None:
    paused = playing(loop=True).paused(10.15)
    assert paused.position_ms(99.0) == pytest.approx(150)
    assert paused.next_change(99.0) is None
    assert paused.playing(99.0).position_ms(99.02) == pytest.approx(170)


def test_an_ended_trace_starts_again_from_the_start() -> None:
    assert playing(loop=False).playing(20.0).position_ms(20.05) == pytest.approx(50)


def test_seeking_keeps_within_the_trace() -> None:
    playback = playing(loop=False)
    assert playback.at(120, 50.0).position_ms(50.03) == pytest.approx(150)
    assert playback.at(1e9, 50.0).ended(50.0)
    assert playback.at(-5, 50.0).position_ms(50.0) == 0


def test_looping_can_change_on_the_way() -> None:
    playback = playing(loop=True).looping(False, 10.65)  # third round
    assert playback.position_ms(10.65) == pytest.approx(50)
    assert playback.ended(10.91)
    assert not playback.looping(True, 10.7).ended(99.0)
