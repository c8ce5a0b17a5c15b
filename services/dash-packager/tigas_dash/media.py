"""A stream's media as players fetch it: the manifest, and each representation's header and segments."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta

from tigas_common.wire.dash import RepresentationInfo, SessionRequest
from tigas_dash.cmaf.chunk import Sample, chunk
from tigas_dash.cmaf.header import ParameterSets, init_segment
from tigas_dash.errors import UnknownSegment
from tigas_dash.mpd import Stream, manifest
from tigas_dash.representation import Representation
from tigas_dash.segments import SegmentWindow

WINDOW_S = 10.0
"""How far back segments are kept, in seconds; at least three of them."""
UNITS_PER_FRAME = 1000
"""Units of the timescale in one frame's duration."""


class Media:
    """Packs encoded frames into chunks and segments, and keeps a window of them."""

    def __init__(
        self,
        request: SessionRequest,
        ladder: Sequence[Representation],
        parameters: Sequence[ParameterSets],
        start: datetime,
    ) -> None:
        """`parameters` are each representation's; frame 0 was captured at `start`."""
        self._request = request
        self._ladder = ladder
        self._parameters = parameters
        self._start = start
        self._segment_s = request.frames_per_segment / request.frame_rate
        self._keep = max(3, round(WINDOW_S / self._segment_s))
        self._windows = {one.id: SegmentWindow(self._keep) for one in ladder}
        self._timescale = request.frame_rate * UNITS_PER_FRAME
        self._headers = {
            one.id: init_segment(sets, one.width, one.height, self._timescale)
            for one, sets in zip(ladder, parameters, strict=True)
        }
        self._rungs = {one.id: one.rung for one in ladder}
        self._pending: list[list[Sample]] = [[] for _ in ladder]
        self._pending_ticks: list[int] = []
        self._chunks = 0

    @property
    def representations(self) -> tuple[RepresentationInfo, ...]:
        """Properties of each representation for viewers."""
        return tuple(
            RepresentationInfo(
                id=one.id, rung=one.rung, width=one.width, height=one.height, bitrate_kbps=one.bitrate_kbps,
                codecs=sets.codecs,
            )
            for one, sets in zip(self._ladder, self._parameters, strict=True)
        )  # fmt: skip

    @property
    def readable_s(self) -> float:
        """How long a segment can be read after its start."""
        return (self._keep + 1) * self._segment_s

    def manifest(self, time_url: str, published: datetime) -> bytes:
        """The MPD."""
        request = self._request
        stream = Stream(
            start=self._start,
            ladder=self._ladder,
            codecs=[sets.codecs for sets in self._parameters],
            frame_rate=request.frame_rate,
            timescale=self._timescale,
            frames_per_segment=request.frames_per_segment,
            frames_per_chunk=request.frames_per_chunk,
            window_segments=self._keep,
            target_latency_ms=request.target_latency_ms,
            time_url=time_url,
        )
        return manifest(stream, published)

    def header(self, representation: str) -> bytes:
        """The init segment. Raises UnknownSegment if there is no such representation."""
        return self._headers[self._known(representation)]

    def segments(self, representation: str) -> SegmentWindow:
        """The media segments, likewise."""
        return self._windows[self._known(representation)]

    def rung(self, representation: str) -> int:
        """Which rung it shows, likewise."""
        return self._rungs[self._known(representation)]

    def append(self, number: int, ticks: int, samples: Sequence[Sample]) -> None:
        """Add frame `number` of each representation, shown for this many ticks."""
        for pending, sample in zip(self._pending, samples, strict=True):
            pending.append(sample)
        self._pending_ticks.append(ticks)
        per_segment, per_chunk = self._request.frames_per_segment, self._request.frames_per_chunk
        begin = number % per_segment
        end = begin + ticks
        if end // per_chunk > begin // per_chunk or end == per_segment:
            self._publish_chunk(number + ticks - sum(self._pending_ticks))

    def close(self) -> None:
        """There are no more frames: readers end."""
        for window in self._windows.values():
            window.close()

    def _publish_chunk(self, first: int) -> None:
        """Flush pending frames; the first one is number `first`."""
        self._chunks += 1
        segment, place = divmod(first, self._request.frames_per_segment)
        durations = [ticks * UNITS_PER_FRAME for ticks in self._pending_ticks]
        self._pending_ticks.clear()
        for one, pending in zip(self._ladder, self._pending, strict=True):
            data = chunk(
                pending,
                durations,
                sequence=self._chunks,
                decode_time=first * UNITS_PER_FRAME,
                captured=self._start + timedelta(seconds=first / self._request.frame_rate),
                first=place == 0,
            )
            self._windows[one.id].append(segment + 1, data)
            pending.clear()

    def _known(self, representation: str) -> str:
        if representation not in self._windows:
            raise UnknownSegment(f"The session has no representation {representation[:64]!r}.")
        return representation
