"""Viewers of a service with several devices: shared scenes, devices that die or are lost, one HTTP interface."""

from __future__ import annotations

import asyncio
import re
import signal
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest

from reference.ply import write_ply
from tests.render.transport.client import eventually, request_body
from tests.render.workers.fleet import ASK, Fleet, Viewer, nothing_left, serving
from tigas_common.placement import ranked
from tigas_render.raster.base import one_gaussian

pytestmark = [pytest.mark.anyio, pytest.mark.slow]

BACK_S = 2.0
FRAMES_PER_S = 100
"""Of each device, which makes them up: enough for three viewers."""
DEVICE = f"instant:5000:{FRAMES_PER_S}"
NAMES = (f"{DEVICE}#0", f"{DEVICE}#1")
SCENES = tuple(
    next(id for id in (f"scene-{number}" for number in range(99)) if ranked(id, NAMES)[0] == name) for name in NAMES
)
"""The first device's, and the second's."""
UNSEEN = "unseen"


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    for scene in (*SCENES, UNSEEN):
        (folder / scene).mkdir()
        write_ply(folder / scene / "scene.ply", one_gaussian())
    return folder


@pytest.fixture(scope="module")
def fleet(models: Path) -> Iterator[Fleet]:
    with serving("--scenes", str(models), edges=2, device=f"{DEVICE},{DEVICE}") as running:
        yield running


def asking_for(scene: str) -> bytes:
    return request_body(scene=scene, width=64, height=36, cx=32, cy=18)


@asynccontextmanager
async def watching(viewers: Sequence[Viewer]) -> AsyncIterator[None]:
    """All watch, and have seen something."""
    tasks = [asyncio.create_task(viewer.watch()) for viewer in viewers]
    try:
        await eventually(lambda: all(len(viewer.shown) >= 5 for viewer in viewers))
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def gaps(viewers: Sequence[Viewer], since: float) -> float:
    """The longest that any of them has seen nothing new, in seconds."""
    seen = [[at for at in viewer.shown if at >= since] for viewer in viewers]
    return max(late - early for each in seen for early, late in zip([since, *each], each, strict=False))


async def frames(http: httpx.AsyncClient) -> Counter[str]:
    """How many each device has made."""
    text = (await http.get("/metrics")).text
    found = re.findall(
        r'^tigas_render_requests_total\{device="([^"]*)",outcome="frame"\} ([0-9.]+)$', text, re.MULTILINE
    )
    return Counter({name: int(float(number)) for name, number in found})


async def test_two_devices_share_two_scenes(fleet: Fleet) -> None:
    async with httpx.AsyncClient(base_url=fleet.url, timeout=60) as http:
        before = await frames(http)
        for scene, times in zip(SCENES, (3, 5), strict=True):
            for _ in range(times):
                assert (await http.post("/render", content=asking_for(scene))).status_code == 200
        after = await frames(http)
    assert [after[name] - before[name] for name in NAMES] == [3, 5]


async def test_what_each_engine_knows_reads_as_one(fleet: Fleet) -> None:
    async with httpx.AsyncClient(base_url=fleet.url, timeout=60) as http:
        for scene in SCENES:
            loaded = await http.post(f"/scenes/{scene}/load")
            assert (loaded.status_code, loaded.json()["state"]) == (200, "loaded")
            assert (await http.get(f"/scenes/{scene}")).json()["state"] == "loaded"
        listed = {each["id"]: each["state"] for each in (await http.get("/scenes?scan=1")).json()}
        assert {scene: listed[scene] for scene in SCENES} == dict.fromkeys(SCENES, "loaded")
        assert list(listed) == sorted(listed)
        assert set(SCENES) <= set((await http.get("/api/load")).json()["scenes"])
        assert (await http.get("/scenes/nowhere")).status_code == 404
        assert (await http.head("/scenes")).status_code == 200
        preview = await http.get(f"/scenes/{SCENES[0]}/preview")
        assert preview.headers["content-type"] == "image/jpeg"
        assert (await http.get(f"/scenes/{SCENES[1]}/enhance")).json()["state"] == "idle"
        assert (await http.get("/config.json")).json()["certificate_sha256"]

        async def all_edges_have_told() -> bool:
            return 'tigas_render_viewers{edge="1"}' in (await http.get("/metrics")).text

        await eventually(all_edges_have_told)
        text = (await http.get("/metrics")).text
    for name in NAMES:
        assert f'tigas_render_device_up{{device="{name}"}} 1.0' in text
    for edge in range(2):
        assert text.count(f'tigas_render_viewers{{edge="{edge}"}}') == 1
    assert text.count("# TYPE tigas_render_requests_total counter") == 1


async def test_a_scene_that_nobody_views_is_unloaded_everywhere(fleet: Fleet) -> None:
    async with httpx.AsyncClient(base_url=fleet.url, timeout=60) as http:
        await http.post(f"/scenes/{UNSEEN}/load")
        answer = await http.post(f"/scenes/{UNSEEN}/unload")
        assert (answer.status_code, answer.json()["state"]) == (200, "unloaded")
        listed = {each["id"]: each["state"] for each in (await http.get("/scenes")).json()}
    assert listed[UNSEEN] == "unloaded"


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
async def test_an_engine_that_stops_costs_its_viewers_two_seconds_and_others_nothing(
    fleet: Fleet, number: signal.Signals
) -> None:
    hit, spared = viewers = [Viewer(fleet, asking_for(scene)) for scene in SCENES]
    async with httpx.AsyncClient(base_url=fleet.url, timeout=60) as http, watching(viewers):
        before = await frames(http)

        async def each_has_its_own() -> bool:
            now = await frames(http)
            return min(now[name] - before[name] for name in NAMES) > 10

        await eventually(each_has_its_own)
        engine = fleet.child("engine 0")
        stopped = time.monotonic()
        engine.send_signal(number)
        await eventually(lambda: all(viewer.shown[-1] > stopped + BACK_S for viewer in viewers))
        assert gaps([hit], stopped) < BACK_S
        assert gaps([spared], stopped) < 1.0
        assert [(viewer.connections, viewer.failed) for viewer in viewers] == [(1, [])] * 2
        assert (await http.get("/healthz")).status_code == 200
        assert (await http.get("/scenes")).status_code == 200
        if number == signal.SIGSTOP:
            engine.send_signal(signal.SIGCONT)
        else:
            await fleet.started_again("engine 0", engine.pid)


async def test_a_popular_scene_gets_both_devices(fleet: Fleet) -> None:
    viewers = [Viewer(fleet, asking_for(SCENES[0])) for _ in range(8)]
    async with httpx.AsyncClient(base_url=fleet.url, timeout=60) as http, watching(viewers):
        before = await frames(http)

        async def widened() -> bool:
            now = await frames(http)
            return min(now[name] - before[name] for name in NAMES) > FRAMES_PER_S

        await eventually(widened)
        assert [viewer.connections for viewer in viewers] == [1] * len(viewers)


@pytest.mark.extended
def test_a_device_that_cannot_be_used_is_named_and_the_others_serve() -> None:
    with nothing_left(), serving(edges=1, device="instant,cuda:99") as fleet:
        assert httpx.get(f"{fleet.url}/healthz").status_code == 200
        assert httpx.post(f"{fleet.url}/render", content=ASK, timeout=60).status_code == 200
        assert 'tigas_render_device_up{device="cuda:99"} 0.0' in httpx.get(f"{fleet.url}/metrics").text
        fleet.errors.seek(0)
        line, *_ = fleet.errors.read().splitlines()  # it may have been tried again by now
    assert re.fullmatch(
        r"The engine on cuda:99 did not start: .*\. It is tried again in 15 s; others do its work meanwhile\.", line
    )
