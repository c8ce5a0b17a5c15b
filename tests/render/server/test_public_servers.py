"""The public servers of one process: every protocol serves the same application, and shows a renewed certificate."""

from __future__ import annotations

import asyncio
import contextlib
import ssl
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import httpx
import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from tests.render.transport.client import CERTIFICATE, FakeFrames, connect, request_body
from tests.render.transport.serving import hello
from tigas_common.address import Address
from tigas_common.origins import OriginPolicy
from tigas_render.admission.viewers import ViewerAdmission
from tigas_render.server.public_servers import run_public_servers
from tigas_render.server.public_sockets import PublicSockets
from tigas_render.settings import RenderSettings
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.shared_port import PortShare

pytestmark = pytest.mark.anyio


@dataclass(frozen=True)
class Served:
    sockets: PublicSockets
    renew: Callable[[Certificate], None]

    async def https_certificate(self) -> bytes:
        """The certificate shown to a new HTTPS connection."""
        assert self.sockets.https_port is not None
        return await asyncio.to_thread(
            lambda port: ssl.PEM_cert_to_DER_cert(ssl.get_server_certificate(("127.0.0.1", port))),
            self.sockets.https_port,
        )


@contextlib.asynccontextmanager
async def served(cache: Path, *, quic: bool = True) -> AsyncIterator[Served]:
    anywhere = Address("127.0.0.1", 0)
    settings = RenderSettings(cache=cache, http=anywhere, https=anywhere, quic=anywhere if quic else None)
    with PublicSockets.open(settings, 1) as sockets:
        async with run_public_servers(
            hello,
            FakeFrames(),
            ViewerAdmission(settings.quic_limits),
            settings,
            OriginPolicy(),
            certificate=CERTIFICATE,
            reset_key=bytes(32),
            http=sockets.http,
            https=sockets.https,
            quic=PortShare(sockets=sockets.quic[0]) if sockets.quic else None,
        ) as renew:
            yield Served(sockets, renew)


async def test_every_protocol_serves_the_application(tmp_path: Path) -> None:
    async with served(tmp_path) as server, httpx.AsyncClient(verify=False) as http:
        port, secure = server.sockets.http_port, server.sockets.https_port
        assert (await http.get(f"http://127.0.0.1:{port}/one")).text == "/one"
        assert (await http.get(f"https://127.0.0.1:{secure}/two")).text == "/two"
        assert server.sockets.quic_port is not None
        async with connect(server.sockets.quic_port) as client:
            assert (await client.fetch("GET", "/three")).body == b"/three"
            header, _ = await client.frame(await client.connect_webtransport(), request_body())
            assert header["status"] == 200


async def test_new_connections_of_every_protocol_see_a_renewed_certificate(tmp_path: Path) -> None:
    renewed = Certificate.create(["localhost"], datetime.now(UTC))
    async with served(tmp_path) as server:
        assert await server.https_certificate() == CERTIFICATE.x509.public_bytes(Encoding.DER)
        server.renew(renewed)
        assert await server.https_certificate() == renewed.x509.public_bytes(Encoding.DER)
        assert server.sockets.quic_port is not None
        async with connect(server.sockets.quic_port, certificate=renewed) as client:
            assert (await client.fetch("GET", "/")).status == 200


async def test_http_is_served_without_quic(tmp_path: Path) -> None:
    async with served(tmp_path, quic=False) as server, httpx.AsyncClient() as http:
        assert server.sockets.quic_port is None
        assert (await http.get(f"http://127.0.0.1:{server.sockets.http_port}/")).text == "/"
