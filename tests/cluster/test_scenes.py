"""Scenes of several hosts as one list."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import httpx
import pytest

from tests.cluster.hosts import FakeFleet, load
from tigas_cluster import host_proxy
from tigas_common.errors import SceneInUse, problem
from tigas_common.wire.render import SceneInfo

pytestmark = pytest.mark.anyio


def scene(id: str, state: str, memory_bytes: int = 0) -> SceneInfo:
    return SceneInfo.model_validate(
        {
            "id": id,
            "name": id.title(),
            "state": state,
            "error": None,
            "gaussians": None,
            "sh_degree": None,
            "file_bytes": 1,
            "memory_bytes": memory_bytes,
            "preview": f"/scenes/{id}/preview",
            "up": (0, -1, 0),
            "camera": None,
            "background": (0, 0, 0),
        }
    )


class Hosts(httpx.AsyncBaseTransport):
    """Have these scenes, by host; unloading is effective."""

    def __init__(self) -> None:
        self.scenes = {
            "a": [scene("garden", "loaded", 7), scene("pond", "unloaded"), scene("wood", "loading")],
            "b": [
                scene("garden", "unloaded"),
                scene("pond", "broken"),
                scene("wood", "loaded"),
                scene("new", "unloaded"),
            ],
        }
        self.silent: set[str] = set()
        self.used: set[str] = set()
        """Hosts with viewers of the scene to unload."""
        self.asked: list[tuple[str, str]] = []

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        name, path = request.url.host.partition(".")[0], request.url.raw_path.decode()
        self.asked.append((name, path))
        if name in self.silent:
            await asyncio.Event().wait()
        if request.method == "POST":
            if name in self.used:
                return httpx.Response(409, json=problem(SceneInUse("Somebody views it.")).model_dump())
            return httpx.Response(200, json=scene(path.split("/")[2], "unloaded").model_dump())
        return httpx.Response(200, json=[info.model_dump() for info in self.scenes[name]])


@pytest.fixture
def hosts() -> Hosts:
    return Hosts()


async def listed(client: httpx.AsyncClient) -> dict[str, str]:
    return {info["id"]: info["state"] for info in (await client.get("/scenes")).json()}


async def test_a_scene_is_loaded_if_it_is_anywhere(client: httpx.AsyncClient) -> None:
    assert await listed(client) == {"garden": "loaded", "pond": "unloaded", "wood": "loaded", "new": "unloaded"}
    assert (await client.get("/scenes")).json()[0]["memory_bytes"] == 7


async def test_every_host_looks_at_its_models_again(client: httpx.AsyncClient, hosts: Hosts) -> None:
    await client.get("/scenes?scan=1")
    assert hosts.asked == [("a", "/scenes?scan=1"), ("b", "/scenes?scan=1")]


async def test_a_host_that_does_not_answer_is_left_out(
    client: httpx.AsyncClient, hosts: Hosts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host_proxy, "ANSWER_S", 0.05)
    hosts.silent = {"b"}
    assert await listed(client) == {"garden": "loaded", "pond": "unloaded", "wood": "loading"}
    hosts.silent = {"a", "b"}
    assert (await client.get("/scenes")).status_code == 503


async def test_a_scene_is_unloaded_wherever_it_is_loaded(
    client: httpx.AsyncClient, hosts: Hosts, fleet: FakeFleet
) -> None:
    fleet.states = [
        replace(state, load=load(scenes=loaded))
        for state, loaded in zip(fleet.states, [("gar den", "wood"), ("gar den",)], strict=True)
    ]
    assert (await client.post("/scenes/gar%20den/unload")).json()["state"] == "unloaded"
    assert hosts.asked == [("a", "/scenes/gar%20den/unload"), ("b", "/scenes/gar%20den/unload")]
    hosts.asked.clear()
    assert (await client.post("/scenes/wood/unload")).status_code == 200
    assert hosts.asked == [("a", "/scenes/wood/unload")]


async def test_that_a_host_keeps_a_scene_in_use_is_said(
    client: httpx.AsyncClient, hosts: Hosts, fleet: FakeFleet
) -> None:
    fleet.states = [replace(state, load=load(scenes=("garden",))) for state in fleet.states]
    hosts.used = {"a"}
    answer = await client.post("/scenes/garden/unload")
    assert (answer.status_code, answer.json()["detail"]) == (409, "Somebody views it.")
    fleet.states = []
    assert (await client.post("/scenes/garden/unload")).status_code == 503
