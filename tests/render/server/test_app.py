"""The HTTP interface over the real engine and rasteriser, through a real client."""

from __future__ import annotations

import asyncio
import hashlib
import io
import json
import sys
import threading
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from PIL import Image

from reference.ply import write_ply
from tests.common.test_weights import NETWORK, made
from tests.prometheus import figures
from tests.render.arrays import gaussians_of
from tests.render.fakes import FakeRasterizer, render_request
from tests.render.scenes import plys
from tigas_common.errors import DeviceLost
from tigas_common.installation import install_command
from tigas_common.weights import FILE, write_weights
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.raster.base import PreparedScene
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.raster.devices import create_rasterizer
from tigas_render.scenes import coarse, scene_file
from tigas_render.server.app import create_app
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings

pytestmark = pytest.mark.anyio


def red_wall() -> Gaussians:
    """One large red Gaussian, three units in front of the origin."""
    return gaussians_of(
        means=[[0.0, 0.0, 3.0]],
        scales=[[5.0, 5.0, 5.0]],
        quaternions=[[1.0, 0.0, 0.0, 0.0]],
        opacities=[0.999],
        sh=[[[1.7, -1.7, -1.7]]],
    )


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A models directory with a good scene and a broken one."""
    directory = tmp_path_factory.mktemp("models")
    for name in ("wall", "broken"):
        (directory / name).mkdir()
    write_ply(directory / "wall" / "wall.ply", red_wall())
    (directory / "wall" / "scene.json").write_text(
        json.dumps({"name": "A wall", "camera": {"position": [0, 0, 0], "look_at": [0, 0, 3]}, "background": [0, 0, 1]})
    )
    big_endian = b"ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float x\nend_header\n1234"
    (directory / "broken" / "broken.ply").write_bytes(big_endian)
    return directory


@pytest.fixture
async def client(models: Path, tmp_path: Path) -> AsyncIterator[httpx.AsyncClient]:
    services = {"near": ":99", "far": "https://example.org/"}
    settings = RenderSettings(scenes=models, cache=tmp_path / "cache", services=services)
    async with RenderService.open(settings, create_rasterizer("cpu")) as service, asking(service) as client:
        yield client


def asking(service: RenderService) -> httpx.AsyncClient:
    transport = httpx.ASGITransport(create_app(service), raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url="http://localhost:8080")


def frame(**changes: Any) -> dict[str, Any]:
    return render_request(scene="wall", **changes).model_dump(mode="json", exclude_none=True)


AWAY: dict[str, Any] = {"position": (0, 0, 0), "quaternion": (0, 1, 0, 0)} | dict.fromkeys(
    ("azimuth", "elevation", "translation")
)
"""The wall is behind this camera."""
MARGINS = "margin_x=32, margin_y=18"


@pytest.mark.parametrize(
    ("changes", "about", "size", "is_red"),
    [
        ({"seq": 41}, "seq=41, width=320, height=180, profile=3", (320, 180), True),
        ({"overscan": 0.1}, f"seq=0, width=384, height=216, {MARGINS}, profile=3", (384, 216), True),
        ({"format": "webp", "profile": None}, "seq=0, width=320, height=180", (320, 180), True),
        ({"format": "png"} | AWAY, "seq=0, width=320, height=180, profile=3", (320, 180), False),
    ],
)
async def test_a_frame_comes_with_what_the_protocol_promises(
    client: httpx.AsyncClient, changes: dict[str, Any], about: str, size: tuple[int, int], is_red: bool
) -> None:
    response = await client.post("/render", json=frame(**changes))
    assert response.status_code == 200
    assert response.headers["content-type"] == f"image/{changes.get('format', 'jpeg')}"
    assert response.headers["content-length"] == str(len(response.content))
    assert response.headers["cache-control"] == "no-store"
    assert response.headers["timing-allow-origin"] == "*"
    assert response.headers["tigas-frame"] == about
    stages = [part.split(";dur=") for part in response.headers["server-timing"].split(", ")]
    assert [name for name, _ in stages] == ["queue", "render", "encode"]
    assert all(float(duration) >= 0 for _, duration in stages)
    picture = Image.open(io.BytesIO(response.content)).convert("RGB")
    assert picture.size == size
    red, green, blue = picture.getpixel((160, 90))  # type: ignore[misc]
    assert (red > 200, green > 60, blue > 200) == (is_red, False, not is_red)


@pytest.mark.parametrize(
    ("changes", "status", "kind"),
    [
        ({"scene": "nowhere"}, 404, "unknown-scene"),
        ({"scene": "../wall"}, 404, "unknown-scene"),
        ({"scene": "wall\0"}, 404, "unknown-scene"),
        ({"scene": "/etc/passwd"}, 404, "unknown-scene"),
        ({"scene": "broken"}, 422, "broken-scene"),
        ({"profile": 9}, 400, "invalid-request"),
        ({"fx": 0}, 400, "invalid-request"),
        ({"width": 100_000, "height": 100_000}, 400, "invalid-request"),
        ({"overscan": -0.01}, 400, "invalid-request"),
        ({"overscan": 0.51}, 400, "invalid-request"),
        ({"overscan": "0.1"}, 400, "invalid-request"),
        ({"overscan": 0.5, "profile": None, "width": 4096, "height": 4096}, 400, "invalid-request"),
        ({"depth": 1}, 400, "invalid-request"),
        ({"extra": 1}, 400, "invalid-request"),
        ({"format": "h264", "video": {"bitrate_kbps": 1000}}, 400, "invalid-request"),  # over WebTransport alone
    ],
)
async def test_a_request_that_cannot_be_served_gets_a_problem(
    client: httpx.AsyncClient, changes: dict[str, Any], status: int, kind: str
) -> None:
    response = await client.post("/render", json=frame() | changes)
    assert response.headers["content-type"] == "application/problem+json"
    problem = response.json()
    assert (response.status_code, problem["status"], problem["type"]) == (status, status, f"tigas:{kind}")
    assert problem["detail"].endswith(".")
    assert (await client.post("/render", json=frame())).status_code == 200


async def test_hostile_bodies_and_paths(client: httpx.AsyncClient) -> None:
    assert (await client.post("/render", content=b"x" * 20_000)).status_code == 413
    assert (await client.post("/render", content=b'{"fx": NaN')).status_code == 400
    for overscan in (b"NaN", b"Infinity", b"1e999", b"null"):
        body = json.dumps(frame()).encode().replace(b'"overscan": 0.0', b'"overscan": ' + overscan)
        assert (await client.post("/render", content=body)).status_code == 400, overscan
    assert (await client.get("/render")).status_code == 405
    for path in ("/nothing", "/scenes/..%2f..%2fetc", "/scenes/%00", "/static/../app.py", "/..%2fapp.py"):
        response = await client.get(path)
        assert response.status_code == 404, path
        assert response.json()["type"] in ("tigas:not-found", "tigas:unknown-scene")


@pytest.mark.parametrize(
    "changes",
    [
        {"fx": 1e-3, "fy": 1e6},
        {"cx": 1e6, "cy": -1e6},
        {"translation": (1e9, -1e9, 1e9)},
        {"azimuth": 1e6, "elevation": -1e6, "roll": 1e6},
        {"width": 1, "height": 1, "profile": None},
        {"width": 8192, "height": 1},
    ],
)
async def test_extreme_but_valid_views_are_frames(client: httpx.AsyncClient, changes: dict[str, Any]) -> None:
    assert (await client.post("/render", json=frame(**changes))).status_code == 200


async def test_scenes_are_listed_loaded_viewed_and_unloaded(client: httpx.AsyncClient) -> None:
    scenes = {scene["id"]: scene for scene in (await client.get("/scenes")).json()}
    assert scenes["wall"] | {"name": "A wall", "gaussians": 1, "state": "unloaded", "memory_bytes": 0} == scenes["wall"]
    assert scenes["broken"]["state"] == "broken"
    assert "big-endian" in scenes["broken"]["error"]
    loaded = (await client.post("/scenes/wall/load")).json()
    assert loaded["state"] == "loaded"
    assert loaded["memory_bytes"] > 0
    assert loaded["camera"] == {"position": [0, 0, 0], "look_at": [0, 0, 3]}
    assert (await client.post("/scenes/wall/unload")).json()["state"] == "unloaded"
    assert (await client.get("/scenes/wall")).json()["state"] == "unloaded"
    assert (await client.post("/scenes/nowhere/load")).status_code == 404
    assert (await client.post("/scenes/broken/load")).status_code == 422
    assert (await client.post("/render", json=frame())).status_code == 200
    refused = await client.post("/scenes/wall/unload")
    assert (refused.status_code, refused.json()["type"]) == (409, "tigas:scene-in-use")
    assert (await client.get("/scenes/wall")).json()["state"] == "loaded"


async def test_a_large_scene_has_coarse_frames_while_it_loads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coarse, "MIN_GAUSSIANS", 400)
    monkeypatch.setattr(scene_file, "SAMPLE", 100)
    write_ply(plys.write(tmp_path / "models" / "large.ply", b""), plys.gaussians(400))
    rasterizer, gate = CpuRasterizer(), threading.Event()

    def pack(scene: Batches) -> PreparedScene:
        assert scene.most < 400 or gate.wait(10)
        return CpuRasterizer.pack(rasterizer, scene)

    monkeypatch.setattr(rasterizer, "pack", pack)
    settings = RenderSettings(scenes=tmp_path / "models", cache=tmp_path / "cache")
    async with RenderService.open(settings, rasterizer) as service, asking(service) as client:

        async def ask(**changes: Any) -> str:
            request = render_request(scene="large", **changes).model_dump(mode="json", exclude_none=True)
            answer = await client.post("/render", json=request, headers={"Tigas-Viewer": str(changes)})
            about: str = answer.headers["tigas-frame"]
            return about

        assert (await client.post("/scenes/large/load?coarse=1")).json()["state"] == "loading"
        assert "coarse=1" in await ask(coarse=True)
        waiting = [asyncio.create_task(ask(**each)) for each in ({}, {"coarse": True, "format": "png"})]
        loading = asyncio.create_task(client.post("/scenes/large/load"))
        assert "coarse=1" in await ask(coarse=True)
        assert not any(task.done() for task in (*waiting, loading))
        gate.set()
        assert not any("coarse" in about for about in await asyncio.gather(*waiting))
        assert (await loading).json()["state"] == "loaded"
        assert "coarse" not in await ask(coarse=True)


async def test_a_scene_added_later_is_found_on_request(client: httpx.AsyncClient, models: Path) -> None:
    (models / "late").mkdir()
    write_ply(models / "late" / "late.ply", red_wall())
    assert (await client.get("/scenes/late")).status_code == 404
    assert "late" in [scene["id"] for scene in (await client.get("/scenes?scan=1")).json()]


async def test_a_missing_preview_is_rendered(client: httpx.AsyncClient) -> None:
    response = await client.get("/scenes/wall/preview")
    assert response.headers["content-type"] == "image/jpeg"
    picture = Image.open(io.BytesIO(response.content))
    assert picture.getpixel((picture.width // 2, picture.height // 2))[0] > 200  # type: ignore[index]
    assert (await client.get("/scenes/nowhere/preview")).status_code == 404


async def test_the_page_learns_its_ladder_and_urls_and_whether_its_scene_is_there(client: httpx.AsyncClient) -> None:
    config = (await client.get("/config.json")).json()
    assert [rung["height"] for rung in config["ladder"]] == [720, 540, 360, 180]
    assert config["services"] == {"near": "http://localhost:99", "far": "https://example.org/"}
    assert config["device"] == "cpu"
    assert config["formats"] == ["jpeg", "webp"]
    assert config["webtransport_url"] is None  # this application is not served over QUIC
    assert config["has_scene"] is None
    for scene, there in (("wall", True), ("broken", True), ("attic", False), ("", False)):
        assert (await client.get("/config.json", params={"scene": scene})).json()["has_scene"] is there, scene


@pytest.mark.parametrize("call", ["POST /render", "POST /scenes/courtyard/load", "GET /scenes/courtyard/preview"])
async def test_who_asks_for_its_health_learns_that_the_device_is_lost(call: str, tmp_path: Path) -> None:
    rasterizer = FakeRasterizer()
    async with RenderService.open(RenderSettings(cache=tmp_path), rasterizer) as service, asking(service) as client:
        assert (await client.get("/healthz")).json() == {"status": "ok"}
        rasterizer.error = DeviceLost("The GPU fell off the bus.")
        assert (await client.request(*call.split(), json=frame() | {"scene": "courtyard"})).status_code == 503
        health = await client.get("/healthz")
    assert (health.status_code, health.json()["type"]) == (503, "tigas:device-lost")
    assert health.json()["detail"] == "The GPU fell off the bus."


async def test_metrics_tell_outcomes_frames_by_scene_rung_and_transport_and_memory(client: httpx.AsyncClient) -> None:
    sizes = [len((await client.post("/render", json=frame(profile=rung))).content) for rung in (3, 3, 1)]
    whole = await client.post("/render", json=frame(profile=None))
    await client.get("/scenes/wall/preview")
    await client.post("/render", json=frame() | {"scene": "nowhere"})
    told = await figures(client)
    by_http = {"scene": "wall", "transport": "http1"}
    assert told("tigas_render_frames_total", rung="3", **by_http) == 2
    assert told("tigas_render_frame_bytes_total", rung="3", **by_http) == sum(sizes[:2])
    assert told("tigas_render_frame_bytes_total", rung="1", **by_http) == sizes[2]
    assert told("tigas_render_frame_bytes_total", rung="none", **by_http) == len(whole.content)
    assert told("tigas_render_frames_total", transport="none") == 1, "the thumbnail"
    assert told("tigas_render_frames_total") == told("tigas_render_requests_total", outcome="frame") == 5
    assert told("tigas_render_requests_total", outcome="unknown-scene") == 1
    assert told("tigas_render_frame_seconds_count", stage="render") == 5
    assert told("tigas_render_scenes", state="loaded") == told("tigas_render_scenes", state="broken") == 1
    assert 0 < told("tigas_render_scene_memory_bytes", scene="wall") < told("tigas_render_scene_memory_limit_bytes")
    assert told("tigas_render_requests_in_flight") == 0
    assert told("tigas_http_requests_total", route="/render") == 0, "counted twice"


async def test_a_scenes_networks_are_served_while_they_fit(client: httpx.AsyncClient, models: Path) -> None:
    path = "/scenes/wall/enhance.safetensors"
    digest = hashlib.sha256((models / "wall" / "wall.ply").read_bytes()).hexdigest()
    assert (await client.get(path.replace("wall", "nowhere"))).status_code == 404
    assert (await client.get(path)).json()["type"] == "tigas:no-weights"
    file = models / "wall" / FILE
    try:
        write_weights(file, made(NETWORK, scene=digest))
        answer = await client.get(path)
        assert answer.content == file.read_bytes()
        again = {"If-None-Match": answer.headers["etag"]}
        assert (await client.get(path, headers=again)).status_code == 304
        assert (await client.get("/scenes/wall")).json()["enhance"] == "scene"
        assert {s["id"]: s["enhance"] for s in (await client.get("/scenes")).json()}["wall"] == "scene"

        write_weights(file, made(NETWORK, scene="00" * 32))
        refused = await client.get(path, headers=again)
        assert refused.status_code == 422
        assert "changed since" in refused.json()["detail"]
        assert (await client.get("/scenes/wall")).json()["enhance"] != "scene"
        assert "changed since" in (await client.get("/scenes/wall/enhance")).json()["problem"]
    finally:
        file.unlink()


async def test_training_is_for_scenes_that_there_are(client: httpx.AsyncClient) -> None:
    assert (await client.get("/scenes/wall/enhance")).json()["state"] == "idle"
    for method in ("GET", "POST", "DELETE"):
        assert (await client.request(method, "/scenes/nowhere/enhance")).status_code == 404
    assert (await client.post("/scenes/broken/enhance")).status_code == 422
    assert (await client.delete("/scenes/wall/enhance")).json()["state"] == "idle"
    assert (await client.get("/config.json")).json()["why_no_training"] is None


async def test_training_needs_pytorch(models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)  # an ImportError on import
    settings = RenderSettings(scenes=models, cache=tmp_path)
    async with RenderService.open(settings, FakeRasterizer()) as service, asking(service) as client:
        said = (await client.get("/config.json")).json()["why_no_training"]
        assert f"needs PyTorch, which this server does not have: {install_command('lab')}" in said
        refused = await client.post("/scenes/wall/enhance")
        assert (refused.status_code, refused.json()["type"]) == (501, "tigas:no-training")
        assert refused.json()["detail"] == said
        assert (await client.get("/scenes/wall/enhance")).json()["state"] == "idle"
