"""The manifest has everything that low-latency players need (ISO/IEC 23009-1, DASH-IF's low-latency guidelines)."""

from __future__ import annotations

from datetime import UTC, datetime
from xml.etree import ElementTree as ET

from tigas_dash.mpd import Stream, manifest
from tigas_dash.representation import Representation

NS = {"d": "urn:mpeg:dash:schema:mpd:2011"}
STREAM = Stream(
    start=datetime(2026, 1, 31, 12, tzinfo=UTC),
    ladder=(Representation(2, 640, 360, 1500), Representation(3, 320, 180, 500)),
    codecs=("avc1.42C01E", "avc1.42C00D"),
    frame_rate=30,
    timescale=30_000,
    frames_per_segment=30,
    frames_per_chunk=3,
    window_segments=10,
    target_latency_ms=200,
    time_url="http://localhost:8081/time",
)


def parsed() -> ET.Element:
    return ET.fromstring(manifest(STREAM, datetime(2026, 1, 31, 12, 1, tzinfo=UTC)))


def test_segments_are_available_while_they_grow() -> None:
    template = parsed().find(".//d:SegmentTemplate", NS)
    assert template is not None
    assert int(template.attrib["duration"]) / int(template.attrib["timescale"]) == 1.0
    assert float(template.attrib["availabilityTimeOffset"]) == 0.9, "a segment less one chunk"
    assert template.attrib["availabilityTimeComplete"] == "false"
    assert template.attrib["media"] == "$RepresentationID$/$Number$.m4s"


def test_players_are_told_the_latency_and_the_time() -> None:
    mpd = parsed()
    latency = mpd.find("d:ServiceDescription/d:Latency", NS)
    assert latency is not None
    assert latency.attrib["target"] == "200"
    rate = mpd.find("d:ServiceDescription/d:PlaybackRate", NS)
    assert rate is not None
    assert float(rate.attrib["min"]) < 1 < float(rate.attrib["max"])
    reference = mpd.find(".//d:ProducerReferenceTime", NS)
    assert reference is not None
    assert reference.attrib["id"] == latency.attrib["referenceId"]
    assert reference.attrib["wallClockTime"] == mpd.attrib["availabilityStartTime"] == "2026-01-31T12:00:00.000Z"
    times = [element.attrib["value"] for element in mpd.iter(f"{{{NS['d']}}}UTCTiming")]
    assert times == [STREAM.time_url] * 2


def test_every_representation_can_be_chosen() -> None:
    rows = [element.attrib for element in parsed().iter(f"{{{NS['d']}}}Representation")]
    assert [(row["id"], row["bandwidth"], row["codecs"], row["width"], row["height"]) for row in rows] == [
        ("r2-1500", "1500000", "avc1.42C01E", "640", "360"),
        ("r3-500", "500000", "avc1.42C00D", "320", "180"),
    ]


def test_elements_stand_in_the_order_of_the_schema() -> None:
    mpd = parsed()
    names = [element.tag.partition("}")[2] for element in mpd]
    assert names == ["ServiceDescription", "Period", "UTCTiming"]
    adaptation = mpd.find("d:Period/d:AdaptationSet", NS)
    assert adaptation is not None
    assert [element.tag.partition("}")[2] for element in adaptation] == [
        "ProducerReferenceTime", "SegmentTemplate", "Representation", "Representation",
    ]  # fmt: skip
    for required in ("profiles", "minBufferTime", "availabilityStartTime", "publishTime", "timeShiftBufferDepth"):
        assert required in mpd.attrib
