"""Pictures come from the real service, over HTTP/3 where that works and otherwise over HTTP/1.1."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

import tigas
from tests.client.conftest import CERTIFICATE, Served
from tigas import http3
from tigas_common.address import Address
from tigas_common.errors import Overloaded, problem
from tigas_common.limits import HttpLimits
from tigas_common.pose import Pose
from tigas_common.runner import serve_http
from tigas_common.web import problem_response
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.server import Http3Server

pytestmark = pytest.mark.anyio

AHEAD = Pose.look_at((0, 0, 0), (0, 0, 3), (0, -1, 0))
WALL = tigas.View(scene="wall", size=(64, 36))
EXACT = tigas.View(scene="wall", size=(64, 36), format="png")


def is_red(pixel: object) -> bool:
    assert isinstance(pixel, tuple)
    red, green, blue = pixel
    return bool(red > 150 and green < 60 and blue < 60)


async def test_a_picture_is_what_is_seen_from_the_pose(served: Served) -> None:
    async with tigas.AsyncClient(served.url) as client:
        wall = await client.render(await client.start_pose("wall"), **WALL)
        behind = await client.render(Pose.look_at((0, 0, 0), (0, 0, -3), (0, -1, 0)), **EXACT)
    assert (wall.size, wall.mode) == ((64, 36), "RGB")
    assert is_red(wall.getpixel((32, 18)))
    assert behind.getpixel((32, 18)) == (0, 0, 255)


async def test_frames_come_over_http3_and_are_the_same_over_http1(served: Served) -> None:
    async with tigas.AsyncClient(served.url) as client, tigas.AsyncClient(served.url, http3=False) as plain:
        quick = await client.frame(AHEAD, **EXACT)
        slow = await plain.frame(AHEAD, **EXACT)
    assert (quick.protocol, slow.protocol) == ("HTTP/3", "HTTP/1.1")
    assert (quick.body, quick.content_type) == (slow.body, "image/png")
    assert quick.timing.render > 0


async def test_a_server_with_another_certificate_is_asked_nothing(served: Served) -> None:
    served.service.set_certificate(Certificate.create([], datetime.now(UTC)))
    async with tigas.AsyncClient(served.url) as client:
        assert (await client.frame(AHEAD, **WALL)).protocol == "HTTP/1.1"


async def test_where_http3_ends_the_visit_goes_on(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http3, "CONNECT_S", 0.2)  # nobody answers any more
    async with tigas.AsyncClient(served.url) as client:
        assert (await client.frame(AHEAD, **WALL)).protocol == "HTTP/3"
        await served.http3.aclose()
        assert (await client.frame(AHEAD, **WALL)).protocol == "HTTP/1.1"


async def test_a_connection_that_has_ended_is_replaced_and_its_socket_closed(served: Served) -> None:
    async with tigas.AsyncClient(served.url) as client:
        await client.frame(AHEAD, **WALL)
        hosts = client._http3
        assert hosts is not None
        [(first, _)] = hosts._connections.values()
        first.close()  # as after a pause of half a minute
        assert (await client.frame(AHEAD, **WALL)).protocol == "HTTP/3"
        [(second, _)] = hosts._connections.values()
        assert second is not first
        assert first._transport is not None
        assert first._transport.is_closing()


async def test_a_host_without_room_for_more_is_asked_over_http1_where_another_may_have(served: Served) -> None:
    async def full(request: Request) -> Response:
        return problem_response(problem(Overloaded("Full.")))

    full_app = Starlette(routes=[Route("/render", full, methods=["POST"])])
    async with Http3Server(full_app, host="127.0.0.1", certificate=CERTIFICATE) as other:
        served.service.quic_port = other.port
        async with tigas.AsyncClient(served.url) as client:
            assert (await client.frame(AHEAD, **WALL)).protocol == "HTTP/1.1"


async def test_the_pictures_of_a_path_come_in_its_order(served: Served) -> None:
    turns = [AHEAD, *(Pose.from_euler(180, 0, 0, (0, 0, 0)) for _ in range(4)), AHEAD]
    async with tigas.AsyncClient(served.url) as client:
        seen = [is_red(picture.getpixel((32, 18))) async for picture in client.render_path(iter(turns), **WALL)]
    assert seen == [True, False, False, False, False, True]


async def test_what_the_service_refuses_is_said_as_the_service_says_it(served: Served) -> None:
    async with tigas.AsyncClient(served.url) as client:
        with pytest.raises(tigas.Refused, match="no scene 'attic'") as refused:
            await client.render(AHEAD, scene="attic")
        assert (refused.value.type, refused.value.status) == ("tigas:unknown-scene", 404)
        with pytest.raises(tigas.ClientError, match=r"^Choose a scene: courtyard, wall\.$"):
            await client.render(AHEAD)
        with pytest.raises(ValueError, match=r"^width: input should be greater than or equal to 1\.$"):
            await client.render(AHEAD, scene="wall", size=(0, 36))


async def test_nobody_and_strangers_are_named_in_a_sentence() -> None:
    async with tigas.AsyncClient("http://127.0.0.1:9") as client:
        with pytest.raises(tigas.Unreachable, match=r"^The render service at http://127\.0\.0\.1:9 does not answer"):
            await client.scenes()

    async def hello(request: Request) -> Response:
        return PlainTextResponse("hello")

    everything = Route("/{path:path}", hello, methods=["GET", "POST"])
    async with answering(everything) as url, tigas.AsyncClient(url) as client:
        with pytest.raises(tigas.Unreachable, match="is not a TIGAS render service"):
            await client.scenes()
        with pytest.raises(tigas.Unreachable, match="is not a TIGAS render service"):
            await client.render(AHEAD, **WALL)


async def test_a_service_without_time_is_asked_again(served: Served) -> None:
    asked = 0
    async with tigas.AsyncClient(served.url) as client:
        good = await client.frame(AHEAD, **WALL)

    async def render(request: Request) -> Response:
        nonlocal asked
        asked += 1
        if asked == 3:
            return Response(good.body, media_type="image/jpeg")
        return problem_response(problem(Overloaded("Later.")), {"Retry-After": "0"})

    async with answering(Route("/render", render, methods=["POST"])) as url, tigas.AsyncClient(url) as client:
        assert (await client.frame(AHEAD, **WALL)).body == good.body
    assert asked == 3


async def test_however_many_are_asked_for_at_once_the_service_has_a_few_at_a_time() -> None:
    now = most = 0
    four = asyncio.Event()

    async def render(request: Request) -> Response:
        nonlocal now, most
        now += 1
        most = max(most, now)
        if now == 4:
            four.set()
        await four.wait()
        await asyncio.sleep(0.01)  # for a fifth to come, if one does
        now -= 1
        return Response(b"frame")

    async with answering(Route("/render", render, methods=["POST"])) as url, tigas.AsyncClient(url) as client:
        frames = await asyncio.gather(*(client.frame(AHEAD, **WALL) for _ in range(12)))
    assert [frame.body for frame in frames] == [b"frame"] * 12
    assert most == 4


@asynccontextmanager
async def answering(route: Route) -> AsyncIterator[str]:
    """The URL of something else."""
    async with serve_http(Starlette(routes=[route]), Address("127.0.0.1", 0), HttpLimits()) as port:
        yield f"http://127.0.0.1:{port}"


async def test_a_request_after_closing_gets_one_sentence(served: Served) -> None:
    client = tigas.AsyncClient(served.url)
    await client.frame(AHEAD, **WALL)
    await client.aclose()
    with pytest.raises(tigas.ClientError, match="The client was closed"):
        await client.frame(AHEAD, **WALL)
