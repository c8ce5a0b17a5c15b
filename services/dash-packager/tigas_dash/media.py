"""A stream's media as fetched by players: the manifest, and each representation's header and segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime, timedelta

from tigas_common.wire.dash import RepresentationInfo, SessionRequest
from tigas_dash.clock import xs_datetime
from tigas_dash.cmaf import ParameterSets, Sample, chunk, init_segment
from tigas_dash.errors import UnknownSegment
from tigas_dash.representation import Representation
from tigas_dash.segments import SegmentWindow

WINDOW_S = 10.0
"""Seconds for which segments are kept; at least three of them are."""
UNITS_PER_FRAME = 1000
"""Duration of a frame, in units of the timescale."""
MIN_UPDATE_S = 60
"""Minimum update period; the manifest never changes."""
PLAYBACK_RATE_RANGE = 0.05
"""Deviation from live speed that players may use to hold the latency; wider ranges make them oscillate."""


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
        """parameters: of each representation; start: capture time of frame 0."""
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
        """The tracks of all representations, best first."""
        return list(self._tracks.values())

    def track(self, representation: str) -> Track:
        """The track of a representation. Raises UnknownSegment."""
        if representation not in self._tracks:
            raise UnknownSegment(f"The session has no representation {representation[:64]!r}.")
        return self._tracks[representation]

    @property
    def readable_s(self) -> float:
        """Seconds after its start for which a segment can be read."""
        return (self._keep + 1) * self._segment_s

    def manifest(self, time_url: str, published: datetime) -> bytes:
        """A live MPD (ISO/IEC 23009-1) with a target latency for players, as XML.

        Media time and wall-clock time are locked from frame 0; players get the time from `time_url` (UTCTiming).
        """
        request, start, best = self._request, xs_datetime(self._start), self.tracks[0].representation
        segment_s, segment = self._segment_s, _format_duration(self._segment_s)
        chunk_s = request.frames_per_chunk / request.frame_rate
        target = request.target_latency_ms
        timing = f'<UTCTiming schemeIdUri="urn:mpeg:dash:utc:http-xsdate:2014" value="{time_url}"/>'
        representations = "\n".join(
            f'<Representation id="{one.id}" bandwidth="{one.bitrate_kbps * 1000}" codecs="{track.codecs}"'
            f' width="{one.width}" height="{one.height}" sar="1:1"/>'
            for track in self.tracks
            for one in (track.representation,)
        )
        # A segment stays available for the depth plus its own duration after its end (ISO/IEC 23009-1, 5.3.9.5.3).
        return f"""<?xml version="1.0" encoding="utf-8"?>
<MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="dynamic"
    profiles="urn:mpeg:dash:profile:isoff-live:2011,urn:mpeg:dash:profile:cmaf:2019"
    availabilityStartTime="{start}" publishTime="{xs_datetime(published)}" minimumUpdatePeriod="PT{MIN_UPDATE_S}S"
    minBufferTime="{segment}" maxSegmentDuration="{segment}"
    timeShiftBufferDepth="{_format_duration((self._keep - 1) * segment_s)}">
<ServiceDescription id="0">
<Latency target="{target}" min="{target // 2}" max="{3 * target}" referenceId="0"/>
<PlaybackRate min="{1 - PLAYBACK_RATE_RANGE:.2f}" max="{1 + PLAYBACK_RATE_RANGE:.2f}"/>
</ServiceDescription>
<Period id="0" start="PT0S">
<AdaptationSet id="0" contentType="video" mimeType="video/mp4" frameRate="{request.frame_rate}"
    maxWidth="{best.width}" maxHeight="{best.height}" segmentAlignment="true" startWithSAP="1">
<ProducerReferenceTime id="0" inband="true" type="captured" wallClockTime="{start}" presentationTime="0">
{timing}
</ProducerReferenceTime>
<SegmentTemplate timescale="{self._timescale}" duration="{request.frames_per_segment * UNITS_PER_FRAME}"
    startNumber="1" availabilityTimeOffset="{segment_s - chunk_s:.6f}" availabilityTimeComplete="false"
    initialization="$RepresentationID$/init.mp4" media="$RepresentationID$/$Number$.m4s"/>
{representations}
</AdaptationSet>
</Period>
{timing}
</MPD>
""".encode()

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
        """End all readers, as there are no more frames."""
        for track in self.tracks:
            track.segments.close()

    def _publish_chunk(self, first: int) -> None:
        """Publish the pending frames as a chunk; `first` is the number of the first one."""
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


def _format_duration(seconds: float) -> str:
    return f"PT{seconds:.6f}".rstrip("0").rstrip(".") + "S"
