"""CMAF (ISO/IEC 23000-19) as bytes: the init segment (CMAF header) of an H.264 track, and its chunks."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

TRACK_ID = 1
BT709 = 1
"""Code point of BT.709 for primaries, transfer characteristics and matrix (ISO/IEC 23091-2)."""
_UNITY_MATRIX = struct.pack(">9I", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)
_NTP_EPOCH = datetime(1900, 1, 1, tzinfo=UTC)
_SYNC, _DEPENDS = 0x02000000, 0x01010000
"""Sample flags: depends on no other frame; depends on others and is not a sync sample."""


@dataclass(frozen=True, slots=True)
class ParameterSets:
    """H.264's sequence and picture parameter sets, as NAL units without start codes."""

    sps: bytes
    pps: bytes

    @property
    def codecs(self) -> str:
        """The `codecs` string (RFC 6381): profile, constraints and level in hexadecimal."""
        return f"avc1.{self.sps[1:4].hex().upper()}"


@dataclass(frozen=True, slots=True)
class Sample:
    data: bytes
    """NAL units, each preceded by its length in four bytes."""
    keyframe: bool


def init_segment(parameters: ParameterSets, width: int, height: int, timescale: int) -> bytes:
    """The CMAF header of a track; width and height in pixels, `timescale` in units per second."""
    return _box(b"ftyp", b"cmfc", bytes(4), b"cmfc", b"iso6", b"avc1", b"dash") + _box(
        b"moov",
        _full_box(
            b"mvhd", 0, 0, struct.pack(">4I", 0, 0, timescale, 0), struct.pack(">IH10x", 0x10000, 0x100),
            _UNITY_MATRIX, bytes(24), struct.pack(">I", TRACK_ID + 1),
        ),
        _track(parameters, width, height, timescale),
        _box(b"mvex", _full_box(b"trex", 0, 0, struct.pack(">5I", TRACK_ID, 1, 0, 0, 0))),
    )  # fmt: skip


def chunk(
    samples: Sequence[Sample],
    durations: Sequence[int],
    *,
    sequence: int,
    decode_time: int,
    captured: datetime,
    first: bool,
) -> bytes:
    """A chunk of a few frames: `prft`, `moof` and `mdat`.

    `sequence` counts chunks from 1; each frame's duration and `decode_time` are in units of the timescale; `captured`
    is the time at which the first frame was requested; `first` is whether the chunk begins a segment.
    """
    brands = (b"cmfs", bytes(4), b"cmfs", b"cmff", b"cmfl") if first else (b"cmfl", bytes(4), b"cmfl")
    size = len(_moof(samples, durations, sequence, decode_time, 0))
    moof = _moof(samples, durations, sequence, decode_time, size + 8)
    data = _box(b"mdat", *(sample.data for sample in samples))
    return _box(b"styp", *brands) + _prft(captured, decode_time) + moof + data


def _box(kind: bytes, *content: bytes) -> bytes:
    """A box (ISO/IEC 14496-12): its length, four-character code and content."""
    body = b"".join(content)
    return struct.pack(">I4s", 8 + len(body), kind) + body


def _full_box(kind: bytes, version: int, flags: int, *content: bytes) -> bytes:
    return _box(kind, struct.pack(">I", version << 24 | flags), *content)


def _track(parameters: ParameterSets, width: int, height: int, timescale: int) -> bytes:
    enabled_in_movie = 0x3
    return _box(
        b"trak",
        _full_box(
            b"tkhd", 0, enabled_in_movie, struct.pack(">5I", 0, 0, TRACK_ID, 0, 0), bytes(16),
            _UNITY_MATRIX, struct.pack(">2I", width << 16, height << 16),
        ),
        _box(
            b"mdia",
            _full_box(b"mdhd", 0, 0, struct.pack(">4I", 0, 0, timescale, 0), struct.pack(">2H", 0x55C4, 0)),  # "und"
            _full_box(b"hdlr", 0, 0, bytes(4), b"vide", bytes(12), b"video\0"),
            _box(
                b"minf",
                _full_box(b"vmhd", 0, 1, bytes(8)),
                _box(b"dinf", _full_box(b"dref", 0, 0, struct.pack(">I", 1), _full_box(b"url ", 0, 1))),
                _box(
                    b"stbl",
                    _full_box(b"stsd", 0, 0, struct.pack(">I", 1), _sample_entry(parameters, width, height)),
                    *(_full_box(kind, 0, 0, bytes(4)) for kind in (b"stts", b"stsc")),
                    _full_box(b"stsz", 0, 0, bytes(8)),
                    _full_box(b"stco", 0, 0, bytes(4)),
                ),
            ),
        ),
    )  # fmt: skip


def _sample_entry(parameters: ParameterSets, width: int, height: int) -> bytes:
    sps, pps = parameters.sps, parameters.pps
    configuration = _box(
        b"avcC",
        bytes([1]), sps[1:4], bytes([0xFF]),  # four-byte length before each NAL unit
        bytes([0xE1]), struct.pack(">H", len(sps)), sps,
        bytes([1]), struct.pack(">H", len(pps)), pps,
    )  # fmt: skip
    return _box(
        b"avc1",
        struct.pack(">6xH16x2H", 1, width, height),
        struct.pack(">2I4xH32sHh", 0x480000, 0x480000, 1, b"", 24, -1),  # 72 dpi, one frame a sample, no name, depth 24
        configuration,
        _box(b"colr", b"nclx", struct.pack(">3HB", BT709, BT709, BT709, 0)),  # 0: limited range
        _box(b"pasp", struct.pack(">2I", 1, 1)),
    )


def _prft(captured: datetime, media_time: int) -> bytes:
    """Producer reference time: `captured` in NTP format (seconds since 1900, 32 bits of fraction)."""
    since = captured - _NTP_EPOCH
    fraction = round((since % timedelta(seconds=1)).total_seconds() * 2**32) & 0xFFFFFFFF
    at_capture = 24  # flags that define the meaning of the time
    return _full_box(
        b"prft", 1, at_capture, struct.pack(">3IQ", TRACK_ID, since // timedelta(seconds=1), fraction, media_time)
    )


def _moof(
    samples: Sequence[Sample], durations: Sequence[int], sequence: int, decode_time: int, data_offset: int
) -> bytes:
    default_base_is_moof = 0x20000
    has_offset, has_durations, has_sizes, has_flags = 0x1, 0x100, 0x200, 0x400
    present = has_offset | has_durations | has_sizes | has_flags
    runs = b"".join(
        struct.pack(">3I", duration, len(sample.data), _SYNC if sample.keyframe else _DEPENDS)
        for sample, duration in zip(samples, durations, strict=True)
    )
    return _box(
        b"moof",
        _full_box(b"mfhd", 0, 0, struct.pack(">I", sequence)),
        _box(
            b"traf",
            _full_box(b"tfhd", 0, default_base_is_moof, struct.pack(">I", TRACK_ID)),
            _full_box(b"tfdt", 1, 0, struct.pack(">Q", decode_time)),
            _full_box(b"trun", 0, present, struct.pack(">Ii", len(samples), data_offset), runs),
        ),
    )
