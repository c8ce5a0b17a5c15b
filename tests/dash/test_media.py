"""A stream's media: boxes, chunks, segments and the manifest."""

from __future__ import annotations

import asyncio
import io
import struct
from datetime import UTC, datetime, timedelta
from xml.etree import ElementTree as ET

import av
import numpy as np
import pytest

from tests.dash.boxes import contents, walk
from tests.dash.conftest import parsed_request
from tests.dash.fakes import grey
from tigas_dash.cmaf import ParameterSets, Sample, chunk, init_segment
from tigas_dash.encoder import LadderEncoder, RawFrame
from tigas_dash.errors import ExpiredSegment, UnknownSegment
from tigas_dash.media import Media
from tigas_dash.representation import Representation
from tigas_dash.segments import SegmentWindow

pytestmark = pytest.mark.anyio

NS = {"d": "urn:mpeg:dash:schema:mpd:2011"}
TIME_URL = "http://localhost:8081/time"


@pytest.fixture
def mpd() -> ET.Element:
    media = Media(
        parsed_request(frames_per_chunk=3, segment_s=1),
        (Representation(2, 640, 360, 1500), Representation(3, 320, 180, 500)),
        [ParameterSets(bytes.fromhex(sps), b"h") for sps in ("6742C01E", "6742C00D")],
        datetime(2026, 1, 31, 12, microsecond=1500, tzinfo=UTC),
    )
    return ET.fromstring(media.manifest(TIME_URL, datetime(2026, 1, 31, 12, 1, tzinfo=UTC)))


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


async def test_readers_get_each_chunk_as_it_comes_whenever_they_began() -> None:
    window = SegmentWindow(3)
    window.append(1, b"a")
    early = window.read(1)
    assert await anext(early) == b"a"
    waiting = asyncio.ensure_future(anext(early))
    await asyncio.sleep(0)
    assert not waiting.done()
    window.append(1, b"b")
    assert await waiting == b"b"
    late = window.read(1)
    window.append(2, b"c")
    assert [part async for part in late] == [b"ab"]
    assert [part async for part in early] == []


async def test_an_early_request_waits_until_its_segment_begins() -> None:
    window = SegmentWindow(3)
    window.append(1, b"a")
    reader = asyncio.ensure_future(anext(window.read(2)))
    await asyncio.sleep(0)
    window.append(1, b"b")
    await asyncio.sleep(0)
    assert not reader.done()
    window.append(2, b"c")
    assert await reader == b"c"


async def test_old_and_far_segments_are_refused() -> None:
    window = SegmentWindow(2)
    for number in range(1, 7):
        window.append(number, b"x")
    assert await anext(window.read(4)) == b"x"
    with pytest.raises(ExpiredSegment) as expired:
        window.read(3)
    assert expired.value.status == 410
    for number in (0, -1, 9, 10**9):
        with pytest.raises(UnknownSegment):
            window.read(number)


async def test_a_reader_of_a_segment_that_left_the_window_still_gets_the_rest() -> None:
    window = SegmentWindow(1)
    window.append(1, b"a")
    reader = window.read(1)
    assert await anext(reader) == b"a"
    window.append(1, b"b")
    for number in range(2, 9):
        window.append(number, b"x")
    assert [part async for part in reader] == [b"b"]


async def test_the_end_of_the_stream_ends_every_reader() -> None:
    window = SegmentWindow(2)
    window.append(1, b"a")
    readers = [window.read(1), window.read(2)]
    window.close()
    assert [[part async for part in reader] for reader in readers] == [[b"a"], []]


RATE, UNITS, PER_SEGMENT = 30, 1000, 5
START = datetime(2026, 1, 31, 12, tzinfo=UTC)
LADDER = (Representation(2, 640, 360, 1500), Representation(3, 318, 178, 400))


def encoded(frames: int) -> tuple[LadderEncoder, list[list[Sample]]]:
    """Frames that become brighter, at each representation."""
    encoder = LadderEncoder("libx264", LADDER, RATE, PER_SEGMENT)
    return encoder, [encoder.encode(RawFrame(grey(640, 360, 40 + 10 * n), 640, 360, n), n) for n in range(frames)]


def one_chunk(sample: Sample, number: int) -> bytes:
    return chunk(
        [sample],
        [UNITS],
        sequence=number + 1,
        decode_time=number * UNITS,
        captured=START + timedelta(seconds=number / RATE),
        first=number % PER_SEGMENT == 0,
    )


@pytest.mark.parametrize("index", [0, 1])
def test_a_stream_decodes_to_what_went_in(index: int) -> None:
    encoder, samples = encoded(12)
    one = LADDER[index]
    data = init_segment(encoder.parameters[index], one.width, one.height, RATE * UNITS)
    data += b"".join(one_chunk(each[index], n) for n, each in enumerate(samples))
    with av.open(io.BytesIO(data), "r") as container:
        frames = list(container.decode(video=0))
        stream = container.streams.video[0].codec_context
        assert (stream.width, stream.height) == (one.width, one.height)
        assert (stream.colorspace, stream.color_range) == (1, 1), "BT.709, limited range"
    assert [round(float(frame.time or 0) * RATE) for frame in frames] == list(range(12))
    assert [n for n, frame in enumerate(frames) if frame.key_frame] == [0, 5, 10]
    for n, frame in enumerate(frames):
        luma = np.frombuffer(bytes(frame.planes[0]), np.uint8)[: one.width]
        assert luma.mean() == pytest.approx(40 + 10 * n, abs=3)


def test_the_header_is_a_cmaf_header() -> None:
    encoder, _ = encoded(1)
    data = init_segment(encoder.parameters[0], 640, 360, RATE * UNITS)
    assert b"cmfc" in contents(data, b"ftyp")[0][8:]
    (entry,) = contents(data, b"stsd")
    assert entry[12:16] == b"avc1"
    configuration = entry[entry.index(b"avcC") + 4 :]
    assert configuration[1:4].hex().upper() == encoder.parameters[0].codecs.removeprefix("avc1.")
    assert encoder.parameters[0].sps in configuration
    assert encoder.parameters[0].pps in configuration
    assert contents(data, b"trex")


def test_parameter_sets_stand_in_the_header_only() -> None:
    _, samples = encoded(6)
    for each in samples:
        data, at, kinds = each[0].data, 0, set()
        while at < len(data):
            (size,) = struct.unpack_from(">I", data, at)
            kinds.add(data[at + 4] & 0x1F)
            at += 4 + size
        assert at == len(data)
        assert kinds <= {1, 5}, "slices only"


def test_a_chunk_says_where_it_belongs_and_when_it_was_captured() -> None:
    _, samples = encoded(2)
    data = one_chunk(samples[1][0], 1)
    assert [kind for kind, _ in walk(data) if kind in (b"styp", b"prft", b"moof", b"mdat")] == [
        b"styp", b"prft", b"moof", b"mdat",
    ]  # fmt: skip
    assert struct.unpack(">4xQ", contents(data, b"tfdt")[0]) == (UNITS,)
    seconds, fraction, media_time = struct.unpack_from(">2IQ", contents(data, b"prft")[0], 8)
    captured = datetime(1900, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds + fraction / 2**32)
    assert abs(captured - START - timedelta(seconds=1 / RATE)) < timedelta(milliseconds=1)
    assert media_time == UNITS
    (offset,) = struct.unpack_from(">i", contents(data, b"trun")[0], 8)
    begins = data.index(b"moof") - 4
    assert data[begins + offset :] == contents(data, b"mdat")[0] == samples[1][0].data
    assert contents(one_chunk(samples[0][0], 0), b"styp")[0][:4] == b"cmfs"
