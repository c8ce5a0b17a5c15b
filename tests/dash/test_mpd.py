"""The manifest has everything that low-latency players need (ISO/IEC 23009-1, DASH-IF's low-latency guidelines)."""

from __future__ import annotations

from datetime import UTC, datetime
from xml.etree import ElementTree as ET

import pytest

from tests.dash.conftest import parsed_request
from tigas_dash.media import manifest
from tigas_dash.representation import Representation

NS = {"d": "urn:mpeg:dash:schema:mpd:2011"}
TIME_URL = "http://localhost:8081/time"


@pytest.fixture
def mpd() -> ET.Element:
    text = manifest(
        parsed_request(frames_per_chunk=3, segment_s=1),
        (Representation(2, 640, 360, 1500), Representation(3, 320, 180, 500)),
        ("avc1.42C01E", "avc1.42C00D"),
        timescale=30_000,
        window_segments=10,
        start=datetime(2026, 1, 31, 12, microsecond=1500, tzinfo=UTC),
        published=datetime(2026, 1, 31, 12, 1, tzinfo=UTC),
        time_url=TIME_URL,
    )
    return ET.fromstring(text)


def attributes(mpd: ET.Element, path: str) -> dict[str, str]:
    """Those of the only element at a path."""
    (element,) = mpd.findall(path, NS)
    return element.attrib


def test_segments_are_available_while_they_grow(mpd: ET.Element) -> None:
    template = attributes(mpd, ".//d:SegmentTemplate")
    assert int(template["duration"]) / int(template["timescale"]) == 1.0
    assert float(template["availabilityTimeOffset"]) == 0.9, "a segment less one chunk"
    assert template["availabilityTimeComplete"] == "false"
    assert template["media"] == "$RepresentationID$/$Number$.m4s"


def test_players_learn_the_latency_and_the_time(mpd: ET.Element) -> None:
    latency = attributes(mpd, "d:ServiceDescription/d:Latency")
    assert latency["target"] == "200"
    rate = attributes(mpd, "d:ServiceDescription/d:PlaybackRate")
    assert float(rate["min"]) < 1 < float(rate["max"])
    reference = attributes(mpd, ".//d:ProducerReferenceTime")
    assert reference["id"] == latency["referenceId"]
    assert reference["wallClockTime"] == mpd.attrib["availabilityStartTime"] == "2026-01-31T12:00:00.001Z"
    assert [element.attrib["value"] for element in mpd.iter(f"{{{NS['d']}}}UTCTiming")] == [TIME_URL] * 2


def test_every_representation_can_be_chosen(mpd: ET.Element) -> None:
    rows = [element.attrib for element in mpd.iter(f"{{{NS['d']}}}Representation")]
    assert [(row["id"], row["bandwidth"], row["codecs"], row["width"], row["height"]) for row in rows] == [
        ("r2-1500", "1500000", "avc1.42C01E", "640", "360"),
        ("r3-500", "500000", "avc1.42C00D", "320", "180"),
    ]


def test_elements_are_in_the_order_of_the_schema(mpd: ET.Element) -> None:
    def names(path: str) -> list[str]:
        return [element.tag.partition("}")[2] for element in mpd.findall(f"{path}/*", NS)]

    assert names(".") == ["ServiceDescription", "Period", "UTCTiming"]
    assert names("d:Period/d:AdaptationSet") == [
        "ProducerReferenceTime", "SegmentTemplate", "Representation", "Representation",
    ]  # fmt: skip
    required = {"profiles", "minBufferTime", "availabilityStartTime", "publishTime", "timeShiftBufferDepth"}
    assert required <= mpd.attrib.keys()
