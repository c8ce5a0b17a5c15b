"""An edge with several engines: the choice of an engine, and its replacement if it fails."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.render.fakes import render_request
from tests.render.transport.client import FakeFrames
from tests.render.transport.serving import eventually
from tigas_common.errors import (
    BrokenScene,
    DeviceLost,
    InvalidRequest,
    NoRoom,
    OutOfDeviceMemory,
    Overloaded,
    TigasError,
    UnknownScene,
)
from tigas_common.wire.render import VideoRequest
from tigas_render.frame import Client
from tigas_render.pipe import engines as engines_module
from tigas_render.pipe.engines import GONE_S, Engines, Sharing
from tigas_render.pipe.remote_engine import WARMING, Pressure
from tigas_render.pipe.server import PipeServer, serve_edges

pytestmark = pytest.mark.anyio

VIEWERS = [Client("192.0.2.1", f"viewer {number}") for number in range(20)]
SCENES = [f"scene {number}" for number in range(20)]
EASE, WORK = (0.0, 0.1), (0.0, 1.0)


@dataclass
class Device:
    """An engine's end."""

    path: Path
    frames: FakeFrames = field(default_factory=FakeFrames)
    state: tuple[float, float] = EASE
    server: PipeServer | None = None

    def asked(self) -> Counter[str]:
        """Number of viewers' requests for each scene."""
        return Counter(
            request.scene for client, request in self.frames.requests if not client.session.endswith(WARMING.session)
        )

    async def start(self, stack: AsyncExitStack) -> None:
        self.server = await stack.enter_async_context(
            serve_edges(self.path, self.frames, lambda: self.state, lambda edge, told: None, arena_bytes=1 << 20)
        )


@pytest.fixture
async def devices(tmp_path: Path) -> AsyncIterator[list[Device]]:
    devices = [Device(tmp_path / name) for name in "ab"]
    async with AsyncExitStack() as stack:
        for device in devices:
            await device.start(stack)
        yield devices


@pytest.fixture
async def engines(devices: list[Device]) -> AsyncIterator[Engines]:
    async with Engines({each.path.name: each.path for each in devices}, 0, lambda *_: None, time.monotonic) as engines:
        await eventually(lambda: len(engines.up()) == 2)
        yield engines


async def ask(engines: Engines, scene: str = "courtyard", viewer: Client = VIEWERS[0]) -> None:
    frame = await engines.submit(viewer, render_request(scene=scene), time.monotonic())
    frame.release()


async def film(engines: Engines) -> None:
    request = render_request(scene="courtyard", format="h264", video=VideoRequest(bitrate_kbps=1000))
    (await engines.submit(VIEWERS[0], request, time.monotonic())).release()


async def test_a_video_that_moves_leaves_no_encoder_behind(devices: list[Device], engines: Engines) -> None:
    await film(engines)
    one, other = first(devices)
    one.frames.error = NoRoom("It is full.")
    await film(engines)
    await one.frames.until(lambda: one.frames.forgotten)
    assert other.frames.requests[-1][1].video is not None
    engines.forget(VIEWERS[0])
    await other.frames.until(lambda: other.frames.forgotten)
    assert len(one.frames.forgotten) == len(other.frames.forgotten) == 1


def first(devices: list[Device], scene: str = "courtyard") -> tuple[Device, Device]:
    """The device asked for a scene, and the other one."""
    one, other = devices
    return (one, other) if one.asked()[scene] else (other, one)


async def test_scenes_are_shared_out_and_each_stays_where_it_is(devices: list[Device], engines: Engines) -> None:
    for scene in SCENES:
        for viewer in VIEWERS[:3]:
            await ask(engines, scene, viewer)
    one, other = (device.asked() for device in devices)
    assert set(one) | set(other) == set(SCENES)
    assert not set(one) & set(other)
    assert min(len(one), len(other)) >= 4


async def test_a_scene_that_is_too_much_for_one_gets_another_and_viewers_stay_with_theirs(
    devices: list[Device], engines: Engines
) -> None:
    await ask(engines)
    busy, other = first(devices)
    busy.state = WORK

    async def widened() -> bool:
        for viewer in VIEWERS:
            await ask(engines, viewer=viewer)
        return len(other.asked()) > 0

    async with asyncio.timeout(20):
        while not await widened():  # noqa: ASYNC110 - only asking tells
            await asyncio.sleep(0.05)
    busy.state = EASE
    await widened()
    for device in devices:
        device.frames.requests.clear()
    for _ in range(5):
        await widened()
    of = [{client.session for client, _ in device.frames.requests} for device in devices]
    assert all(len(sessions) >= 4 for sessions in of)
    assert sum(map(len, of)) == len(VIEWERS)


async def test_viewers_stay_where_the_scene_is_until_the_other_device_has_it(
    devices: list[Device], engines: Engines
) -> None:
    await ask(engines)
    busy, other = first(devices)
    other.frames.held = True  # it loads the scene
    busy.state = WORK

    async def is_warming() -> bool:
        for viewer in VIEWERS:
            await asyncio.wait_for(ask(engines, viewer=viewer), 5)
        return bool(other.frames.requests)

    async with asyncio.timeout(20):
        while not await is_warming():  # noqa: ASYNC110 - only asking tells
            await asyncio.sleep(0.05)
    await is_warming()
    assert [client.session.partition(" ")[2] for client, _ in other.frames.requests] == [WARMING.session]
    other.frames.release(0)
    other.frames.held = False
    async with asyncio.timeout(20):
        while not other.asked():
            await is_warming()


async def test_a_scene_that_may_soon_need_another_device_is_loaded_there_before(
    devices: list[Device], engines: Engines
) -> None:
    await ask(engines)
    busy, other = first(devices)
    busy.state = (0.0, 0.75)
    async with asyncio.timeout(20):
        while not other.frames.requests:
            await ask(engines)
            await asyncio.sleep(0.02)
    assert not other.asked()


@pytest.mark.parametrize("kind", [BrokenScene, NoRoom, OutOfDeviceMemory, UnknownScene, DeviceLost])
async def test_what_one_device_cannot_do_another_is_asked_for(
    devices: list[Device], engines: Engines, kind: type[TigasError]
) -> None:
    await ask(engines)
    refusing, other = first(devices)
    refusing.frames.error = kind("It cannot.")
    await ask(engines)
    assert other.asked()["courtyard"] == 1


async def test_a_device_without_room_for_a_scene_is_not_asked_for_it_with_every_frame(
    devices: list[Device], engines: Engines
) -> None:
    await ask(engines)
    refusing, _ = first(devices)
    refusing.frames.error = OutOfDeviceMemory("It is full.")
    for _ in range(10):
        await ask(engines)
    assert refusing.asked()["courtyard"] == 2


@pytest.mark.parametrize("kind", [InvalidRequest, Overloaded, BrokenScene])
async def test_what_no_other_device_can_mend_is_answered_as_it_is(
    devices: list[Device], engines: Engines, kind: type[TigasError]
) -> None:
    for device in devices:
        device.frames.error = kind("A sentence.")
    with pytest.raises(kind, match="A sentence"):
        await ask(engines)
    asked = sum(device.asked()["courtyard"] for device in devices)
    assert asked == (2 if kind is BrokenScene else 1)


async def test_requests_to_an_engine_that_dies_are_answered_by_another(devices: list[Device], engines: Engines) -> None:
    await ask(engines)
    dying, other = first(devices)
    dying.frames.held = True
    asked = [asyncio.create_task(ask(engines, viewer=viewer)) for viewer in VIEWERS]
    await eventually(lambda: len(dying.frames.requests) == 1 + len(VIEWERS))
    assert dying.server is not None
    dying.server.close()
    await asyncio.wait_for(asyncio.gather(*asked), 5)
    assert other.asked()["courtyard"] == len(VIEWERS)


async def test_a_request_that_was_passed_on_can_be_withdrawn(devices: list[Device], engines: Engines) -> None:
    await ask(engines)
    refusing, other = first(devices)
    refusing.frames.error, other.frames.held = BrokenScene("It cannot."), True
    asked = asyncio.create_task(ask(engines))
    await eventually(lambda: other.frames.requests)
    asked.cancel()
    await eventually(lambda: other.frames.cancelled == [0])


async def test_an_engine_that_says_nothing_any_more_is_given_up(
    devices: list[Device], engines: Engines, monkeypatch: pytest.MonkeyPatch
) -> None:
    await ask(engines)
    silent, other = first(devices)
    silent.frames.held = True
    assert silent.server is not None
    for edge in silent.server.edges:
        monkeypatch.setattr(edge, "send", lambda message: None)
    await asyncio.wait_for(ask(engines), engines_module.SILENT_S + 1)
    assert other.asked()["courtyard"] == 1


async def test_without_any_engine_viewers_hear_when_to_come_back(tmp_path: Path) -> None:
    async with Engines({"a": tmp_path / "a", "b": tmp_path / "b"}, 0, lambda *_: None, time.monotonic) as engines:
        with pytest.raises(Overloaded, match="starting again") as caught:
            await ask(engines)
        assert caught.value.retry_after_s


async def test_the_edge_hears_of_the_engine_that_has_the_least_to_do(devices: list[Device]) -> None:
    heard: list[tuple[float, float]] = []
    devices[0].state, devices[1].state = (0.5, 1.0), (0.25, 0.875)
    async with Engines(
        {each.path.name: each.path for each in devices}, 0, lambda *state: heard.append(state), time.monotonic
    ) as engines:
        await eventually(lambda: len(engines.up()) == 2)
        heard.clear()
        await eventually(lambda: len(heard) >= 6)
    assert heard[-1] == (0.25, 0.875)


def share(sharing: Sharing, sessions: Sequence[int], engines: Sequence[str], now: float = 0.0) -> dict[int, str]:
    return {session: sharing.choose(session, engines, now) for session in sessions}


def test_engines_have_as_many_sessions_each_and_sessions_stay() -> None:
    sharing = Sharing()
    first = share(sharing, range(31), ("a", "b", "c"))
    assert sorted(Counter(first.values()).values()) == [10, 10, 11]
    assert share(sharing, range(31), ("a", "b", "c")) == first


def test_a_new_engine_takes_its_part_and_no_more_sessions_move_than_have_to() -> None:
    sharing = Sharing()
    before = share(sharing, range(30), ("a", "b"))
    after = share(sharing, range(30), ("a", "b", "c"))
    assert set(Counter(after.values()).values()) == {10}
    assert sum(before[session] != after[session] for session in range(30)) == 10
    assert share(sharing, range(30), ("a", "b", "c")) == after


def test_the_sessions_of_an_engine_that_is_gone_are_shared_out() -> None:
    sharing = Sharing()
    before = share(sharing, range(30), ("a", "b", "c"))
    after = share(sharing, range(30), ("a", "b"))
    assert set(Counter(after.values()).values()) == {15}
    assert all(after[session] == engine for session, engine in before.items() if engine != "c")


def test_sessions_that_ask_no_more_do_not_count() -> None:
    sharing = Sharing()
    share(sharing, range(10), ("a", "b"))
    assert sharing.forget(GONE_S / 2)
    assert not sharing.forget(GONE_S)
    assert Counter(share(sharing, range(10, 14), ("a", "b"), GONE_S).values()) == {"a": 2, "b": 2}


def heard(pressure: Pressure, times: int, age_s: float, utilisation: float) -> bool:
    for _ in range(times):
        pressure.heard(age_s, utilisation)
    return pressure.pressed


def test_an_engine_that_hardly_rests_is_pressed_until_it_is_at_ease() -> None:
    pressure = Pressure()
    assert not heard(pressure, 50, 0.0, 0.8)
    assert heard(pressure, 20, 0.0, 0.95)
    assert heard(pressure, 50, 0.0, 0.75), "neither much nor little to do changes anything"
    assert not heard(pressure, 20, 0.0, 0.45)


def test_an_engine_whose_clients_wait_is_pressed_whatever_else_it_says() -> None:
    pressure = Pressure()
    assert heard(pressure, 20, 0.2, 0.3)
    assert not heard(pressure, 20, 0.0, 0.3)


def test_an_engine_says_when_it_may_soon_be_pressed_and_when_it_could_do_as_much_again() -> None:
    pressure = Pressure()
    for utilisation, is_near, at_ease in ((0.3, False, True), (0.5, False, False), (0.7, True, False)):
        heard(pressure, 50, 0.0, utilisation)
        assert (pressure.is_near, pressure.at_ease) == (is_near, at_ease)


def test_a_moment_is_no_pressure() -> None:
    pressure = Pressure()
    assert not heard(pressure, 2, 0.1, 1.0)
    assert not heard(pressure, 1, 0.0, 0.1)
