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

from tests.eventually import eventually
from tests.render.fakes import render_request
from tests.render.transport.client import FakeFrames
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
from tigas_render.pipe.engines import SESSION_EXPIRY_S, EnginePool, SessionAssignment
from tigas_render.pipe.remote_engine import WARM_UP, Pressure
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
            request.scene for client, request in self.frames.requests if not client.session.endswith(WARM_UP.session)
        )


@dataclass
class Host:
    """Two devices, and an edge connected to them."""

    devices: list[Device]
    edge: EnginePool
    heard: list[tuple[float, float]]

    async def ask(
        self, scene: str = "courtyard", viewer: Client = VIEWERS[0], *, video: bool = False, coarse: bool = False
    ) -> None:
        request = render_request(scene=scene, coarse=coarse)
        if video:
            request = render_request(scene=scene, format="h264", video=VideoRequest(bitrate_kbps=1000))
        (await asyncio.wait_for(self.edge.submit(viewer, request, time.monotonic()), 5)).release()

    async def all_ask(self) -> None:
        for viewer in VIEWERS:
            await self.ask(viewer=viewer)

    async def first(self) -> tuple[Device, Device]:
        """The device that gets the request for the scene, and the other one."""
        await self.ask()
        return tuple(sorted(self.devices, key=lambda device: not device.asked()))  # type: ignore[return-value]


@pytest.fixture
async def host(tmp_path: Path) -> AsyncIterator[Host]:
    devices = [Device(tmp_path / name) for name in "ab"]
    heard: list[tuple[float, float]] = []
    async with AsyncExitStack() as stack:
        for device in devices:
            device.server = await stack.enter_async_context(
                serve_edges(
                    device.path,
                    device.frames,
                    lambda device=device: device.state,  # type: ignore[misc]
                    lambda edge, told: None,
                    arena_bytes=1 << 20,
                )
            )
        sockets = {device.path.name: device.path for device in devices}
        edge = EnginePool(sockets, 0, lambda *state: heard.append(state), time.monotonic)
        await stack.enter_async_context(edge)
        await eventually(lambda: len(edge.connected()) == 2)
        yield Host(devices, edge, heard)


async def test_a_video_that_moves_leaves_no_encoder_behind(host: Host) -> None:
    await host.ask(video=True)
    one, other = await host.first()
    one.frames.error = NoRoom("It is full.")
    await host.ask(video=True)
    await eventually(lambda: one.frames.forgotten)
    assert other.frames.requests[-1][1].video is not None
    host.edge.forget(VIEWERS[0])
    await eventually(lambda: other.frames.forgotten)
    assert len(one.frames.forgotten) == len(other.frames.forgotten) == 1


async def test_an_engine_has_a_scene_once_it_answers_with_all_of_it(host: Host) -> None:
    def warm() -> list[str]:
        return [engine.name for engine in host.edge.all if engine.is_warm("courtyard")]

    await host.ask(coarse=True)
    assert not warm()
    one, other = await host.first()
    assert warm() == [one.path.name]
    one.frames.error = NoRoom("It is full.")
    await host.ask(coarse=True)  # passed on to the other one
    host.edge.all[host.devices.index(other)].warm_up(render_request(scene="courtyard", coarse=True))
    await eventually(lambda: warm() == [other.path.name])
    assert [request.coarse for _, request in other.frames.requests] == [True, False]


async def test_scenes_are_shared_out_and_each_stays_where_it_is(host: Host) -> None:
    for scene in SCENES:
        for viewer in VIEWERS[:3]:
            await host.ask(scene, viewer)
    one, other = (device.asked() for device in host.devices)
    assert set(one) | set(other) == set(SCENES)
    assert not set(one) & set(other)
    assert min(len(one), len(other)) >= 4


async def test_a_scene_that_is_too_much_for_one_is_loaded_by_another_and_shared_with_it(host: Host) -> None:
    busy, other = await host.first()
    other.frames.held = True  # it loads the scene
    busy.state = WORK
    async with asyncio.timeout(20):
        while not other.frames.requests:
            await host.all_ask()
    await host.all_ask()
    assert [client.session.partition(" ")[2] for client, _ in other.frames.requests] == [WARM_UP.session]
    other.frames.held = False
    other.frames.release(0)
    async with asyncio.timeout(20):
        while not other.asked():
            await host.all_ask()
    busy.state = EASE
    await host.all_ask()
    for device in host.devices:
        device.frames.requests.clear()
        device.frames.release(0)
    for _ in range(5):
        await host.all_ask()
    of = [{client.session for client, _ in device.frames.requests} for device in host.devices]
    assert all(len(sessions) >= 4 for sessions in of)
    assert sum(map(len, of)) == len(VIEWERS), "each stays with its engine"


async def test_a_scene_that_may_soon_need_another_device_is_loaded_there_before(host: Host) -> None:
    busy, other = await host.first()
    busy.state = (0.0, 0.75)
    async with asyncio.timeout(20):
        while not other.frames.requests:
            await host.ask()
    assert not other.asked()


@pytest.mark.parametrize("kind", [BrokenScene, NoRoom, OutOfDeviceMemory, UnknownScene, DeviceLost])
async def test_what_one_device_cannot_do_another_is_asked_for(host: Host, kind: type[TigasError]) -> None:
    refusing, other = await host.first()
    refusing.frames.error = kind("It cannot.")
    for _ in range(10):
        await host.ask()
    assert other.asked()["courtyard"] == 10
    if kind is OutOfDeviceMemory:
        assert refusing.asked()["courtyard"] == 2, "it is not asked with every frame"


@pytest.mark.parametrize(("kind", "asked"), [(InvalidRequest, 1), (Overloaded, 1), (BrokenScene, 2)])
async def test_what_no_other_device_can_mend_is_answered_as_it_is(
    host: Host, kind: type[TigasError], asked: int
) -> None:
    for device in host.devices:
        device.frames.error = kind("A sentence.")
    with pytest.raises(kind, match="A sentence"):
        await host.ask()
    assert sum(device.asked()["courtyard"] for device in host.devices) == asked


async def test_requests_to_an_engine_that_dies_are_answered_by_another(host: Host) -> None:
    dying, other = await host.first()
    dying.frames.held = True
    asked = [asyncio.create_task(host.ask(viewer=viewer)) for viewer in VIEWERS]
    await eventually(lambda: len(dying.frames.requests) == 1 + len(VIEWERS))
    assert dying.server is not None
    dying.server.close()
    await asyncio.gather(*asked)
    assert other.asked()["courtyard"] == len(VIEWERS)


async def test_a_request_that_was_passed_on_can_be_withdrawn(host: Host) -> None:
    refusing, other = await host.first()
    refusing.frames.error, other.frames.held = BrokenScene("It cannot."), True
    asked = asyncio.create_task(host.ask())
    await eventually(lambda: other.frames.requests)
    asked.cancel()
    await eventually(lambda: other.frames.cancelled == [0])


async def test_an_engine_that_says_nothing_any_more_is_given_up(host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    silent, other = await host.first()
    silent.frames.held = True
    assert silent.server is not None
    for edge in silent.server.edges:
        monkeypatch.setattr(edge, "send", lambda message: None)
    await asyncio.wait_for(host.ask(), engines_module.SILENCE_TIMEOUT_S + 20)
    assert other.asked()["courtyard"] == 1


async def test_without_any_engine_viewers_hear_when_to_come_back(host: Host) -> None:
    for device in host.devices:
        assert device.server is not None
        device.server.close()
    await eventually(lambda: not host.edge.connected())
    with pytest.raises(Overloaded, match="restarting") as caught:
        await host.ask()
    assert caught.value.retry_after_s


async def test_the_edge_hears_of_the_engine_that_has_the_least_to_do(host: Host) -> None:
    host.devices[0].state, host.devices[1].state = (0.5, 1.0), (0.25, 0.875)
    await eventually(lambda: host.heard and host.heard[-1][1] > 0.8)
    host.heard.clear()
    await eventually(lambda: len(host.heard) >= 6)
    assert host.heard[-1] == (0.25, 0.875)


def share(assignment: SessionAssignment, sessions: Sequence[int], engines: str, now: float = 0.0) -> dict[int, str]:
    return {session: assignment.choose(session, tuple(engines), now) for session in sessions}


@pytest.mark.parametrize(
    ("sessions", "before", "after", "shares", "moved"),
    [(31, "abc", "abc", [10, 10, 11], 0), (30, "ab", "abc", [10, 10, 10], 10), (30, "abc", "ab", [15, 15], 10)],
    ids=["the same engines", "a new engine", "an engine that is gone"],
)
def test_engines_have_as_many_sessions_each_and_no_more_sessions_move_than_have_to(
    sessions: int, before: str, after: str, shares: list[int], moved: int
) -> None:
    assignment = SessionAssignment()
    first = share(assignment, range(sessions), before)
    then = share(assignment, range(sessions), after)
    assert sorted(Counter(then.values()).values()) == shares
    assert sum(first[session] != then[session] for session in range(sessions)) == moved
    assert share(assignment, range(sessions), after) == then


def test_sessions_that_ask_no_more_do_not_count() -> None:
    assignment = SessionAssignment()
    share(assignment, range(10), "ab")
    assert assignment.expire(SESSION_EXPIRY_S / 2)
    assert not assignment.expire(SESSION_EXPIRY_S)
    assert Counter(share(assignment, range(10, 14), "ab", SESSION_EXPIRY_S).values()) == {"a": 2, "b": 2}


@pytest.mark.parametrize(
    "reports",
    [
        [(50, 0.0, 0.8, False), (20, 0.0, 0.95, True), (50, 0.0, 0.75, True), (20, 0.0, 0.45, False)],
        [(20, 0.2, 0.3, True), (20, 0.0, 0.3, False)],
        [(2, 0.1, 1.0, False), (1, 0.0, 0.1, False)],
    ],
    ids=["it hardly rests, until it is at ease", "its clients wait", "a moment is no pressure"],
)
def test_whether_an_engine_is_pressed_after(reports: list[tuple[int, float, float, bool]]) -> None:
    """reports: times, age of the queue, utilisation, and whether it is pressed then."""
    pressure = Pressure()
    for times, age_s, utilisation, pressed in reports:
        for _ in range(times):
            pressure.update(age_s, utilisation)
        assert pressure.is_high == pressed


def test_an_engine_says_when_it_may_soon_be_pressed_and_when_it_could_do_as_much_again() -> None:
    pressure = Pressure()
    for utilisation, is_rising, is_low in ((0.3, False, True), (0.5, False, False), (0.7, True, False)):
        for _ in range(50):
            pressure.update(0.0, utilisation)
        assert (pressure.is_rising, pressure.is_low) == (is_rising, is_low)
