"""Attacks over HTTP/1.1 and WebSocket."""

from __future__ import annotations

import asyncio
import json

import websockets.asyncio.client

from benchmarks.hostile.attacker import ADDRESS, Attacker, head
from benchmarks.hostile.client import request
from benchmarks.hostile.services import SCENE, Name

LOW = json.dumps(request(profile=3)).encode()
STREAM = json.dumps({**request(1280, 720), "frame_rate": 60}).encode()
MESSAGE = b'{"seq": 1, "position": [' + b"0," * 7_500_000 + b"0]}"
"""15 MB."""
SLOWLY_S = 2.0
CONNECTIONS = 2000
"""More than a process's default limit of open files."""


async def slow_headers(service: Name, attacker: Attacker) -> None:
    """Two thousand connections with an endless request: a byte from time to time."""
    port = getattr(attacker.ports, service)
    await _dribble(attacker, port, f"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nX-Slow: ".encode())


async def slow_bodies(attacker: Attacker) -> None:
    """Two thousand requests with an endless body."""
    port = attacker.ports.render
    await _dribble(attacker, port, head("POST", port, "/render", "Content-Length: 10000"))


async def _dribble(attacker: Attacker, port: int, start: bytes) -> None:
    async def attempt() -> None:
        reader, writer = await attacker.open(port)
        try:
            writer.write(start)
            while not reader.at_eof():
                writer.write(b"x")
                await writer.drain()
                await asyncio.sleep(SLOWLY_S)
            attacker.done["ended by the service"] += 1
            raise ConnectionResetError
        finally:
            writer.close()

    await attacker.again(attempt, copies=CONNECTIONS)


async def page_flood(attacker: Attacker) -> None:
    """Frames over 64 connections of HTTP/1.1, as fast as they come."""
    port = attacker.ports.render
    await attacker.again(lambda: attacker.post(port, "/render", LOW), copies=64)


async def get_flood(path: str, attacker: Attacker) -> None:
    """A costly answer over 16 connections, again and again."""
    port = attacker.ports.render

    async def attempt() -> None:
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

    await attacker.again(attempt, copies=16)


async def unload_scene(attacker: Attacker) -> None:
    """The scene that the others look at is unloaded all the time."""
    port = attacker.ports.render

    async def attempt() -> None:
        await attacker.post(port, f"/scenes/{SCENE}/unload", b"")
        await asyncio.sleep(0.1)

    await attacker.again(attempt, copies=2)


async def streams_left(attacker: Attacker) -> None:
    """DASH streams that are opened, and left running."""

    async def attempt() -> None:
        await attacker.post(attacker.ports.dash, "/sessions", STREAM)
        await asyncio.sleep(0.5)

    await attacker.again(attempt, copies=4)


async def large_messages(attacker: Attacker) -> None:
    """Messages of 15 MB to a stream's WebSocket, where a pose is some hundred bytes."""
    small = json.dumps({**request(320, 180), "frame_rate": 5}).encode()
    status, answer = await attacker.post(attacker.ports.dash, "/sessions", small)
    path = json.loads(answer)["poses"] if status == 201 else "/sessions/none/poses"

    async def attempt() -> None:
        url = f"ws://127.0.0.1:{attacker.ports.dash}{path}"
        async with websockets.asyncio.client.connect(
            url, local_addr=(ADDRESS, 0), compression=None, proxy=None
        ) as socket:
            while True:
                try:
                    await socket.send(MESSAGE)
                    attacker.done["messages"] += 1
                except websockets.ConnectionClosed as error:
                    raise ConnectionResetError from error

    await attacker.again(attempt, copies=4)


async def watchers(attacker: Attacker) -> None:
    """Two hundred connections that watch the link without reading."""
    port = attacker.ports.shaper

    async def attempt() -> None:
        reader, writer = await attacker.open(port)
        try:
            writer.write(head("GET", port, "/events"))
            attacker.done[(await reader.readline()).decode().strip()] += 1
            await asyncio.sleep(20)
        finally:
            writer.close()

    await attacker.again(attempt, copies=200)
