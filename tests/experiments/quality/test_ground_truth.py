"""Captures against ground truth, and the comparison of two pictures."""

from __future__ import annotations

import json
import math
import struct
import zlib

import httpx
import numpy as np
import pytest
from PIL import Image

from tests.experiments.made_up import LENS, inputs, png
from tests.experiments.triplets_made_up import jpeg, view
from tests.scenes import ALONE
from tigas_common.render_requests import RenderClient
from tigas_experiments.errors import RunFailed
from tigas_experiments.quality.ground_truth import GroundTruth
from tigas_experiments.quality.picture import MAX_PSNR_DB, BrokenPicture, compare, decode, encode
from tigas_experiments.wire.recording import Capture

pytestmark = pytest.mark.anyio

SAMPLED = inputs(10)  # poses 1 to 10, at 0, 20, … ms, at x = 0, 1, …


class Renderer:
    """Answers with a picture that depends on the camera's position; records its requests."""

    def __init__(self, answer: httpx.Response | None = None) -> None:
        self.asked: list[float] = []
        self._answer = answer

    def __call__(self, request: httpx.Request) -> httpx.Response:
        if request.url.path == "/config.json":
            return httpx.Response(200, content=ALONE.model_dump_json())
        wanted = json.loads(request.content)
        assert (wanted["format"], wanted["width"], wanted["height"]) == ("png", LENS.width, LENS.height)
        assert "profile" not in wanted, "ground truth has the viewport's own resolution"
        self.asked.append(wanted["position"][0])
        return self._answer or httpx.Response(200, content=png(shade=int(20 * wanted["position"][0])))


def truth(renderer: Renderer) -> GroundTruth:
    http = httpx.AsyncClient(base_url="http://render", transport=httpx.MockTransport(renderer))
    return GroundTruth(RenderClient(http), "courtyard", LENS)


def capture(at: float, pose: int, shown_at: float | None = None) -> Capture:
    """A frame of a pose, on the screen at a tick, and since when."""
    return Capture(at=at, shown_at=at if shown_at is None else shown_at, pose=pose, rung=2, width=64, height=36)


async def test_a_picture_is_compared_with_its_own_pose_and_by_the_viewer_s() -> None:
    renderer = Renderer()
    quality = await truth(renderer).assess(png(shade=40), capture(at=150, pose=3, shown_at=110), SAMPLED)
    assert renderer.asked == [2, 5, 7], "pose 3 stands at x = 2; at 110 ms the viewer was at x = 5, at 150 ms at x = 7"
    assert quality is not None
    assert (quality.picture, quality.view, quality.seen) == tuple(
        compare(decode(png(shade=40)), decode(png(shade=shade))) for shade in (40, 100, 140)
    )


async def test_a_picture_that_is_not_late_is_rendered_once() -> None:
    renderer = Renderer()
    quality = await truth(renderer).assess(png(shade=40), capture(at=45, pose=3), SAMPLED)
    assert renderer.asked == [2]
    assert quality is not None
    assert quality.picture == quality.view == quality.seen


async def test_a_turned_picture_is_compared_with_the_pose_it_was_turned_to_and_its_holes_are_counted() -> None:
    renderer = Renderer()
    shown = np.dstack((decode(png(shade=100)), np.full((36, 64), 255, np.uint8)))
    shown[:, 60:, 3] = 0
    turned = capture(at=150, pose=3, shown_at=150).model_copy(update={"view": 6})
    quality = await truth(renderer).assess(encode(shown), turned, SAMPLED)
    assert renderer.asked == [5, 7], "pose 6 stands at x = 5; at 150 ms the viewer was at x = 7"
    assert quality is not None
    assert quality.picture is None, "no frame as it was rendered"
    assert quality.uncovered == 4 / 64
    on_black = decode(png(shade=100)).copy()
    on_black[:, 60:] = 0
    assert quality.view == compare(on_black, decode(png(shade=100)))


async def test_a_frame_of_a_predicted_pose_has_no_picture_to_be_compared_with() -> None:
    renderer = Renderer()
    quality = await truth(renderer).assess(png(), capture(at=150, pose=3, shown_at=110), SAMPLED, predicted=True)
    assert renderer.asked == [5, 7]
    assert quality is not None
    assert (quality.picture, quality.uncovered) == (None, 0)


async def test_a_stalled_page_s_picture_is_compared_with_where_the_viewer_should_have_been() -> None:
    """There were no samples from 40 to 100 ms; the due poses have the next one's number."""
    stalled = [
        entry.model_copy(update={"missed": True, "pose": 6}) if 40 <= entry.at < 100 else entry for entry in SAMPLED
    ]
    renderer = Renderer()
    await truth(renderer).assess(png(shade=40), capture(at=85, pose=2, shown_at=30), stalled)
    await truth(renderer).assess(png(shade=40), capture(at=105, pose=6, shown_at=105), stalled)
    assert renderer.asked == [1, 4, 5]


async def test_a_frame_from_before_the_run_counts_for_what_is_seen_alone() -> None:
    renderer = Renderer()
    quality = await truth(renderer).assess(png(shade=100), capture(at=100, pose=0, shown_at=-400), SAMPLED)
    assert quality is not None
    assert (quality.picture, quality.view) == (None, None)
    assert quality.seen is not None
    assert quality.seen.psnr_db == 100


async def test_what_was_seen_before_a_first_frame_is_black() -> None:
    renderer = Renderer()
    nothing = encode(np.zeros((36, 64, 4), np.uint8))
    quality = await truth(renderer).assess(nothing, capture(at=150, pose=-1, shown_at=-1), SAMPLED)
    assert renderer.asked == [7], "at 150 ms the viewer was at x = 7"
    assert quality is not None
    assert (quality.picture, quality.view, quality.uncovered) == (None, None, 1.0)
    assert quality.seen == compare(np.zeros((36, 64, 3), np.uint8), decode(png(shade=140)))


async def test_nothing_is_compared_before_the_viewer_moves() -> None:
    renderer = Renderer()
    assert await truth(renderer).assess(png(), capture(-5, 3), SAMPLED) is None
    assert renderer.asked == []


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (httpx.Response(503, content=b"{}"), "answers with status 503"),
        (httpx.Response(200, content=b"<html>"), "cannot be read"),
    ],
)
async def test_a_service_that_fails_costs_the_run(answer: httpx.Response, sentence: str) -> None:
    with pytest.raises(RunFailed, match=sentence):
        await truth(Renderer(answer)).assess(png(), capture(100, 3), SAMPLED)


def test_equal_pictures() -> None:
    picture = decode(png())
    quality = compare(picture, picture)
    assert quality.psnr_db == MAX_PSNR_DB
    assert quality.ssim == pytest.approx(1)


def test_psnr_of_a_known_error() -> None:
    truth = np.full((32, 32, 3), 100, np.uint8)
    assert compare(truth + np.uint8(10), truth).psnr_db == pytest.approx(10 * math.log10(255**2 / 100))


def test_ssim_falls_with_structure_and_not_with_a_shift_of_brightness() -> None:
    random = np.random.default_rng(1)
    truth = random.integers(60, 190, (64, 64, 3), np.uint8)
    noise = np.clip(truth + random.integers(-40, 41, truth.shape), 0, 255).astype(np.uint8)
    assert compare(truth + np.uint8(20), truth).ssim > 0.95
    assert compare(noise, truth).ssim < 0.9


def test_a_smaller_frame_is_shown_as_large_as_the_viewport() -> None:
    truth = decode(png(width=128, height=72))
    small = np.asarray(Image.fromarray(truth).resize((64, 36), Image.Resampling.BOX))
    assert compare(small, truth).psnr_db > 30


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n\x1a\nrubbish", png()[:60], b"GIF89a"])
def test_what_is_no_picture(data: bytes) -> None:
    with pytest.raises(BrokenPicture, match="cannot be read"):
        decode(data)


@pytest.mark.parametrize("side", [6_000, 12_000, 30_000])
def test_a_picture_of_too_many_pixels(side: int) -> None:
    """Pillow warns of the second, and refuses the third itself."""
    header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", len(header)) + b"IHDR" + header + struct.pack(">I", zlib.crc32(b"IHDR" + header))
    with pytest.raises(BrokenPicture, match="pixels"):
        decode(b"\x89PNG\r\n\x1a\n" + chunk + struct.pack(">I", 0) + b"IDAT" + struct.pack(">I", zlib.crc32(b"IDAT")))


def test_psnr_and_ssim_fall_as_compression_grows() -> None:
    truth = view()
    found = [compare(picture, truth) for picture in (truth, *(decode(jpeg(truth, q)) for q in (95, 70, 40, 15, 3)))]
    for values in ([quality.psnr_db for quality in found], [quality.ssim for quality in found]):
        assert values == sorted(values, reverse=True)
        assert len(set(values)) == 6
