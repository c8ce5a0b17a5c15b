"""Hostile HTTP/3 ends its connection before it costs much."""

from __future__ import annotations

import pylsqpack
import pytest
from aioquic.buffer import encode_uint_var
from aioquic.h3.connection import ErrorCode, FrameType, Setting, StreamType, encode_frame, encode_settings
from aioquic.h3.events import DataReceived, H3Event, HeadersReceived
from aioquic.quic.events import StreamDataReceived

from tests.render.transport.simulated import Simulation
from tigas_render.transport.aioquic_ext.h3 import MAX_ENCODER_TABLE, MAX_FIELD_SECTION, ServerH3Connection

REQUEST, CONTROL, ENCODER = 0, 2, 6
FIELDS = [(b":method", b"GET"), (b":scheme", b"https"), (b":authority", b"localhost"), (b":path", b"/")]
LARGEST_STATIC = b"\xfa"
"""strict-transport-security: max-age=31536000; includesubdomains; preload (RFC 9204, appendix A)"""


class Peer:
    """A client's bytes, fed to a server's HTTP/3 at once; returns the server's close."""

    def __init__(self) -> None:
        quic = Simulation().server
        quic.close = self._close  # type: ignore[method-assign]
        self.h3 = ServerH3Connection(quic, enable_webtransport=True)
        self.closed: int | None = None

    def send(self, stream_id: int, data: bytes, end: bool = False) -> list[H3Event]:
        return self.h3.handle_event(StreamDataReceived(data=data, end_stream=end, stream_id=stream_id))

    def settings(self, settings: dict[int, int]) -> None:
        self.send(CONTROL, bytes([StreamType.CONTROL]) + encode_frame(FrameType.SETTINGS, encode_settings(settings)))

    def _close(self, error_code: int = 0, frame_type: int | None = None, reason_phrase: str = "") -> None:
        self.closed = error_code


@pytest.fixture
def peer() -> Peer:
    return Peer()


def section(*fields: tuple[bytes, bytes]) -> bytes:
    """A request's encoded fields."""
    return pylsqpack.Encoder().encode(REQUEST, [*FIELDS, *fields])[1]


def frame_header(frame_type: int, size: int) -> bytes:
    return encode_uint_var(frame_type) + encode_uint_var(size)


HEADERS = encode_frame(FrameType.HEADERS, section())
SETTINGS = bytes([StreamType.CONTROL]) + encode_frame(FrameType.SETTINGS, b"")
TOO_LARGE = {
    "headers just too long": (REQUEST, frame_header(FrameType.HEADERS, MAX_FIELD_SECTION + 1)),
    "headers": (REQUEST, frame_header(FrameType.HEADERS, (1 << 62) - 1)),
    "trailers": (REQUEST, HEADERS + frame_header(FrameType.HEADERS, 1 << 30)),
    "settings": (CONTROL, bytes([StreamType.CONTROL]) + frame_header(FrameType.SETTINGS, 1 << 30)),
    "a push id": (CONTROL, SETTINGS + frame_header(FrameType.MAX_PUSH_ID, 1 << 30)),
}


@pytest.mark.parametrize(("stream_id", "data"), TOO_LARGE.values(), ids=TOO_LARGE)
def test_a_frame_that_promises_too_much_is_refused_before_it_arrives(peer: Peer, stream_id: int, data: bytes) -> None:
    peer.send(stream_id, data)
    assert peer.closed == ErrorCode.H3_EXCESSIVE_LOAD


def test_bodies_and_unknown_frames_may_be_of_any_size(peer: Peer) -> None:
    peer.settings({})
    peer.send(REQUEST, frame_header(0x21, 1 << 20) + bytes(1 << 20))
    peer.send(REQUEST, encode_frame(FrameType.HEADERS, section()) + frame_header(FrameType.DATA, 1 << 30))
    assert peer.send(REQUEST, b"body") == [DataReceived(data=b"body", stream_id=REQUEST, stream_ended=False)]
    peer.send(CONTROL, frame_header(0x21, 1 << 30) + b"grease")
    assert peer.closed is None


def test_a_settings_frame_is_cut_until_its_last_byte(peer: Peer) -> None:
    content = bytes([StreamType.CONTROL]) + encode_frame(FrameType.SETTINGS, encode_settings({0x21: 1}))
    for byte in content[:-1]:
        peer.send(CONTROL, bytes([byte]))
    assert peer.h3.has_partial_frame(CONTROL)
    peer.send(CONTROL, content[-1:])
    assert not peer.h3.has_partial_frame(CONTROL)
    assert peer.h3.received_settings == {0x21: 1, Setting.QPACK_MAX_TABLE_CAPACITY: 0}


def test_clients_are_told_of_no_table_and_of_the_limit(peer: Peer) -> None:
    sent = peer.h3.sent_settings
    assert sent is not None
    assert sent[Setting.QPACK_MAX_TABLE_CAPACITY] == 0
    assert sent[Setting.QPACK_BLOCKED_STREAMS] == 0
    assert sent[Setting.MAX_FIELD_SECTION_SIZE] == MAX_FIELD_SECTION


def test_a_client_that_fills_a_table_all_the_same_is_cut_off(peer: Peer) -> None:
    encoder = pylsqpack.Encoder()
    capacity = encoder.apply_settings(max_table_capacity=4096, blocked_streams=16)
    peer.send(ENCODER, bytes([StreamType.QPACK_ENCODER]) + capacity)
    assert peer.closed == ErrorCode.QPACK_ENCODER_STREAM_ERROR


def test_a_reference_to_the_table_is_an_error_at_once(peer: Peer) -> None:
    peer.send(REQUEST, encode_frame(FrameType.HEADERS, b"\x02\x00\x80"))
    assert peer.closed == ErrorCode.QPACK_DECOMPRESSION_FAILED


def test_a_long_section_is_refused_undecoded(peer: Peer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peer.h3, "_decoder", None)
    peer.send(REQUEST, encode_frame(FrameType.HEADERS, bytes(MAX_FIELD_SECTION + 1)))
    assert peer.closed == ErrorCode.H3_EXCESSIVE_LOAD


@pytest.mark.parametrize(
    "encoded",
    [
        section() + LARGEST_STATIC * 1000,
        section((b"cookie", b"x" * MAX_FIELD_SECTION)),
        section(*[(b"%d" % number, b"") for number in range(250)]),
    ],
    ids=["references", "a long field", "many fields"],
)
def test_a_short_section_that_stands_for_a_long_one_is_refused(peer: Peer, encoded: bytes) -> None:
    peer.send(REQUEST, encode_frame(FrameType.HEADERS, encoded), end=True)
    assert peer.closed == ErrorCode.H3_EXCESSIVE_LOAD


def test_what_browsers_send_is_far_below_the_limit(peer: Peer) -> None:
    fields = [(b"user-agent", b"Mozilla/5.0" * 20), (b"referer", b"https://localhost/" * 10), (b"cookie", b"c" * 4096)]
    (event,) = peer.send(REQUEST, encode_frame(FrameType.HEADERS, section(*fields)), end=True)
    assert isinstance(event, HeadersReceived)
    assert event.headers == FIELDS + fields
    assert peer.closed is None


def test_our_own_table_has_a_limit_too(peer: Peer) -> None:
    peer.settings({Setting.QPACK_MAX_TABLE_CAPACITY: 1 << 31, Setting.QPACK_BLOCKED_STREAMS: 100})
    received = peer.h3.received_settings
    assert received is not None
    assert received[Setting.QPACK_MAX_TABLE_CAPACITY] == MAX_ENCODER_TABLE
    assert peer.closed is None
