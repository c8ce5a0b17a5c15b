"""Streams opened by a client without a first frame, on a simulated network."""

from __future__ import annotations

import asyncio

import pytest
from aioquic.h3.connection import ErrorCode, FrameType, StreamType, encode_frame
from aioquic.quic.events import QuicEvent, StreamReset
from starlette.types import Receive, Scope, Send

from tests.eventually import eventually
from tests.render.transport.aioquic_ext.test_h3 import frame_header, section
from tests.render.transport.simulated import Simulation
from tigas_render.admission.connections import Usage
from tigas_render.admission.limits import Limits
from tigas_render.transport.routing import Router, Service

pytestmark = pytest.mark.anyio

HALF_HEADERS = frame_header(FrameType.HEADERS, 1000) + bytes(500)
WHOLE_REQUEST = encode_frame(FrameType.HEADERS, section())


class Routed(Simulation):
    """A simulated connection with HTTP/3 on the server side."""

    router: Router

    def __init__(self, **limits: int) -> None:
        self.resets: dict[int, int] = {}
        self.seen: list[str] = []
        """Paths of requests, which are not answered."""
        super().__init__()
        self.usage = Usage("::/64")
        service = Service(self.app, {}, Limits(**limits))
        self.router = Router(self.server, service, ("::1", 1), ("::1", 2), self.usage, lambda: None)

    async def app(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.seen.append(scope["path"])
        await asyncio.Event().wait()

    def upload(self, data: bytes, is_unidirectional: bool = False) -> int:
        """The client opens a stream and sends something on it; the stream's id."""
        stream_id = self.client.get_next_available_stream_id(is_unidirectional)
        self.more(stream_id, data)
        return stream_id

    def more(self, stream_id: int, data: bytes) -> None:
        self.client.send_stream_data(stream_id, data)
        self.run()

    def wait(self, seconds: float) -> None:
        """The server's timer fires after this time."""
        self.now += seconds
        self.router.abort_late_streams(self.now)
        self.run()

    def _events(self) -> None:
        if hasattr(self, "router"):
            while (event := self.server.next_event()) is not None:
                self.router.handle_event(event, self.now)
            self.router.watch_streams(self.server.pop_gapped_streams(), self.now)
        super()._events()

    def _client_event(self, event: QuicEvent) -> None:
        super()._client_event(event)
        if isinstance(event, StreamReset):
            self.resets[event.stream_id] = event.error_code

    @property
    def terminated(self) -> int | None:
        """The server's close of the connection."""
        event = self.client._close_event
        return None if event is None else event.error_code


@pytest.mark.parametrize(
    "start",
    [HALF_HEADERS, b"\x01", frame_header(0x21, 1 << 30) + b"grease", frame_header(FrameType.WEBTRANSPORT_STREAM, 4)],
    ids=["half headers", "half a frame's header", "an unknown frame", "a session's stream without content"],
)
async def test_what_is_no_request_in_time_is_ended(start: bytes) -> None:
    routed = Routed()
    stream_id = routed.upload(start)
    for _ in range(9):
        routed.wait(1.0)
        if start == HALF_HEADERS:
            routed.more(stream_id, b"x")  # bytes that trickle in win no time
    assert routed.resets == {}
    routed.wait(1.1)
    assert routed.resets == {stream_id: ErrorCode.H3_REQUEST_INCOMPLETE}
    assert routed.router.next_deadline is None
    assert routed.terminated is None


@pytest.mark.parametrize("is_unidirectional", [False, True], ids=["request", "unidirectional"])
async def test_a_stream_whose_start_never_comes_is_ended(is_unidirectional: bool) -> None:
    """QUIC keeps its bytes without reporting it."""
    routed = Routed()
    stream_id = routed.client.get_next_available_stream_id(is_unidirectional)
    sender = routed.client._get_or_create_stream_for_send(stream_id).sender
    sender._buffer_start = sender._buffer_stop = 1  # so that it never sends the first byte
    routed.more(stream_id, bytes(1000))
    assert routed.usage.requests == 1
    routed.wait(10.1)
    assert routed.usage.requests == 0
    if is_unidirectional:
        assert routed.terminated == ErrorCode.H3_EXCESSIVE_LOAD
    else:
        assert routed.resets == {stream_id: ErrorCode.H3_REQUEST_INCOMPLETE}


async def test_what_one_connection_has_open_counts_for_its_address() -> None:
    routed = Routed(requests_per_address=3)
    routed.usage.requests = 1  # another connection's
    routed.upload(WHOLE_REQUEST)
    routed.upload(HALF_HEADERS)
    assert routed.usage.requests == 3
    rejected = routed.upload(HALF_HEADERS)
    assert routed.resets == {rejected: ErrorCode.H3_REQUEST_REJECTED}
    routed.router.close()
    await routed.router.cancel_tasks()
    assert routed.usage.requests == 1


async def test_unfinished_streams_count_as_requests() -> None:
    routed = Routed(requests=3)
    streams = [routed.upload(HALF_HEADERS) for _ in range(5)]
    assert routed.resets == dict.fromkeys(streams[3:], ErrorCode.H3_REQUEST_REJECTED)
    routed.wait(10.1)
    assert set(routed.resets) == set(streams)
    later = [routed.upload(HALF_HEADERS) for _ in range(3)]
    assert not set(routed.resets) & set(later), "the first have left room"


async def test_a_request_that_arrives_in_two_parts_is_a_request() -> None:
    routed = Routed(requests=1)
    stream_id = routed.upload(WHOLE_REQUEST[:5])
    routed.more(stream_id, WHOLE_REQUEST[5:])
    await eventually(lambda: routed.seen == ["/"])
    routed.wait(20.0)
    assert routed.resets == {}
    await routed.router.cancel_tasks()


async def test_settings_that_never_end_end_the_connection() -> None:
    routed = Routed()
    routed.upload(bytes([StreamType.CONTROL]) + frame_header(FrameType.SETTINGS, 100) + bytes(50), True)
    routed.wait(9.0)
    assert routed.terminated is None
    routed.wait(1.1)
    assert routed.terminated == ErrorCode.H3_EXCESSIVE_LOAD
