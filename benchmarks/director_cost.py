"""What a director's process spends: on asking a host how it is, and on telling a page where to go (/config.json).

    python -m benchmarks.director_cost [--hosts 16 128] [--seconds 5]

Hosts are made up: a process that answers /api/load at once. Pages are another, with eight connections that ask as fast
as they are answered. Only processor time of the director's own process counts.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import multiprocessing
import os
import socket
import time
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection

import httpx

from tigas_cluster.director import create_director
from tigas_cluster.fleet import Fleet, HostAddress, HostState
from tigas_cluster.polled_fleet import POLL_S, PolledFleet
from tigas_common.address import Address
from tigas_common.http_limits import HttpLimits
from tigas_common.origins import OriginPolicy
from tigas_common.runner import serve_listener
from tigas_common.wire.cluster import HostLoad
from tigas_common.wire.render import DEFAULT_LADDER, ServerConfig

PAGES = 8
SCENES = 1000
CONFIG = ServerConfig(
    version="1", ladder=DEFAULT_LADDER, certificate_sha256="A" * 44, webtransport_url="https://127.0.0.1:4433/render",
    https_url=None, services={},
)  # fmt: skip
LOAD = HostLoad(config=CONFIG, viewers=20, utilisation=0.5, queue_age_s=0.002, scenes=("courtyard", "flowers"))


class StandIn(asyncio.Protocol):
    """All hosts: whatever it is asked, it says how it is."""

    BODY = LOAD.model_dump_json().encode()
    ANSWER = b"HTTP/1.1 200 OK\r\ncontent-type: application/json\r\ncontent-length: %d\r\n\r\n%s" % (len(BODY), BODY)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        self._transport.write(self.ANSWER * data.count(b"\r\n\r\n"))


def run_hosts(told: Connection) -> None:
    """A process: tells its port, and answers until it is killed."""

    async def serve() -> None:
        server = await asyncio.get_running_loop().create_server(StandIn, "127.0.0.1", 0)
        told.send(server.sockets[0].getsockname()[1])
        await server.serve_forever()

    asyncio.run(serve())


def run_pages(port: int) -> None:
    """A process: asks for /config.json, of one scene after another, until it is killed."""

    async def ask(numbers: itertools.count[int]) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        while True:
            writer.write(b"GET /config.json?scene=s%d HTTP/1.1\r\nhost: 127.0.0.1\r\n\r\n" % (next(numbers) % SCENES))
            head = await reader.readuntil(b"\r\n\r\n")
            (length,) = (int(line[15:]) for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:"))
            await reader.readexactly(length)

    async def all_of_them() -> None:
        numbers = itertools.count()
        await asyncio.gather(*(ask(numbers) for _ in range(PAGES)))

    asyncio.run(all_of_them())


class Counted(httpx.AsyncHTTPTransport):
    """Counts what was asked."""

    polls = 0

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        self.polls += 1
        return await super().handle_async_request(request)


def started(target: Callable[..., None], *arguments: object) -> multiprocessing.process.BaseProcess:
    """A process of its own."""
    process = multiprocessing.get_context("spawn").Process(target=target, args=arguments, daemon=True)
    process.start()
    return process


class Still(Fleet):
    """Hosts as they were heard of once."""

    def __init__(self, states: Sequence[HostState]) -> None:
        self._states = states

    def hosts(self) -> Sequence[HostState]:
        return self._states

    async def suspect(self, name: str) -> None:
        """Nothing: nobody is lost."""


async def measure_polls(addresses: list[HostAddress], seconds: float) -> tuple[float, Still]:
    """Seconds of processor time that a poll takes, and the hosts."""
    counted = Counted(limits=httpx.Limits(max_connections=None))
    async with PolledFleet(addresses, time.monotonic, counted) as fleet:
        polls, before = counted.polls, time.process_time()
        await asyncio.sleep(seconds)
        return (time.process_time() - before) / (counted.polls - polls), Still(fleet.hosts())


async def measure_answers(fleet: Fleet, seconds: float) -> float:
    """Seconds of processor time that an answer to a page takes."""
    answers = 0
    asked = asyncio.Event()
    policy = OriginPolicy.of([Address("127.0.0.1", 0)], (), ())
    async with create_director(fleet, origins=policy, clock=time.monotonic) as director:

        async def app(scope: dict[str, object], *rest: object) -> None:
            nonlocal answers
            answers += 1
            asked.set()
            await director(scope, *rest)  # type: ignore[arg-type]

        async with serve_listener(app, socket.create_server(("127.0.0.1", 0)), HttpLimits()) as port:
            pages = started(run_pages, port)
            try:
                await asked.wait()
                told, before = answers, time.process_time()
                await asyncio.sleep(seconds)
                return (time.process_time() - before) / (answers - told)
            finally:
                pages.kill()
                pages.join()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hosts", type=int, nargs="+", default=[16, 128], help="(default: 16 128)")
    parser.add_argument("--seconds", type=float, default=5, help="that each of the two is measured (default: 5)")
    arguments = parser.parse_args()
    ours, theirs = multiprocessing.Pipe()
    standing_in = started(run_hosts, theirs)
    try:
        port = ours.recv()
        for hosts in arguments.hosts:
            addresses = [HostAddress(f"host-{number}", f"http://127.0.0.1:{port}") for number in range(hosts)]
            poll, fleet = asyncio.run(measure_polls(addresses, arguments.seconds))
            answer = asyncio.run(measure_answers(fleet, arguments.seconds))
            print(
                f"{hosts} hosts: {1e3 * poll:.2f} ms a poll, {poll / POLL_S:.1%} of a core for each host; "
                f"{1e3 * answer:.2f} ms an answer to a page. Load average {os.getloadavg()[0]:.1f}."
            )
    finally:
        standing_in.kill()
        standing_in.join()


if __name__ == "__main__":
    main()
