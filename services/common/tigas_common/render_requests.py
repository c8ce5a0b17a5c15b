"""Requests to a render service, or to a cluster's director, which names the host of each scene."""

from __future__ import annotations

import asyncio
import re
import subprocess
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, replace
from typing import Final, Literal, Self, TypeVar
from urllib.parse import quote

import httpx
from pydantic import ValidationError

from tigas_common.errors import StartError, TigasError
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.processes import run_process, tigas_command
from tigas_common.wire.render import LadderName, Problem, RenderRequest, SceneInfo, ServerConfig

MAX_TRIES: Final = 5
RETRY_STATUSES: Final = (409, 429, 503)
"""Statuses worth retrying: superseded by a newer request; rate limited; overloaded."""
PAUSE_S: Final = 1.0
MAX_PAUSE_S: Final = 10.0
"""Default and maximum pause between two tries, in seconds."""
HOST_REFRESH_S: Final = 3.0
"""Interval at which the director is asked for a scene's host, in seconds."""
HOST_RECHECK_S: Final = 1.0
"""Minimum interval at which it is asked about a host that has refused a request, in seconds."""
ANSWER_S: Final = 1.0
"""Timeout of its answer in seconds, after which the known host is kept."""
MOST_SCENES: Final = 256
"""Maximum number of scenes with a known host."""
MAX_CONCURRENT: Final = 4
"""Useful number of concurrent requests: enough to keep a renderer and the encoders behind it busy."""
LOAD_S: Final = 300
STOP_S: Final = 5
FRAME_S: Final = 60
MAX_LIST: Final = 10_000_000
"""Maximum size of a scene list, in bytes."""

Message = TypeVar("Message")


class RenderUnavailable(TigasError):
    status, type, title = 502, "render-unavailable", "The render service sends no frames"


class RenderProblem(TigasError):
    """The render service refused a request; its own problem is passed on."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.status = problem.status
        self.type = problem.type.removeprefix("tigas:")
        self.title = problem.title


async def send_with_retries(ask: Callable[[], Awaitable[httpx.Response]]) -> httpx.Response:
    """Repeat a request while the answer's status is in RETRY_STATUSES, up to MAX_TRIES times. Raises as `ask` does."""
    for _ in range(MAX_TRIES - 1):
        answer = await ask()
        if answer.status_code not in RETRY_STATUSES:
            return answer
        retry_after = answer.headers.get("retry-after", "")
        await asyncio.sleep(min(float(retry_after), MAX_PAUSE_S) if retry_after.isdecimal() else PAUSE_S)
    return await ask()


@dataclass(frozen=True, slots=True)
class _Host:
    name: str | None
    """Name in the cluster; None outside a cluster."""
    base_url: str
    """Empty for the service itself."""
    asked_at: float


class SceneHosts:
    """The hosts behind one service, which may be its only host."""

    def __init__(self, http: httpx.AsyncClient, clock: Callable[[], float] = time.monotonic) -> None:
        """http: with the service's base URL; clock: in seconds."""
        self._http = http
        self._clock = clock
        self._hosts: dict[str, _Host] = {}

    async def request(
        self, scene: str, method: str, path: str, *, content: str | None, timeout_s: float
    ) -> httpx.Response:
        """Ask the scene's host; if it is down, full or draining and the director names another, ask that one.

        timeout_s: for each host. Raises httpx.HTTPError and httpx.InvalidURL.
        """
        host = await self._find_host(scene)
        gone: httpx.TransportError | None = None
        answer: httpx.Response | None = None
        try:
            answer = await self._http.request(method, host.base_url + path, content=content, timeout=timeout_s)
        except httpx.TransportError as error:
            gone = error
        if answer is not None and answer.status_code != httpx.codes.SERVICE_UNAVAILABLE:
            return answer
        other = await self._find_other_host(scene, host, "lost" if gone else "silent")
        if other is not None:
            return await self._http.request(method, other.base_url + path, content=content, timeout=timeout_s)
        if answer is None:
            assert gone is not None
            raise gone
        return answer

    async def _find_host(self, scene: str) -> _Host:
        known = self._hosts.get(scene)
        if known is None:
            return await self._ask_director(scene, _Host(None, "", self._clock()))
        if known.name is not None and self._clock() >= known.asked_at + HOST_REFRESH_S:
            return await self._ask_director(scene, known, at=known.name)
        return known

    async def _find_other_host(self, scene: str, host: _Host, doubt: Literal["silent", "lost"]) -> _Host | None:
        """Another host of the scene, if the director names one."""
        known = self._hosts.get(scene, host)
        if known.base_url == host.base_url and host.name is not None:
            if doubt == "silent" and self._clock() < known.asked_at + HOST_RECHECK_S:
                return None
            known = await self._ask_director(scene, known, **{doubt: host.name})
        return known if known.base_url != host.base_url else None

    async def _ask_director(self, scene: str, known: _Host, **about: str) -> _Host:
        """The director's answer, or the known host if it does not answer."""
        if scene in self._hosts:
            self._hosts[scene] = known = replace(known, asked_at=self._clock())  # concurrent requests need not ask
        try:
            answer = await self._http.get("/config.json", params={"scene": scene, **about}, timeout=ANSWER_S)
            config = parse(ServerConfig, answer.raise_for_status().content, MAX_BODY)
        except (httpx.HTTPError, TigasError):
            return known
        if len(self._hosts) >= MOST_SCENES:
            self._hosts.clear()
        self._hosts[scene] = host = _Host(config.host, config.render_url or "", self._clock())
        return host


class RenderClient:
    """A client of a render service or a cluster's director. Methods raise RenderUnavailable and RenderProblem."""

    def __init__(self, http: httpx.AsyncClient, name: str = "The render service", *, patient: bool = False) -> None:
        """name: as used in errors. patient: retry while the service is busy."""
        self._http = http
        self._hosts = SceneHosts(http)
        self._name = name
        self._patient = patient

    @classmethod
    @asynccontextmanager
    async def connect(cls, url: str) -> AsyncIterator[Self]:
        """Connect to a URL during the context, with retries. The caller may request MAX_CONCURRENT frames at a time."""
        limits = httpx.Limits(max_connections=MAX_CONCURRENT)
        async with httpx.AsyncClient(base_url=url, trust_env=False, verify=False, limits=limits) as http:
            yield cls(http, f"The render service at {url}", patient=True)

    async def config(self, timeout_s: float = FRAME_S) -> ServerConfig:
        return self._parse(ServerConfig, await self._send(lambda: self._http.get("/config.json", timeout=timeout_s)))

    async def scenes(self, timeout_s: float = FRAME_S) -> list[SceneInfo]:
        return self._parse(list[SceneInfo], await self._send(lambda: self._http.get("/scenes", timeout=timeout_s)))

    async def load(self, scene: str) -> SceneInfo:
        """Load a scene, and return its description."""
        path = f"/scenes/{quote(scene, safe='')}/load"
        ask = self._send(lambda: self._hosts.request(scene, "POST", path, content=None, timeout_s=LOAD_S))
        return self._parse(SceneInfo, await ask)

    async def prepare_download(self, scene: str) -> None:
        """Have a scene's download file made, which takes seconds for a large one."""
        path, first_byte = f"/scenes/{quote(scene, safe='')}/download/compressed", {"Range": "bytes=0-0"}
        await self._send(lambda: self._http.get(path, headers=first_byte, timeout=LOAD_S))

    async def frame(self, request: RenderRequest, timeout_s: float = FRAME_S) -> bytes:
        body = request.model_dump_json(exclude_none=True)
        return await self._send(
            lambda: self._hosts.request(request.scene, "POST", "/render", content=body, timeout_s=timeout_s)
        )

    async def _send(self, ask: Callable[[], Awaitable[httpx.Response]]) -> bytes:
        try:
            answer = await (send_with_retries(ask) if self._patient else ask())
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise RenderUnavailable(f"{self._name} does not answer ({str(error) or type(error).__name__}).") from None
        if answer.is_success:
            return answer.content
        try:
            problem = Problem.model_validate_json(answer.content)
        except ValidationError:
            raise RenderUnavailable(
                f"{self._name} answers with status {answer.status_code}, unlike a TIGAS render service."
            ) from None
        raise RenderProblem(problem)

    def _parse(self, kind: type[Message], content: bytes) -> Message:
        try:
            return parse(kind, content, MAX_LIST)
        except TigasError:
            raise RenderUnavailable(f"{self._name} is not a TIGAS render service.") from None


@contextmanager
def run_render_service(device: str = "auto", *, ladder: LadderName = "scene") -> Iterator[str]:
    """Run a render service on this machine until the context ends, and yield its URL. Raises StartError."""
    options = ["--http", "127.0.0.1:0", "--quic", "off", "--device", device, "--ladder", ladder]
    with run_process(
        tigas_command("render", *options), STOP_S, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        assert process.stdout is not None
        last = "no output"
        for line in process.stdout:
            last = line.decode(errors="replace").strip() or last
            if found := re.search(r"Open (http://\S+)/", last):
                break
        else:
            raise StartError(f"The render service did not start: {last}")
        threading.Thread(target=deque(maxlen=0).extend, args=(process.stdout,), daemon=True).start()
        yield found[1]
