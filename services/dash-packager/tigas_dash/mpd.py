"""The manifest: a live MPD (ISO/IEC 23009-1) with a target latency for players."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from tigas_common.wire.dash import SessionRequest
from tigas_dash.clock import iso
from tigas_dash.representation import Representation

UPDATE_S = 60
"""Minimum update period; the manifest never changes."""
RATE_RANGE = 0.05
"""How much faster or slower than live players may play to hold the latency; wider ranges make them swing."""


def manifest(
    request: SessionRequest,
    ladder: Sequence[Representation],
    codecs: Sequence[str],
    *,
    timescale: int,
    window_segments: int,
    start: datetime,
    published: datetime,
    time_url: str,
) -> bytes:
    """The MPD as XML.

    `codecs` are each representation's; `window_segments` complete segments are available; frame 0 was captured at
    `start`, from where media time and wall-clock time run together; players learn the time at `time_url` (UTCTiming).
    """
    segment_s = request.frames_per_segment / request.frame_rate
    chunk_s = request.frames_per_chunk / request.frame_rate
    target = request.target_latency_ms
    timing = f'<UTCTiming schemeIdUri="urn:mpeg:dash:utc:http-xsdate:2014" value="{time_url}"/>'
    representations = "\n".join(
        f'<Representation id="{one.id}" bandwidth="{one.bitrate_kbps * 1000}" codecs="{its_codecs}"'
        f' width="{one.width}" height="{one.height}" sar="1:1"/>'
        for one, its_codecs in zip(ladder, codecs, strict=True)
    )
    # A segment stays available for the depth plus its own duration after its end (ISO/IEC 23009-1, 5.3.9.5.3).
    return f"""<?xml version="1.0" encoding="utf-8"?>
<MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="dynamic"
    profiles="urn:mpeg:dash:profile:isoff-live:2011,urn:mpeg:dash:profile:cmaf:2019"
    availabilityStartTime="{iso(start)}" publishTime="{iso(published)}" minimumUpdatePeriod="PT{UPDATE_S}S"
    minBufferTime="{_duration(segment_s)}" maxSegmentDuration="{_duration(segment_s)}"
    timeShiftBufferDepth="{_duration((window_segments - 1) * segment_s)}">
<ServiceDescription id="0">
<Latency target="{target}" min="{target // 2}" max="{3 * target}" referenceId="0"/>
<PlaybackRate min="{1 - RATE_RANGE:.2f}" max="{1 + RATE_RANGE:.2f}"/>
</ServiceDescription>
<Period id="0" start="PT0S">
<AdaptationSet id="0" contentType="video" mimeType="video/mp4" frameRate="{request.frame_rate}"
    maxWidth="{ladder[0].width}" maxHeight="{ladder[0].height}" segmentAlignment="true" startWithSAP="1">
<ProducerReferenceTime id="0" inband="true" type="captured" wallClockTime="{iso(start)}" presentationTime="0">
{timing}
</ProducerReferenceTime>
<SegmentTemplate timescale="{timescale}" duration="{request.frames_per_segment * timescale // request.frame_rate}"
    startNumber="1" availabilityTimeOffset="{segment_s - chunk_s:.6f}" availabilityTimeComplete="false"
    initialization="$RepresentationID$/init.mp4" media="$RepresentationID$/$Number$.m4s"/>
{representations}
</AdaptationSet>
</Period>
{timing}
</MPD>
""".encode()


def _duration(seconds: float) -> str:
    return f"PT{seconds:.6f}".rstrip("0").rstrip(".") + "S"
