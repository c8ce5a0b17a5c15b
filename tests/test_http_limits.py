"""No service waits for ever for a client over HTTP/1.1, or gives one address every connection."""

from __future__ import annotations

import asyncio
import re
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.common.raw_client import ASK, PATIENCE_S, connected
from tests.every_service import SERVICES
from tests.prerequisites import LINUX
from tigas_common.address import Address
from tigas_common.command import load
from tigas_common.errors import UsageError
from tigas_common.limits import HttpLimits
from tigas_common.runner import serve_http
from tigas_dash.settings import DashSettings
from tigas_render.settings import RenderSettings

pytestmark = pytest.mark.anyio
PAGE = "http://localhost:8080"
LONG_S = 600


TAKES_A_BODY = {
    "render": "/render",
    "dash": "/sessions",
    "shaper": "/start",
    "store": "/experiments",
    "director": "/render",
}
Serve = Callable[..., AbstractAsyncContextManager[int]]


@pytest.fixture(params=SERVICES)
def service(request: pytest.FixtureRequest) -> str:
    """Each service."""
    return str(request.param)


@pytest.fixture
def serve(service: str, tmp_path: Path) -> Serve:
    """Serves it with limits; omitted ones have no effect in a test."""

    @asynccontextmanager
    async def serving(**limits: Any) -> AsyncIterator[int]:
        patient = {"header_s": LONG_S, "body_s": LONG_S, "idle_s": LONG_S, "unread_s": LONG_S}
        async with (
            SERVICES[service](tmp_path) as app,
            serve_http(app, Address("127.0.0.1", 0), HttpLimits(**patient | limits)) as port,
        ):
            yield port

    return serving


async def test_headers_that_never_end_are_given_up(serve: Serve) -> None:
    async with serve(header_s=0.3) as port, connected(port) as client:
        client.say(ASK[:-2])
        answer = await client.answer()
        assert (answer.status, answer.problem) == (408, "tigas:request-timeout")
        assert await client.ended() == b""


async def test_a_body_that_never_ends_is_given_up(serve: Serve, service: str) -> None:
    async with serve(body_s=0.3) as port, connected(port) as client:
        head = (
            f"POST {TAKES_A_BODY[service]} HTTP/1.1\r\nHost: localhost\r\nOrigin: {PAGE}\r\nContent-Length: 9\r\n\r\n"
        )
        client.say(head.encode() + b"{")
        answer = await client.answer()
        assert (answer.status, answer.problem) == (408, "tigas:request-timeout")
        assert await client.ended() == b""


async def test_a_connection_that_asks_nothing_more_is_closed(serve: Serve) -> None:
    async with serve(idle_s=1) as port, connected(port) as client:
        client.say(ASK)
        assert (await client.answer()).status == 200
        assert await client.ended() == b""


@LINUX.mark
async def test_a_client_that_reads_nothing_loses_its_connection(serve: Serve) -> None:
    async with serve(unread_s=0.5) as port:
        with socket.socket() as stuck:
            stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)  # the least that the system gives
            stuck.connect(("127.0.0.1", port))
            stuck.sendall(ASK * 100)

            def is_served() -> bool:
                return any(one.raddr == stuck.getsockname() for one in psutil.Process().net_connections("tcp"))

            deadline = time.monotonic() + PATIENCE_S
            for wanted in (True, False):
                while is_served() != wanted:
                    assert time.monotonic() < deadline
                    await asyncio.sleep(0.05)


async def test_a_thousand_connections_of_one_address_leave_room_for_others(serve: Serve) -> None:
    async with serve(connections_per_address=20) as port, AsyncExitStack() as stack:
        crowd = [await stack.enter_async_context(connected(port)) for _ in range(1000)]
        refused = [await client.answer() for client in crowd[20:]]
        assert {(answer.status, answer.problem) for answer in refused} == {(503, "tigas:too-many-connections")}
        polite = await stack.enter_async_context(connected(port, "127.0.0.2"))
        for client in (polite, *crowd[:20]):
            client.say(ASK)
            assert (await client.answer()).status == 200


def test_one_address_cannot_take_every_connection() -> None:
    assert HttpLimits().connections_per_address <= HttpLimits().connections / 4


def test_limits_are_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tigas.toml").write_text("[dash.http_limits]\nconnections = 3\n[render]\nidle_minutes = 1\n")
    assert HttpLimits.of(load(DashSettings, {}).http_limits) == HttpLimits(connections=3)
    monkeypatch.setenv("TIGAS_RENDER_HTTP_LIMITS", '{"connections": 9}')
    assert HttpLimits.of(load(RenderSettings, {}).http_limits) == HttpLimits(connections=9)


@pytest.mark.parametrize("table", ["http_limits.header_s", "quic_limits.idle_timeout"])
def test_constants_are_no_settings(table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tigas.toml").write_text(f"[render]\n{table} = 3\n")
    with pytest.raises(UsageError, match=f"^{re.escape(table)}: Extra inputs are not permitted"):
        load(RenderSettings, {})
