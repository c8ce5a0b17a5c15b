"""The measured render service: a running one, or one started with given options."""

from __future__ import annotations

import socket
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urlsplit

import httpx

from benchmarks.services import Service, free_ports
from benchmarks.services import started as started_service
from tigas_common.errors import StartError
from tigas_common.wire.render import SceneInfo, ServerConfig

LOAD_S = 300


@dataclass(frozen=True, slots=True)
class Server:
    """A running service."""

    name: str
    """As the report calls it."""
    url: str
    """Its API's, without a slash at the end."""
    service: Service | None = None
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
        """IP address and port of HTTP/3. Raises StartError."""
        url = urlsplit(self.config().webtransport_url or "")
        if not (url.hostname and url.port):
            raise StartError(f"{self.url} has no HTTP/3 for this machine.")
        return socket.gethostbyname(url.hostname), url.port

    def scene(self, scene_id: str | None) -> SceneInfo:
        """A scene, or the first, loaded. Raises StartError."""
        with self._http() as http:
            if scene_id is None:
                scene_id = str(http.get("/scenes").raise_for_status().json()[0]["id"])
            loaded = http.post(f"/scenes/{quote(scene_id)}/load").raise_for_status()
            return SceneInfo.model_validate_json(loaded.content)


@contextmanager
def started(name: str, options: Sequence[str]) -> Iterator[Server]:
    """`tigas render` on free ports of this machine, until the context ends. Raises StartError."""
    http, quic = free_ports(socket.SOCK_STREAM, socket.SOCK_DGRAM)
    listens = ("--http", f"127.0.0.1:{http}", "--quic", f"127.0.0.1:{quic}")
    with (
        tempfile.NamedTemporaryFile(prefix="tigas-load-", suffix=".log") as log,
        started_service("render", *listens, *options, log=Path(log.name)) as service,
    ):
        service.wait_until_healthy(http)
        yield Server(name, f"http://127.0.0.1:{http}", service)
