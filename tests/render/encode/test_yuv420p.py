"""Raw video has the values that BT.709 gives."""

from __future__ import annotations

import numpy as np
import pytest

from tigas_render.encode.images import encode_yuv420p


@pytest.mark.parametrize(
    ("rgb", "yuv"),
    [
        ((0, 0, 0), (16, 128, 128)),
        ((255, 255, 255), (235, 128, 128)),
        ((255, 0, 0), (63, 102, 240)),
        ((0, 255, 0), (173, 42, 26)),
        ((0, 0, 255), (32, 240, 118)),
    ],
)
def test_yuv420p_has_the_published_values_of_the_primaries(rgb: tuple[int, ...], yuv: tuple[int, ...]) -> None:
    """The 8-bit code values of BT.709's primaries, limited range."""
    pixels = np.broadcast_to(np.array(rgb, np.uint8), (5, 7, 3)).copy()
    planes = np.frombuffer(encode_yuv420p(pixels), np.uint8)
    assert planes.size == 5 * 7 + 2 * 3 * 4
    means = [plane.mean() for plane in np.split(planes, [35, 47])]
    assert means == pytest.approx(yuv, abs=1)
    assert all(np.ptp(plane) == 0 for plane in np.split(planes, [35, 47]))
