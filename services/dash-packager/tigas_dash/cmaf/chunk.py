"""A CMAF chunk: one `moof` and one `mdat` with a few frames, sent before its segment is complete."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from tigas_dash.cmaf.boxes import box, brands, full_box
from tigas_dash.cmaf.header import TRACK_ID

_NTP_EPOCH = datetime(1900, 1, 1, tzinfo=UTC)
_SYNC, _DEPENDS = 0x02000000, 0x01010000
"""Sample flags: depends on no other frame; depends on others and is no sync sample."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One encoded frame."""

    data: bytes
    """NAL units, each after four bytes with its length."""
    keyframe: bool


def chunk(
    samples: Sequence[Sample],
    durations: Sequence[int],
    *,
    sequence: int,
    decode_time: int,
    captured: datetime,
    first: bool,
) -> bytes:
    """The bytes of a chunk.

    `sequence` counts chunks from 1; each frame's duration and `decode_time` are in units of the timescale; `captured`
    is the time of the first frame's request; `first` is whether the chunk begins a segment.
    """
    kind = brands(b"styp", b"cmfs", b"cmfs", b"cmff", b"cmfl") if first else brands(b"styp", b"cmfl", b"cmfl")
    size = len(_moof(samples, durations, sequence, decode_time, 0))
    moof = _moof(samples, durations, sequence, decode_time, size + 8)
    return kind + _prft(captured, decode_time) + moof + box(b"mdat", *(sample.data for sample in samples))


def _prft(captured: datetime, media_time: int) -> bytes:
    """Producer reference time: `captured` in NTP's format (seconds since 1900, 32 bits of fraction)."""
    since = captured - _NTP_EPOCH
    fraction = round((since % timedelta(seconds=1)).total_seconds() * 2**32) & 0xFFFFFFFF
    at_capture = 24  # the flags that say which moment this is
    return full_box(
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
    return box(
        b"moof",
        full_box(b"mfhd", 0, 0, struct.pack(">I", sequence)),
        box(
            b"traf",
            full_box(b"tfhd", 0, default_base_is_moof, struct.pack(">I", TRACK_ID)),
            full_box(b"tfdt", 1, 0, struct.pack(">Q", decode_time)),
            full_box(b"trun", 0, present, struct.pack(">Ii", len(samples), data_offset), runs),
        ),
    )
