"""Every message comes out of the pipe as it went in, and no bytes do anything but become a message or a sentence."""

from __future__ import annotations

import contextlib
import math
import struct
from collections.abc import Callable
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from tests.render.fakes import render_request
from tigas_common.errors import Overloaded, TigasError
from tigas_common.wire.model import MAX_SIDE
from tigas_common.wire.render import AnswerFormat, RenderRequest, ServerTiming, VideoInfo, VideoRequest
from tigas_render.frame import Client, Frame, Transport
from tigas_render.pipe import messages
from tigas_render.pipe.link import PREFIX, BadMessage, Kind
from tigas_render.pipe.packing import Packing

coordinates = st.floats(-1e9, 1e9)
texts = st.text(st.characters(codec="utf-8"), max_size=60)
formats = st.sampled_from(("jpeg", "png", "yuv420p", "webp"))
rotated = {
    "azimuth": st.none(),
    "elevation": st.none(),
    "translation": st.none(),
    "position": st.tuples(*[coordinates] * 3),
    "quaternion": st.tuples(*[coordinates] * 4).filter(any),
}
encoded = {
    "format": st.just("h264"),
    "video": st.builds(
        VideoRequest, bitrate_kbps=st.integers(10, 200_000), frames_per_s=st.floats(1, 240), key=st.booleans()
    ),
}
requests = st.builds(
    lambda *changes: render_request(**{name: value for each in changes for name, value in each.items()}),
    st.fixed_dictionaries(
        {
            "scene": texts,
            "seq": st.integers(0, 2**32 - 1),
            "profile": st.none() | st.integers(0, 255),
            "overscan": st.floats(0, 0.5),
            "depth": st.booleans(),
            "detail": st.sampled_from(("auto", "full")),
            "coarse": st.booleans(),
            "deadline_ms": st.none() | st.floats(0, 60_000, exclude_min=True),
            "format": formats,
        }
    ),
    st.fixed_dictionaries(rotated) | st.fixed_dictionaries({"roll": st.none() | st.floats(-1e6, 1e6)}),
    st.just({}) | st.fixed_dictionaries(encoded),
)
numbers, sides, times = st.integers(0, 2**32 - 1), st.integers(0, MAX_SIDE), st.floats(0, 1e6)
videos = st.builds(VideoInfo, key=st.booleans(), after=st.none() | numbers, codec=st.just("avc1.4d401f"))


def of_format(format: AnswerFormat) -> st.SearchStrategy[Frame]:
    """Frames of this format."""
    timing = st.builds(ServerTiming, queue=times, render=times, encode=times)
    video = videos if format == "h264" else st.none()
    profile = st.none() | st.integers(0, 255)
    body = st.binary(max_size=50)
    view = (numbers, profile, timing, sides, sides, video, st.booleans())
    return st.builds(Frame, body, st.just(format), sides, sides, *view)


UNPACK: list[Callable[[bytes], object]] = [
    messages.unpack_request,
    lambda content: messages.unpack_frame(content, is_inline=True),
    lambda content: messages.unpack_frame(content, is_inline=False),
    messages.unpack_failure,
    messages.unpack_hello,
    messages.unpack_number,
    messages.unpack_state,
]


def content(message: bytes, kind: Kind) -> bytes:
    """The content of a message of this kind."""
    assert PREFIX.unpack_from(message) == (len(message) - PREFIX.size, kind)
    return message[PREFIX.size :]


@given(numbers, numbers, st.floats(0, 1e9), st.floats(0, 1e9), requests)
def test_a_request_comes_out_as_it_went_in(
    id: int, session: int, arrived: float, sent: float, request: RenderRequest
) -> None:
    packed = messages.pack_request(id, session, arrived, sent, request)
    assert messages.unpack_request(content(packed, Kind.REQUEST)) == (id, session, arrived, sent, request)


@pytest.mark.parametrize("is_inline", [True, False])
@given(numbers, st.sampled_from(get_args(AnswerFormat)).flatmap(of_format))
def test_a_frame_comes_out_as_it_went_in(is_inline: bool, id: int, frame: Frame) -> None:
    packed = messages.pack_frame(id, frame, None if is_inline else 4096)
    found = messages.unpack_frame(content(packed, Kind.INLINE if is_inline else Kind.FRAME), is_inline=is_inline)
    assert (found.id, found.offset, found.length) == (id, 0 if is_inline else 4096, len(frame.body))
    assert Frame(found.inline if is_inline else frame.body, *found.fields) == frame


@pytest.mark.parametrize(
    "error",
    [
        *(kind("A sentence – with a dash.") for kind in messages._ERRORS),
        Overloaded("Later.", 2.5),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_comes_out_as_it_went_in(error: TigasError) -> None:
    id, found = messages.unpack_failure(content(messages.pack_failure(7, error), Kind.FAILURE))
    assert (id, type(found), found.detail) == (7, type(error), error.detail)
    assert getattr(found, "retry_after_s", None) == getattr(error, "retry_after_s", None)


@given(numbers, texts, texts, st.sampled_from(get_args(Transport)))
def test_the_small_ones_come_out_as_they_went_in(number: int, address: str, session: str, transport: Transport) -> None:
    client = Client(address, session, transport)
    assert messages.unpack_hello(content(messages.pack_hello(number, client), Kind.HELLO)) == (number, client)
    for kind in (Kind.OPEN, Kind.BYE, Kind.WITHDRAW, Kind.ARENA, Kind.RELEASE):
        assert messages.unpack_number(content(messages.pack_number(kind, 2**20 * number), kind)) == 2**20 * number
    assert messages.unpack_state(content(messages.pack_state(0.5, 0.25), Kind.STATE)) == (0.5, 0.25)


@pytest.mark.parametrize("unpack", UNPACK)
@given(garbage=st.binary(max_size=200))
def test_bytes_that_are_no_message_are_refused(unpack: Callable[[bytes], object], garbage: bytes) -> None:
    with contextlib.suppress(BadMessage):
        unpack(garbage)


@given(st.integers(0, 400), st.integers(1, 255))
def test_a_request_with_any_byte_changed_is_a_request_or_refused(position: int, change: int) -> None:
    packed = bytearray(content(messages.pack_request(1, 2, 3.0, 4.0, render_request(deadline_ms=50.0)), Kind.REQUEST))
    packed[position % len(packed)] ^= change
    with contextlib.suppress(BadMessage):
        asked = messages.unpack_request(bytes(packed))
        assert asked.request.model_dump().keys() == RenderRequest.model_fields.keys()


@pytest.mark.parametrize("cut", [0, 1, 50, -1])
def test_cut_messages_are_refused(cut: int) -> None:
    frame = Frame(b"body", "jpeg", 1, 1, 0, None, ServerTiming(queue=0, render=0, encode=0))
    with pytest.raises(BadMessage):
        messages.unpack_frame(content(messages.pack_frame(1, frame, 0), Kind.FRAME)[:cut], is_inline=False)
    with pytest.raises(BadMessage):
        messages.unpack_frame(content(messages.pack_frame(1, frame, None), Kind.INLINE)[:cut], is_inline=True)


@pytest.mark.parametrize("state", [(-1.0, 0.5), (math.nan, 0.5), (0.0, 1.5), (0.0, math.nan), (math.inf, 0.0)])
def test_a_state_that_cannot_be_is_refused(state: tuple[float, float]) -> None:
    with pytest.raises(BadMessage):
        messages.unpack_state(struct.pack("<dd", *state))


class Extended(RenderRequest):
    """A RenderRequest with fields that it does not have today."""

    exposure: float | None = Field(default=None, gt=0)
    samples: int = 1
    corner: tuple[int, bool] | None = None


@pytest.mark.parametrize(
    "added", [{}, {"exposure": 0.5, "samples": 4, "corner": (3, True)}, {"samples": -1, "corner": (0, False)}]
)
def test_a_field_that_is_added_is_packed_without_further_code(added: dict[str, Any]) -> None:
    packing = Packing(Extended)
    model = Extended(**vars(render_request()) | added)
    unpacked = packing.unpack(b"head" + packing.pack(model), 4)
    assert unpacked == model
    copy = unpacked.model_copy(update={"seq": 2})
    assert (copy.seq, unpacked.seq) == (2, 0)
    assert Extended.model_validate(copy.model_dump()) == copy
    with pytest.raises(BadMessage):
        packing.unpack(packing.pack(model)[:20])
