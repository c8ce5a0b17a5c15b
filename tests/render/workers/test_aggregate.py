"""Combined answers of several engines."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.eventually import eventually
from tests.visitor import Visitor
from tigas_common.origins import OriginPolicy
from tigas_common.wire.render import SceneInfo, Training
from tigas_render.pipe.engines import EnginePool
from tigas_render.workers import aggregate
from tigas_render.workers.aggregate import (
    MAX_CHANGES_PER_ADDRESS,
    MAX_REQUESTS_PER_ADDRESS,
    EngineAggregator,
    EngineProxy,
)


def info(id: str = "garden", **changes: Any) -> SceneInfo:
    known: dict[str, Any] = {
        "id": id,
        "name": id,
        "state": "unloaded",
        "error": None,
        "gaussians": None,
        "sh_degree": None,
        "file_bytes": 1,
        "memory_bytes": 0,
        "preview": "",
        "up": (0, -1, 0),
        "camera": None,
        "background": (0, 0, 0),
    }
    return SceneInfo(**known | changes)


def bodies(*models: SceneInfo | Training) -> dict[str, bytes]:
    return {f"device {number}": model.model_dump_json().encode() for number, model in enumerate(models)}


def test_a_scene_is_loaded_if_it_is_anywhere_and_what_any_knows_is_known() -> None:
    one = info(state="loaded", gaussians=7, memory_bytes=100, file_sha256="ab")
    other = info(state="loading", memory_bytes=0, sh_degree=3)
    for given in (bodies(one, other), bodies(other, one)):
        assert SceneInfo.model_validate_json(aggregate.merge_scene(given)) == one.model_copy(update={"sh_degree": 3})
    both = SceneInfo.model_validate_json(aggregate.merge_scene(bodies(one, one)))
    assert both.memory_bytes == 200


def test_a_scene_is_broken_only_if_no_device_can_have_it() -> None:
    broken = info(state="broken", error="It is broken.")
    assert SceneInfo.model_validate_json(aggregate.merge_scene(bodies(broken, info()))) == info()
    assert SceneInfo.model_validate_json(aggregate.merge_scene(bodies(broken, broken))) == broken


def test_scenes_that_only_one_engine_has_found_are_listed_too() -> None:
    of = {"x": [info("a"), info("c")], "y": [info("b"), info("a", state="loaded")]}
    given = {name: json.dumps([each.model_dump() for each in infos]).encode() for name, infos in of.items()}
    listed = [(each["id"], each["state"]) for each in json.loads(aggregate.merge_scenes(given))]
    assert listed == [("a", "loaded"), ("b", "unloaded"), ("c", "unloaded")]


@pytest.mark.parametrize(
    ("one", "other", "together"),
    [("idle", "running", "running"), ("done", "idle", "done"), ("failed", "idle", "failed"), ("idle", "idle", "idle")],
)
def test_a_training_is_that_of_the_engine_that_knows_of_one(one: Any, other: Any, together: str) -> None:
    merged = aggregate.merge_training(bodies(Training(state=one), Training(state=other)))
    assert json.loads(merged)["state"] == together
    assert aggregate.is_training(merged) == (together == "running")


def test_metrics_of_engines_have_a_device_and_those_of_edges_are_there_once() -> None:
    text = """# HELP tigas_render_requests_total Render requests
# TYPE tigas_render_requests_total counter
tigas_render_requests_total{outcome="frame"} 3.0
# HELP tigas_render_frame_seconds Time
# TYPE tigas_render_frame_seconds histogram
tigas_render_frame_seconds_bucket{le="+Inf",stage="queue"} 3.0
tigas_render_frame_seconds_count{stage="queue"} 3.0
tigas_render_frame_seconds_sum{stage="queue"} 0.5
# HELP tigas_render_viewers Viewers
# TYPE tigas_render_viewers gauge
tigas_render_viewers{edge="0"} 2.0
"""
    merged = aggregate.merge_metrics({"a": text.encode(), "b": text.encode()}, []).decode()
    for device in "ab":
        assert f'tigas_render_requests_total{{device="{device}",outcome="frame"}} 3.0' in merged
        assert f'tigas_render_frame_seconds_bucket{{device="{device}",le="+Inf",stage="queue"}} 3.0' in merged
    assert merged.count("tigas_render_viewers{") == 1
    assert merged.count("# TYPE tigas_render_frame_seconds histogram") == 1


class FakeEngine:
    """An engine's HTTP interface: it answers any request with `[]`, once it may."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.asked: list[str] = []
        self.connections = 0
        self.may_answer = asyncio.Event()

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[EngineProxy]:
        proxy = EngineProxy(self.path, OriginPolicy())
        async with await asyncio.start_unix_server(self._serve, self.path):
            yield proxy
            await proxy.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        try:
            while request := (await reader.readline()).decode():
                await reader.readuntil(b"\r\n\r\n")
                self.asked.append(request.removesuffix(" HTTP/1.1\r\n"))
                end, may = asyncio.create_task(reader.read(1)), asyncio.create_task(self.may_answer.wait())
                await asyncio.wait((end, may), return_when=asyncio.FIRST_COMPLETED)
                if end.done():
                    return
                writer.write(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\nConnection: close\r\n\r\n[]")
                end.cancel()
                return
        finally:
            self.connections -= 1
            writer.close()


async def leave(visitors: Sequence[Visitor]) -> None:
    for visitor in visitors:
        visitor.left.set()
    await eventually(lambda: all(visitor.asking.done() for visitor in visitors))


@pytest.mark.anyio
async def test_one_address_does_not_take_all_requests_and_one_that_leaves_frees_its_own(tmp_path: Path) -> None:
    engine = FakeEngine(tmp_path / "engine")
    async with engine.serving() as proxy:
        first = [Visitor(proxy, "POST", "/scenes/garden/load") for _ in range(MAX_REQUESTS_PER_ADDRESS)]
        await eventually(lambda: engine.connections == MAX_REQUESTS_PER_ADDRESS)
        further = Visitor(proxy, "POST", "/scenes/garden/load")
        await further.asking
        assert further.status == 503
        assert aggregate.BUSY.encode() in further.got[1]["body"]
        other = Visitor(proxy, "POST", "/scenes/garden/load", "192.0.2.2")
        await eventually(lambda: engine.connections == MAX_REQUESTS_PER_ADDRESS + 1)
        await leave(first)
        assert [visitor.got for visitor in first] == [[]] * len(first)
        await eventually(lambda: engine.connections == 1)
        engine.may_answer.set()
        await other.asking
        assert other.status == 200


@pytest.mark.anyio
async def test_a_change_reaches_all_engines_although_its_client_has_left(tmp_path: Path) -> None:
    one, other = engines = [FakeEngine(tmp_path / name) for name in ("one", "other")]
    frames = EnginePool({engine.path.name: engine.path for engine in engines}, 0, lambda *_: None, lambda: 0.0)
    other.may_answer.set()
    async with one.serving() as first, other.serving() as second:
        app = EngineAggregator(frames, {"one": first, "other": second}, OriginPolicy())
        visitor = Visitor(app, "DELETE", "/scenes/garden")
        await eventually(lambda: one.asked)
        await leave([visitor])
        one.may_answer.set()
        await eventually(lambda: not app._change_limit._running)
    assert (one.asked, other.asked) == (["DELETE /scenes/garden", "GET /scenes?scan=1"], ["GET /scenes?scan=1"])


@pytest.mark.anyio
async def test_changes_whose_clients_have_left_do_not_take_all_connections(tmp_path: Path) -> None:
    engine = FakeEngine(tmp_path / "one")
    frames = EnginePool({"one": engine.path}, 0, lambda *_: None, lambda: 0.0)
    async with engine.serving() as proxy:
        app = EngineAggregator(frames, {"one": proxy}, OriginPolicy())
        for _ in range(3):
            visitors = [Visitor(app, "DELETE", "/scenes/garden") for _ in range(20)]
            await asyncio.wait([visitor.asking for visitor in visitors[MAX_CHANGES_PER_ADDRESS:]])
            await leave(visitors)
        await eventually(lambda: engine.connections == MAX_CHANGES_PER_ADDRESS)
        engine.may_answer.set()
        await eventually(lambda: not app._change_limit._running)
        assert engine.asked.count("GET /scenes?scan=1") == MAX_CHANGES_PER_ADDRESS
