"""A stream's media as players fetch it: the manifest, and each representation's header and segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime, timedelta

from tigas_common.wire.dash import RepresentationInfo, SessionRequest
from tigas_dash.cmaf import ParameterSets, Sample, chunk, init_segment
from tigas_dash.errors import UnknownSegment
from tigas_dash.mpd import manifest
from tigas_dash.representation import Representation
from tigas_dash.segments import SegmentWindow

WINDOW_S = 10.0
"""How far back segments are kept, in seconds; at least three of them."""
UNITS_PER_FRAME = 1000
"""Units of the timescale in one frame's duration."""


@dataclass(frozen=True, slots=True)
class Track:
    representation: Representation
    codecs: str
    header: bytes
    """The init segment."""
    segments: SegmentWindow
    pending: list[Sample] = field(default_factory=list)
    """Frames of the next chunk."""

    @property
    def info(self) -> RepresentationInfo:
        return RepresentationInfo(id=self.representation.id, codecs=self.codecs, **asdict(self.representation))


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
        self._start = start
        self._segment_s = request.frames_per_segment / request.frame_rate
        self._keep = max(3, round(WINDOW_S / self._segment_s))
        self._timescale = request.frame_rate * UNITS_PER_FRAME
        self._tracks = {
            one.id: Track(
                one,
                sets.codecs,
                init_segment(sets, one.width, one.height, self._timescale),
                SegmentWindow(self._keep),
            )
            for one, sets in zip(ladder, parameters, strict=True)
        }
        self._pending_ticks: list[int] = []
        self._chunks = 0

    @property
    def tracks(self) -> list[Track]:
        """All representations' segments, the best first."""
        return list(self._tracks.values())

    def track(self, representation: str) -> Track:
        """A representation's track. Raises UnknownSegment."""
        if representation not in self._tracks:
            raise UnknownSegment(f"The session has no representation {representation[:64]!r}.")
        return self._tracks[representation]

    @property
    def readable_s(self) -> float:
        """How long a segment can be read after its start."""
        return (self._keep + 1) * self._segment_s

    def manifest(self, time_url: str, published: datetime) -> bytes:
        return manifest(
            self._request,
            [track.representation for track in self.tracks],
            [track.codecs for track in self.tracks],
            timescale=self._timescale,
            window_segments=self._keep,
            start=self._start,
            published=published,
            time_url=time_url,
        )

    def append(self, number: int, ticks: int, samples: Sequence[Sample]) -> None:
        """Add frame `number` of each representation, shown for this many ticks."""
        for track, sample in zip(self.tracks, samples, strict=True):
            track.pending.append(sample)
        self._pending_ticks.append(ticks)
        per_segment, per_chunk = self._request.frames_per_segment, self._request.frames_per_chunk
        begin = number % per_segment
        end = begin + ticks
        if end // per_chunk > begin // per_chunk or end == per_segment:
            self._publish_chunk(number + ticks - sum(self._pending_ticks))

    def close(self) -> None:
        """There are no more frames: readers end."""
        for track in self.tracks:
            track.segments.close()

    def _publish_chunk(self, first: int) -> None:
        """Flush pending frames; the first one is number `first`."""
        self._chunks += 1
        segment, place = divmod(first, self._request.frames_per_segment)
        durations = [ticks * UNITS_PER_FRAME for ticks in self._pending_ticks]
        self._pending_ticks.clear()
        for track in self.tracks:
            data = chunk(
                track.pending,
                durations,
                sequence=self._chunks,
                decode_time=first * UNITS_PER_FRAME,
                captured=self._start + timedelta(seconds=first / self._request.frame_rate),
                first=place == 0,
            )
            track.segments.append(segment + 1, data)
            track.pending.clear()
