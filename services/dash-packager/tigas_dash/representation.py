"""What a session's representations are: resolution and bitrate of each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tigas_common.errors import InvalidRequest
from tigas_common.wire import Rung
from tigas_dash.wire import RepresentationRequest, SessionRequest

_REFERENCE_PIXELS, _REFERENCE_RATE, _REFERENCE_KBPS = 1280 * 720, 30, 4000


@dataclass(frozen=True, slots=True)
class Representation:
    """One of the qualities that a player may choose from."""

    id: str
    rung: int
    width: int
    height: int
    """Pixels; even."""
    bitrate_kbps: int


def representations(request: SessionRequest, ladder: Sequence[Rung]) -> tuple[Representation, ...]:
    """The representations of a session, the largest first. Raises InvalidRequest if the ladder has not such a rung."""
    wanted = request.representations or tuple(RepresentationRequest(rung=rung) for rung in range(len(ladder)))
    made = []
    for each in wanted:
        if each.rung >= len(ladder):
            raise InvalidRequest(f"The ladder has no rung {each.rung}, only 0 to {len(ladder) - 1}.")
        width, height = (_even(side) for side in ladder[each.rung].size_for(request.width, request.height))
        bitrate = each.bitrate_kbps or default_bitrate(width, height, request.frame_rate)
        made.append(Representation(f"r{each.rung}", each.rung, width, height, bitrate))
    return tuple(sorted(made, key=lambda one: (-one.width * one.height, one.rung)))


def default_bitrate(width: int, height: int, frame_rate: int) -> int:
    """Kilobits a second: 4000 for 1280×720 at 30 frames/s.

    It grows with the number of pixels to the power of 0.75 (the rule of thumb of J. Ozer, "Encoding by the Numbers"),
    and with the square root of the frame rate, since more frames differ less from one another.
    """
    size = math.pow(width * height / _REFERENCE_PIXELS, 0.75)
    return max(50, round(_REFERENCE_KBPS * size * math.sqrt(frame_rate / _REFERENCE_RATE)))


def _even(side: int) -> int:
    return max(16, side // 2 * 2)
