"""A share of the event loop for each address, so that one client's HTTP requests do not hold up those of others."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine, Generator
from types import coroutine
from typing import Any

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tigas_common.address import client_network
from tigas_common.errors import AskedTooOften
from tigas_common.limits import RateLimit
from tigas_common.origins import OriginPolicy
from tigas_common.proxy import send_error

BURST_S = 0.1
"""Seconds of the loop that an address may use at once: more than opening the page takes."""
UPFRONT_COST_S = 0.002
"""Cost charged for a request in advance, in seconds."""
OVERHEAD_S = 0.0005
"""Seconds that a request costs outside the application, for parsing and for writing the answer."""
MAX_WAIT_S = 2.0
"""Seconds for which a request waits for its address's share before it is refused. Refusals are delayed as long, to slow
down clients that retry at once.
"""
FRAME_PATH = "/render"


class LoopShare:
    """ASGI middleware that measures how long each address's requests keep the event loop busy.

    Requests of an address that has used up its share wait, or are answered with 429 if the wait would be too long.
    Frames are not counted: the renderer gives each address an equal share itself.
    """

    def __init__(
        self,
        app: ASGIApp,
        share: float,
        origins: OriginPolicy,
        clock: Callable[[], float] = time.monotonic,
        busy_clock: Callable[[], float] = time.thread_time,
        sleep: Callable[[float], Coroutine[Any, Any, None]] = asyncio.sleep,
    ) -> None:
        """share: of the loop's time, 0 to 1. origins: pages that may read a refusal."""
        self._app = app
        self._share = share
        self._origins = origins
        self._clock = clock
        self._busy_clock = busy_clock
        self._sleep = sleep
        self._used = RateLimit[str]()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        address = client_network(scope["client"][0]) if scope["client"] else ""
        delay = self._used.delay_s(address, self._clock(), self._share, BURST_S / self._share, UPFRONT_COST_S)
        if delay > MAX_WAIT_S:
            await self._sleep(MAX_WAIT_S)
            error = AskedTooOften("Your address exceeds its share; send fewer requests.", delay)
            return await send_error(error, self._origins, scope, receive, send)
        self._charge(address, UPFRONT_COST_S)
        meter, is_frame = _Meter(self._busy_clock), False

        async def watch(message: Message) -> None:
            nonlocal is_frame
            if message["type"] == "http.response.start":
                is_frame = scope["path"] == FRAME_PATH and message["status"] < 400
            await send(message)

        try:
            if delay:
                await self._sleep(delay)
            await meter.run(self._app(scope, receive, watch))  # type: ignore[arg-type]
        finally:
            used = 0.0 if is_frame else OVERHEAD_S + meter.seconds
            self._charge(address, used - UPFRONT_COST_S)

    def _charge(self, address: str, seconds: float) -> None:
        self._used.consume(address, self._clock(), self._share, seconds)


class _Meter:
    """Measures how long a coroutine's steps take in total."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.seconds = 0.0
        self._clock = clock

    @coroutine
    def run(self, work: Coroutine[Any, Any, None]) -> Generator[Any, Any, None]:
        """Await the work, one step at a time."""
        step: Callable[[Any], Any] = work.send
        value: Any = None
        while True:
            began = self._clock()
            try:
                awaited = step(value)
            except StopIteration:
                return
            finally:
                self.seconds += self._clock() - began
            try:
                step, value = work.send, (yield awaited)
            except BaseException as error:
                step, value = work.throw, error
