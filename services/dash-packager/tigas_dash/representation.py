"""The representations of a session, with their resolutions and bitrates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from tigas_common.errors import InvalidRequest
from tigas_common.wire.dash import SessionRequest, StreamRequest
from tigas_common.wire.render import Rung

_REFERENCE_PIXELS, _REFERENCE_RATE, _REFERENCE_KBPS = 1280 * 720, 30, 4000
MAX_SIZES = 4
HIGH_BITRATE_FACTOR = 3
"""Multiple of its bitrate at which the best resolution is also offered, for faster links."""


@dataclass(frozen=True, slots=True)
class Representation:
    """One of the qualities among which a player can choose."""

    rung: int
    width: int
    height: int
    """Pixels; even."""
    bitrate_kbps: int

    @property
    def id(self) -> str:
        """Rung and kilobits per second, such as r2-1414."""
        return f"r{self.rung}-{self.bitrate_kbps}"

    @property
    def pixels(self) -> int:
        return self.width * self.height


def choose_representations(request: SessionRequest, ladder: Sequence[Rung]) -> tuple[Representation, ...]:
    """The representations of a session, best first.

    Raises InvalidRequest for a rung that is not in the ladder, and for duplicates.
    """
    if request.representations is None:
        made = _default_set(request, ladder)
    else:
        made = [_make_representation(request, ladder, each.rung, each.bitrate_kbps) for each in request.representations]
    if len({one.id for one in made}) < len(made):
        raise InvalidRequest("Two representations of one rung need different bitrates.")
    return tuple(sorted(made, key=lambda one: (-one.pixels, one.rung, -one.bitrate_kbps)))


def choose_representation(request: StreamRequest, ladder: Sequence[Rung], rung: int | None) -> Representation:
    """A stream's only representation: a rung's, or the largest that fits into the viewport. Raises InvalidRequest."""
    if rung is not None:
        return _make_representation(request, ladder, rung, None)
    return max(_default_set(request, ladder), key=lambda one: one.pixels)


def _default_set(request: StreamRequest, ladder: Sequence[Rung]) -> list[Representation]:
    """Every size with no more pixels than the viewport, as more would be wasted, or else the smallest size.

    As each size costs an encoder, at most MAX_SIZES are chosen, from the largest to the smallest.
    """
    rungs: dict[int, int] = {}
    for number, rung in enumerate(ladder):
        rungs.setdefault(rung.width * rung.height, number)  # a video's quality depends on its bitrate only
    limit = max(request.width * request.height, min(rungs))
    sizes = sorted((pixels for pixels in rungs if pixels <= limit), reverse=True)
    made = [_make_representation(request, ladder, rungs[pixels], None) for pixels in _choose_sizes(sizes)]
    best = max(made, key=lambda one: one.pixels)
    return [*made, replace(best, bitrate_kbps=HIGH_BITRATE_FACTOR * best.bitrate_kbps)]


def _make_representation(
    request: StreamRequest, ladder: Sequence[Rung], rung: int, bitrate_kbps: int | None
) -> Representation:
    if rung >= len(ladder):
        raise InvalidRequest(f"The ladder has no rung {rung}, only 0 to {len(ladder) - 1}.")
    width, height = (_round_to_even(side) for side in ladder[rung].size_for(request.width, request.height))
    return Representation(rung, width, height, bitrate_kbps or default_bitrate(width, height, request.frame_rate))


def default_bitrate(width: int, height: int, frame_rate: int) -> int:
    """Default bitrate in kilobits per second: 4000 for 1280×720 at 30 frames/s.

    It grows with the number of pixels to the power of 0.75 (a rule of thumb by J. Ozer, "Encoding by the Numbers"), and
    with the square root of the frame rate, as consecutive frames differ less.
    """
    size = math.pow(width * height / _REFERENCE_PIXELS, 0.75)
    return max(50, round(_REFERENCE_KBPS * size * math.sqrt(frame_rate / _REFERENCE_RATE)))


def _choose_sizes(sizes: Sequence[int]) -> list[int]:
    """Up to MAX_SIZES of descending sizes, as evenly spaced in their logarithms as possible."""
    if len(sizes) <= MAX_SIZES:
        return list(sizes)
    step = math.log(sizes[-1] / sizes[0]) / (MAX_SIZES - 1)
    wanted = [sizes[0] * math.exp(step * each) for each in range(MAX_SIZES)]
    return list(dict.fromkeys(min(sizes, key=lambda size: abs(math.log(size / each))) for each in wanted))


def _round_to_even(side: int) -> int:
    return max(16, side // 2 * 2)
