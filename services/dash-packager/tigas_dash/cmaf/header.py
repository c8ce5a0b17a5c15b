"""The init segment of an H.264 track: the CMAF header (ISO/IEC 23000-19, 7.3.1)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from tigas_dash.cmaf.boxes import UNITY_MATRIX, box, brands, full_box

TRACK_ID = 1
BT709 = 1
"""The code point of BT.709 for primaries, transfer characteristics and matrix (ISO/IEC 23091-2)."""


@dataclass(frozen=True, slots=True)
class ParameterSets:
    """H.264's sequence and picture parameter sets, as NAL units without start codes."""

    sps: bytes
    pps: bytes

    @property
    def codecs(self) -> str:
        """The `codecs` string (RFC 6381): profile, constraints and level in hexadecimal."""
        return f"avc1.{self.sps[1:4].hex().upper()}"


def init_segment(parameters: ParameterSets, width: int, height: int, timescale: int) -> bytes:
    """The CMAF header of a track; width and height in pixels, `timescale` in units a second."""
    return brands(b"ftyp", b"cmfc", b"cmfc", b"iso6", b"avc1", b"dash") + box(
        b"moov",
        full_box(
            b"mvhd", 0, 0, struct.pack(">4I", 0, 0, timescale, 0), struct.pack(">IH10x", 0x10000, 0x100),
            UNITY_MATRIX, bytes(24), struct.pack(">I", TRACK_ID + 1),
        ),
        _track(parameters, width, height, timescale),
        box(b"mvex", full_box(b"trex", 0, 0, struct.pack(">5I", TRACK_ID, 1, 0, 0, 0))),
    )  # fmt: skip


def _track(parameters: ParameterSets, width: int, height: int, timescale: int) -> bytes:
    enabled_in_movie = 0x3
    return box(
        b"trak",
        full_box(
            b"tkhd", 0, enabled_in_movie, struct.pack(">5I", 0, 0, TRACK_ID, 0, 0), bytes(16),
            UNITY_MATRIX, struct.pack(">2I", width << 16, height << 16),
        ),
        box(
            b"mdia",
            full_box(b"mdhd", 0, 0, struct.pack(">4I", 0, 0, timescale, 0), struct.pack(">2H", 0x55C4, 0)),  # "und"
            full_box(b"hdlr", 0, 0, bytes(4), b"vide", bytes(12), b"video\0"),
            box(
                b"minf",
                full_box(b"vmhd", 0, 1, bytes(8)),
                box(b"dinf", full_box(b"dref", 0, 0, struct.pack(">I", 1), full_box(b"url ", 0, 1))),
                box(
                    b"stbl",
                    full_box(b"stsd", 0, 0, struct.pack(">I", 1), _sample_entry(parameters, width, height)),
                    *(full_box(kind, 0, 0, bytes(4)) for kind in (b"stts", b"stsc")),
                    full_box(b"stsz", 0, 0, bytes(8)),
                    full_box(b"stco", 0, 0, bytes(4)),
                ),
            ),
        ),
    )  # fmt: skip


def _sample_entry(parameters: ParameterSets, width: int, height: int) -> bytes:
    sps, pps = parameters.sps, parameters.pps
    configuration = box(
        b"avcC",
        bytes([1]), sps[1:4], bytes([0xFF]),  # four bytes of length before each NAL unit
        bytes([0xE1]), struct.pack(">H", len(sps)), sps,
        bytes([1]), struct.pack(">H", len(pps)), pps,
    )  # fmt: skip
    return box(
        b"avc1",
        struct.pack(">6xH16x2H", 1, width, height),
        struct.pack(">2I4xH32sHh", 0x480000, 0x480000, 1, b"", 24, -1),  # 72 dpi, one frame a sample, no name, depth 24
        configuration,
        box(b"colr", b"nclx", struct.pack(">3HB", BT709, BT709, BT709, 0)),  # 0: limited range
        box(b"pasp", struct.pack(">2I", 1, 1)),
    )
