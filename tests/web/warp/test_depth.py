"""The page reads the depth that frames carry."""

from __future__ import annotations

import base64
import io
import struct
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page

from tests.web.warp.views import (
    encoded,
    noise,
)
from tigas_render.encode import depth_segment


def with_depth(jpeg: bytes, nearest: float, image: bytes) -> bytes:
    content = b"tigas:depth\0" + struct.pack(">f", nearest) + image
    return jpeg[:2] + b"\xff\xe9" + struct.pack(">H", len(content) + 2) + content + jpeg[2:]


def decoded_depth(page: Page, jpeg: bytes) -> dict[str, Any] | None:
    depth: dict[str, Any] | None = page.evaluate(
        """async (jpeg) => {
          const { decodeDepth } = await import("/depth.js");
          const depth = await decodeDepth(new Blob([bytes(jpeg)]));
          return depth && { ...depth, codes: [...depth.codes] };
        }""",
        base64.b64encode(jpeg).decode(),
    )
    return depth


@pytest.mark.parametrize(
    ("kind", "options"),
    [("webp", {"lossless": True}), ("webp", {"quality": 95}), ("jpeg", {"quality": 95}), ("png", {})],
)
def test_a_frame_s_depth_has_the_codes_that_were_sent(page: Page, kind: str, options: dict[str, Any]) -> None:
    y, x = np.mgrid[:104, :184]
    codes = np.round(127.5 + 127.5 * np.sin(x / 40) * np.cos(y / 30)).astype(np.uint8)
    frame = encoded(noise(32, 18), "jpeg")
    sent = encoded(codes, kind, **options)
    depth = decoded_depth(page, with_depth(frame, 0.25, sent))
    assert depth is not None
    assert (depth["width"], depth["height"], depth["nearest"]) == (184, 104, 0.25)
    with Image.open(io.BytesIO(sent)) as image:
        expected = np.asarray(image.convert("L"), dtype=int)
    assert np.abs(np.reshape(depth["codes"], codes.shape) - expected).max() <= 1


def test_the_page_reads_the_depth_that_the_server_writes(page: Page) -> None:
    y, x = np.mgrid[:104, :184]
    inverse = (0.3 + 0.2 * np.sin(x / 40) * np.cos(y / 30)).astype(np.float32)
    depth = decoded_depth(
        page, depth_segment.insert_depth(encoded(noise(32, 18), "jpeg"), depth_segment.encode_depth(inverse))
    )
    assert depth is not None
    found = depth["nearest"] * np.reshape(depth["codes"], inverse.shape) / 255
    assert np.abs(found - inverse).mean() < 0.005


@pytest.mark.parametrize(
    "image", [b"no image", encoded(noise(64, 36), "png")[:99], encoded(np.zeros((1, 20_000), np.uint8), "png")]
)
def test_a_broken_depth_is_none(page: Page, image: bytes) -> None:
    frame = encoded(noise(32, 18), "jpeg")
    assert decoded_depth(page, with_depth(frame, 0.25, image)) is None
    assert decoded_depth(page, frame) is None
