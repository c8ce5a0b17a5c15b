"""The messages between edges and the engine: packed at one end, checked and unpacked at the other.

Both ends are of one version, as one process starts them. Every `unpack_` raises BadMessage.
"""

from __future__ import annotations

import math
import struct
from typing import Any, Final, NamedTuple, get_args

from tigas_common.errors import (
    BrokenScene,
    DeadlineExceeded,
    DeviceLost,
    InvalidRequest,
    NoRoom,
    OutOfDeviceMemory,
    Overloaded,
    Superseded,
    TigasError,
    UnknownScene,
    problem,
)
from tigas_common.wire.render import AnswerFormat, RenderRequest, ServerTiming, VideoInfo
from tigas_render.frame import Client, Frame, Transport
from tigas_render.pipe.link import BadMessage, Kind, framed
from tigas_render.pipe.packing import Packing

_FORMATS: Final[tuple[AnswerFormat, ...]] = get_args(AnswerFormat)
_NUMBER_OF: Final = {format: number for number, format in enumerate(_FORMATS)}
_TRANSPORTS: Final[tuple[Transport, ...]] = get_args(Transport)
_NUMBER: Final = struct.Struct("<Q")
_STATE: Final = struct.Struct("<dd")
_HELLO: Final = struct.Struct("<IBB")
"""A session's number, its transport's, and the length of its address, which follows; the rest is its name."""

_REQUEST: Final = struct.Struct("<IIdd")
"""id, session, arrived, sent. The RenderRequest follows."""
_RENDER_REQUEST: Final = Packing(RenderRequest)


class Asked(NamedTuple):
    """A request received from the pipe."""

    id: int
    session: int
    arrived: float
    """On the monotonic clock, which all processes of a machine share."""
    sent: float
    """Time at which the edge sent it, on the same clock."""
    request: RenderRequest


def pack_request(id: int, session: int, arrived: float, sent: float, request: RenderRequest) -> bytes:
    """A request with the edge's own id, from a session introduced before."""
    return framed(Kind.REQUEST, _REQUEST.pack(id, session, arrived, sent) + _RENDER_REQUEST.pack(request))


def unpack_request(content: bytes) -> Asked:
    """A request. Its fields are not validated again: the edge has validated the client's request."""
    id, session, arrived, sent = _unpacked(_REQUEST, content, at_least=True)
    if not math.isfinite(arrived + sent):
        raise BadMessage("A request has a time that does not exist.")
    return Asked(id, session, arrived, sent, _RENDER_REQUEST.unpack(content, _REQUEST.size))


_FRAME: Final = struct.Struct("<IQI IHHHHhB ddd IB16s?")
"""id, offset, length; seq, width, height, margins, profile, format; timing; the frame that a video's refers to, flags,
and the codec's name; whether it is coarse. The body follows if it is inline."""
_NO_PROFILE: Final = -1
_IS_KEY, _HAS_AFTER = 1, 2


class FrameMessage(NamedTuple):
    """A received frame; its body is at `offset` and `length` in the arena, or `inline`."""

    id: int
    offset: int
    length: int
    inline: bytes
    fields: tuple[AnswerFormat, int, int, int, int | None, ServerTiming, int, int, VideoInfo | None, bool]
    """The fields of a Frame after its body."""


def pack_frame(id: int, frame: Frame, offset: int | None) -> bytes:
    """A frame with its body at `offset` of the arena; with its body inline, if that is None."""
    timing = frame.timing
    content = _FRAME.pack(
        id, offset or 0, len(frame.body), frame.seq, frame.width, frame.height, frame.margin_x, frame.margin_y,
        _NO_PROFILE if frame.profile is None else frame.profile, _NUMBER_OF[frame.format],
        timing.queue, timing.render, timing.encode, *_of_video(frame.video), frame.coarse,
    )  # fmt: skip
    if offset is None:
        return framed(Kind.INLINE, b"".join((content, frame.body)))
    return framed(Kind.FRAME, content)


def unpack_frame(content: bytes, *, is_inline: bool) -> FrameMessage:
    (
        id, offset, length, seq, width, height, margin_x, margin_y, profile, format, queue, render, encode,
        after, flags, codec, coarse,
    ) = _unpacked(_FRAME, content, at_least=is_inline)  # fmt: skip
    inline = content[_FRAME.size :]
    if format >= len(_FORMATS) or profile < _NO_PROFILE or (is_inline and (len(inline) != length or offset)):
        raise BadMessage("A frame has a format, a profile or a length that cannot be.")
    if not (math.isfinite(queue) and math.isfinite(render) and math.isfinite(encode)):
        raise BadMessage("A frame's times are not numbers.")
    timing = ServerTiming.trusted({"queue": queue, "render": render, "encode": encode})
    chosen, video = None if profile == _NO_PROFILE else profile, None
    if _FORMATS[format] == "h264":
        video = VideoInfo.trusted({
            "key": flags & _IS_KEY != 0, "after": after if flags & _HAS_AFTER else None,
            "codec": _text(codec.rstrip(b"\0")),
        })  # fmt: skip
    fields = (_FORMATS[format], width, height, seq, chosen, timing, margin_x, margin_y, video, coarse)
    return FrameMessage(id, offset, length, inline, fields)


def _of_video(video: VideoInfo | None) -> tuple[int, int, bytes]:
    """The last numbers of a frame's message."""
    if video is None:
        return 0, 0, b""
    flags = (_IS_KEY if video.key else 0) | (0 if video.after is None else _HAS_AFTER)
    return video.after or 0, flags, video.codec.encode()


_FAILURE: Final = struct.Struct("<IdB")
"""id, seconds after which to try again, or NaN, and the error's type. The sentence follows."""
_ERRORS: Final[tuple[type[TigasError], ...]] = (
    TigasError, InvalidRequest, UnknownScene, BrokenScene, Superseded, DeadlineExceeded, Overloaded, OutOfDeviceMemory,
    DeviceLost, NoRoom,
)  # fmt: skip
"""All answers of the engine, the least specific first."""


def pack_failure(id: int, error: Exception) -> bytes:
    """Why there is no frame; of an error that is not a client's business only that the server failed."""
    kind = type(error) if type(error) in _ERRORS else TigasError
    retry_after_s = getattr(error, "retry_after_s", None)
    content = _FAILURE.pack(id, math.nan if retry_after_s is None else retry_after_s, _ERRORS.index(kind))
    return framed(Kind.FAILURE, content + problem(error).detail.encode(errors="replace"))


def unpack_failure(content: bytes) -> tuple[int, TigasError]:
    id, retry_after_s, number = _unpacked(_FAILURE, content, at_least=True)
    if number >= len(_ERRORS):
        raise BadMessage("An error has a type that does not exist.")
    detail, kind = _text(content[_FAILURE.size :]), _ERRORS[number]
    if issubclass(kind, Overloaded):
        return id, kind(detail, None if math.isnan(retry_after_s) else retry_after_s)
    return id, kind(detail)


def pack_hello(session: int, client: Client) -> bytes:
    """Introduces a session: requests name it by its number."""
    address = client.address.encode()
    head = _HELLO.pack(session, _TRANSPORTS.index(client.transport), len(address))
    return framed(Kind.HELLO, head + address + client.session.encode())


def unpack_hello(content: bytes) -> tuple[int, Client]:
    number, transport, length = _unpacked(_HELLO, content, at_least=True)
    end = _HELLO.size + length
    if len(content) < end:
        raise BadMessage("A session's introduction is too short.")
    if transport >= len(_TRANSPORTS):
        raise BadMessage("A session has a transport that does not exist.")
    address, session = content[_HELLO.size : end], content[end:]
    return number, Client(_text(address), _text(session), _TRANSPORTS[transport])


def pack_number(kind: Kind, number: int) -> bytes:
    """OPEN with the edge's number, BYE with a session's, WITHDRAW with a request's; ARENA with its size, RELEASE with
    the offset of a frame in it.
    """
    return framed(kind, _NUMBER.pack(number))


def unpack_number(content: bytes) -> int:
    (number,) = _unpacked(_NUMBER, content)
    return int(number)


def pack_state(queue_age_s: float, utilisation: float) -> bytes:
    """How busy the engine is."""
    return framed(Kind.STATE, _STATE.pack(queue_age_s, utilisation))


def unpack_state(content: bytes) -> tuple[float, float]:
    """The queue's age in seconds, and the utilisation, 0 to 1."""
    age, utilisation = _unpacked(_STATE, content)
    if not (0 <= age < math.inf and 0 <= utilisation <= 1):
        raise BadMessage("The engine's state is out of range.")
    return age, utilisation


def _unpacked(layout: struct.Struct, content: bytes, *, at_least: bool = False) -> tuple[Any, ...]:
    if len(content) < layout.size or (len(content) > layout.size and not at_least):
        raise BadMessage(f"A message has {len(content)} bytes instead of {layout.size}.")
    return layout.unpack_from(content)


def _text(encoded: bytes) -> str:
    try:
        return encoded.decode()
    except UnicodeDecodeError:
        raise BadMessage("A text in a message is not UTF-8.") from None
