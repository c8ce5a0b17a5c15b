"""The packager in front of the real render service: its frame rate, the delay of its chunks, and its memory.

    python -m benchmarks.dash [--seconds 60] [--width 640] [--height 360]

A viewer looks around in the demo scene; the best representation of the stream is read like a player does. A chunk's
delay is the time from its tick (its media time on the wall clock) until its last byte was read here. The baseline, in
the same run, is FFmpeg's own muxer for fragmented MP4 (`frag_every_frame`), which outputs a frame when it gets the next
one. Memory is that of the packager's process: over the session, and after opening and dropping ten more, sixteen times:
the first ones leave memory in the allocator for the next, the last ones must add none.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import socket
import statistics
import struct
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import av
import httpx
import psutil
from websockets.asyncio.client import connect

from benchmarks.load import server
from benchmarks.services import free_ports, started

RATE = 30
WARM_UP_S = 10
ROUNDS = 16
LIMIT_MB = 5


def session_request(width: int, height: int) -> dict[str, Any]:
    """The demo scene from its door, in the packager's default representations."""
    view = {"fx": width / 2, "fy": width / 2, "cx": width / 2, "cy": height / 2, "width": width, "height": height}
    pose = {"position": [0, -1.75, -6], "quaternion": [0, 0, 0, 1]}
    return {"scene": "courtyard", **pose, **view, "frame_rate": RATE}


@asynccontextmanager
async def walking(port: int, session: dict[str, Any]) -> AsyncIterator[None]:
    """A viewer that looks around at 60 poses per second, as a context manager."""

    async def walk() -> None:
        async with connect(f"ws://127.0.0.1:{port}{session['poses']}") as socket:
            for seq in range(1, 2**31):
                half = seq / 60 * math.radians(20) / 2
                turned = {"position": [0, -1.75, -6], "quaternion": [0, math.sin(half), 0, math.cos(half)]}
                await socket.send(json.dumps({"seq": seq, **turned}))
                while True:
                    try:
                        await asyncio.wait_for(socket.recv(), 1 / 60)
                    except TimeoutError:
                        break

    task = asyncio.create_task(walk())
    try:
        yield
    finally:
        task.cancel()


async def chunk_delays(http: httpx.AsyncClient, session: dict[str, Any], seconds: float) -> list[float]:
    """Milliseconds from each chunk's tick until it was read, in the best representation."""
    mpd = ET.fromstring((await http.get(session["manifest"])).content)
    started = datetime.fromisoformat(mpd.attrib["availabilityStartTime"])
    one, *_ = session["representations"]
    now = datetime.fromisoformat((await http.get("/time")).text)
    ahead = now - datetime.now(UTC)
    number = int((now - started).total_seconds() / session["segment_s"]) + 1
    delays, until = [], time.monotonic() + seconds
    while time.monotonic() < until:
        rest = b""
        async with http.stream("GET", f"/sessions/{session['id']}/{one['id']}/{number}.m4s") as answer:
            async for part in answer.aiter_raw():
                read = datetime.now(UTC) + ahead
                rest += part
                while len(rest) >= 8 and len(rest) >= (size := struct.unpack_from(">I", rest)[0]):
                    if rest[4:8] == b"prft":
                        (units,) = struct.unpack_from(">Q", rest, 24)
                    if rest[4:8] == b"mdat":
                        tick = (started - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() + units / (RATE * 1000)
                        delays.append(1000 * (read.timestamp() - tick))
                    rest = rest[size:]
        number += 1
    return delays


def muxer_delays(width: int, height: int, frames: int) -> list[float]:
    """Milliseconds from each frame until FFmpeg's muxer has given out the last byte of it, at the same pace."""
    given: list[float] = []

    class Sink:
        def write(self, data: bytes) -> int:
            given.append(time.monotonic())
            return len(data)

    options = {"movflags": "frag_every_frame+empty_moov+default_base_moof", "flush_packets": "1"}
    container = av.open(Sink(), "w", format="mp4", options=options)
    stream = container.add_stream("libx264", rate=RATE, options={"preset": "ultrafast", "tune": "zerolatency"})
    stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
    asked, delays, began = [], [], time.monotonic()
    for number in range(frames):
        time.sleep(max(0, began + number / RATE - time.monotonic()))
        frame = av.VideoFrame(width, height, "yuv420p")
        frame.pts = number
        asked.append(time.monotonic())
        before = len(given)
        for packet in stream.encode(frame):
            container.mux(packet)
        if number > 1 and len(given) > before:
            delays.append(1000 * (given[-1] - asked[number - 1]))  # the output is the previous frame
    container.close()
    return delays


def show(name: str, delays: list[float]) -> None:
    """One row of the table."""
    cuts = statistics.quantiles(delays, n=20)
    print(f"{name:44} {statistics.median(delays):8.1f} {cuts[-1]:8.1f}   ms")


async def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--width", type=int, default=640, choices=(1280, 960, 640, 320))
    parser.add_argument("--height", type=int, default=360)
    arguments = parser.parse_args()
    (port,) = free_ports(socket.SOCK_STREAM)
    settings = {"TIGAS_DASH_IDLE_S": "2", "TIGAS_DASH_ENCODER": "libx264", "TIGAS_DASH_MAX_SESSIONS": "20"}
    with (
        server.started("render", ()) as render,
        tempfile.NamedTemporaryFile() as log,
        started(
            "dash", "--http", f"127.0.0.1:{port}", "--render", render.url, log=Path(log.name), **settings
        ) as packager,
    ):
        packager.wait_until_healthy(port)
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=60) as http:
            memory = psutil.Process(packager.process.pid)
            wanted = session_request(arguments.width, arguments.height)
            session = (await http.post("/sessions", json=wanted)).json()
            async with walking(port, session):
                await chunk_delays(http, session, WARM_UP_S)
                before = (await http.get(f"/sessions/{session['id']}")).json()
                started_with = memory.memory_info().rss / 1e6
                delays = await chunk_delays(http, session, arguments.seconds)
                after = (await http.get(f"/sessions/{session['id']}")).json()
                ended_with = memory.memory_info().rss / 1e6
            await http.delete(f"/sessions/{session['id']}")

            left = [(memory.memory_info().rss / 1e6, memory.num_threads())]
            for _ in range(ROUNDS):
                for _ in range(10):
                    (await http.post("/sessions", json=wanted)).raise_for_status()
                async with asyncio.timeout(60):
                    while (await http.get("/sessions")).json():  # noqa: ASYNC110 - the service sends no events
                        await asyncio.sleep(0.2)
                left.append((memory.memory_info().rss / 1e6, memory.num_threads()))
    frames = after["frames"] - before["frames"]
    offered = ", ".join(one["id"] for one in session["representations"])
    print(
        f"{arguments.width}×{arguments.height} as {offered}: {frames / arguments.seconds:.1f} frames/s in the stream;"
    )
    for name in ("repeated", "dropped"):
        print(f"  {name:9} {100 * (after[name] - before[name]) / frames:5.1f} %")
    print(f"\n{'delay':44} {'p50':>8} {'p95':>8}")
    show("tick → rendered, encoded, read by the player", delays)
    baseline = muxer_delays(arguments.width, arguments.height, 90)
    show("FFmpeg's muxer alone, frag_every_frame", baseline)
    print(f"the whole way takes {statistics.median(delays) / statistics.median(baseline):.2f}× as long as that muxer\n")
    print(f"resident memory over {arguments.seconds:.0f} s: {started_with:.1f} → {ended_with:.1f} MB")
    rounds = ", ".join(f"{megabytes:.0f}" for megabytes, _ in left)
    print(f"then, each time after ten sessions at once were opened and dropped: {rounds} MB")
    print(f"threads: {left[0][1]} → {left[-1][1]}")
    return int(max(ended_with - started_with, left[-1][0] - left[3 * ROUNDS // 4][0]) > LIMIT_MB)


if __name__ == "__main__":
    sys.exit(asyncio.run(main()))
