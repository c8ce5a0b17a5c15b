"""H.264 byte streams (ITU-T H.264, annex B): taking them apart."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator

from tigas_dash.cmaf.header import ParameterSets

_START_CODE = re.compile(rb"\x00\x00\x00?\x01")
_SEI, _SPS, _PPS, _DELIMITER = 6, 7, 8, 9


def nal_units(stream: bytes) -> Iterator[bytes]:
    """The NAL units of a byte stream, without their start codes."""
    for unit in _START_CODE.split(stream)[1:]:
        if unit:
            yield unit


def parameter_sets(stream: bytes) -> ParameterSets:
    """The first parameter sets in a byte stream. Raises ValueError if it has none."""
    found = {unit[0] & 0x1F: unit for unit in reversed(list(nal_units(stream)))}
    if _SPS not in found or _PPS not in found:
        raise ValueError("the encoder gave no parameter sets")
    return ParameterSets(found[_SPS], found[_PPS])


def to_sample(stream: bytes) -> bytes:
    """A frame in an `mdat`: lengths for start codes, without the parameter sets of the init segment."""
    units = (unit for unit in nal_units(stream) if unit[0] & 0x1F not in (_SEI, _SPS, _PPS, _DELIMITER))
    return b"".join(struct.pack(">I", len(unit)) + unit for unit in units)
