"""Observations of a stream: its status, its announcements and its pictures."""

from __future__ import annotations

import asyncio
import io
import json
import time
from collections.abc import Callable
from typing import Any

import av

from tests.dash.conftest import Packager

PATIENCE_S = 20


async def until(condition: Callable[[dict[str, Any]], bool], packager: Packager, session: dict[str, Any]) -> None:
    """Wait until a session's status is as wanted."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition(status := await packager.status(session)):
        assert time.monotonic() < deadline, status
        await asyncio.sleep(0.01)


async def until_idle(packager: Packager) -> None:
    """Until every stream has ended."""
    deadline = time.monotonic() + PATIENCE_S
    while packager.sessions.all():
        assert time.monotonic() < deadline
        await asyncio.sleep(0.01)


async def told(socket_: Any, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The first announcement that meets a condition."""
    async with asyncio.timeout(PATIENCE_S):
        while not wanted(message := json.loads(await socket_.recv())):
            pass
    found: dict[str, Any] = message
    return found


async def brightness(
    packager: Packager, session: dict[str, Any], number: int, representation: str = "r3-500"
) -> dict[int, int]:
    """The grey of each frame of a segment, by the frame's number."""
    base = f"/sessions/{session['id']}/{representation}"
    data = (await packager.http.get(f"{base}/init.mp4")).content + (
        await packager.http.get(f"{base}/{number}.m4s")
    ).content
    with av.open(io.BytesIO(data), "r") as container:
        return {
            round(float(frame.time or 0) * 30): round(float(frame.to_ndarray()[: frame.height].mean()))
            for frame in container.decode(video=0)
        }
