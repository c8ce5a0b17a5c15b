"""An edge's answers equal those of a single process."""

from __future__ import annotations

import re
from collections.abc import Iterator

import httpx
import pytest

from reference.ply import write_ply
from tests.prometheus import Figures
from tests.render.scenes import plys
from tests.render.uploads.client import TUS, part
from tests.render.workers.fleet import ASK, Fleet, serving

pytestmark = pytest.mark.slow

EVIL = {"Origin": "https://evil.example"}
REQUESTS: list[tuple[str, str, dict[str, str], bytes]] = [
    ("GET", "/scenes", {}, b""),
    ("GET", "/scenes?scan=1", {}, b""),
    ("POST", "/scenes/courtyard/load", {}, b""),
    ("GET", "/scenes/courtyard", {}, b""),
    ("GET", "/scenes/courtyard/preview", {}, b""),
    ("GET", "/scenes/nowhere", {}, b""),
    ("GET", "/scenes/a%2Fb%20%25?x=%20", {}, b""),
    ("GET", "/config.json", {}, b""),
    ("GET", "/config.json", {"Host": "evil.example"}, b""),
    ("GET", "/config.json", EVIL, b""),
    ("GET", "/healthz", {}, b""),
    ("GET", "/", {}, b""),
    ("GET", "/nothing/here", {}, b""),
    ("GET", "/nothing/../healthz", {}, b""),
    ("HEAD", "/scenes", {}, b""),
    ("DELETE", "/scenes", {}, b""),
    ("GET", "/render", {}, b""),
    ("POST", "/render", {}, ASK),
    ("POST", "/render", {}, b"{}"),
    ("POST", "/render", {}, b"x" * 20_000),
    ("POST", "/render", EVIL, ASK),
    ("POST", "/render", {"Host": "evil.example"}, ASK),
    ("OPTIONS", "/render", {"Origin": "http://localhost:1", "Access-Control-Request-Method": "POST"}, b""),
    ("OPTIONS", "/scenes", {"Origin": "http://localhost:1", "Access-Control-Request-Method": "GET"}, b""),
    ("GET", "/enhance/general.safetensors", {}, b""),
    ("GET", "/scenes/courtyard/enhance", {}, b""),
    ("DELETE", "/scenes/courtyard", {}, b""),
    ("DELETE", "/scenes/nowhere", EVIL, b""),
    ("PATCH", "/scenes/nowhere", {}, b"{}"),
    ("POST", "/scenes/nowhere/rename", {}, b'{"name": "a"}'),
    ("POST", "/scenes/courtyard/rename", {}, b"{}"),
    ("OPTIONS", "/uploads", {}, b""),
    ("POST", "/uploads", {}, b""),
    ("GET", "/uploads", {}, b""),
    ("PATCH", "/uploads/x", {}, b"x" * 20_000),
    ("PATCH", "/uploads/x", {**part(0), "Origin": "http://localhost:1"}, b"x" * 20_000),
    ("PATCH", "/uploads/x", {**part(0), **EVIL}, b"x"),
    ("HEAD", "/uploads/x", TUS, b""),
    ("GET", "/uploads/x", {}, b""),
    ("POST", "/uploads/x/scene", {}, b""),
    ("GET", "/scenes/cloud/download/compressed", {}, b""),
    ("HEAD", "/scenes/cloud/download/compressed", {}, b""),
    ("GET", "/scenes/cloud/download/compressed", {"Range": "bytes=100-199", "Origin": "http://localhost:1"}, b""),
    ("GET", "/scenes/cloud/download/ply", {}, b""),
    ("POST", "/scenes/courtyard/unload", {"X-Forwarded-For": "192.0.2.1"}, b""),
]


TWO = "instant:5000,instant:5000"
"""Devices."""


@pytest.fixture(scope="module", params=["instant:5000", pytest.param(TWO, marks=pytest.mark.extended)])
def both(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Fleet, Fleet]]:
    """A single process and a fleet, with one device or with two, that have a small scene and share a cache."""
    scenes = tmp_path_factory.mktemp("scenes")
    (scenes / "cloud").mkdir()
    write_ply(scenes / "cloud" / "cloud.ply", plys.gaussians(100))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TIGAS_RENDER_SCENES", str(scenes))
        patch.setenv("TIGAS_RENDER_CACHE", str(tmp_path_factory.mktemp("cache")))
        with serving(edges=1) as single, serving(edges=2, device=request.param) as fleet:
            yield single, fleet


@pytest.mark.parametrize(("method", "path", "headers", "body"), REQUESTS)
def test_answers_are_the_same(
    both: tuple[Fleet, Fleet], method: str, path: str, headers: dict[str, str], body: bytes
) -> None:
    def answer(fleet: Fleet) -> tuple[int, list[tuple[str, object]], str]:
        with httpx.Client(headers=headers, timeout=60) as client:
            response = client.request(method, fleet.url + path, content=body or None)
        varying = {"date", "server-timing"}
        kept = sorted(each for each in response.headers.multi_items() if each[0] not in varying)
        plain: list[tuple[str, object]] = [
            (name, sorted(value.split(", ")) if name == "allow" else _plain(value)) for name, value in kept
        ]
        return response.status_code, plain, _plain(response.text)

    single, fleet = both
    assert answer(fleet) == answer(single)


def test_metrics_come_from_the_engine_and_tell_of_every_edge(both: tuple[Fleet, Fleet]) -> None:
    _, fleet = both
    with httpx.Client(base_url=fleet.url, timeout=60) as viewer:
        before = Figures(viewer.get("/metrics").text)
        sizes = [len(viewer.post("/render", content=ASK).content) for _ in range(5)]
        told = Figures(viewer.get("/metrics").text)
    for name, more in (("tigas_render_frames_total", 5), ("tigas_render_frame_bytes_total", sum(sizes))):
        assert told(name, transport="http1") - before(name, transport="http1") == more
    assert told("tigas_render_requests_total", outcome="frame") == told("tigas_render_frames_total")
    assert told("tigas_build_info", service="render") == told.text.count("\nprocess_start_time_seconds"), (
        "not each engine once"
    )
    assert all(f'tigas_render_viewers{{edge="{number}"}}' in told.text for number in range(2))


def _plain(text: str) -> str:
    """Without ports, hashes and ages, which differ between any two services."""
    text = re.sub(r"(localhost|127\.0\.0\.1):[0-9]+", r"\1:PORT", text)
    return re.sub(r'("certificate_sha256":|"idle_s":)[^,}]*', r"\1X", text)
