"""Viewers of a service with several devices: shared scenes, devices that die or are lost, one HTTP interface."""

from __future__ import annotations

import re
import signal
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import httpx
import pytest

from reference.ply import write_ply
from tests.eventually import eventually
from tests.render.transport.client import request_body
from tests.render.workers.fleet import ASK, Fleet, Viewer, gap, nothing_left, serving, watching
from tigas_common.placement import rank_names
from tigas_render.raster.base import one_gaussian

pytestmark = [pytest.mark.anyio, pytest.mark.slow]

BACK_S = 2.0
FRAMES_PER_S = 100
"""Of each device, which makes them up: enough for three viewers."""
DEVICE = f"instant:5000:{FRAMES_PER_S}"
NAMES = (f"{DEVICE}#0", f"{DEVICE}#1")
SCENES = tuple(
    next(id for id in (f"scene-{number}" for number in range(99)) if rank_names(id, NAMES)[0] == name) for name in NAMES
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


@pytest.fixture
async def http(fleet: Fleet) -> AsyncIterator[httpx.AsyncClient]:
    async with httpx.AsyncClient(base_url=fleet.url, timeout=60) as http:
        yield http


async def frames(http: httpx.AsyncClient) -> Counter[str]:
    """How many each device has made."""
    text = (await http.get("/metrics")).text
    found = re.findall(
        r'^tigas_render_requests_total\{device="([^"]*)",outcome="frame"\} ([0-9.]+)$', text, re.MULTILINE
    )
    return Counter({name: int(float(number)) for name, number in found})


async def test_two_devices_share_scenes_and_what_each_knows_reads_as_one(http: httpx.AsyncClient) -> None:
    before = await frames(http)
    for scene, times in zip(SCENES, (3, 5), strict=True):
        for _ in range(times):
            assert (await http.post("/render", content=asking_for(scene))).status_code == 200
    after = await frames(http)
    assert [after[name] - before[name] for name in NAMES] == [3, 5]
    await http.post(f"/scenes/{UNSEEN}/load")
    unloaded = await http.post(f"/scenes/{UNSEEN}/unload")
    assert (unloaded.status_code, unloaded.json()["state"]) == (200, "unloaded")
    listed = {each["id"]: each["state"] for each in (await http.get("/scenes?scan=1")).json()}
    assert {id: listed[id] for id in (*SCENES, UNSEEN)} == dict.fromkeys(SCENES, "loaded") | {UNSEEN: "unloaded"}
    assert list(listed) == sorted(listed)
    assert set(SCENES) <= set((await http.get("/api/load")).json()["scenes"])

    async def all_edges_have_told() -> bool:
        return 'tigas_render_viewers{edge="1"}' in (await http.get("/metrics")).text

    await eventually(all_edges_have_told)
    text = (await http.get("/metrics")).text
    for name in NAMES:
        assert f'tigas_render_device_up{{device="{name}"}} 1.0' in text
    for edge in range(2):
        assert text.count(f'tigas_render_viewers{{edge="{edge}"}}') == 1
    assert text.count("# TYPE tigas_render_requests_total counter") == 1


async def each_device_has_made(http: httpx.AsyncClient, more: int) -> None:
    """Wait until each device has made more than this many frames."""
    before = await frames(http)

    async def has_made() -> bool:
        now = await frames(http)
        return min(now[name] - before[name] for name in NAMES) > more

    await eventually(has_made)


@pytest.mark.alone  # a busy engine refuses frames of anybody
@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
async def test_an_engine_that_stops_costs_its_viewers_two_seconds_and_others_nothing(
    fleet: Fleet, http: httpx.AsyncClient, number: signal.Signals
) -> None:
    hit, spared = viewers = [Viewer(fleet, asking_for(scene)) for scene in SCENES]
    async with watching(viewers):
        await each_device_has_made(http, 10)
        engine = fleet.child("engine 0")
        stopped = time.monotonic()
        engine.send_signal(number)
        await eventually(lambda: all(viewer.shown[-1] > stopped + BACK_S for viewer in viewers))
        assert gap([hit], stopped) < BACK_S
        assert gap([spared], stopped) < 1.0
        assert [(viewer.connections, viewer.failed) for viewer in viewers] == [(1, [])] * 2
        assert (await http.get("/healthz")).status_code == 200
        assert (await http.get("/scenes")).status_code == 200
        if number == signal.SIGSTOP:
            engine.send_signal(signal.SIGCONT)
        else:
            await fleet.started_again("engine 0", engine.pid)


@pytest.mark.alone  # engines must be able to make as many frames as viewers ask for
async def test_a_popular_scene_gets_both_devices(fleet: Fleet, http: httpx.AsyncClient) -> None:
    viewers = [Viewer(fleet, asking_for(SCENES[0])) for _ in range(8)]
    async with watching(viewers):
        await each_device_has_made(http, FRAMES_PER_S)
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
        r"The engine on cuda:99 did not start: .*\. It is restarted in 15 s; others replace it until then\.", line
    )
