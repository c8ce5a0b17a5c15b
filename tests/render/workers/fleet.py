"""A render service of several processes, with made-up frames, and viewers of it."""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any
from urllib.parse import urlsplit

import httpx
import psutil
import pytest
from aioquic.quic.events import ConnectionTerminated

from tests.eventually import eventually
from tests.render.transport.client import Client, connect, request_body
from tigas.http3 import split_frame

TIGAS = str(Path(sys.executable).parent / "tigas")
ASK = request_body(scene="courtyard", width=64, height=36, cx=32, cy=18)
EVERY_S = 1 / 30
TOO_OFTEN = 429


@dataclass
class Fleet:
    """A service that runs."""

    process: subprocess.Popen[str]
    url: str
    port: int
    """Of QUIC."""
    edges: int
    errors: IO[str]
    """Its standard error."""

    def child(self, name: str) -> psutil.Process:
        """A child by its name, such as `edge 1`."""
        [found] = [each for each in self.children() if each.name() == name]
        return found

    def children(self) -> list[psutil.Process]:
        return psutil.Process(self.process.pid).children()

    def pid(self, name: str) -> int | None:
        """Of a child, if there is one at the moment."""
        with contextlib.suppress(ValueError, psutil.Error):
            return self.child(name).pid
        return None

    def owner(self, client: Client) -> int:
        """The number of the edge that has a client's connection."""
        return client._quic._peer_cid.cid[0] % self.edges

    async def started_again(self, name: str, than: int) -> None:
        """Wait until a child has another process than it had."""
        await eventually(lambda: self.pid(name) not in (None, than))


@contextlib.contextmanager
def serving(*arguments: str, edges: int = 3, device: str = "instant:5000") -> Iterator[Fleet]:
    """A service on free ports, until the context ends."""
    command = [TIGAS, "render", "--edges", str(edges), "--device", device, "--quic", "127.0.0.1:0", *arguments]
    if "--http" not in arguments:
        command += ["--http", "127.0.0.1:0"]
    with (
        tempfile.TemporaryFile("w+") as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as process,
    ):
        try:
            assert process.stdout is not None
            for line in process.stdout:
                if opened := re.match(r"Open (http://\S+)/", line):
                    break
            else:
                errors.seek(0)
                raise AssertionError(f"the service did not start:\n{errors.read()}")
            url = opened[1]
            port = urlsplit(httpx.get(f"{url}/config.json").json()["webtransport_url"]).port
            assert port is not None
            yield Fleet(process, url, port, edges, errors)
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                process.wait(10)


@contextlib.asynccontextmanager
async def session(fleet: Fleet) -> AsyncIterator[tuple[Client, int]]:
    """A client of any edge, and its session."""
    async with connect(fleet.port, certificate=None) as client:
        yield client, await client.connect_webtransport()


async def status(client: Client, session: int) -> int:
    """How one request for a frame ends."""
    header, _ = await client.frame(session, ASK)
    return int(header["status"])


@dataclass
class Viewer:
    """Requests frames continuously, and reconnects like the page.

    Like the page, it keeps to the announced rate: a busy machine's edges lower it, and refuse clients that
    exceed it.
    """

    fleet: Fleet
    ask: bytes = ASK
    owner: int = -1
    connections: int = 0
    since: float = 0.0
    """When the newest of them was opened."""
    shown: list[float] = field(default_factory=list)
    """When frames came, in seconds of the monotonic clock."""
    failed: list[int] = field(default_factory=list)
    """The status of each other answer."""

    async def watch(self) -> None:
        while True:
            with contextlib.suppress(ConnectionError):  # it was refused
                async with connect(self.fleet.port, certificate=None) as client:
                    _heed_resets(client)
                    await self._ask(client, await client.connect_webtransport())
            await asyncio.sleep(EVERY_S)

    async def _ask(self, client: Client, session: int) -> None:
        self.owner = self.fleet.owner(client)
        self.connections, self.since = self.connections + 1, time.monotonic()
        while client.terminated is None:
            answer = client.responses[client.open_stream(session, self.ask)]
            await client.until(lambda answer=answer: answer.done or client.terminated)  # type: ignore[misc]
            if client.terminated is not None:
                return
            header, _ = split_frame(bytes(answer.body))
            if header["status"] == 200:
                self.shown.append(time.monotonic())
            elif header["status"] != TOO_OFTEN:
                self.failed.append(header["status"])
            await asyncio.sleep(max(EVERY_S, 1 / (header.get("requests_per_s") or math.inf)))


@contextlib.asynccontextmanager
async def watching(viewers: Sequence[Viewer]) -> AsyncIterator[None]:
    """All watch, and have seen something."""
    tasks = [asyncio.create_task(viewer.watch()) for viewer in viewers]
    try:
        await eventually(lambda: all(len(viewer.shown) >= 5 for viewer in viewers))
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def gap(viewers: Sequence[Viewer], since: float) -> float:
    """The longest that any of them has seen nothing new, in seconds."""
    seen = [[at for at in viewer.shown if at >= since] for viewer in viewers]
    return max(late - early for each in seen for early, late in zip([since, *each], each, strict=False))


def _heed_resets(client: Client) -> None:
    """Let a stateless reset (RFC 9000, 10.3) end the connection, as in browsers; aioquic's clients do not know it."""
    take, quic = client.datagram_received, client._quic

    def datagram_received(data: bytes | str, addr: Any) -> None:
        tokens = {cid.stateless_reset_token for cid in (quic._peer_cid, *quic._peer_cid_available)}
        if data[-16:] in tokens:
            client.terminated = ConnectionTerminated(error_code=0, frame_type=None, reason_phrase="reset")
            client._news.set()
        else:
            take(data, addr)

    client.datagram_received = datagram_received  # type: ignore[method-assign]


@contextlib.contextmanager
def nothing_left() -> Iterator[None]:
    """Services that start meanwhile must leave no process, and no temporary file, when the context ends."""
    with tempfile.TemporaryDirectory(prefix="t-") as temporary, pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", temporary)
        yield
        files = [path.name for path in Path(temporary).iterdir()]
        processes = [each.cmdline() for each in psutil.process_iter() if _began_with(each, temporary)]
        assert (files, processes) == ([], [])


def _began_with(process: psutil.Process, temporary: str) -> bool:
    with contextlib.suppress(psutil.Error):
        return process.environ().get("TMPDIR") == temporary and process.status() != psutil.STATUS_ZOMBIE
    return False
