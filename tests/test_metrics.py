"""Metrics of every service."""

from __future__ import annotations

import platform
import re
from importlib.metadata import version
from pathlib import Path

import anyio
import pytest

from tests.every_service import SERVICES, client_of
from tests.prerequisites import PROMTOOL
from tests.prometheus import figures
from tests.render.fakes import render_request
from tigas_common.metrics import MAX_SCENES, OTHER, SceneNames

pytestmark = pytest.mark.anyio
DOCS = (Path(__file__).parents[1] / "docs/deploy.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", SERVICES)
async def test_a_service_tells_its_build_its_process_and_its_requests_as_documented(name: str, tmp_path: Path) -> None:
    async with client_of(name, tmp_path) as http:
        health = await http.get("/healthz")
        await http.get("/healthz", headers={"Origin": "https://evil.example"})
        told = await figures(http)
    build = {"service": name, "version": version("tigas"), "python": platform.python_version()}
    assert told("tigas_build_info", **build) == 1
    assert told.labels("tigas_build_info") == {*build, "commit"}
    assert told("process_resident_memory_bytes") > 1e6
    assert told("process_cpu_seconds_total") > 0
    status = str(health.status_code)
    assert told("tigas_http_requests_total", route="/healthz", method="GET", status=status) == 1
    assert told("tigas_http_requests_total", route="other", status="403") == 1, "a refusal does not count"
    assert told("tigas_http_response_seconds_count", route="/healthz") == 1
    assert told("tigas_http_requests_in_flight") == 1, "not this very request"
    assert not [family for family in told.families if family.endswith("_created")]
    documented = set(re.findall(r"`((?:tigas|process)_\w+)`", DOCS))
    assert {re.sub("_(bucket|count|sum)$", "", name) for name in told.names} <= documented


@pytest.mark.parametrize("name", SERVICES)
async def test_nothing_that_a_request_says_becomes_a_label(name: str, tmp_path: Path) -> None:
    async with client_of(name, tmp_path) as http:
        for method, path in (
            ("GET", "/hostile"),
            ("HOSTILE", "/healthz"),
            ("GET", "/scenes/hostile"),
            ("POST", "/scenes/hostile/load"),
            ("POST", "/sessions"),
            ("GET", "/sessions/hostile"),
            ("GET", "/experiments/hostile"),
            ("POST", "/start"),
            ("GET", "/config.json?scene=hostile&at=hostile"),
        ):
            headers = {"Origin": "http://localhost", "Tigas-Viewer": "hostile"}
            await http.request(method, path, json={"scene": "hostile", "trace": "hostile"}, headers=headers)
        asked = render_request(scene="hostile").model_dump(mode="json", exclude_none=True)
        await http.post("/render", json=asked)
        told = await figures(http)
    assert "hostile" not in told.text.lower()
    assert told("tigas_http_requests_total", method="other", route="/healthz") == 1


@PROMTOOL.mark
@pytest.mark.parametrize("name", SERVICES)
async def test_names_follow_prometheus_conventions(name: str, tmp_path: Path) -> None:
    async with client_of(name, tmp_path) as http:
        told = await figures(http)
    lint = await anyio.run_process(["promtool", "check", "metrics"], input=told.text.encode(), check=False)
    assert (lint.returncode, lint.stdout + lint.stderr) == (0, b"")


async def test_the_first_scenes_keep_their_names_and_the_rest_share_one() -> None:
    names = SceneNames()
    scenes = [f"scene {number}" for number in range(MAX_SCENES + 50)]
    first = [names.label(scene) for scene in scenes]
    assert first == [*scenes[:MAX_SCENES], *[OTHER] * 50]
    assert [names.label(scene) for scene in scenes] == first
