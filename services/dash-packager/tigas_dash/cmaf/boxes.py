"""The bytes of ISO base media file format boxes (ISO/IEC 14496-12)."""

from __future__ import annotations

import struct

UNITY_MATRIX = struct.pack(">9I", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)
"""No transformation of the picture."""


def box(kind: bytes, *content: bytes) -> bytes:
    """A box: its length, its four-character code, its content."""
    body = b"".join(content)
    return struct.pack(">I4s", 8 + len(body), kind) + body


def full_box(kind: bytes, version: int, flags: int, *content: bytes) -> bytes:
    """A box that begins with version and flags."""
    return box(kind, struct.pack(">I", version << 24 | flags), *content)


def brands(kind: bytes, major: bytes, *compatible: bytes) -> bytes:
    """A file type (`ftyp`) or segment type (`styp`) box."""
    return box(kind, major, bytes(4), *compatible)
