"""The offline warp and the fit of the error of age, on planes that were drawn by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.reprojection import Sample, fitted
from benchmarks.reprojection_depth import packed
from benchmarks.reprojection_warp import Frame, cropped, turned, with_margins
from benchmarks.views import centred_lens
from tigas_common.pose import Intrinsics, Pose
from tigas_experiments.quality.picture import Picture, compare

LENS = centred_lens(64, 36)
WIDE = with_margins(LENS, 0.25)
HERE = Pose.from_euler(0, 0, 0, (0, 0, 0))
FAR = 5.0


def plane(pose: Pose, lens: Intrinsics, distance: float = FAR) -> Picture:
    """Waves on a plane z = distance; or on the sky, if that is infinite."""
    columns, rows = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    rays = np.stack([(columns - lens.cx) / lens.fx, (rows - lens.cy) / lens.fy, np.ones_like(rows)], -1)
    rays = rays @ np.array(pose.rotation).T
    at = rays / rays[..., 2:]
    if np.isfinite(distance):
        x, y, z = pose.position
        at = (at * (distance - z) + (x, y, 0)) / distance
    waves = 127 + 60 * np.sin(14 * at[..., 0]) + 60 * np.cos(11 * at[..., 1])
    return np.repeat(waves[..., None], 3, axis=-1).astype(np.uint8)


def frame(distance: float = FAR) -> Frame:
    return Frame(plane(HERE, WIDE, distance), HERE, WIDE)


def test_the_frame_s_own_view_is_its_middle() -> None:
    assert (WIDE.width, WIDE.height) == (96, 54)
    assert np.array_equal(cropped(frame(), LENS), plane(HERE, LENS))
    picture, border = turned(frame(), HERE, LENS, 1 / FAR)
    assert border == 0
    assert compare(picture, plane(HERE, LENS)).psnr_db > 45


def test_what_is_infinitely_far_is_turned() -> None:
    pose = Pose.from_euler(8, -3, 5, (0.4, 0.1, 0))
    picture, border = turned(frame(np.inf), pose, LENS, 0.0)
    assert border == 0
    assert compare(picture, plane(pose, LENS, np.inf)).psnr_db > 35


def test_what_is_near_moves_by_its_depth() -> None:
    pose = Pose.from_euler(4, 0, 2, (0.3, -0.1, 0.2))
    depth = np.full((27, 48), 1 / FAR)
    truth = plane(pose, LENS)
    by_depth, by_turning = (compare(turned(frame(), pose, LENS, way)[0], truth).psnr_db for way in (depth, 0.0))
    assert by_depth > 35 > 25 > by_turning


def test_the_share_beyond_the_margins_is_the_border() -> None:
    half = 2 * np.degrees(np.arctan(LENS.width / 2 / LENS.fx))  # a whole view further right: half a margin is left
    _, border = turned(frame(np.inf), Pose.from_euler(half, 0, 0, (0, 0, 0)), LENS, 0.0)
    assert 0.6 < border < 0.9


def test_depth_arrives_as_it_was_sent_but_for_a_few_codes() -> None:
    inverse = np.linspace(0.05, 0.5, 40 * 72, dtype=np.float32).reshape(40, 72)
    found, sent = packed(inverse)
    assert np.abs(found - inverse).mean() < 4 * 0.5 / 255
    assert 50 < sent < 2000


def test_the_error_of_age_is_a_power_of_the_turn() -> None:
    samples = [
        Sample("room", "walk", 0, 50, "depth", turn, 0.0, mse=12 * (turn / 4) ** 1.5, psnr_db=30, ssim=1, border=0)
        for turn in (0.0, 0.5, 1, 2, 4, 8)
    ]
    error, power = fitted(samples)
    assert error == pytest.approx(12, rel=0.02)
    assert power == pytest.approx(1.5, rel=0.02)
