"""Where a trace is at a given time, and playing traces on a link that only remembers."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.shaper.conftest import IDLE, FakeLink, FakeTime, make_player, trace
from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.link.link import LinkClosed
from tigas_shaper.player import NotPlaying, Playback, Player

pytestmark = pytest.mark.anyio
TRACE = trace(1, 2, 3)


@pytest.fixture
def player(time: FakeTime, link: FakeLink) -> Player:
    return make_player(time, link)


async def test_each_step_comes_at_its_own_time_round_after_round(
    time: FakeTime, link: FakeLink, player: Player
) -> None:
    player.start(trace(1, 2, 3))
    await time.advance(0.65)
    assert link.applied == [(0.0, 1), (0.1, 2), (0.2, 3), (0.3, 1), (0.4, 2), (0.5, 3), (0.6, 1)]
    assert link.queues == [(2.0, 1000.0)]  # the mean rates of the trace
    assert player.mode == "playing"
    assert player.position_ms == pytest.approx(50)


async def test_without_a_loop_the_last_state_stays(time: FakeTime, link: FakeLink, player: Player) -> None:
    player.start(trace(1, 2), loop=False)
    await time.advance(5)
    assert player.mode == "ended"
    assert player.state.down_kbps == 2
    player.resume()
    await time.advance(0.05)
    assert (player.mode, player.state.down_kbps) == ("playing", 1)


async def test_a_late_wake_up_skips_what_it_missed(time: FakeTime, link: FakeLink) -> None:
    async def late(seconds: float) -> None:
        await time.sleep(seconds + 0.25)

    player = Player(link, IDLE, clock=time.clock, sleep=late)
    player.start(trace(1, 2, 3, 4, 5), loop=False)
    await time.advance(0.36)
    assert link.applied == [(0.0, 1), (0.35, 4)]


async def test_pause_resume_and_seek(time: FakeTime, link: FakeLink, player: Player) -> None:
    player.start(trace(1, 2, 3))
    await time.advance(0.15)
    player.pause()
    await time.advance(10)
    assert (player.mode, player.state.down_kbps) == ("paused", 2)
    player.seek(250)
    assert (player.mode, player.state.down_kbps) == ("paused", 3)
    player.resume()
    link.applied.clear()
    await time.advance(0.06)
    assert link.applied == [(10.2, 1)]
    player.seek(-5)
    assert (player.position_ms, player.mode) == (0, "playing")
    player.set_loop(False)
    player.seek(1e9)
    assert (player.position_ms, player.mode, player.state.down_kbps) == (300, "ended", 3)


async def test_another_trace_or_a_constant_link_takes_over(time: FakeTime, link: FakeLink, player: Player) -> None:
    player.start(trace(1, 2, 3))
    await time.advance(0.15)
    player.start(trace(10, 20, name="other"))
    await time.advance(0.1)
    assert player.state.down_kbps == 20
    player.hold(LinkSetting(7, 8, delay_ms=9))
    link.applied.clear()
    await time.advance(5)
    assert link.applied == []
    assert (player.mode, player.trace, player.state.delay_ms) == ("constant", None, 9)
    player.stop()
    assert player.state == IDLE


async def test_the_loop_can_be_ended_while_playing(time: FakeTime, link: FakeLink, player: Player) -> None:
    player.start(trace(1, 2))
    await time.advance(0.25)
    player.set_loop(False)
    assert player.position_ms == pytest.approx(50)
    await time.advance(5)
    assert (player.mode, player.position_ms) == ("ended", 200)
    assert [rate for _, rate in link.applied] == [1, 2, 1, 1, 2, 2]
    player.set_loop(True)
    await time.advance(0.05)
    assert player.mode == "playing"


async def test_without_a_trace_there_is_nothing_to_control(player: Player) -> None:
    for act in (player.pause, player.resume, lambda: player.seek(0), lambda: player.set_loop(True)):
        with pytest.raises(NotPlaying):
            act()


async def test_a_link_that_closes_ends_the_playing_quietly(time: FakeTime, link: FakeLink, player: Player) -> None:
    player.start(trace(1, 2, 3))
    link.close("gone")
    await time.advance(1)
    assert link.applied == [(0.0, 1)]
    with pytest.raises(LinkClosed, match="gone"):
        player.start(trace(1))


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
