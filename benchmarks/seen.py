"""What the simulator judges controllers by: how far pictures of a rung, and late ones, are from what should be seen.

    python -m benchmarks.seen walk.csv [more.csv …] [--scene NAME=PLY …] [--cameras cameras.json] --predicted poses.csv
        --out web/src/simulator/seen-error.json

Rungs: PSNR and SSIM of the courtyard's views at the rungs of its ladder and at the paper's, as `tigas scene ladder`
measures them. Late pictures: those of `benchmarks.reprojection`, 20 to 2000 ms old; for each way of showing them, the
mean squared error and SSIM of those that turned about as far, in groups of equal size. Nobody asks for poses further
ahead than those in --predicted, so older frames count as shown by depth.
"""

from __future__ import annotations

import io
import json
from itertools import islice
from pathlib import Path
from typing import Annotated, TypedDict

import numpy as np
import typer
from PIL import Image

from benchmarks.reprojection import Bench, Predicted, Sample, read_predicted, walked, write_samples
from benchmarks.views import centred_lens, chosen
from tigas_common.standpoints import Place, intrinsics
from tigas_common.wire.render import DEFAULT_LADDER, Rung
from tigas_experiments.quality.picture import compare
from tigas_render.encode.jpeg import encode_jpeg
from tigas_render.ladder.measure import DISPLAY, walks
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.scenes.demo import DEMO_METADATA, demo_scene
from tigas_render.scenes.registry import BUILTIN

HORIZONS_MS = (20, 50, 100, 200, 300, 500, 1000, 2000)
WAYS = ("stale", "rotation", "depth", "predicted")
GROUPS = 8
VIEWS = 6


class Picture(TypedDict):
    """Of one rung."""

    kb: float
    psnr_db: float
    ssim: float


class Late(TypedDict):
    """Of pictures that turned about as far."""

    turn_deg: float
    mse: float
    ssim: float


def grouped(samples: list[Sample], groups: int = GROUPS) -> list[Late]:
    """Means of groups of equal size, by the turn; an error never falls where the view has turned further."""
    ordered = sorted(samples, key=lambda one: one.turn_deg)
    parts = [part for part in np.array_split(np.arange(len(ordered)), groups) if len(part)]
    found: list[Late] = []
    for part in parts:
        own = [ordered[i] for i in part]
        turn, mse, ssim = (float(np.mean([getattr(one, name) for one in own])) for name in ("turn_deg", "mse", "ssim"))
        mse = max(mse, found[-1]["mse"]) if found else mse
        ssim = min(ssim, found[-1]["ssim"]) if found else ssim
        found.append(Late(turn_deg=round(turn, 2), mse=round(mse, 1), ssim=round(ssim, 4)))
    return found


def pictures(rungs: tuple[Rung, ...]) -> list[Picture]:
    """PSNR of the mean squared error, mean SSIM and size over views of the courtyard, at display size."""
    rasterizer = CpuRasterizer()
    scene = rasterizer.prepare(demo_scene())
    assert DEMO_METADATA.camera is not None
    poses = list(islice(walks(Place.of(DEMO_METADATA.camera, DEMO_METADATA.up), "seen"), VIEWS))
    lens = intrinsics(*DISPLAY)

    def rendered(camera: Camera) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
        with rasterizer.render(scene, camera, "png") as image:
            return image.to_host().copy()

    found: list[Picture] = []
    truths = [rendered(Camera(pose, lens, DEMO_METADATA.background)) for pose in poses]
    for rung in rungs:
        size = (rung.width, rung.height)
        sharp = max(1.0, DISPLAY[0] / rung.width)
        errors, similar, sizes = [], [], []
        for pose, truth in zip(poses, truths, strict=True):
            frame = rendered(Camera(pose, lens.resized(*size), DEMO_METADATA.background, sharp))
            body = encode_jpeg(frame, rung.quality)
            with Image.open(io.BytesIO(body)) as opened:
                shown = np.asarray(opened.convert("RGB").resize(DISPLAY, Image.Resampling.BICUBIC))
            errors.append(float(np.mean(np.square(shown.astype(np.float32) - truth))))
            similar.append(compare(shown, truth).ssim)
            sizes.append(len(body) / 1000)
        psnr = 10 * float(np.log10(255**2 / np.mean(errors)))
        found.append(
            Picture(kb=round(float(np.mean(sizes)), 2), psnr_db=round(psnr, 2), ssim=round(float(np.mean(similar)), 4))
        )
    return sorted(found, key=lambda one: -one["psnr_db"])


def main(
    movements: Annotated[list[Path], typer.Argument(metavar="MOVEMENT…")],
    predicted: Annotated[Path, typer.Option(help="CSV: movement, t_ms, horizon_ms, x, y, z, qx … qw.")],
    out: Annotated[Path, typer.Option(help="JSON.")],
    scene: Annotated[list[str] | None, typer.Option(metavar="NAME=PLY", help="Without: the courtyard.")] = None,
    cameras: Annotated[Path | None, typer.Option(help="JSON with a start camera for each scene.")] = None,
    moments: Annotated[int, typer.Option(help="Of each movement in each scene.")] = 10,
    size: Annotated[str, typer.Option(help="Of late pictures.")] = "640x360",
    samples_out: Annotated[Path | None, typer.Option("--samples", help="Every late picture, as CSV.")] = None,
) -> None:
    """Measure both, and write the table."""
    width, height = map(int, size.split("x"))
    poses: Predicted = read_predicted(predicted)
    samples: list[Sample] = []
    for name, gaussians, view in chosen(scene, cameras):
        bench = Bench(name, gaussians, view, 0.15, centred_lens(width, height))
        for path in movements:
            walk = walked(path, bench.info)
            for at in walk.moments(moments, HORIZONS_MS[-1]):
                samples += bench.samples(walk, at, poses, HORIZONS_MS)
    if samples_out is not None:
        write_samples(samples, samples_out)
    furthest = max((one.horizon_ms for one in samples if one.way == "predicted"), default=0)
    late = {way: [one for one in samples if one.way == way] for way in WAYS}
    late["predicted"] += [one for one in late["depth"] if one.horizon_ms > furthest]
    ladder = BUILTIN["courtyard"].ladder or ()
    distinct = tuple({(one.width, one.height, one.quality): one for one in (*ladder, *DEFAULT_LADDER)}.values())
    table = {
        "rungs": pictures(distinct),
        "late": {way: grouped(own) for way, own in late.items()},
    }
    out.write_text(json.dumps(table, indent=2) + "\n")


if __name__ == "__main__":
    typer.run(main)
