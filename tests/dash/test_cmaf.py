"""The bytes of a stream, against ISO/IEC 14496-12 and 23000-19 and an independent reader."""

from __future__ import annotations

import io
import struct
from datetime import UTC, datetime, timedelta

import av
import numpy as np
import pytest

from tests.dash.boxes import contents, walk
from tests.dash.fakes import grey
from tigas_dash.cmaf import Sample, chunk, init_segment
from tigas_dash.encoder import LadderEncoder, RawFrame
from tigas_dash.representation import Representation

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
