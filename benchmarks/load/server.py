"""The measured render service: a running one, or one started with given options."""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urlsplit

import httpx
import psutil

from tigas_common.errors import StartError
from tigas_common.processes import running, tigas
from tigas_common.wire.render import SceneInfo, ServerConfig

START_S = 180
"""The first start on a machine compiles the rasteriser."""
LOAD_S = 300
STOP_S = 10
OPEN = "Open "
"""Prefix of the line with the service's URL."""
HERE = ("--http", "127.0.0.1:0", "--quic", "127.0.0.1:0")


@dataclass(frozen=True, slots=True)
class Server:
    """A running service."""

    name: str
    """As the report calls it."""
    url: str
    """Its API's, without a slash at the end."""
    process: psutil.Process | None = None
    """If it was started here."""

    @contextmanager
    def _http(self) -> Iterator[httpx.Client]:
        try:
            with httpx.Client(base_url=self.url, trust_env=False, timeout=LOAD_S) as http:
                yield http
        except httpx.HTTPError as error:
            raise StartError(f"{self.name} at {self.url} does not answer: {error or type(error).__name__}.") from None

    def config(self) -> ServerConfig:
        """Its configuration. Raises StartError."""
        with self._http() as http:
            return ServerConfig.model_validate_json(http.get("/config.json").raise_for_status().content)

    def address(self) -> tuple[str, int]:
        """Host and port of HTTP/3. Raises StartError."""
        url = urlsplit(self.config().webtransport_url or "")
        if not (url.hostname and url.port):
            raise StartError(f"{self.url} has no HTTP/3 for this machine.")
        return url.hostname, url.port

    def scene(self, scene_id: str | None) -> SceneInfo:
        """A scene, or the first, loaded. Raises StartError."""
        with self._http() as http:
            if scene_id is None:
                scene_id = str(http.get("/scenes").raise_for_status().json()[0]["id"])
            loaded = http.post(f"/scenes/{quote(scene_id)}/load").raise_for_status()
            return SceneInfo.model_validate_json(loaded.content)

    def cpu_s(self) -> float | None:
        """Seconds that its processes have computed, in user and kernel mode; None if it runs elsewhere."""
        if self.process is None:
            return None
        total = 0.0
        for process in (self.process, *self.process.children(recursive=True)):
            try:
                times = process.cpu_times()
            except psutil.NoSuchProcess:
                continue
            total += times.user + times.system
        return total


@contextmanager
def started(name: str, options: Sequence[str]) -> Iterator[Server]:
    """`tigas render` on free ports of this machine, until the context ends. Raises StartError."""
    with (
        tempfile.NamedTemporaryFile(prefix="tigas-load-", suffix=".log") as log,
        running(tigas("render", *HERE, *options), STOP_S, stdout=log, stderr=log) as process,
    ):
        yield Server(name, _url(process, Path(log.name)), psutil.Process(process.pid))


def _url(process: subprocess.Popen[bytes], log: Path) -> str:
    """The service's output once it serves. Raises StartError."""
    late = time.monotonic() + START_S
    while time.monotonic() < late:
        lines = log.read_text(errors="replace").splitlines()
        for line in lines:
            if line.startswith(OPEN):
                return line.removeprefix(OPEN).strip().rstrip("/")
        if process.poll() is not None:
            raise StartError("tigas render does not start: " + " ".join(lines[-3:]))
        time.sleep(0.1)
    raise StartError(f"tigas render has not started within {START_S} s.")
