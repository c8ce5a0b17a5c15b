"""Messages of the pipe that contain models, with their fields as plain values without names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from tigas_common.errors import TigasError, problem
from tigas_common.wire.render import RenderRequest, ServerTiming
from tigas_render.frame import Client, Frame
from tigas_render.pipe.link import Kind, encode_message

_REQUEST: Final = tuple(RenderRequest.model_fields)
_TIMING: Final = tuple(ServerTiming.model_fields)


def pack_request(id: int, client: Client, arrived: float, sent: float, request: RenderRequest) -> bytes:
    """Pack a request. id: the edge's. arrived, sent: times on the monotonic clock, which all processes share."""
    return encode_message(Kind.REQUEST, id, tuple(client), arrived, sent, tuple(vars(request).values()))


def unpack_request(values: tuple[Any, ...]) -> RenderRequest:
    """Unpack a request, without validation, because the edge has validated it already."""
    return RenderRequest.trusted(dict(zip(_REQUEST, values, strict=True)))


def pack_frame(id: int, frame: Frame, offset: int) -> bytes:
    """Pack a frame that has its body at `offset` in the arena."""
    return encode_message(
        Kind.FRAME, id, offset, len(frame.body), frame.format, frame.width, frame.height, frame.seq, frame.profile,
        tuple(vars(frame.timing).values()), frame.margin_x, frame.margin_y, frame.video, frame.coarse,
    )  # fmt: skip


def unpack_frame(body: memoryview, values: tuple[Any, ...], on_release: Callable[[], None]) -> Frame:
    """Unpack a frame from its body and the other values of its message."""
    format, width, height, seq, profile, times, margin_x, margin_y, video, coarse = values
    timing = ServerTiming.trusted(dict(zip(_TIMING, times, strict=True)))
    return Frame(body, format, width, height, seq, profile, timing, margin_x, margin_y, video, coarse, on_release)


def pack_failure(id: int, error: Exception) -> bytes:
    """Pack the reason why there is no frame. For an unexpected error, it says only that the server has failed.

    Edges do not load the engine's modules, so errors defined there are replaced with a more general class.
    """
    known = error if isinstance(error, TigasError) else TigasError(problem(error).detail)
    kind = next(each for each in type(known).__mro__ if each.__module__ == TigasError.__module__)
    return encode_message(Kind.FAILURE, id, kind, known.detail, known.retry_after_s)
