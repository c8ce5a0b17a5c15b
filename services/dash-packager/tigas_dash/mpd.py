"""The manifest: a live MPD (ISO/IEC 23009-1) with a target latency for players."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from xml.etree import ElementTree as ET

from tigas_dash.clock import iso
from tigas_dash.representation import Representation

NAMESPACE = "urn:mpeg:dash:schema:mpd:2011"
PROFILES = "urn:mpeg:dash:profile:isoff-live:2011,urn:mpeg:dash:profile:cmaf:2019"
UPDATE_S = 60
"""Minimum update period; the manifest never changes."""
RATE_RANGE = 0.05
"""How much faster or slower than live players may play to hold the latency; wider ranges make them swing."""


@dataclass(frozen=True, slots=True)
class Stream:
    """Contents of a manifest."""

    start: datetime
    """When frame 0 was captured: media time and wall-clock time run together from here."""
    ladder: Sequence[Representation]
    codecs: Sequence[str]
    """One for each representation."""
    frame_rate: int
    timescale: int
    frames_per_segment: int
    frames_per_chunk: int
    window_segments: int
    """Number of complete segments available."""
    target_latency_ms: int
    time_url: str
    """Where players learn the time (UTCTiming)."""


def manifest(stream: Stream, published: datetime) -> bytes:
    """The MPD as XML."""
    segment_s = stream.frames_per_segment / stream.frame_rate
    chunk_s = stream.frames_per_chunk / stream.frame_rate
    widest = stream.ladder[0]
    mpd = ET.Element(
        "MPD",
        {
            "xmlns": NAMESPACE,
            "profiles": PROFILES,
            "type": "dynamic",
            "availabilityStartTime": iso(stream.start),
            "publishTime": iso(published),
            "minimumUpdatePeriod": _duration(UPDATE_S),
            "minBufferTime": _duration(segment_s),
            # A segment stays available for this time plus its own duration after its end (ISO/IEC 23009-1, 5.3.9.5.3).
            "timeShiftBufferDepth": _duration((stream.window_segments - 1) * segment_s),
            "maxSegmentDuration": _duration(segment_s),
        },
    )
    service = ET.SubElement(mpd, "ServiceDescription", {"id": "0"})
    target = stream.target_latency_ms
    ET.SubElement(
        service, "Latency", {"target": str(target), "min": str(target // 2), "max": str(3 * target), "referenceId": "0"}
    )
    ET.SubElement(service, "PlaybackRate", {"min": f"{1 - RATE_RANGE:.2f}", "max": f"{1 + RATE_RANGE:.2f}"})
    period = ET.SubElement(mpd, "Period", {"id": "0", "start": "PT0S"})
    adaptation = ET.SubElement(
        period,
        "AdaptationSet",
        {
            "id": "0",
            "contentType": "video",
            "mimeType": "video/mp4",
            "frameRate": str(stream.frame_rate),
            "maxWidth": str(widest.width),
            "maxHeight": str(widest.height),
            "segmentAlignment": "true",
            "startWithSAP": "1",
        },
    )
    reference = ET.SubElement(
        adaptation,
        "ProducerReferenceTime",
        {"id": "0", "inband": "true", "type": "captured", "wallClockTime": iso(stream.start), "presentationTime": "0"},
    )
    _timing(reference, stream.time_url)
    ET.SubElement(
        adaptation,
        "SegmentTemplate",
        {
            "timescale": str(stream.timescale),
            "duration": str(stream.frames_per_segment * stream.timescale // stream.frame_rate),
            "startNumber": "1",
            "availabilityTimeOffset": f"{segment_s - chunk_s:.6f}",
            "availabilityTimeComplete": "false",
            "initialization": "$RepresentationID$/init.mp4",
            "media": "$RepresentationID$/$Number$.m4s",
        },
    )
    for representation, codecs in zip(stream.ladder, stream.codecs, strict=True):
        ET.SubElement(
            adaptation,
            "Representation",
            {
                "id": representation.id,
                "bandwidth": str(representation.bitrate_kbps * 1000),
                "codecs": codecs,
                "width": str(representation.width),
                "height": str(representation.height),
                "sar": "1:1",
            },
        )
    _timing(mpd, stream.time_url)
    text: bytes = ET.tostring(mpd, encoding="utf-8", xml_declaration=True)
    return text


def _timing(parent: ET.Element, url: str) -> None:
    ET.SubElement(parent, "UTCTiming", {"schemeIdUri": "urn:mpeg:dash:utc:http-xsdate:2014", "value": url})


def _duration(seconds: float) -> str:
    return f"PT{seconds:.6f}".rstrip("0").rstrip(".") + "S"
