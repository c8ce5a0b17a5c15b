"""Any bytes of a client at worst end its own HTTP/3 connection; and their segmentation does not matter."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import tracemalloc
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from typing import Any

import pylsqpack
import pytest
from aioquic.buffer import encode_uint_var
from aioquic.h3.connection import ErrorCode, FrameType, Setting, StreamType, encode_frame, encode_settings
from aioquic.h3.events import DataReceived, H3Event, HeadersReceived, WebTransportStreamDataReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.events import StreamDataReceived
from hypothesis import given
from hypothesis import strategies as st
from starlette.types import Receive, Scope, Send

from tests.fuzz.asgi import LONGEST_S, opened
from tests.fuzz.byte_edits import chunked, edited
from tests.fuzz.fuzzers import effort, found
from tests.render.transport.client import CERTIFICATE, Client, FakeFrames, connect, request_body
from tigas.http3 import Response
from tigas_render.admission.limits import Limits
from tigas_render.transport.aioquic_ext.h3 import MAX_FIELD_SECTION, ServerH3Connection
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server

FIELDS = [(b":method", b"POST"), (b":scheme", b"https"), (b":authority", b"localhost"), (b":path", b"/render")]
SESSION = [(b":method", b"CONNECT"), (b":protocol", b"webtransport"), *FIELDS[1:]]
FILL = 2 * MAX_FIELD_SECTION
"""Bytes that follow on open streams; no server keeps that many."""
MOST_MEMORY = 8_000_000
"""Memory limit for one client of this test, which sends some hundred kilobytes at most."""


def headers(*fields: tuple[bytes, bytes]) -> bytes:
    return encode_frame(FrameType.HEADERS, pylsqpack.Encoder().encode(0, list(fields))[1])


def frame_header(frame_type: int, size: int) -> bytes:
    return encode_uint_var(frame_type) + encode_uint_var(size)


GREASE = frame_header(0x21, 3) + b"abc"
"""A frame of an unknown type (RFC 9114, 9)."""
SETTINGS = encode_settings(
    {Setting.QPACK_MAX_TABLE_CAPACITY: 4096, Setting.H3_DATAGRAM: 1, Setting.ENABLE_WEBTRANSPORT: 1}
)
STREAMS: dict[int, bytes] = {
    2: encode_uint_var(StreamType.CONTROL) + encode_frame(FrameType.SETTINGS, SETTINGS) + GREASE,
    6: encode_uint_var(StreamType.QPACK_ENCODER),
    10: encode_uint_var(StreamType.QPACK_DECODER),
    0: headers(*FIELDS) + encode_frame(FrameType.DATA, request_body()) + GREASE + headers((b"x-end", b"1")),
    4: headers(*SESSION),
    8: encode_uint_var(FrameType.WEBTRANSPORT_STREAM) + encode_uint_var(4) + request_body(seq=3),
    14: encode_uint_var(StreamType.WEBTRANSPORT) + encode_uint_var(4) + b"unidirectional",
}  # fmt: skip
"""A valid client's bytes, by stream."""
SECTION = pylsqpack.Encoder().encode(0, FIELDS)[1]
PIECES = (
    *(frame_header(kind, size) for kind in (*range(8), 0xD, 0x21, 0x41) for size in (0, 1, 63, 64, 16_385, 1 << 30)),
    *(frame_header(FrameType.HEADERS, (1 << 62) - 1), encode_uint_var((1 << 62) - 1), b"\xff", b"\x80\x00\x00\x00"),
    *(headers(), headers(*FIELDS), headers(*SESSION), headers((b":path", b"//["))),
    *(headers((b"X", b"\r\n")), headers(*FIELDS * 2)),
    *(encode_frame(FrameType.HEADERS, SECTION + b"\xfa" * 1000), encode_frame(FrameType.HEADERS, b"\x02\x00\x80")),
    *(b"\x3f\xe1\x1f", b"\xc0\x01\x00", b"\x80" * 64, encode_frame(FrameType.SETTINGS, b"\x01\x40")),
)  # fmt: skip
METHODS = (b"GET", b"POST", b"CONNECT", b"CONNECT", b"HEAD", b"get", b"", b"\xff", b"M" * 300)
PATHS = (
    b"/",
    b"/render",
    b"/render?x",
    b"//[",
    b"/\xff",
    b"/%ff",
    b"%00",
    b"",
    b"*",
    b"http://[::1",
    b"/\x7f",
    b"p" * 9000,
)
HOSTS = (b"localhost", b"[", b"", b"a:b:c", b"\xff", b"h" * 9000)
OTHERS = ((b":protocol", b"webtransport"), (b":protocol", b"x"), (b":status", b"200"), (b":x", b""), (b"X", b"upper"))
MORE = (
    (b"content-length", b"-1"),
    (b"content-length", b"9"),
    (b"te", b"x"),
    (b"a", b"\r\n"),
    (b"host", b"x"),
)


@st.composite
def requests(draw: st.DrawFn) -> bytes:
    """A header section with wrong, reordered, repeated or missing fields, and the rest of the stream."""
    fields = [
        (b":method", draw(st.sampled_from(METHODS))),
        (b":scheme", draw(st.sampled_from((b"https", b"https", b"", b"ftp")))),
        (b":authority", draw(st.sampled_from(HOSTS[:1] * 5 + HOSTS))),
        (b":path", draw(st.sampled_from(PATHS))),
        *draw(st.lists(st.sampled_from(OTHERS[:1] * 3 + OTHERS), max_size=2)),
    ]
    if draw(st.integers(0, 3)) == 0:
        fields = draw(st.permutations(fields))[draw(st.integers(0, 1)) :]
    fields += draw(st.lists(st.sampled_from(MORE), max_size=1))
    return headers(*fields) + draw(st.sampled_from((b"", STREAMS[0], request_body(), *PIECES)))


def damaged(content: bytes) -> st.SearchStrategy[bytes]:
    """A stream's bytes after a few edits, or with whole misplaced frames."""
    frames = st.lists(st.sampled_from(PIECES), min_size=1, max_size=4).map(b"".join)
    return edited(st.just(content), PIECES) | frames | frames.map(lambda pieces: content + pieces)


@st.composite
def conversations(draw: st.DrawFn) -> dict[int, tuple[bytes, bool]]:
    """Bytes of each stream, and whether it ends; some streams are damaged."""
    sent: dict[int, tuple[bytes, bool]] = {}
    for stream_id, content in STREAMS.items():
        if draw(st.integers(0, 3)) == 0:
            content = draw(requests() | damaged(content) if stream_id % 4 == 0 else damaged(content))
        sent[stream_id] = content, stream_id % 4 == 0 and stream_id != 4 and draw(st.booleans())
    return sent


@st.composite
def orders(draw: st.DrawFn, sent: dict[int, tuple[bytes, bool]]) -> list[tuple[int, bytes, bool]]:
    """The same in pieces, the streams' pieces shuffled among each other: (stream, data, whether it ends)."""
    pieces = {
        stream_id: [(stream_id, data, ends and number == len(cut)) for number, data in enumerate(cut, 1)]
        for stream_id, (content, ends) in sent.items()
        for cut in [draw(chunked(content))]
    }
    turns = draw(st.permutations([stream_id for stream_id, cut in pieces.items() for _ in cut]))
    return [pieces[stream_id].pop(0) for stream_id in turns]


# -- the protocol ------------------------------------------------------------------------------------------------------


class SilentQuic:
    """A connection that sends nothing and remembers how it was closed."""

    _quic_logger = None
    _remote_max_datagram_frame_size = 65536

    def __init__(self) -> None:
        self.configuration = QuicConfiguration(is_client=False)
        self.closed: int | None = None
        self._streams = iter(range(3, 1000, 4))

    def get_next_available_stream_id(self, is_unidirectional: bool = False) -> int:
        return next(self._streams)

    def send_stream_data(self, stream_id: int, data: bytes, end_stream: bool = False) -> None:
        pass

    def close(self, error_code: int = 0, frame_type: int | None = None, reason_phrase: str = "") -> None:
        self.closed = error_code if self.closed is None else self.closed


@dataclass
class Heard:
    """The server's interpretation, independent of segmentation."""

    closed: int | None = None
    headers: dict[int, list[Any]] = field(default_factory=lambda: defaultdict(list))
    data: dict[int, bytes] = field(default_factory=lambda: defaultdict(bytes))
    sessions: dict[int, int] = field(default_factory=dict)
    ended: set[int] = field(default_factory=set)
    kept: int = field(default=0, compare=False)
    """The most bytes of a stream that waited for the rest of a frame."""

    def add(self, event: H3Event) -> None:
        match event:
            case HeadersReceived():
                self.headers[event.stream_id].append(event.headers)
            case DataReceived():
                self.data[event.stream_id] += event.data
            case WebTransportStreamDataReceived():
                self.sessions[event.stream_id] = event.session_id
                self.data[event.stream_id] += event.data
        if getattr(event, "stream_ended", False):
            self.ended.add(event.stream_id)  # type: ignore[attr-defined]


def hear(pieces: list[tuple[int, bytes, bool]]) -> Heard:
    """Give a server pieces of streams until it closes the connection."""
    quic, heard = SilentQuic(), Heard()
    h3 = ServerH3Connection(quic, enable_webtransport=True)  # type: ignore[arg-type]
    for stream_id, data, ends in pieces:
        if quic.closed is None:
            for event in h3.handle_event(StreamDataReceived(data=data, end_stream=ends, stream_id=stream_id)):
                heard.add(event)
            if quic.closed is None:
                heard.kept = max(heard.kept, *(len(stream.buffer) for stream in h3._stream.values()))
    heard.closed = quic.closed
    return heard


def test_what_a_sound_client_sends_is_understood() -> None:
    heard = hear([(stream_id, content, stream_id in (0, 8)) for stream_id, content in STREAMS.items()])
    assert heard.closed is None
    assert (heard.headers[0][0], heard.headers[4]) == (FIELDS, [SESSION])
    assert (heard.data[0], heard.data[8], heard.sessions[8]) == (request_body(), request_body(seq=3), 4)
    assert heard.ended == {0, 8}


@effort(150)
@given(st.data())
def test_how_streams_are_cut_changes_nothing(data: st.DataObject) -> None:
    sent = data.draw(conversations())
    whole = hear([(stream_id, content, ends) for stream_id, (content, ends) in sent.items()])
    cut = hear(data.draw(orders(sent)))
    assert (whole.closed is None) == (cut.closed is None)
    if whole.closed is None:
        assert whole == cut


def opening(kind: int) -> Callable[[bytes], list[tuple[int, bytes, bool]]]:
    """A stream of the client's own before many requests."""
    requests = [(4 * n, STREAMS[0], True) for n in range(50)]
    return lambda content: [(2, encode_uint_var(kind) + content, False), *requests]


@effort(100)
@given(pieces=conversations().flatmap(orders))
@found("http3-request", pieces=lambda content: [(0, content, False)])
@found("http3-control", pieces=opening(StreamType.CONTROL))
@found("http3-control", pieces=opening(StreamType.QPACK_ENCODER))
def test_what_a_client_sends_costs_no_memory_beyond_it(pieces: list[tuple[int, bytes, bool]]) -> None:
    endless = [
        (stream_id, b"\x21" * FILL, False)
        for stream_id in (0, 2)
        if (stream_id, True) not in {(p[0], p[2]) for p in pieces}
    ]
    tracemalloc.start()
    heard = hear(pieces + endless)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < MOST_MEMORY
    assert heard.kept < FILL
    for sections in heard.headers.values():
        assert all(sum(len(name) + len(value) + 32 for name, value in one) <= MAX_FIELD_SECTION for one in sections)


# -- the server --------------------------------------------------------------------------------------------------------


async def reads_and_answers(scope: Scope, receive: Receive, send: Send) -> None:
    while (message := await receive())["type"] == "http.request" and message["more_body"]:
        pass
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"read"})


@asynccontextmanager
async def serving() -> AsyncIterator[Client]:
    """A client that means well, of a server that others attack."""
    sessions = {"/render": render_session(FakeFrames())}
    async with (
        Http3Server(
            reads_and_answers, host="127.0.0.1", certificate=CERTIFICATE, webtransport=sessions, limits=Limits()
        ) as server,
        connect(server.port) as polite,
    ):
        polite.server_port = server.port  # type: ignore[attr-defined]
        yield polite


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[Client, Callable[..., Any]]]:
    with opened(serving()) as (polite, run):
        yield polite, run


Sent = list[tuple[str, bytes, bool]]
"""Kinds of streams, their bytes, and whether they end."""


def sending(kinds: tuple[str, ...], data: st.SearchStrategy[bytes]) -> st.SearchStrategy[tuple[str, bytes, bool]]:
    return st.tuples(st.sampled_from(kinds), data, st.booleans())


sendings = st.lists(
    st.one_of(
        sending(("request",), requests()),
        sending(("request",), st.sampled_from([STREAMS[0], STREAMS[4], STREAMS[8]]).flatmap(damaged)),
        sending(("control",), damaged(GREASE)),
        sending(("encoder", "decoder"), damaged(b"\x3f\xe1\x1f")),
        sending(("unidirectional",), damaged(STREAMS[14])),
        sending(("datagram",), damaged(request_body(seq=9))),
    ),
    min_size=1,
    max_size=8,
)
OWN_STREAMS = {"control": 2, "encoder": 6, "decoder": 10}
"""Streams opened by the client."""


async def attack(port: int, sent: Sent, failed: list[str]) -> int | None:
    """The error code with which the server ends the connection, or None; given up once something has `failed`."""
    async with connect(port) as client:
        session = await client.connect_webtransport()
        for kind, data, end in sent:
            quic = client._quic
            match kind:
                case "datagram":
                    client.h3.send_datagram(session, data)
                case "request":
                    quic.send_stream_data(quic.get_next_available_stream_id(), data, end)
                case "unidirectional":
                    quic.send_stream_data(quic.get_next_available_stream_id(is_unidirectional=True), data, end)
                case _:
                    quic.send_stream_data(OWN_STREAMS[kind], data)
            client.transmit()
        pong = asyncio.ensure_future(client.ping())
        while not pong.done() and not failed:
            await asyncio.wait([pong], timeout=0.05)
        with contextlib.suppress(ConnectionError, asyncio.CancelledError):
            pong.cancel()
            await pong
        return client.terminated.error_code if client.terminated else None


@pytest.mark.slow
@effort(60)
@given(sent=sendings)
@found("http3-request", sent=lambda content: [("request", content, True)])
@found("http3-control", sent=lambda content: [("control", content, False), ("encoder", content, False)])
def test_an_attack_ends_at_most_its_own_connection_in_the_protocol_s_way(
    server: tuple[Client, Callable[..., Any]], sent: Sent
) -> None:
    polite, run = server

    async def attacked(failed: list[str]) -> tuple[int | None, Response]:
        async with asyncio.timeout(LONGEST_S):
            code = await attack(polite.server_port, sent, failed)  # type: ignore[attr-defined]
            return code, await polite.fetch("GET", "/")

    with failures() as logged:
        code, answer = run(attacked(logged))
    assert (answer.status, answer.body) == (200, b"read")
    assert code is None or code in CODES, code
    assert not logged, logged


CODES = {int(code) for code in ErrorCode} - {ErrorCode.H3_INTERNAL_ERROR}


@contextmanager
def failures() -> Iterator[list[str]]:
    """Errors logged by the transport."""
    found: list[str] = []
    handler = logging.Handler(logging.ERROR)
    handler.emit = lambda record: found.append(record.getMessage() + str(record.exc_info))  # type: ignore[method-assign]
    logger = logging.getLogger("tigas_render.transport")
    logger.addHandler(handler)
    try:
        yield found
    finally:
        logger.removeHandler(handler)
