"""The CUDA rasteriser on this machine: time from pose to JPEG, stages, throughput, and gsplat as the baseline.

    python -m benchmarks.gpu [--device cuda:0] [--seconds 5] [--gsplat]

Real scenes come from ../shared (or TIGAS_SHARED), with the built-in demo scene as a fallback. --gsplat adds the usual
alternative, in the same run: gsplat, a copy to the host, and Pillow. It needs gsplat and nvcc.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import numpy as np
import torch
import uvloop
from PIL import Image as PillowImage

from benchmarks.gpu_load import throughput
from benchmarks.views import centred_lens, look, start_view
from tigas_common.pose import Pose
from tigas_render.gaussians import Gaussians
from tigas_render.local_files import cache_directory
from tigas_render.raster.base import Camera
from tigas_render.raster.calls import Calls
from tigas_render.raster.cuda.rasterizer import CudaRasterizer
from tigas_render.raster.cuda.scene import CudaScene
from tigas_render.raster.devices import cuda_problem
from tigas_render.scenes.demo import DEMO_SOURCE
from tigas_render.scenes.directory import read_scene_file

SHARED = Path(os.environ.get("TIGAS_SHARED", Path(__file__).resolve().parents[2] / "shared"))
SOURCES = {
    "guitar": ("0", "guitar.compressed.ply"),
    "flowers": ("2", *(f"flowers_lod0_{part}.sog" for part in range(4))),
    "narcissus": ("0", "narcissus.sog"),
}
RUNGS = ((1280, 720), (960, 540), (640, 360), (320, 180))
QUALITY = 90
REPEATS = 300
COPIES = (6, 24)
"""How many times the densified scenes repeat each Gaussian."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--seconds", type=float, default=5, help="of each load on the engine")
    parser.add_argument("--gsplat", action="store_true", help="compare with gsplat, a copy and Pillow")
    arguments = parser.parse_args()
    if problem := cuda_problem():
        sys.exit(problem)
    index = int(arguments.device.partition(":")[2] or 0)
    with tempfile.TemporaryDirectory() as folder:
        scenes = load_scenes(Path(folder))
    started = time.perf_counter()
    rasterizer = CudaRasterizer(index, cache_directory())
    rasterizer.warm_up()
    bandwidth = copy_bandwidth()
    print(f"{torch.cuda.get_device_name(index)}: ready after {time.perf_counter() - started:.1f} s;", end=" ")
    print(f"a copy on the device moves {bandwidth / 1e12:.2f} TB/s (read and written)")
    if "flowers" in scenes:
        gaussians, pose = scenes["flowers"]
        scenes |= {f"flowers x {copies}": (densified(gaussians, copies), pose) for copies in COPIES}
    print(f"\nPose to JPEG bytes on the host, ms, quality {QUALITY}")
    prepared = {name: rasterizer.pack(gaussians.batches()) for name, (gaussians, _) in scenes.items()}
    poses = {name: pose for name, (_, pose) in scenes.items()}
    own = latencies(rasterizer, prepared, poses)
    if arguments.gsplat:
        print("\ngsplat, copy, Pillow, ms at 1280 x 720")
        for name, (gaussians, pose) in scenes.items():
            theirs = gsplat_latency(gaussians, pose)
            print(f"  {name:12} p50 {theirs:6.2f}   {theirs / own[name]:.2f} times ours")
    print("\nStages, microseconds, each kernel launched by itself")
    stages(rasterizer, prepared, poses, bandwidth)
    name = "flowers" if "flowers" in scenes else "courtyard"
    print(f"\nEngine, {name}, profile 1")
    uvloop.run(throughput(rasterizer, prepared[name], poses[name], arguments.seconds))


# --- scenes ---


def load_scenes(folder: Path, names: Iterable[str] = SOURCES) -> dict[str, tuple[Gaussians, Pose]]:
    """The demo scene and, if they are there, some of the real ones, with where each is looked at from."""
    demo = DEMO_SOURCE.load()
    scenes = {"courtyard": (demo, look(start_view(demo, builtin=True)))}
    cameras_file = SHARED / "scenes" / "cameras.json"
    if not cameras_file.is_file():
        return scenes
    cameras = json.loads(cameras_file.read_text())
    for name in names:
        degree, *files = SOURCES[name]
        ply = folder / f"{name}.ply"
        sources = [str(SHARED / "scenes" / file) for file in files]
        command = [sys.executable, str(SHARED / "tools" / "splat_convert.py"), str(ply), *sources, "--deg", degree]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        scenes[name] = read_scene_file(ply).load(), look(cameras[name])
        ply.unlink()
    return scenes


def densified(gaussians: Gaussians, copies: int) -> Gaussians:
    """Each Gaussian `copies` times, moved by 0.7 of its deviations, and as much smaller as keeps the scene's look."""
    from reference.rasterizer import rotation_matrices

    means, scales, quaternions, opacities, sh = (array.repeat(copies, 0) for array in gaussians.arrays)
    moved = np.float32(0.7) * np.random.default_rng(0).standard_normal(means.shape, np.float32) * scales
    means += np.einsum("nij,nj->ni", rotation_matrices(torch.from_numpy(quaternions)).numpy(), moved)
    return Gaussians(means, scales * np.float32(copies**-0.33), quaternions, opacities, sh)


# --- latency ---


def latencies(rasterizer: CudaRasterizer, prepared: dict[str, CudaScene], poses: dict[str, Pose]) -> dict[str, float]:
    """p50 at the first rung, by scene."""
    first = {}
    print("  " + " " * 12 + "".join(f"{width:>9} x {height:<4}" for width, height in RUNGS))
    for name, scene in prepared.items():
        row = []
        for width, height in RUNGS:
            camera = Camera(poses[name], centred_lens(width, height))

            def frame(scene: CudaScene = scene, camera: Camera = camera) -> int:
                return len(rasterizer.render(scene, camera, quality=QUALITY).content)

            times = timed(frame)
            row.append((statistics.median(times), times[int(0.95 * len(times))], frame()))
        first[name] = row[0][0]
        print(f"  {name:12}" + "".join(f"{p50:8.3f}/{p95:.3f} " for p50, p95, _ in row), end="")
        print(f"   p50/p95; {row[0][2] // 1000} KB at the first")
    return first


def timed(frame: Callable[[], object], repeats: int = REPEATS) -> list[float]:
    """Sorted milliseconds, after a warm-up."""
    for _ in range(20):
        frame()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        frame()
        times.append(1000 * (time.perf_counter() - started))
    return sorted(times)


def gsplat_latency(gaussians: Gaussians, pose: Pose) -> float:
    """p50 in milliseconds of gsplat's rasterisation, the copy to the host, and Pillow's JPEG."""
    import gsplat

    k = centred_lens(*RUNGS[0])
    rotation = torch.tensor(pose.rotation).T
    matrix = torch.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ torch.tensor(pose.position)
    tensors = [
        torch.from_numpy(array).cuda()
        for array in (gaussians.means, gaussians.quaternions, gaussians.scales, gaussians.opacities, gaussians.sh)
    ]
    intrinsics = torch.tensor([[k.fx, 0, k.cx], [0, k.fy, k.cy], [0, 0, 1]]).cuda()

    @torch.no_grad()
    def frame() -> int:
        picture = gsplat.rasterization(
            *tensors, matrix[None].cuda(), intrinsics[None], k.width, k.height,
            sh_degree=gaussians.sh_degree, near_plane=0.01,
        )[0][0]  # fmt: skip
        host = (picture.clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy()
        buffer = io.BytesIO()
        PillowImage.fromarray(host).save(buffer, "JPEG", quality=QUALITY)
        return buffer.tell()

    return statistics.median(timed(frame, 100))


# --- stages ---


def copy_bandwidth() -> float:
    """Bytes a second of a large copy on the device, read and written."""
    a = torch.empty(1 << 30, dtype=torch.uint8, device="cuda").random_()
    b = torch.empty_like(a)
    stream = torch.cuda.current_stream()
    return 2 * a.nbytes / (1e-6 * statistics.median(device_time(lambda: b.copy_(a), stream) for _ in range(20)))


def device_time(work: Callable[[], object], stream: torch.cuda.Stream) -> float:
    """Microseconds of device time for the work that `work` queues on a stream."""
    start, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))  # type: ignore[no-untyped-call]
    start.record(stream)
    work()
    end.record(stream)
    end.synchronize()
    return 1000 * float(start.elapsed_time(end))


def stages(
    rasterizer: CudaRasterizer, prepared: dict[str, CudaScene], poses: dict[str, Pose], bandwidth: float
) -> None:
    for name, scene in prepared.items():
        for width, height in (RUNGS[0], RUNGS[3]):
            stages_of_one(rasterizer, name, scene, Camera(poses[name], centred_lens(width, height)), bandwidth)


def stages_of_one(rasterizer: CudaRasterizer, name: str, scene: CudaScene, camera: Camera, bandwidth: float) -> None:
    width, height = camera.intrinsics.width, camera.intrinsics.height
    rasterizer.render(scene, camera)  # enlarges the buffers
    workspace = rasterizer.take_workspace()
    stream = workspace.torch_stream
    side = workspace.prepare(scene, camera, "jpeg").side
    spent: dict[str, list[float]] = {}
    for _ in range(100):
        for stage in rasterizer.stages[side]:
            spent.setdefault(stage.name, []).append(device_time(partial(workspace.launch_stage, stage), stream))
    median = {stage: statistics.median(times) for stage, times in spent.items()}
    calls = workspace.frame(scene, camera, "jpeg", QUALITY)
    whole = statistics.median(device_time(Calls(*calls.draw).make, stream) for _ in range(100))
    codec = 1000 * statistics.median(timed(Calls(*calls.fetch).make, 100))
    line = "  ".join(f"{stage} {time:.0f}" for stage, time in median.items())
    print(f"  {name:12} {width} x {height}: {line}  as a graph {whole:.0f}; nvJPEG {codec:.0f};", end="")
    print(f" {workspace.entries} entries, tiles of {side}")
    read = scene.padded * (28 + 8 * scene.sh.shape[0])
    for name, size in (
        ("project", read + scene.padded * 44),
        ("bin", scene.padded * 44 + 8 * workspace.entries),
    ):
        rate = size / (1e-6 * median[name])
        print(f"  {'':12} {name}: {size / 1e6:.0f} MB if all is visible, {rate / 1e12:.2f} TB/s,", end="")
        print(f" {100 * rate / bandwidth:.0f} % of the copy's")
    rasterizer.give_back(workspace)


if __name__ == "__main__":
    main()
