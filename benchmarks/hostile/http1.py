"""Attacks over HTTP/1.1 and WebSocket, uploads among them."""

from __future__ import annotations

import asyncio
import gzip
import json
from functools import partial

import websockets.asyncio.client

from benchmarks.hostile.attacker import ADDRESS, Attacker, attack, head
from benchmarks.hostile.client import EXPERIMENT, RUN, request
from benchmarks.hostile.services import SCENE, Name

LOW = json.dumps(request(profile=3)).encode()
STREAM = json.dumps({**request(1280, 720), "frame_rate": 60}).encode()
MESSAGE = b'{"seq": 1, "position": [' + b"0," * 7_500_000 + b"0]}"
"""15 MB."""
SLOWLY_S = 2.0
CONNECTIONS = 2000
"""More than a process's default limit of open files."""
MEGABYTE = 1_000_000
JSON = "Content-Type: application/json"


async def slow_headers(service: Name, attacker: Attacker) -> None:
    """Two thousand connections with an endless request: a byte from time to time."""
    port = getattr(attacker.ports, service)
    start = f"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nX-Slow: ".encode()
    await attacker.dribble(port, start, b"x", SLOWLY_S)


SERVICES: tuple[Name, ...] = ("render", "dash", "store", "shaper")
for each in SERVICES:
    guests = ("page" if each == "render" else each,)
    attack(name=f"slow-headers-{each}", copies=CONNECTIONS, service=each, guests=guests)(partial(slow_headers, each))


@attack(copies=CONNECTIONS, guests=("page",))
async def slow_bodies(attacker: Attacker) -> None:
    """Two thousand requests with an endless body."""
    port = attacker.ports.render
    await attacker.dribble(port, head("POST", port, "/render", "Content-Length: 10000"), b"x", SLOWLY_S)


@attack(copies=64, guests=("page",))
async def page_flood(attacker: Attacker) -> None:
    """Frames over 64 connections of HTTP/1.1, as fast as they come."""
    await attacker.post(attacker.ports.render, "/render", LOW)


async def get_flood(path: str, attacker: Attacker) -> None:
    """A costly answer over 16 connections, again and again."""
    port = attacker.ports.render
    reader, writer = await attacker.open(port)
    try:
        while True:
            writer.write(head("GET", port, path))
            fields = await reader.readuntil(b"\r\n\r\n")
            attacker.done[f"status {int(fields.split(b' ', 2)[1])}"] += 1
            length = fields.lower().split(b"content-length: ", 1)[1].split(b"\r\n", 1)[0]
            await reader.readexactly(int(length))
    except asyncio.IncompleteReadError as error:
        raise ConnectionResetError from error
    finally:
        writer.close()


for of, path in (("openapi", "/openapi.json"), ("scan", "/scenes?scan=1"), ("metrics", "/metrics")):
    attack(name=f"{of}-flood", copies=16, guests=("page",))(partial(get_flood, path))


@attack(copies=2, guests=("page",))
async def unload_scene(attacker: Attacker) -> None:
    """The scene that the others look at is unloaded all the time."""
    await attacker.post(attacker.ports.render, f"/scenes/{SCENE}/unload", b"")
    await asyncio.sleep(0.1)


@attack(copies=4, service="dash", guests=("dash",))
async def streams_left(attacker: Attacker) -> None:
    """DASH streams that are opened, and left running."""
    await attacker.post(attacker.ports.dash, "/sessions", STREAM)
    await asyncio.sleep(0.5)


@attack(copies=4, service="dash", guests=("dash",))
async def large_messages(attacker: Attacker) -> None:
    """Messages of 15 MB to a stream's WebSocket, where a pose is some hundred bytes."""
    small = json.dumps({**request(320, 180), "frame_rate": 5}).encode()
    status, answer = await attacker.post(attacker.ports.dash, "/sessions", small)
    path = json.loads(answer)["poses"] if status == 201 else "/sessions/none/poses"
    url = f"ws://127.0.0.1:{attacker.ports.dash}{path}"
    async with websockets.asyncio.client.connect(url, local_addr=(ADDRESS, 0), compression=None, proxy=None) as socket:
        while True:
            try:
                await socket.send(MESSAGE)
                attacker.done["messages"] += 1
            except websockets.ConnectionClosed as error:
                raise ConnectionResetError from error


@attack(copies=200, service="shaper", guests=("shaper",))
async def watchers(attacker: Attacker) -> None:
    """Two hundred connections that watch the link without reading."""
    port = attacker.ports.shaper
    reader, writer = await attacker.open(port)
    try:
        writer.write(head("GET", port, "/events"))
        attacker.done[(await reader.readline()).decode().strip()] += 1
        await asyncio.sleep(20)
    finally:
        writer.close()


@attack(copies=4, service="store", guests=("store",))
async def error_bomb(attacker: Attacker) -> None:
    """A megabyte with half a million mistakes, each of which could become a separate error."""
    await upload(attacker, b'{"link": [' + b"{}," * (MEGABYTE // 3) + b"{}]}")


@attack(copies=4, service="store", guests=("store",))
async def deep_json(attacker: Attacker) -> None:
    """Ten megabytes of brackets."""
    await upload(attacker, b'{"link": ' + b"[" * (10 * MEGABYTE))


@attack(copies=16, service="store", guests=("store",))
async def large_uploads(attacker: Attacker) -> None:
    """Sixteen uploads that promise as much as a run may have, and go on for ever."""
    port = attacker.ports.store
    begin = head("PUT", port, await run(attacker), JSON, "Content-Length: 255000000") + b'{"link": ['
    await attacker.dribble(port, begin, b"{}," * 100_000, 0.2)


async def upload(attacker: Attacker, body: bytes) -> None:
    """Upload the run of a new experiment, again and again."""
    path = await run(attacker)
    while True:
        await attacker.post(attacker.ports.store, path, body, JSON, method="PUT")


async def run(attacker: Attacker) -> str:
    """The path of a new experiment's run."""
    _, answer = await attacker.post(attacker.ports.store, "/experiments", json.dumps(EXPERIMENT).encode(), JSON)
    return f"/experiments/{json.loads(answer)['id']}/runs/{RUN}"


@attack(copies=4, service="shaper", guests=("shaper",))
async def gzip_bomb(attacker: Attacker) -> None:
    """A trace of four gigabytes in four megabytes."""
    bomb = gzip.compress(bytes(64 * MEGABYTE)) * 64
    page = f"Origin: http://127.0.0.1:{attacker.ports.render}"
    while True:
        await attacker.post(attacker.ports.shaper, "/traces?name=bomb.csv.gz", bomb, page)
