"""Attacks by uploads, at the store and at the shaper."""

from __future__ import annotations

import asyncio
import gzip
import json

from benchmarks.hostile.attacker import Attacker, head

MEGABYTE = 1_000_000
JSON = "Content-Type: application/json"


async def error_bomb(attacker: Attacker) -> None:
    """A megabyte with half a million mistakes, each of which could become a separate error."""
    await _upload(attacker, b'{"link": [' + b"{}," * (MEGABYTE // 3) + b"{}]}")


async def deep_json(attacker: Attacker) -> None:
    """Ten megabytes of brackets."""
    await _upload(attacker, b'{"link": ' + b"[" * (10 * MEGABYTE))


async def _upload(attacker: Attacker, body: bytes) -> None:
    port = attacker.ports.store
    path = await _experiment(attacker)
    await attacker.again(lambda: attacker.post(port, path, body, JSON), copies=4)


async def large_uploads(attacker: Attacker) -> None:
    """Sixteen uploads that promise as much as a run may have, and go on for ever."""
    port = attacker.ports.store
    path = await _experiment(attacker)

    async def attempt() -> None:
        reader, writer = await attacker.open(port)
        try:
            writer.write(head("POST", port, path, JSON, "Content-Length: 255000000") + b'{"link": [')
            while not reader.at_eof():
                writer.write(b"{}," * 100_000)
                attacker.done["parts of 300 kB"] += 1
                await writer.drain()
                await asyncio.sleep(0.2)
            raise ConnectionResetError
        finally:
            writer.close()

    await attacker.again(attempt, copies=16)


async def _experiment(attacker: Attacker) -> str:
    """The path of a new experiment's runs."""
    plan = json.dumps({"name": "hostile", "plan": {"seed": 1}}).encode()
    _, answer = await attacker.post(attacker.ports.store, "/experiments", plan, JSON)
    return f"/experiments/{json.loads(answer)['id']}/runs"


async def gzip_bomb(attacker: Attacker) -> None:
    """A trace of four gigabytes in four megabytes."""
    bomb = gzip.compress(bytes(64 * MEGABYTE)) * 64
    port, page = attacker.ports.shaper, f"Origin: http://127.0.0.1:{attacker.ports.render}"
    await attacker.again(lambda: attacker.post(port, "/traces?name=bomb.csv.gz", bomb, page), copies=4)
