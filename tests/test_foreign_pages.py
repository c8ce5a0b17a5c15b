"""Attempts of other web pages on the services of a visitor's machine, directly and by DNS rebinding."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.every_service import SERVICES, client_of

pytestmark = pytest.mark.anyio

PAGE = {"Origin": "http://localhost:8080"}
"""The viewer's own page."""
EVIL = {"Origin": "https://evil.example"}
NOBODY = {"Origin": "null"}
"""A page in a sandbox."""
IMAGE = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}
"""Embedded resources have no Origin."""
FRAME = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "iframe"}
REBOUND = {"Host": "evil.example:8080", "Origin": "http://evil.example:8080"}
"""Another page with a name that now resolves to this machine: DNS rebinding."""

REQUESTS = {
    "render": (
        "GET /config.json",
        "GET /scenes?scan=1",
        "GET /metrics",
        "POST /render",
        "POST /scenes/courtyard/load",
        "POST /scenes/courtyard/unload",
    ),
    "dash": ("GET /sessions", "POST /sessions", "GET /sessions/a/r0-500/1.m4s", "DELETE /sessions/a"),
    "shaper": ("GET /status", "GET /events", "GET /traces", "POST /stop", "POST /link", "POST /traces"),
    "store": (
        "GET /experiments",
        "GET /experiments/a/zip",
        "GET /movements",
        "POST /experiments",
        "POST /plans",
        "POST /experiments/a/next",
        "PUT /experiments/a/runs/b",
        "DELETE /experiments/a",
    ),
}
CASES = [(service, request) for service, requests in REQUESTS.items() for request in requests]


def attacks(method: str) -> list[tuple[Mapping[str, str], int]]:
    """Headers of other pages' requests, and the status that each is refused with."""
    embedded = [(IMAGE, 403), (FRAME, 403), ({"Host": "evil.example"}, 421)] if method == "GET" else []
    return [(EVIL, 403), (NOBODY, 403), (REBOUND, 421), *embedded]


@pytest.mark.parametrize(("service", "request_line"), CASES)
async def test_a_foreign_page_reads_changes_and_opens_nothing(service: str, request_line: str, tmp_path: Path) -> None:
    method, path = request_line.split()
    async with client_of(service, tmp_path) as http:
        for headers, status in attacks(method):
            answer = await http.request(method, path, headers=headers)
            assert answer.status_code == status, headers
            assert answer.json()["type"] == ("tigas:foreign-host" if status == 421 else "tigas:foreign-origin")
            assert "access-control-allow-origin" not in answer.headers
            preflight = dict(headers) | {"Access-Control-Request-Method": method}
            assert (await http.options(path, headers=preflight)).status_code in (403, 405, 421)


@pytest.mark.parametrize("service", SERVICES)
async def test_the_viewers_page_reads_and_every_answer_is_protected(service: str, tmp_path: Path) -> None:
    async with client_of(service, tmp_path) as http:
        for path, status in (("/healthz", 200), ("/nowhere", 404)):
            answer = await http.get(path, headers={"Origin": "http://localhost:9999"})
            assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (
                status,
                "http://localhost:9999",
            )
            assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
            assert answer.headers["cross-origin-resource-policy"] == "same-origin"
            assert answer.headers["x-content-type-options"] == "nosniff"
            assert answer.headers["referrer-policy"] == "strict-origin"
        assert (await http.get("/healthz")).status_code == 200  # a program
