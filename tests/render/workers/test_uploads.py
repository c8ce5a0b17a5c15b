"""Scenes appear and disappear in a service of several processes, over any connection."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest

from tests.render.scenes import plys
from tests.render.uploads.client import TUS, begin, part
from tests.render.workers.fleet import serving

pytestmark = [pytest.mark.anyio, pytest.mark.slow]


@pytest.mark.extended
async def test_any_process_takes_any_part_and_all_know_the_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = plys.binary_ply(2_000)
    monkeypatch.setenv("TIGAS_RENDER_SCENES", str(tmp_path))
    with serving(edges=2, device="instant:5000,instant:5000") as fleet:

        def client() -> httpx.AsyncClient:
            """A client with separate connections, assigned to edges by the system."""
            return httpx.AsyncClient(base_url=fleet.url, timeout=60)

        async with client() as first:
            at = "/" + (await first.post("/uploads", headers=begin("hall.ply", len(content)))).headers["location"]
        for offset in range(0, len(content), 50_000):
            async with client() as other:
                sent = await other.patch(at, headers=part(offset), content=content[offset : offset + 50_000])
                assert sent.status_code == 204, sent.text
        async with client() as last:
            assert (await last.head(at, headers=TUS)).headers["upload-offset"] == str(len(content))
            assert (await last.post(f"{at}/scene")).status_code == 201
            foreign = await last.patch(at, headers={**part(0), "Origin": "https://evil.example"}, content=b"x")
            assert foreign.status_code == 403
            # each engine answers with facts that the other may lack
            assert [scene["id"] for scene in (await last.get("/scenes")).json()] == ["courtyard", "hall"]
            assert (await last.post("/scenes/hall/rename", json={"name": "foyer"})).json()["id"] == "foyer"
            view = {"camera": {"position": [0, 0, -9], "look_at": [0, 0, 0]}, "up": [0, 0, 1]}
            assert (await last.patch("/scenes/foyer", json=view)).json()["up"] == [0, 0, 1]
            assert (await last.post("/scenes/foyer/load")).json()["state"] == "loaded"
            assert (await last.delete("/scenes/foyer")).status_code == 204
            assert [scene["id"] for scene in (await last.get("/scenes")).json()] == ["courtyard"]
