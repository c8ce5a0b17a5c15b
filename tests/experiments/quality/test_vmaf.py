"""VMAF and VIFp through libvmaf: best of equal pictures, falling with compression, and not the same the other way."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from tests.experiments.triplets_made_up import jpeg, view
from tigas_common.errors import StartError
from tigas_common.installation import install_command
from tigas_experiments.errors import MetricUnavailable
from tigas_experiments.quality.picture import Picture, decode
from tigas_experiments.quality.vmaf import ffmpeg, lossless_video, vmaf_and_vif


def luma(picture: Picture) -> NDArray[np.float64]:
    """BT.709, limited range, as 8 bits have it."""
    return np.asarray(np.round(16 + 219 / 255 * (picture @ np.array([0.2126, 0.7152, 0.0722]))))


def readable_vif(picture: Picture, truth: Picture) -> float:
    """Sheikh and Bovik's VIF in the pixel domain (their vifp_mscale.m), without an edge where windows leave."""
    reference, distorted = luma(truth), luma(picture)
    told, could_be_told = 0.0, 0.0
    for scale in range(4):
        size = 2 ** (4 - scale) + 1
        window = np.exp(-((np.arange(size) - size // 2) ** 2) / (2 * (size / 5) ** 2))
        window /= window.sum()

        def mean(x: NDArray[np.float64], window: NDArray[np.float64] = window) -> NDArray[np.float64]:
            return np.asarray(correlate1d(correlate1d(x, window, 0, mode="mirror"), window, 1, mode="mirror"))

        if scale:
            reference, distorted = mean(reference)[::2, ::2], mean(distorted)[::2, ::2]
        variance = np.maximum(mean(reference**2) - mean(reference) ** 2, 0)
        distorted_variance = np.maximum(mean(distorted**2) - mean(distorted) ** 2, 0)
        covariance = mean(reference * distorted) - mean(reference) * mean(distorted)
        gain = np.maximum(covariance / (variance + 1e-10), 0)
        noise = np.maximum(distorted_variance - gain * covariance, 1e-10)
        told += np.log2(1 + gain**2 * variance / (noise + 2)).sum()
        could_be_told += np.log2(1 + variance / 2).sum()
    return told / could_be_told


def test_both_fall_as_compression_grows_and_equal_pictures_are_the_best() -> None:
    truth = view()
    pictures = [truth, *(decode(jpeg(truth, quality)) for quality in (90, 60, 30, 10, 3))]
    found = vmaf_and_vif((number, picture, truth) for number, picture in enumerate(pictures))
    vmafs, vifs = zip(*found.values(), strict=True)
    assert vmafs[0] > 95
    assert list(vmafs[1:]) == sorted(vmafs[1:], reverse=True)
    assert max(vmafs) - vmafs[0] < 1
    assert vifs[0] == pytest.approx(1, abs=1e-3)
    assert list(vifs) == sorted(vifs, reverse=True)


def test_vif_is_that_of_the_literature() -> None:
    truth = view(5)
    pictures = [decode(jpeg(truth, quality)) for quality in (80, 40, 10)]
    found = vmaf_and_vif((number, picture, truth) for number, picture in enumerate(pictures))
    expected = [readable_vif(picture, truth) for picture in pictures]
    assert [vif for _, vif in found.values()] == pytest.approx(expected, abs=0.01)


def test_picture_and_truth_are_not_exchanged() -> None:
    truth = view()
    flat = (128 + (truth.astype(np.float32) - 128) * 0.6).astype(np.uint8)
    ((_, less),) = vmaf_and_vif([(1, flat, truth)]).values()
    ((_, more),) = vmaf_and_vif([(1, truth, flat)]).values()
    assert less < 0.98 < 1.02 < more


def test_numbers_stay_with_their_pictures() -> None:
    truths = {number: view(number) for number in (7, 3, 5)}
    frames = [(number, truth if number == 3 else view(99), truth) for number, truth in truths.items()]
    found = vmaf_and_vif(frames)
    assert list(found) == [7, 3, 5]
    assert found[3][1] == pytest.approx(1, abs=1e-3)
    assert max(found[7][1], found[5][1]) < 0.5


@pytest.mark.parametrize(("width", "height"), [(65, 37), (32, 32)])
def test_odd_and_small_pictures(width: int, height: int) -> None:
    truth = view(1, width, height)
    ((vmaf, vif),) = vmaf_and_vif([(1, truth, truth)]).values()
    assert vmaf > 90
    assert vif == pytest.approx(1, abs=1e-3)


def test_pictures_of_two_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="cannot be compared"):
        vmaf_and_vif([(1, view(1, 64, 36), view(1))])


def test_a_failure_of_ffmpeg_is_a_sentence() -> None:
    tiny = np.zeros((8, 8, 3), np.uint8)
    with pytest.raises(StartError, match="ffmpeg could not compute VMAF: "):
        vmaf_and_vif([(1, tiny, tiny)])


def test_the_video_has_every_bit(tmp_path: Path) -> None:
    pictures = [view(seed, 50, 34) for seed in (1, 2)]
    with lossless_video(tmp_path / "a.mkv") as add:
        for picture in pictures:
            add(picture)
    with av.open(tmp_path / "a.mkv") as container:
        found = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert np.array_equal(found, pictures)


def test_without_ffmpeg_or_libvmaf_there_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/bin/true")
    with pytest.raises(MetricUnavailable, match="/bin/true has no libvmaf"):
        ffmpeg()
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MetricUnavailable, match=re.escape(install_command("lab"))):
        ffmpeg()
