"""The link of a run: plays the run's part of a trace, monitors it, and makes the link fast again afterwards."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from time import monotonic, time
from typing import Any

import httpx
from pydantic import ValidationError

from tigas_common.files import read_regular
from tigas_common.parsing import describe_error
from tigas_common.wire.shaper import MAX_DURATION_MS, MAX_UPLOAD_BYTES, ShaperStatus
from tigas_experiments.errors import RunFailed
from tigas_experiments.run.targets import Target
from tigas_experiments.wire.recording import LinkSample
from tigas_experiments.wire.run import Network

TIMEOUT_S = 10
UPLOAD_TIMEOUT_S = 60
OPENING_S = 10
"""Seconds of the trace played before the warm-up: a viewer that opens during an outage might never become ready."""
JUMP_MS = 500
"""Deviation from a trace's expected position that shows that it was moved; smaller ones come from timing."""


@dataclass(frozen=True, slots=True)
class RunLink:
    """A link reserved for a run."""

    shaper: ShaperClient
    network: Network
    warm_up_s: float
    first: ShaperStatus
    """Its status when it was reserved."""

    async def warm_up(self) -> None:
        """Play the network's trace, if it is one, from the start of the warm-up. Raises RunFailed."""
        await self._seek(self.warm_up_s)

    async def play(self) -> None:
        """Play the trace from the start of the movement. Raises RunFailed."""
        await self._seek(0)

    async def _seek(self, before_s: float) -> None:
        if self.network.trace is not None:
            await self.shaper.seek(self.network, before_s, self.first.duration_ms)

    def is_undisturbed(self, seen: Iterable[ShaperStatus]) -> bool:
        """Whether the link changed only according to its network during the movement."""
        playing: ShaperStatus | None = None
        for status in seen:
            if status.trace != self.first.trace:
                return False
            if self.network.trace is None:
                if status.link != self.first.link:
                    return False
                continue
            if self.network.rtt_ms is not None and status.link.delay_ms != self.first.link.delay_ms:
                return False
            playing = playing or status
            if status.mode != "playing" or _jump_ms(playing, status) > JUMP_MS:
                return False
        return True


@asynccontextmanager
async def reserve_link(target: Target, network: Network, warm_up_s: float = 0) -> AsyncIterator[RunLink | None]:
    """Apply a network before a viewer opens, and return to the shaper's fast link afterwards. Raises RunFailed.

    Yields None if there is no shaper and the run needs none.
    """
    if target.shaper is None:
        if network.shaped:
            raise RunFailed(f"There is no shaper behind {target.url}, so the network must be `unshaped`.")
        yield None
        return
    shaper = ShaperClient(target.shaper, target.url)
    try:
        first = await (shaper.begin(network, warm_up_s + OPENING_S) if network.shaped else shaper.release())
        yield RunLink(shaper, network, warm_up_s, first)
    finally:
        with contextlib.suppress(RunFailed):
            await shaper.release()
        await shaper.close()


@asynccontextmanager
async def record_link(link: RunLink | None) -> AsyncIterator[list[tuple[float, ShaperStatus]]]:
    """Record (unix ms, status) of the link during the context.

    Raises RunFailed at the end if the link was closed or changed from outside.
    """
    seen: list[tuple[float, ShaperStatus]] = []
    if link is None:
        yield seen
        return

    ahead_s = time() - monotonic()  # constant, so that adjusting the clock does not take back time

    async def watch() -> None:
        async for status in link.shaper.watch():
            seen.append(((ahead_s + monotonic()) * 1000, status))

    task = asyncio.create_task(watch())
    try:
        yield seen
    finally:
        task.cancel()
        await asyncio.wait([task])
        # Always retrieved, as asyncio logs unretrieved exceptions.
        error = None if task.cancelled() else task.exception()
    if error is not None:
        raise error
    if closed := next((status.closed for _, status in seen if status.closed), None):
        raise RunFailed(f"The link was closed during the run: {closed}")
    if not link.is_undisturbed(status for _, status in seen):
        raise RunFailed("The link was changed from outside during the run.")


def link_sample(status: ShaperStatus, at: float) -> LinkSample:
    """The recorded part of a status; `at` is in ms since the run's start."""
    return LinkSample(
        at=at,
        position_ms=status.position_ms,
        target_kbps=status.down.target_kbps,
        delivered_kbps=status.down.delivered_kbps,
        queue_ms=status.down.queue_ms,
        drops=status.down.drops,
        up_delivered_kbps=status.up.delivered_kbps,
    )


def _jump_ms(earlier: ShaperStatus, later: ShaperStatus) -> float:
    """Distance of a trace from its expected position; traces loop."""
    if earlier.position_ms is None or later.position_ms is None or not later.duration_ms:
        return 0.0
    half = later.duration_ms / 2
    moved = later.position_ms - earlier.position_ms - (later.time_ms - earlier.time_ms)
    return abs((moved + half) % later.duration_ms - half)


class ShaperClient:
    """A shaper at a URL. Every failure is a RunFailed with one sentence."""

    def __init__(self, url: str, origin: str) -> None:
        self.url = url.rstrip("/")
        self._http = httpx.AsyncClient(
            base_url=self.url, headers={"Origin": origin}, timeout=TIMEOUT_S, trust_env=False, verify=False
        )

    async def close(self) -> None:
        await self._http.aclose()

    async def begin(self, network: Network, before_s: float) -> ShaperStatus:
        """Apply the network. Its trace loops, and starts `before_s` seconds before the run's part."""
        if network.link is not None:
            return await self._post("/link", asdict(network.link))
        name = network.trace if network.trace_file is None else await self._upload(network.trace_file)
        delay_ms = None if network.rtt_ms is None else network.rtt_ms / 2
        playing = await self._post("/start", {"trace": name, "loop": True, "delay_ms": delay_ms})
        if network.offset_s * 1000 >= (playing.duration_ms or math.inf):
            raise RunFailed(f"The trace {name} is shorter than {network.offset_s:g} s, so no run can start there.")
        return await self.seek(network, before_s, playing.duration_ms)

    async def seek(self, network: Network, before_s: float, duration_ms: float | None) -> ShaperStatus:
        """Play the network's trace from `before_s` seconds before the run's part, wrapping around its start."""
        position_ms = (network.offset_s - before_s) * 1000
        return await self._post("/seek", {"position_ms": position_ms % (duration_ms or MAX_DURATION_MS)})

    async def release(self) -> ShaperStatus:
        """Return to the shaper's own constant rate, which is fast."""
        return await self._post("/stop", {})

    async def watch(self) -> AsyncIterator[ShaperStatus]:
        """Yield the link's status about five times per second."""
        try:
            async with self._http.stream("GET", "/events", timeout=httpx.Timeout(TIMEOUT_S, read=None)) as answer:
                async for line in answer.aiter_lines():
                    if line.startswith("data:"):
                        yield self._status(json.loads(line.removeprefix("data:")))
        except (httpx.HTTPError, json.JSONDecodeError) as error:
            raise RunFailed(f"The shaper at {self.url} stopped reporting its link ({_reason(error)}).") from None
        raise RunFailed(f"The shaper at {self.url} stopped reporting its link (it has ended).")

    def _status(self, data: Any) -> ShaperStatus:
        try:
            return ShaperStatus.model_validate(data, extra="ignore")  # a newer shaper may send more
        except ValidationError as error:
            raise RunFailed(
                f"The shaper at {self.url} reports its link in an unknown form: {describe_error(error)}"
            ) from None

    async def _upload(self, path: Path) -> str:
        try:
            data = await asyncio.to_thread(read_regular, path, MAX_UPLOAD_BYTES)
        except OSError as error:
            raise RunFailed(f"{path} cannot be read: {error.strerror or error}.") from None
        answer = await self._send("POST", "/traces", params={"name": path.name}, content=data, timeout=UPLOAD_TIMEOUT_S)
        if not isinstance(answer, dict) or not isinstance(answer.get("name"), str):
            raise RunFailed(f"The shaper at {self.url} accepted {path.name} but did not name it.")
        return str(answer["name"])

    async def _post(self, path: str, body: dict[str, Any]) -> ShaperStatus:
        return self._status(await self._send("POST", path, json=body))

    async def _send(self, method: str, path: str, **arguments: Any) -> Any:
        try:
            answer = await self._http.request(method, path, **arguments)
            told = answer.json() if answer.is_success or "json" in answer.headers.get("content-type", "") else None
        except (httpx.HTTPError, ValueError) as error:
            raise RunFailed(f"The shaper at {self.url} does not answer ({_reason(error)}).") from None
        if answer.is_success:
            return told
        detail = told.get("detail") if isinstance(told, dict) else None
        raise RunFailed(f"The shaper refused {path}: {detail or answer.status_code}")


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__
