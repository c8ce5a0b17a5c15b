"""How much scene-tuned and general networks gain over bicubic enlargement, on held-out views of a list of scenes.

    python -m benchmarks.enhance_quality OUT SCENES [SCENE …] [--seconds 45] [--keep-out SCENE …] [--jobs-per-gpu 1]

SCENES is a models directory; without names, every folder of it and the built-in courtyard are measured. For each scene
a set of networks is trained on its own views. General sets are trained on several: one for each scene that leaves this
scene out (and every --keep-out), to test it on what it never saw, and one on all but those that are kept out, to ship.
Into OUT go `SCENE.safetensors`, `general.safetensors`, `results.json` and `results.md`. One job a GPU at a time, or one
at a time without.

"before" is the picture that lower rungs had when 3DGS's dilation was applied in their own pixels: rendered at the
rung's size for that size, encoded here at the rung's quality, and enlarged bicubically. Numbers are of pixels that are
not background, at display size; intervals are 95 %, bootstrapped over views, and for a mean of scenes over scenes, too.
LPIPS and DISTS are of whole pictures, less is better, and only there after `tigas quality fetch`.
"""

from __future__ import annotations

import argparse
import io
import json
import queue
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from tigas_common.standpoints import intrinsics
from tigas_common.weights import Weights, write_weights
from tigas_common.wire.render import RenderRequest, Rung, SceneInfo
from tigas_enhance.evaluate import bicubic_scores, enhanced_scores, interval
from tigas_enhance.network import Network, resampled, shown
from tigas_enhance.pairs import Pair, Pixels, Renderer
from tigas_enhance.renderer_process import render_service
from tigas_enhance.tuning import RECIPES, SceneViews, collect, common_ladder, fit, to_network
from tigas_enhance.views import held_out_views
from tigas_experiments.quality.perceptual import Perceptual
from tigas_experiments.quality.weights import NoWeights, dists, lpips

BUILT_IN = "courtyard"
GENERAL = "general"
RENDERING = 0.3
"""The share of a job's time in which views are rendered, at most."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Job:
    """One set to train, and the scenes to test it on."""

    name: str
    train: tuple[str, ...]
    test: tuple[str, ...]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--seconds", type=float, default=45, help="of each set, rendering included")
    parser.add_argument("--general-seconds", type=float, help="of each general set; twice as much if left out")
    parser.add_argument("--keep-out", nargs="*", default=[], help="scenes that no general set is trained on")
    parser.add_argument("--views", type=int, default=256, help="training views of a set")
    parser.add_argument("--held-out", type=int, default=24, help="held-out views of a scene")
    parser.add_argument("--channels", type=int, default=16)
    parser.add_argument("--jobs-per-gpu", type=int, default=1)
    parser.add_argument("--job", help=argparse.SUPPRESS)
    parser.add_argument("--device", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    arguments.general_seconds = arguments.general_seconds or 2 * arguments.seconds
    if arguments.job:
        name, train, test = json.loads(arguments.job)
        work(Job(name, tuple(train), tuple(test)), arguments)
        return
    folders = sorted(path.name for path in arguments.scenes.iterdir() if path.is_dir())
    names = arguments.names or [BUILT_IN, *(name for name in folders if name != BUILT_IN)]
    arguments.out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    results = run_all(jobs(names, arguments.keep_out), arguments)
    (arguments.out / "results.json").write_text(json.dumps(results))
    text = "\n".join(report(results, names))
    (arguments.out / "results.md").write_text(f"{text}\n")
    print(text)
    print(f"\n{time.monotonic() - began:.0f} s")


def jobs(names: Sequence[str], kept_out: Sequence[str]) -> list[Job]:
    """The long ones first."""
    learnt = [name for name in names if name not in kept_out]
    unseen = [Job(f"without-{name}", tuple(n for n in learnt if n != name), (name,)) for name in learnt]
    shipped = Job(GENERAL, tuple(learnt), tuple(kept_out))
    return [shipped, *(unseen if len(learnt) > 1 else []), *(Job(name, (name,), (name,)) for name in names)]


def run_all(todo: Sequence[Job], arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Each in a process of its own, on a GPU that is free."""
    gpus = [f"cuda:{index}" for index in range(torch.cuda.device_count())] * arguments.jobs_per_gpu or ["cpu"]
    free: queue.Queue[str] = queue.Queue()
    for gpu in gpus:
        free.put(gpu)

    def run(job: Job) -> list[dict[str, Any]]:
        device = free.get()
        call = json.dumps([job.name, job.train, job.test])
        began = time.monotonic()
        try:
            command = [sys.executable, "-m", "benchmarks.enhance_quality", *sys.argv[1:], "--job", call]
            done = subprocess.run([*command, "--device", device], capture_output=True, text=True, check=False)
        finally:
            free.put(device)
        print(f"{job.name}: {time.monotonic() - began:.0f} s on {device}", file=sys.stderr, flush=True)
        if done.returncode:
            print(f"{job.name} failed:\n{done.stderr[-2000:]}", file=sys.stderr, flush=True)
            return []
        found: list[dict[str, Any]] = json.loads(done.stdout.splitlines()[-1])
        return found

    with ThreadPoolExecutor(len(gpus)) as pool:
        return [row for rows in pool.map(run, todo) for row in rows]


# --- one job ---


def work(job: Job, arguments: argparse.Namespace) -> None:
    """Train a set, write it, and print its scores on held-out views as JSON."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the render service ends, too
    device = torch.device(arguments.device)
    is_own = job.train == job.test
    seconds = arguments.seconds if is_own else arguments.general_seconds
    service = render_service(arguments.scenes, arguments.device, own_ladders=False)
    with service as url, Renderer(url, workers=8) as renderer:
        trained = [renderer.load(name) for name in job.train]
        ladder = common_ladder(renderer, trained)
        began = time.monotonic()
        views: list[SceneViews] = []
        for index, scene in enumerate(trained):
            until = began + seconds * RENDERING * (index + 1) / len(job.train)
            number = max(8, arguments.views // len(job.train))
            views.append(collect(renderer, scene, ladder, number, 4, until))
        recipe = replace(RECIPES[device.type], channels=arguments.channels)
        weights = fit(views, ladder, began + seconds, device, _unheard, recipe, general=not is_own)
        write_weights(arguments.out / f"{job.name}.safetensors", weights)
        tests = [(name, list(held_out(renderer, renderer.load(name), ladder, arguments.held_out))) for name in job.test]
    rows = [row for name, pairs in tests for row in scores(job, name, pairs, weights, ladder, device)]
    print(json.dumps(rows))


def _unheard(what: str, done: float) -> None:
    """Progress that nobody watches."""


def held_out(renderer: Renderer, scene: SceneInfo, ladder: Sequence[Rung], number: int) -> Iterator[tuple[Pair, Pair]]:
    """Held-out views: as they are, and with the frames as they were before."""

    def both() -> Iterator[tuple[Pair, Pair]]:
        for pose in held_out_views(scene, 4 * number):
            pair = renderer.pair(scene, ladder, range(1, len(ladder)), pose)
            if pair is None:
                continue
            before = {}
            for index, rung in enumerate(ladder[1:], 1):
                lens = intrinsics(rung.width, rung.height)
                request = RenderRequest.at(scene.id, pose, lens, format="png")
                before[index] = as_jpeg(renderer.picture(request), rung.quality)
            yield pair, replace(pair, rungs=before)

    return islice(both(), number)


def as_jpeg(pixels: Pixels, quality: int) -> Pixels:
    """What comes out of a JPEG."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=quality, subsampling="4:2:0")
    return np.asarray(Image.open(buffer).convert("RGB"))


def scores(
    job: Job,
    scene: str,
    tests: Sequence[tuple[Pair, Pair]],
    weights: Weights,
    ladder: Sequence[Rung],
    device: torch.device,
) -> Iterator[dict[str, Any]]:
    """For each rung, of each view."""
    pairs, before = [pair for pair, _ in tests], [old for _, old in tests]
    judges = perceptual(device)
    for info in weights.networks:
        networks = to_network(info, weights)
        old = bicubic_scores(before, info.rung, device)
        plain = bicubic_scores(pairs, info.rung, device)
        better = enhanced_scores(pairs, info.rung, networks, device)
        yield {
            "set": "own" if job.train == job.test else "general",
            "job": job.name,
            "scene": scene,
            "rung": info.rung,
            "name": f"{ladder[info.rung].width} × {ladder[info.rung].height}",
            "before": old.psnr.tolist(),
            "bicubic": plain.psnr.tolist(),
            "enhanced": better.psnr.tolist(),
            "before_ssim": old.ssim.tolist(),
            "bicubic_ssim": plain.ssim.tolist(),
            "enhanced_ssim": better.ssim.tolist(),
            **{
                f"{kind}_{name}": [distance(judge, pair, info.rung, network, device) for pair in pairs]
                for name, judge in judges.items()
                for kind, network in (("bicubic", None), ("enhanced", networks.to(device)))
            },
        }


def perceptual(device: torch.device) -> dict[str, Perceptual]:
    """LPIPS and DISTS, if their weights were fetched."""
    try:
        return {"lpips": lpips().to(device), "dists": dists().to(device)}
    except NoWeights:
        return {}


@torch.no_grad()
def distance(judge: Perceptual, pair: Pair, rung: int, network: Network | None, device: torch.device) -> float:
    """Of a rung's frame from the truth, at display size: enhanced, or enlarged bicubically."""
    low, truth = (
        torch.from_numpy(pixels.copy()).to(device).permute(2, 0, 1)[None].float() / 255
        for pixels in (pair.rungs[rung], pair.full)
    )
    height, width = pair.full.shape[:2]
    picture = resampled(low, width, height).clamp(0, 1) if network is None else shown(network, low, width, height)
    return float(judge((picture * 255).round() / 255, truth)[0])


# --- report ---


def report(results: Sequence[dict[str, Any]], names: Sequence[str]) -> Iterator[str]:
    """Markdown: a table for own sets, and one for general sets on scenes that they never saw."""
    titles = {"own": "Own networks", "general": "General networks, on scenes that they never saw"}
    for kind, title in titles.items():
        rows = [row for row in results if row["set"] == kind]
        if not rows:
            continue
        yield f"## {title}\n"
        judged = [name for name in ("lpips", "dists") if all(f"enhanced_{name}" in row for row in rows)]
        heads = [
            "scene",
            "rung",
            "before",
            "bicubic",
            "enhanced",
            "over bicubic",
            "over before",
            "SSIM",
            "over bicubic",
        ]
        heads += [f"{name.upper()} over bicubic" for name in judged]
        yield f"| {' | '.join(heads)} |"
        yield "|---" * len(heads) + "|"
        for name in names:
            yield from (line(name, [row]) for row in rows if row["scene"] == name)
        for rung in sorted({row["rung"] for row in rows}):
            yield line("**mean**", [row for row in rows if row["rung"] == rung])
        yield line("**mean**", rows, rung="all")
        yield ""


def line(scene: str, rows: Sequence[dict[str, Any]], rung: str | None = None) -> str:
    """One row of a table, of one scene or of several together."""

    def of(key: str) -> list[Floats]:
        return [np.array(row[key]) for row in rows]

    def mean(values: Iterable[Floats]) -> float:
        return float(np.mean([each.mean() for each in values]))

    def gain(new: str, old: str) -> list[Floats]:
        return [a - b for a, b in zip(of(new), of(old), strict=True)]

    over_bicubic, over_before = gain("enhanced", "bicubic"), gain("enhanced", "before")
    similarity = gain("enhanced_ssim", "bicubic_ssim")
    cells = [
        scene,
        rung or f"{rows[0]['rung']} ({rows[0]['name']})",
        *(f"{mean(of(key)):.2f}" for key in ("before", "bicubic", "enhanced")),
        f"{mean(over_bicubic):+.2f} ({_interval(over_bicubic, 2)})",
        f"{mean(over_before):+.2f} ({_interval(over_before, 2)})",
        f"{mean(of('enhanced_ssim')):.4f}",
        f"{mean(similarity):+.4f} ({_interval(similarity, 4)})",
    ]
    for name in ("lpips", "dists"):
        if all(f"enhanced_{name}" in row for row in rows):
            change = gain(f"enhanced_{name}", f"bicubic_{name}")
            cells.append(f"{mean(change):+.4f} ({_interval(change, 4)})")
    return "| " + " | ".join(cells) + " |"


def _interval(groups: Sequence[Floats], digits: int) -> str:
    """Of one scene's views; or of several scenes, drawn first, and then views of each."""
    if len(groups) == 1:
        low, high = interval(groups[0])
    else:
        random = np.random.default_rng(0)
        means = [
            np.mean(
                [
                    random.choice(groups[i], len(groups[i])).mean()
                    for i in random.integers(len(groups), size=len(groups))
                ]
            )
            for _ in range(1000)
        ]
        low, high = (float(each) for each in np.quantile(means, (0.025, 0.975)))
    return f"{low:+.{digits}f} to {high:+.{digits}f}"


if __name__ == "__main__":
    main()
