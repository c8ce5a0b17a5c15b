"""Made-up sampled pictures: small views with edges and gradients, as JPEGs of a rung with their truth."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import RenderRequest
from tigas_experiments.quality.picture import Picture, encode, upscale_bicubic
from tigas_experiments.records.samples import JPEG, TRUTH, write_sample_file, write_samples
from tigas_experiments.wire.recording import Sample

WIDTH, HEIGHT = 128, 72


def view(seed: int = 1, width: int = WIDTH, height: int = HEIGHT) -> Picture:
    """A view of nothing in particular."""
    chance = np.random.default_rng(seed)
    coarse = gaussian_filter(chance.normal(size=(height, width, 3)), (6, 6, 0)) * 6
    edges = np.sign(gaussian_filter(chance.normal(size=(height, width, 3)), (3, 3, 1))) * 0.25
    fine = gaussian_filter(chance.normal(size=(height, width, 3)), (0.7, 0.7, 0)) * 0.2
    return np.asarray(np.clip(128 + 90 * (coarse + edges + fine), 0, 255), np.uint8)


def jpeg(picture: Picture, quality: int) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()


def reduced(picture: Picture, scale: int) -> Picture:
    """A rung's picture: smaller by this factor."""
    height, width = picture.shape[:2]
    return np.asarray(Image.fromarray(picture).resize((width // scale, height // scale), Image.Resampling.BOX))


def halfway(picture: Picture, truth: Picture) -> Picture:
    """An enhancement that undoes half of the damage."""
    height, width = truth.shape[:2]
    mixed: Picture = ((upscale_bicubic(picture, width, height).astype(np.uint16) + truth) // 2).astype(np.uint8)
    return mixed


def write_triplets(
    run: Path,
    count: int = 3,
    quality: int = 40,
    enhance: Callable[[Picture, Picture], Picture] | None = halfway,
    model: str = "scene",
) -> Path:
    """Samples, numbered 10, 20, …, in a folder that may be a run's."""
    samples = []
    for seq in range(10, 10 * count + 1, 10):
        truth = view(seq)
        data = jpeg(reduced(truth, 2), quality)
        write_sample_file(run, seq, JPEG, data)
        write_sample_file(run, seq, TRUTH, encode(truth))
        if enhance is not None:
            shown = enhance(np.asarray(Image.open(io.BytesIO(data))), truth)
            write_sample_file(run, seq, "enhanced.png", encode(shown))
        samples.append(_sample(seq, len(data), model if enhance is not None else "off"))
    write_samples(run, samples)
    return run


def _sample(seq: int, size: int, model: str) -> Sample:
    lens = Intrinsics(60, 60, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)
    request = RenderRequest.at("courtyard", Pose.from_euler(0, 0, 0, (0, 0, 0)), lens, profile=2)
    return Sample(
        seq=seq,
        at=float(seq),
        request=request.model_copy(update={"seq": seq}),
        rung=2,
        bytes=size,
        upscale=model,
        enhance_ms=None if model == "off" else 3.0,
        width=WIDTH,
        height=HEIGHT,
        enhanced=model != "off",
    )
