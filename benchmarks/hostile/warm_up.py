"""Exercises each service once before it is measured: memory left by the first use is no harm of an attack."""

from __future__ import annotations

import time
from collections.abc import Iterable

import httpx

from benchmarks.hostile.client import request
from benchmarks.hostile.services import Name, Ports

STREAMS, STREAM_S = 4, 3.0
"""As many streams as the packager allows, and how long they run."""
LINK = ("at", "position_ms", "target_kbps", "delivered_kbps", "queue_ms", "drops", "up_delivered_kbps")
LINKS = 8_000
"""A megabyte of them."""
STREAM = {**request(1280, 720), "frame_rate": 30}


def warm_up(services: Iterable[Name], ports: Ports) -> None:
    """Use these services; the render service is used by the viewer."""
    for name in services:
        with httpx.Client(base_url=f"http://127.0.0.1:{getattr(ports, name)}", trust_env=False, timeout=60) as http:
            if name == "dash":
                _streams(http)
            elif name == "store":
                _upload(http)


def _streams(http: httpx.Client) -> None:
    opened = [http.post("/sessions", json=STREAM).raise_for_status().json()["id"] for _ in range(STREAMS)]
    time.sleep(STREAM_S)
    for session in opened:
        http.delete(f"/sessions/{session}").raise_for_status()


def _upload(http: httpx.Client) -> None:
    """An upload of usual size that is refused: it has started the checking process."""
    made = http.post("/experiments", json={"name": "warm-up", "plan": {"seed": 1}}).raise_for_status().json()["id"]
    run = {"link": [dict.fromkeys(LINK, 1.0)] * LINKS}
    assert http.post(f"/experiments/{made}/runs", json=run).status_code == 400
