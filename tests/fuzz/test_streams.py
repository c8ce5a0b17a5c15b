"""DASH streams are opened, read, steered, stopped and ended in any order: no encoder, thread or task is left behind."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from collections.abc import AsyncIterator
from typing import Any
from unittest.mock import Mock

import httpx
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, initialize, invariant, rule
from starlette.types import ASGIApp, Message

from tests.dash.conftest import session_request
from tests.dash.fakes import FakeRender
from tests.fuzz.asgi import LONGEST_S, ask, assert_answered
from tests.fuzz.fuzzers import assert_sentence, effort
from tests.fuzz.json_texts import bodies
from tests.fuzz.wire_examples import EXAMPLES
from tigas_common.errors import Overloaded
from tigas_common.origins import OriginPolicy
from tigas_common.render_requests import RenderClient
from tigas_common.wire.dash import PoseUpdate
from tigas_dash.app import create_app
from tigas_dash.clock import Clock
from tigas_dash.sessions import Sessions
from tigas_dash.webrtc.stream import WebRtcServer

LIMIT = 3
NUMBERS = ("0", "1", "2", "3", "4", "9", "-1", "01", "1e1", "999999999999", "9999999999999", "٣", "", "x", "1.m4s")
REPRESENTATIONS = ("r3-500", "r3-501", "r0-1", "", "..", "init.mp4")
MESSAGES = bodies(PoseUpdate, EXAMPLES[PoseUpdate])


@contextlib.asynccontextmanager
async def packaging(render: FakeRender) -> AsyncIterator[Sessions]:
    transport = httpx.ASGITransport(render.app, raise_app_exceptions=False)
    async with (
        httpx.AsyncClient(transport=transport, base_url="http://render") as upstream,
        Sessions(RenderClient(upstream), "libx264", Clock(), limit=LIMIT, idle_s=600).run() as sessions,
    ):
        yield sessions


class Socket:
    """A pose socket's client."""

    def __init__(self, app: ASGIApp, path: str) -> None:
        self.to_server: asyncio.Queue[Message] = asyncio.Queue()
        self.answers: list[dict[str, Any]] = []
        self.closed: Message | None = None
        scope = {
            **{
                "type": "websocket",
                "asgi": {"version": "3.0", "spec_version": "2.3"},
                "path": path,
                "query_string": b"",
            },
            **{
                "raw_path": path.encode(),
                "headers": [(b"host", b"localhost:8082")],
                "subprotocols": [],
                "root_path": "",
            },
            **{"client": ("192.0.2.1", 1), "server": ("127.0.0.1", 8082), "scheme": "ws", "http_version": "1.1"},
        }
        self.to_server.put_nowait({"type": "websocket.connect"})
        self.task = asyncio.ensure_future(app(scope, self.to_server.get, self._send))

    async def _send(self, message: Message) -> None:
        if message["type"] == "websocket.send":
            self.answers.append(json.loads(message["text"]))
        elif message["type"] != "websocket.accept":
            self.closed = message

    async def leave(self) -> None:
        self.to_server.put_nowait({"type": "websocket.disconnect", "code": 1006})
        async with asyncio.timeout(LONGEST_S):
            await self.task


class StreamMachine(RuleBasedStateMachine):
    """A packager and all that may be done with it."""

    sessions = Bundle("sessions")
    sockets = Bundle("sockets")

    @initialize()
    def begin(self) -> None:
        self.threads = threading.active_count()
        self.runner = asyncio.Runner()
        self.render = FakeRender()
        self.context = packaging(self.render)
        self.running = self.runner.run(self._enter())
        self.app = create_app(self.running, OriginPolicy(), Mock(spec=WebRtcServer))
        self.open_sockets: list[Socket] = []
        self.readers: list[asyncio.Task[Any]] = []

    async def _enter(self) -> Sessions:
        return await self.context.__aenter__()

    def ask(self, method: str, path: str, **more: Any) -> Any:
        answer = self.runner.run(ask(self.app, method, path, **more))
        assert_answered(answer, "too-many-sessions", "overloaded", "render-unavailable")
        return answer

    @rule(
        target=sessions,
        changes=st.sampled_from(({}, {"frame_rate": 60}, {"segment_s": 0.2}, {"representations": None})),
    )
    def open(self, changes: dict[str, Any]) -> str:
        small = {"width": 64, "height": 36, "representations": [{"rung": 3, "bitrate_kbps": 500}]}
        body = json.dumps(session_request(**{**small, **changes})).encode()
        count = len(self.running.all())
        answer = self.ask("POST", "/sessions", chunks=[body])
        if answer.status != 201:
            assert count == LIMIT or self.render.error
            return "never-was"
        return str(json.loads(answer.body)["id"])

    @rule(session=sessions, representation=st.sampled_from(REPRESENTATIONS), number=st.sampled_from(NUMBERS))
    def read(self, session: str, representation: str, number: str) -> None:
        """Begin to read a segment; it goes on while other things happen."""

        async def begin() -> None:
            path = f"/sessions/{session}/{representation}/{number}.m4s"
            self.readers.append(asyncio.create_task(ask(self.app, "GET", path)))
            await asyncio.sleep(0)

        self.runner.run(begin())

    @rule(session=sessions, path=st.sampled_from(("", "/manifest.mpd", "/r3-500/init.mp4", "/poses", "/x")))
    def look(self, session: str, path: str) -> None:
        self.ask("GET", f"/sessions/{session}{path}")

    @rule(target=sockets, session=sessions)
    def watch(self, session: str) -> Socket:
        async def connect() -> Socket:
            return Socket(self.app, f"/sessions/{session}/poses")

        socket = self.runner.run(connect())
        self.open_sockets.append(socket)
        return socket

    @rule(socket=sockets, message=MESSAGES, binary=st.booleans())
    def steer(self, socket: Socket, message: bytes, binary: bool) -> None:
        text = message.decode("utf-8", "replace")
        socket.to_server.put_nowait(
            {"type": "websocket.receive", "bytes": message} if binary else {"type": "websocket.receive", "text": text}
        )

    @rule(socket=consumes(sockets))
    def leave(self, socket: Socket) -> None:
        self.runner.run(socket.leave())

    @rule(session=sessions)
    def end(self, session: str) -> None:
        known = session in {one.name for one in self.running.all()}
        assert self.ask("DELETE", f"/sessions/{session}").status == (204 if known else 404)

    @rule(fails=st.booleans())
    def render_fails(self, fails: bool) -> None:
        self.render.error = Overloaded("Too many requests are waiting.") if fails else None

    @rule()
    def stream(self) -> None:
        """Let some frames be made."""
        self.runner.run(asyncio.sleep(0.02))

    @invariant()
    def there_are_no_more_streams_than_may_be(self) -> None:
        if hasattr(self, "running"):
            assert len(self.running.all()) <= LIMIT

    def teardown(self) -> None:
        if not hasattr(self, "running"):
            return
        with self.runner:
            self.runner.run(self._end_everything())
        encoders = [thread for thread in threading.enumerate() if thread.name.startswith("encoder-")]
        for thread in encoders:
            thread.join(5)
            assert not thread.is_alive(), "an encoder was left behind"
        assert threading.active_count() <= self.threads, "a thread was left behind"

    async def _end_everything(self) -> None:
        async with asyncio.timeout(LONGEST_S):
            for session in list(self.running.all()):
                await self.running.end(session.name)
            for answer in await asyncio.gather(*self.readers):
                assert_answered(answer)
            for socket in self.open_sockets:
                if not socket.task.done():
                    await socket.leave()
                for told in socket.answers:
                    if "frame" not in told:
                        assert 400 <= told["status"] < 500
                        assert_sentence(told["detail"])
            await self.context.__aexit__(None, None, None)
            while len(left := asyncio.all_tasks()) > 1:  # this one
                await asyncio.wait(left, timeout=0.05)


TestStreams = StreamMachine.TestCase
TestStreams.settings = effort(8)
