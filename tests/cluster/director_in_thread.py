"""A director in a thread, for tests without an event loop."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from tigas_cluster.director import create_director
from tigas_cluster.fleet import Fleet, HostAddress
from tigas_common.address import Address
from tigas_common.limits import HttpLimits
from tigas_common.origins import OriginPolicy
from tigas_common.runner import serve_http

PATIENCE_S = 30


@dataclass
class RunningDirector:
    """A director served over HTTP by a context manager."""

    url: str
    _fleet: Fleet
    _loop: asyncio.AbstractEventLoop

    def follow(self, addresses: Iterable[HostAddress]) -> None:
        self._on_loop(lambda: self._fleet.set_hosts(addresses))

    def wait_for(self, names: Iterable[str]) -> None:
        wanted, end = set(names), time.monotonic() + PATIENCE_S
        while (up := self._on_loop(lambda: {host.name for host in self._fleet.hosts()})) != wanted:
            assert time.monotonic() < end, f"{up} are up and not {wanted}"
            time.sleep(0.05)

    def _on_loop(self, act: Callable[[], object]) -> object:
        async def acting() -> object:
            return act()

        return asyncio.run_coroutine_threadsafe(acting(), self._loop).result(PATIENCE_S)


@contextmanager
def running_director(addresses: Iterable[HostAddress]) -> Iterator[RunningDirector]:
    """A director of these hosts, on a free port of this machine."""
    started: list[RunningDirector] = []
    ready, loop, stop = threading.Event(), asyncio.new_event_loop(), asyncio.Event()

    async def serve() -> None:
        address = Address("127.0.0.1", 0)
        async with (
            Fleet(addresses, time.monotonic) as fleet,
            create_director(fleet, origins=OriginPolicy.from_addresses([address]), clock=time.monotonic) as app,
            serve_http(app, address, HttpLimits()) as port,
        ):
            started.append(RunningDirector(f"http://127.0.0.1:{port}/", fleet, loop))
            ready.set()
            await stop.wait()

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()), daemon=True)
    thread.start()
    try:
        assert ready.wait(PATIENCE_S), "the director did not start"
        yield started[0]
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join(PATIENCE_S)
        loop.close()
