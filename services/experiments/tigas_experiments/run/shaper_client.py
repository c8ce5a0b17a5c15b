"""The shaper's API (docs/network.md), as far as runs need it."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncIterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import httpx
from pydantic import ValidationError

from tigas_common.files import read_regular
from tigas_common.parsing import sentence
from tigas_common.wire.shaper import MAX_UPLOAD_BYTES, ShaperStatus
from tigas_experiments.errors import RunFailed
from tigas_experiments.wire.run import Network

TIMEOUT_S = 10
UPLOAD_TIMEOUT_S = 60


class ShaperClient:
    """A shaper at a URL. Every failure is a RunFailed with one sentence."""

    def __init__(self, url: str, origin: str) -> None:
        self.url = url.rstrip("/")
        self._http = httpx.AsyncClient(
            base_url=self.url, headers={"Origin": origin}, timeout=TIMEOUT_S, trust_env=False
        )

    async def close(self) -> None:
        await self._http.aclose()

    async def hold(self, network: Network) -> ShaperStatus:
        """Put the network's first state in force, and keep it."""
        if network.link is not None:
            return await self._post("/link", asdict(network.link))
        name = network.trace if network.trace_file is None else await self._upload(network.trace_file)
        delay_ms = None if network.rtt_ms is None else network.rtt_ms / 2
        playing = await self._post("/start", {"trace": name, "loop": True, "delay_ms": delay_ms})
        if network.offset_s * 1000 >= (playing.duration_ms or math.inf):
            raise RunFailed(f"The trace {name} is shorter than {network.offset_s:g} s, so no run can begin there.")
        await self._post("/pause", {})
        return await self._seek(network)

    async def play(self, network: Network) -> None:
        """Play the held trace from where a run begins."""
        await self._seek(network)
        await self._post("/resume", {})

    async def release(self) -> ShaperStatus:
        """Back to the shaper's own constant rate, which is fast."""
        return await self._post("/stop", {})

    async def watch(self) -> AsyncIterator[ShaperStatus]:
        """The link about five times a second."""
        try:
            async with self._http.stream("GET", "/events", timeout=httpx.Timeout(TIMEOUT_S, read=None)) as answer:
                async for line in answer.aiter_lines():
                    if line.startswith("data:"):
                        yield self._status(json.loads(line.removeprefix("data:")))
        except (httpx.HTTPError, json.JSONDecodeError) as error:
            raise RunFailed(f"The shaper at {self.url} stopped reporting its link ({_reason(error)}).") from None
        raise RunFailed(f"The shaper at {self.url} stopped reporting its link (it has ended).")

    async def _seek(self, network: Network) -> ShaperStatus:
        return await self._post("/seek", {"position_ms": network.offset_s * 1000})

    def _status(self, data: Any) -> ShaperStatus:
        try:
            return ShaperStatus.model_validate(data, extra="ignore")  # of a newer shaper
        except ValidationError as error:
            raise RunFailed(
                f"The shaper at {self.url} reports its link in an unknown form: {sentence(error)}"
            ) from None

    async def _upload(self, path: Path) -> str:
        try:
            data = await asyncio.to_thread(read_regular, path, MAX_UPLOAD_BYTES)
        except OSError as error:
            raise RunFailed(f"{path} cannot be read: {error.strerror or error}.") from None
        answer = await self._send("POST", "/traces", params={"name": path.name}, content=data, timeout=UPLOAD_TIMEOUT_S)
        if not isinstance(answer, dict) or not isinstance(answer.get("name"), str):
            raise RunFailed(f"The shaper at {self.url} took {path.name} and does not say as what.")
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
