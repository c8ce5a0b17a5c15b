"""What a frame's enhancement by a scene's network costs on this machine's GPU, and how far it is from PyTorch's.

    python -m benchmarks.enhance --write FOLDER [--weights enhance.safetensors]   # needs Node.js and web/node_modules
    python -m benchmarks.enhance --shaders FOLDER [--frames 200]                  # needs wgpu, PyTorch and safetensors

The shaders are those that the page generates from the weights (random ones without --weights), run through `wgpu`.
Times are the GPU's own, by timestamp queries. The first step can be done on another machine. Exits with 1 if a picture
is more than 2/255 from PyTorch's anywhere.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load_file

from benchmarks.network_shaders import NetworkShaders, Precision, read_shaders
from tigas_enhance.network import Network

ROOT = Path(__file__).resolve().parents[1]
WEIGHTS = "enhance.safetensors"
WARM_UP_S = 1
"""GPUs that had nothing to do run at a fraction of their clock."""
MOST_FRAMES = 2000
TOLERANCE = 2
"""Of 255."""
COLUMNS = ("rung", "frame", "scale", "MAC/pixel", "GMAC", "arithmetic", "ms p50", "ms p95", "TMAC/s", "off by, of 255")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    step = parser.add_mutually_exclusive_group(required=True)
    step.add_argument("--write", type=Path, metavar="FOLDER", help="write shaders into it")
    step.add_argument("--shaders", type=Path, metavar="FOLDER", help="measure those in it")
    parser.add_argument("--weights", type=Path, help="of which networks to write shaders")
    parser.add_argument("--frames", type=int, default=200, help="to time for each network")
    arguments = parser.parse_args()
    if not 1 <= arguments.frames <= MOST_FRAMES:
        parser.error(f"--frames must be between 1 and {MOST_FRAMES}.")
    if arguments.write:
        write(arguments.write, arguments.weights)
    else:
        measure(arguments.shaders, arguments.frames)


def write(folder: Path, weights: Path | None) -> None:
    """The folder that `measure` takes: weights, and the shaders that the page makes of them."""
    from tests.enhance.networks import random_networks, weights_file

    folder.mkdir(parents=True, exist_ok=True)
    own = folder / WEIGHTS
    if weights is None:
        own.write_bytes(weights_file(random_networks({1: 2, 2: 2, 3: 2})))
    else:
        shutil.copyfile(weights, own)
    script = ROOT / "web/scripts/enhance-wgsl.mjs"
    subprocess.run(["node", script, own.resolve(), folder.resolve()], cwd=ROOT / "web", check=True)


def measure(folder: Path, frames: int) -> None:
    try:
        from benchmarks.wgpu_network import WgpuNetwork, open_device

        device = open_device()
    except ImportError:
        sys.exit("This needs wgpu: pip install wgpu")
    except RuntimeError as error:
        sys.exit(f"wgpu finds no GPU, and no driver that does without one: {error}")
    print(f"{device.adapter.summary}\n")
    precisions: list[Precision] = ["f32", "f16"] if "shader-f16" in device.features else ["f32"]
    timed = "timestamp-query" in device.features
    tensors = load_file(folder / WEIGHTS)
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    worst = 0.0
    for shaders in read_shaders(folder):
        frame = np.random.default_rng(0).integers(0, 256, (shaders.height, shaders.width, 3), dtype=np.uint8)
        for precision in precisions:
            network = WgpuNetwork(device, shaders, precision, shaders.width, shaders.height)
            expected = by_torch(shaders, tensors, len(shaders.layers[precision]), frame)
            difference = 255 * float(np.abs(network.run(frame) - expected).max())
            worst = max(worst, difference)
            billions = shaders.multiplications * shaders.width * shaders.height / 1e9
            cells = [
                *(shaders.rung, f"{shaders.width}×{shaders.height}", shaders.scale, f"{shaders.multiplications:,}"),
                *(f"{billions:.2f}", precision),
            ]
            if timed:
                started = time.perf_counter()
                while time.perf_counter() < started + WARM_UP_S:
                    network.times(frames)
                times = sorted(network.times(frames))
                median = statistics.median(times)
                cells += [f"{median:.3f}", f"{times[int(0.95 * len(times))]:.3f}", f"{billions / median:.2f}"]
            else:
                cells += ["–"] * 3
            print(f"| {' | '.join(map(str, cells))} | {difference:.2f} |", flush=True)
    if worst > TOLERANCE:
        sys.exit(f"\nA picture differs from PyTorch's by {worst:.2f} of 255; {TOLERANCE} are allowed.")


def by_torch(
    shaders: NetworkShaders, tensors: dict[str, torch.Tensor], layers: int, frame: NDArray[np.uint8]
) -> NDArray[np.float32]:
    """The picture [r·H, r·W, 3] of a frame [H, W, 3]."""
    network = Network(shaders.scale, layers, shaders.channels)
    prefix = f"rung{shaders.rung}.conv"
    own = {
        name.replace(prefix, "convolutions."): tensor.float()
        for name, tensor in tensors.items()
        if name.startswith(prefix)
    }
    network.load_state_dict(own)
    with torch.inference_mode():
        result: NDArray[np.float32] = (
            network(torch.from_numpy(frame).permute(2, 0, 1)[None] / 255)[0].permute(1, 2, 0).numpy()
        )
    return result


if __name__ == "__main__":
    main()
